"""SNGR, the paper's algorithm: trigger, closure, nested sampling, mean, gate, apply."""

from collections.abc import Iterable
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.sampling import engines, weighted_samples
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
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
    run: weighted_samples.NestedRun


def window_likelihood(solution: Solution, t: int, factor: float) -> LocalLikelihood:
    """Local log-likelihood of window w(t), everything else held at the MAP.

    Uses the factors that touch the window. The paper's fixed-point closure takes in the whole
    graph, but factors between held variables add a constant, which changes neither the
    samples nor any difference of log posteriors.
    """
    keys = windows.window_keys(t)
    factors = closure.touching_factors(solution.graph, keys)
    return LocalLikelihood(factors, solution.estimate, keys, factor)


def refine_windows(
    solution: Solution,
    which: Iterable[int],
    covariances: np.ndarray,
    settings: SamplerSettings,
    gate: Gate,
    engine: str = "dynesty",
    *,
    rng: np.random.Generator,
) -> list[RefinedWindow]:
    """Sample windows, take the weighted means, ask the gate (paper, Algorithm 1).

    All start from the same iSAM2 estimate. Every window of the trajectory has a random stream
    of its own, so a window's result does not depend on which others are refined, on their
    order, or on how many are sampled at a time (``joblib.parallel_config(n_jobs=...)``).

    Parameters
    ----------
    which : first poses of the windows to refine
    covariances : (T-W+1, 9, 9) Sigma_w of all windows
    engine : see `settings.EngineChoice`
    """
    streams, which = rng.spawn(len(covariances)), np.array(list(which), dtype=int)
    likelihoods = [window_likelihood(solution, t, settings.likelihood_factor) for t in which]
    runs = engines.sample_windows(
        likelihoods, covariances[which], settings, engine, rngs=[streams[t] for t in which]
    )
    return [
        judge(int(t), likelihood, run, gate)
        for t, likelihood, run in zip(which, likelihoods, runs, strict=True)
    ]


def judge(
    t: int, likelihood: LocalLikelihood, run: weighted_samples.NestedRun, gate: Gate
) -> RefinedWindow:
    """The gate's decision on the mean of a window's samples (paper eq. "gate")."""
    mean = run.mean
    delta_logp = likelihood(mean) - likelihood(np.zeros(likelihood.dimension))
    accepted = passes_gate(delta_logp, gate.gate_tolerance)
    return RefinedWindow(t, delta_logp, accepted, likelihood.variables(mean), run)


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
