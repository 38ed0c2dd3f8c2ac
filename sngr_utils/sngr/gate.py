"""The gate: is the mean of the samples as good as the MAP (paper eq. "gate")?"""

import math
from typing import Annotated

from pydantic import Field
from scipy import stats

from sngr_utils.settings import Checked


class Gate(Checked):
    """tolerance : how far the log posterior of the mean may lie below the MAP's, [nats]"""

    gate_tolerance: Annotated[float, Field(ge=0)] = 1e-3


def passes_gate(delta_logp: float, tolerance: float) -> bool:
    """log p(mean) >= log p(MAP) - tolerance (paper eq. "gate")."""
    return delta_logp >= -tolerance


class NoiseGate(Gate):
    """A gate that forgives what a mean of n effective samples loses by its own noise.

    For a Gaussian posterior in d dimensions and n independent samples that loss is
    chi^2_d / 2n: d / 2n on average, with standard deviation sqrt(d / 2) / n.

    gate_sigmas : standard deviations of the loss that are forgiven on top of its mean
    """

    gate_sigmas: Annotated[float, Field(ge=0)] = 3.0

    def slack(self, dimension: int, effective: float) -> float:
        """How far log p(mean) may lie below log p(MAP), [nats].

        Parameters
        ----------
        effective : n, the effective number of samples
        """
        noise = 0.5 * dimension + self.gate_sigmas * math.sqrt(0.5 * dimension)
        return self.gate_tolerance + noise / effective

    def false_refusal(self, dimension: int, effective: float) -> float:
        """Probability that the exact mode of a Gaussian posterior is refused by noise alone.

        0.0098 for d = 9 and 0.0059 for d = 27 at three sigmas and no tolerance.
        """
        return float(stats.chi2.sf(2 * effective * self.slack(dimension, effective), dimension))
