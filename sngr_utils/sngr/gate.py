"""The gate: is the mean of the samples as good as the MAP?"""

import math
from typing import Annotated

from pydantic import Field

from sngr_utils.settings import Checked


class Gate(Checked):
    """gate_tolerance : how far log p(mean) may lie below log p(MAP), [nats]"""

    gate_tolerance: Annotated[float, Field(ge=0)] = 1e-3

    def slack(self, dimension: int, effective: float) -> float:
        """How far log p(mean) may lie below log p(MAP), [nats].

        Parameters
        ----------
        dimension, effective : d, and n, the effective number of samples
        """
        return self.gate_tolerance


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
        """The tolerance, and what noise of d numbers and n effective samples may cost, [nats]."""
        noise = 0.5 * dimension + self.gate_sigmas * math.sqrt(0.5 * dimension)
        return self.gate_tolerance + noise / effective
