"""What is known of one place in the plane, from ranges any of which may be wrong."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sngr_utils.sampling.targets import compiled
from sngr_utils.slam import range_density


@dataclass(frozen=True)
class Evidence:
    """What is known of a place: N ranges to known anchors, and a weak Gaussian prior.

    Attributes
    ----------
    anchors : (N, 2) the known ends, [m]
    ranges : (N,) [m]
    variances : (N,) of a right range about the distance, with that of its anchor, [m^2]
    wrong : (N,) probability that a range is wrong, and then uniform up to `longest`
    longest : the longest range there is, [m]
    centre : (2,) mean of the prior, [m]
    sigma : of the prior, [m]

    The density of a range is that of `range_density`.
    """

    anchors: np.ndarray
    ranges: np.ndarray
    variances: np.ndarray
    wrong: np.ndarray
    longest: float
    centre: np.ndarray
    sigma: float

    def __post_init__(self):
        n = len(self.ranges)
        if n == 0:
            raise ValueError("ranges is empty: a place needs at least one")
        for name, shape in (("anchors", (n, 2)), ("variances", (n,)), ("wrong", (n,))):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"{name} has shape {np.shape(getattr(self, name))}, not {shape}")
        if not (np.all(self.variances > 0) and self.longest > 0 and self.sigma > 0):
            raise ValueError("variances, longest and sigma must be positive")
        if not np.all((self.wrong >= 0) & (self.wrong < 1)):
            raise ValueError("wrong holds a value outside [0, 1)")

    @property
    def floors(self) -> np.ndarray:
        """(N,) density of a wrong range over the highest of a right one."""
        return range_density.floor(self.variances, self.wrong, self.longest)

    @cached_property
    def factors(self) -> compiled.Factors:
        """The likelihood as the compiled engines read it; xi is the offset from `centre`."""
        n = len(self.ranges)
        measured = np.zeros((n, 8))
        measured[:, 0], measured[:, 1] = self.ranges, self.floors
        measured[:, 5] = 1 / np.sqrt(self.variances)
        return compiled.Factors(
            poses=np.zeros((0, 5)),
            points=np.vstack([self.centre, self.anchors]),
            counts=np.array([0, 1, 0, 0, 0, n, 0]),
            of=np.column_stack([np.arange(1, n + 1), np.zeros(n)]).astype(np.uint64),
            measured=measured,
            quadratic=np.zeros((0, 0)),
            linear=np.zeros(0),
            factor=1.0,
        )

    @property
    def ceiling(self) -> float:
        """Log-density of all ranges where each fits best, [nats]: what the factors leave out."""
        highest = range_density.density(0.0, self.variances, self.wrong, self.longest)
        return float(np.log(highest).sum())
