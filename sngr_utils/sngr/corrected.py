"""What SNGR samples with its slips mended: the window's own posterior at a settled estimate.

The paper samples the root of the likelihood under a prior that already holds it. Here the
target is that of `window_posterior`: every factor, once. The gate that goes with it is
`gate.NoiseGate`, which knows the noise of a mean.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sngr_utils.sampling import importance, laplace, weighted_samples
from sngr_utils.sampling.settings import FastSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.slam.levenberg_marquardt import converge
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import window_posterior, windows

LONG_WALKS = 400  # steps at which the evidence has no bias that we can measure in 27 dimensions
# The sampler starts from N(estimate, c Sigma), Sigma the joint marginal of all that moves, and
# divides it out again; c = 4 is twice as wide as the marginal posterior.
PROPOSAL_SCALE = 4.0
LAPLACE_DRAWS = 2000  # an effective thousand, where nested sampling at 100 live points has 500


@dataclass(frozen=True)
class Corrected:
    """The window's own posterior at the batch estimate, by importance sampling.

    separators : what the window is joined to: held at the estimate ("conditional"), or
        integrated out ("marginal")
    """

    separators: Literal["conditional", "marginal"]

    def settle(self, solution: Solution, covariances: np.ndarray) -> tuple[Solution, np.ndarray]:
        """The batch estimate from that of iSAM2, and the (N, 9, 9) marginals of its windows."""
        settled = converge(solution)
        return settled, windows.covariances(settled)

    def targets(
        self, solution: Solution, which: np.ndarray, covariances: np.ndarray
    ) -> list[window_posterior.Target]:
        """Of the windows that start at the poses `which`; `covariances` are those of all."""
        pieces = window_posterior.expand(solution) if self.separators == "marginal" else None
        return [
            window_posterior.target(solution, t, covariances[t], self.separators, pieces)
            for t in which
        ]

    def sample(
        self, target: window_posterior.Target, *, rng: np.random.Generator
    ) -> weighted_samples.WeightedSamples:
        """About the Laplace Gaussian, or about all modes where that may not be trusted."""
        return sample_target(target, PROPOSAL_SCALE, rng=rng)


def sample_target(
    aim: window_posterior.Target, scale: float, *, rng: np.random.Generator
) -> weighted_samples.WeightedSamples:
    """Samples of a target from the prior N(0, scale * covariance), divided out again."""
    factors, cholesky = aim.corrected(scale), np.linalg.cholesky(scale * aim.covariance)
    run = laplace.sample(factors, cholesky, LAPLACE_DRAWS, rng=rng)
    return run if run is not None else _many_modes(factors, cholesky, rng)


def _many_modes(
    factors: compiled.Factors, cholesky: np.ndarray, rng: np.random.Generator
) -> weighted_samples.WeightedSamples:
    """Importance sampling about all modes found, for targets that are not one Gaussian.

    Modes far apart need long walks in nested sampling (400 of them agree); here they cost nothing.
    The diagnostics' objections are kept in the note.
    """
    many = FastSettings(n_draws=10 * LAPLACE_DRAWS)
    draw = importance.sample(factors, cholesky, many, rng=rng)
    return replace(draw, note=", ".join(draw.diagnostics.objections))
