"""SNGR, the paper's algorithm: trigger, closure, nested sampling, mean, gate, apply."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X
from pydantic import Field

from sngr_utils import windows
from sngr_utils.sampling import engines, weighted_samples
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.settings import Checked, Positive
from sngr_utils.slam.solution import Solution


class Gate(Checked):
    """tolerance : how far the log posterior of the mean may lie below the MAP's, [nats]"""

    gate_tolerance: Annotated[float, Field(ge=0)] = 1e-3


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
    factors = windows.touching_factors(solution.graph, keys)
    return LocalLikelihood(factors, solution.estimate, keys, factor)


def passes_gate(delta_logp: float, tolerance: float) -> bool:
    """log p(mean) >= log p(MAP) - tolerance (paper eq. "gate")."""
    return delta_logp >= -tolerance


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


class TriggerOnly(Checked):
    """The no-op importance sampler of the trigger-only baseline; the paper's values."""

    noop_samples: Annotated[int, Field(ge=2)] = 500
    noop_sigma: Positive = 0.5  # in every coordinate, [m, m, rad]


def noop_log_weights(
    covariance: np.ndarray, settings: TriggerOnly, *, rng: np.random.Generator
) -> np.ndarray:
    """(N,) log importance weights of draws from N(MAP, s^2 I) under the iSAM2 marginal.

    log N(x; MAP, Sigma_w) - log N(x; MAP, s^2 I), both normalised, [nats]. Their expectation
    is `noop_expected_log_weight`.

    Parameters
    ----------
    covariance : (d, d) joint marginal Sigma_w
    """
    d, sigma = len(covariance), settings.noop_sigma
    draws = rng.normal(scale=sigma, size=(settings.noop_samples, d))
    quadratic = np.sum(draws * np.linalg.solve(covariance, draws.T).T, axis=1)
    log_determinant = np.linalg.slogdet(covariance)[1]
    proposal = np.sum(draws**2, axis=1) / sigma**2 + 2 * d * np.log(sigma)
    return -0.5 * (quadratic + log_determinant - proposal)


def noop_expected_log_weight(covariance: np.ndarray, sigma: float) -> float:
    """Closed form of the mean of `noop_log_weights`: minus KL(N(0, s^2 I) || N(0, Sigma_w))."""
    d = len(covariance)
    trace = sigma**2 * np.trace(np.linalg.inv(covariance))
    log_ratio = np.linalg.slogdet(covariance)[1] - 2 * d * np.log(sigma)
    return float(-0.5 * (trace - d + log_ratio))
