"""Range scale and offset of the online estimator, found anew at looks at all data.

A range is scale * distance + offset. The estimator works on distances, corrected by what is
believed; where the two are open, EM over all data so far now and then finds what is left to
correct, poses and landmarks along with it.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sngr_utils.world.log import Log

FIRST, MORE = 30, 1.25  # poses at the first look, and times as many at the next one
NEAREST = 0.1  # range sigmas: a distance after correction is no shorter


@dataclass(frozen=True)
class Calibration:
    """What is believed of range scale and offset.

    Attributes
    ----------
    scale, offset : believed; the offset in [m]
    told_scale, told_offset : mean and sigma known beforehand, as in a `Log`
    """

    scale: float
    offset: float
    told_scale: tuple[float, float]
    told_offset: tuple[float, float]

    @property
    def open(self) -> bool:
        return self.told_scale[1] > 0 or self.told_offset[1] > 0

    def corrected(self, measured: Log) -> Log:
        """Distances with their sigmas in place of ranges."""
        if not self.open and (self.scale, self.offset) == (1.0, 0.0):
            return measured
        sigmas = measured.range_sigmas / self.scale
        distances = np.maximum((measured.ranges - self.offset) / self.scale, NEAREST * sigmas)
        return measured._with(
            ranges=distances, range_sigmas=sigmas, scale=(1.0, 0.0), offset=(0.0, 0.0)
        )

    def uncut(self, log: Log, measured: np.ndarray) -> Log:
        """A log of distances, those that were too short as (M,) ranges measured have them."""
        cut = log.ranges <= (1 + 1e-9) * NEAREST * log.range_sigmas
        distances = (measured - self.offset) / self.scale
        return log._with(ranges=np.where(cut, distances, log.ranges))

    def opened(self, log: Log) -> Log:
        """A log of distances, with what may be left to correct as its own scale and offset."""
        (mean, sigma), (shift, shift_sigma) = self.told_scale, self.told_offset
        return log._with(
            scale=(mean / self.scale if sigma > 0 else 1.0, sigma / self.scale),
            offset=((shift - self.offset) / self.scale if shift_sigma > 0 else 0.0,
                    shift_sigma / self.scale),
        )  # fmt: skip

    def after(self, left: np.ndarray) -> Self:
        """What is believed once (2,) scale and offset of distances have been found."""
        offset = self.offset + self.scale * float(left[1])
        return replace(self, scale=self.scale * float(left[0]), offset=offset)


def of(log: Log) -> Calibration:
    """What a log says beforehand."""
    return Calibration(log.scale[0], log.offset[0], log.scale, log.offset)
