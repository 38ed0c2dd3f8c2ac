"""A window refined: what the paper samples, the mean, the gate, and how updates are applied."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.sampling.weighted_samples import WeightedSamples
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import closure, windows
from sngr_utils.sngr.gate import Gate, passes_gate


@dataclass(frozen=True)
class RefinedWindow:
    """One window after nested sampling.

    Attributes
    ----------
    t : index of the window's first pose
    delta_logp : local log posterior of the mean minus that of the MAP, [nats]
    accepted : passed the gate
    poses : the three refined poses
    run : the nested sampling run
    """

    t: int
    delta_logp: float
    accepted: bool
    poses: list[gtsam.Pose2]
    run: WeightedSamples

    @property
    def expected_loss(self) -> float:
        """Of log posterior by taking a sampled mean for the maximum, d / 2n, [nats].

        n is the effective sample size. For a Gaussian, independent samples, and a prior that is
        wide compared with the likelihood.
        """
        n_samples, dimension = self.run.samples.shape
        return dimension / (2 * self.run.ess_share * n_samples)


def window_likelihood(solution: Solution, t: int, factor: float) -> LocalLikelihood:
    """Local log-likelihood of window w(t), everything else held at the MAP.

    Uses the factors that touch the window. The paper's fixed-point closure takes in the whole
    graph, but factors between held variables add a constant, which changes neither the
    samples nor any difference of log posteriors.
    """
    keys = windows.window_keys(t)
    factors = closure.touching_factors(solution.graph, keys)
    return LocalLikelihood(factors, solution.estimate, keys, factor)


class PaperTarget(NamedTuple):
    """The paper's log density of a window, and the (9, 9) marginal covariance Sigma_w."""

    log_density: LocalLikelihood
    covariance: np.ndarray


@dataclass(frozen=True)
class Paper:
    """The paper's sampling: the local likelihood under N(MAP, c Sigma_w), at iSAM2's estimate.

    engine : see `settings.EngineChoice`
    """

    sampler: SamplerSettings
    engine: str

    def settle(self, solution: Solution, covariances: np.ndarray) -> tuple[Solution, np.ndarray]:
        """As they are."""
        return solution, covariances

    def targets(
        self, solution: Solution, which: np.ndarray, covariances: np.ndarray
    ) -> list[PaperTarget]:
        """Of the windows that start at the poses `which`; `covariances` are those of all."""
        factor = self.sampler.likelihood_factor
        return [PaperTarget(window_likelihood(solution, t, factor), covariances[t]) for t in which]

    def sample(self, target: PaperTarget, *, rng: np.random.Generator) -> WeightedSamples:
        """Nested sampling of one of them."""
        return engines.sample_window(*target, self.sampler, self.engine, rng=rng)


def judge(
    solution: Solution,
    t: int,
    log_density: Callable[[np.ndarray], float],
    run: WeightedSamples,
    gate: Gate,
) -> RefinedWindow:
    """The gate's decision on the mean of a window's samples, see `gate.passes_gate`.

    Of what moves along with the window's poses nothing is kept.

    Parameters
    ----------
    log_density : of the (d,) offset from the estimate, the window's poses first, [nats]
    """
    mean = run.mean
    gain = float(log_density(mean) - log_density(np.zeros(len(mean))))
    slack = gate.slack(len(mean), run.ess_share * len(run.samples))
    moved = [
        solution.estimate.atPose2(key).retract(mean[3 * i : 3 * i + 3])
        for i, key in enumerate(windows.window_keys(t))
    ]
    return RefinedWindow(t, gain, passes_gate(gain, slack), moved, run)


def apply_updates(estimate: gtsam.Values, refined: list[RefinedWindow]) -> gtsam.Values:
    """A copy of `estimate` with all accepted windows applied together.

    Windows overlap. The paper does not say who wins; here the later window does: a pose takes
    its value from the latest accepted window that holds it.
    """
    updated = gtsam.Values(estimate)
    for window in sorted(refined, key=lambda window: window.t):
        if window.accepted:
            for i, pose in enumerate(window.poses):
                updated.update(X(window.t + i), pose)
    return updated
