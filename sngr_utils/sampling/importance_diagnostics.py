"""Why importance samples may be trusted, or not."""

from dataclasses import dataclass

MAX_MODES = 8
MAX_K_HAT = 0.7  # Vehtari et al., Pareto smoothed importance sampling, JMLR 25 (2024)
MIN_ESS = 200  # effective draws, below which they are not trusted


@dataclass(frozen=True)
class Diagnostics:
    """Why the fast path may be trusted, or not.

    Attributes
    ----------
    n_modes : modes found
    converged : share of the starts whose optimisation converged
    k_hat : shape of the Pareto tail of the weights; blind to a mode that no draw has visited
    ess : effective number of draws
    """

    n_modes: int
    converged: float
    k_hat: float
    ess: float

    @property
    def objections(self) -> list[str]:
        """What speaks against the result; empty if nothing does."""
        return [
            text
            for text, bad in (
                ("modes", self.n_modes >= MAX_MODES),
                ("starts", self.converged < 0.9),
                ("k-hat", not self.k_hat <= MAX_K_HAT),
                ("ESS", self.ess < MIN_ESS),
            )
            if bad
        ]
