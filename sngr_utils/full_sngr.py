"""Driver of notebook 03: the whole algorithm, from trigger to gate."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from sngr_utils.metrics import rmse_and_nees
from sngr_utils.sampling.settings import EngineChoice, SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.settings import Positive, Probability, Seed
from sngr_utils.slam import marginals
from sngr_utils.slam.conventions import PRESETS, preset_conventions
from sngr_utils.slam.solution import pose_vector
from sngr_utils.sngr import algorithm, closure, gate, noop_baseline, refine, trigger, windows
from sngr_utils.sngr.baseline import Baseline, run_baseline
from sngr_utils.world import dead_reckoning
from sngr_utils.world.scenario import Scenario


class Config(Scenario, EngineChoice, SamplerSettings, gate.Gate, noop_baseline.TriggerOnly):
    """Parameters of the full pipeline; the defaults are the paper's values where it states them.

    p_levels : wrong-association probabilities; must hold p_diagnosed and p_noop
    p_diagnosed : level of the diagnostics figure
    p_noop : level of the trigger-only baseline
    """

    seed: Seed = 0
    p_levels: Annotated[list[Probability], Field(min_length=1)] = [0.0, 0.1, 0.2, 0.3]
    p_diagnosed: Probability = 0.2
    p_noop: Probability = 0.3
    tau: Positive = 3.9
    preset: str = "B"
    conventions: dict = {}

    @model_validator(mode="after")
    def _consistent(self):
        preset_conventions(self.preset, self.conventions)
        for name in ("p_diagnosed", "p_noop"):
            if getattr(self, name) not in self.p_levels:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be one of p_levels")
        if len(set(self.p_levels)) < len(self.p_levels):
            raise ValueError(f"p_levels is {self.p_levels}: it must not repeat a value")
        return self


@dataclass(frozen=True)
class Refinement:
    """SNGR on one world.

    Attributes
    ----------
    baseline : iSAM2 and the trigger
    windows : the refined windows, ascending
    poses : (T, 3) after all accepted windows were applied, [m, m, rad]
    pose_rmse : [m]
    nees : with iSAM2's covariances
    odometry_rmse : of dead reckoning from the true first pose, for scale, [m]
    """

    baseline: Baseline
    windows: list[refine.RefinedWindow]
    poses: np.ndarray
    pose_rmse: float
    nees: float
    odometry_rmse: float

    @property
    def accepted(self) -> int:
        return sum(window.accepted for window in self.windows)

    @property
    def gains(self) -> np.ndarray:
        """(n,) delta log p of the refined windows, [nats]"""
        return np.array([window.delta_logp for window in self.windows])

    @property
    def median_gain(self) -> float:
        """[nats]; NaN if no window was refined"""
        return float(np.median(self.gains)) if self.windows else float("nan")

    @property
    def largest_gain(self) -> float:
        """[nats]; NaN if no window was refined"""
        return float(self.gains.max()) if self.windows else float("nan")

    @property
    def rmse_change(self) -> float:
        """Pose RMSE after refinement less before, [mm]"""
        return 1e3 * (self.pose_rmse - self.baseline.pose_rmse)

    @property
    def ess_shares(self) -> np.ndarray:
        """(n,) effective sample size of the refined windows as a share of their samples"""
        return np.array([window.run.ess_share for window in self.windows])


def run(config: Config) -> dict[float, Refinement]:
    """SNGR at every p, on the world of `seed` (paper, Algorithm 1)."""
    return {p: run_level(config, p) for p in config.p_levels}


def run_level(config: Config, p: float) -> Refinement:
    """SNGR at one p. The sampler's stream depends on the seed, not on p or the other levels."""
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, p, config.seed)
    refined = _refine(config, base, partial(trigger.triggers, tau=config.tau))
    poses, true = refined.poses, base.world.poses
    covariances = marginals.position_covariances(base.solution, conventions.nees_frame)
    dead = dead_reckoning.dead_reckoning(true[0], base.world.odometry)
    return Refinement(
        baseline=base,
        windows=refined.windows,
        poses=poses,
        pose_rmse=rmse_and_nees.rmse(poses[:, :2], true[:, :2]),
        nees=rmse_and_nees.nees(poses[:, :2] - true[:, :2], covariances),
        odometry_rmse=rmse_and_nees.rmse(dead[:, :2], true[:, :2]),
    )


def _refine(
    config: Config, base: Baseline, fires: Callable[[np.ndarray], np.ndarray]
) -> algorithm.Refined:
    sampling = refine.Paper(config.part(SamplerSettings), config.engine)
    return algorithm.run(
        base.world, preset_conventions(config.preset, config.conventions), fires, sampling,
        config.part(gate.Gate), base, rng=np.random.default_rng([config.seed, 1]),
    )  # fmt: skip


def run_presets(config: Config, levels: dict[float, Refinement]) -> dict[str, Refinement]:
    """SNGR at p_diagnosed under each preset of the open conventions, on the same data.

    Parameters
    ----------
    levels : what `run` gave, of which one preset's level is a part
    """
    p, runs = config.p_diagnosed, {}
    for preset in PRESETS:
        other = config.model_copy(update={"preset": preset, "conventions": {}})
        runs[preset] = levels[p] if other == config else run_level(other, p)
    return runs


def noop_mean_log_weights(config: Config, level: Refinement) -> np.ndarray:
    """(n,) mean log importance weight of the no-op sampler on each triggered window, [nats]."""
    base = level.baseline
    streams = np.random.default_rng([config.seed, 2]).spawn(len(base.covariances))
    settings = config.part(noop_baseline.TriggerOnly)
    return np.array([
        noop_baseline.noop_log_weights(base.covariances[t], settings, rng=streams[t]).mean()
        for t in np.flatnonzero(base.fired(config.tau))
    ])


def noop_expected(config: Config, level: Refinement) -> np.ndarray:
    """(n,) closed form of the same, for the same windows, [nats]."""
    base = level.baseline
    return np.array([
        noop_baseline.noop_expected_log_weight(base.covariances[t], config.noop_sigma)
        for t in np.flatnonzero(base.fired(config.tau))
    ])


def example_window(config: Config, level: Refinement) -> refine.RefinedWindow:
    """The window of highest score, refined whether it triggered or not: one to look at."""
    scores = level.baseline.scores
    best = trigger.FIRST_ELIGIBLE + int(np.argmax(scores[trigger.FIRST_ELIGIBLE :]))
    only = partial(trigger.regardless, which=best)
    return _refine(config, level.baseline, only).windows[0]


def likelihood_of(config: Config, level: Refinement, t: int) -> LocalLikelihood:
    """Local log-likelihood of window t, as the sampler sees it."""
    return refine.window_likelihood(level.baseline.solution, t, config.likelihood_factor)


def window_positions(
    config: Config, level: Refinement, window: refine.RefinedWindow, n: int = 300
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions of a window's poses: truth (3, 2), iSAM2 (3, 2), n samples (n, 3, 2), mean (3, 2).

    The samples are drawn by weight.
    """
    likelihood = likelihood_of(config, level, window.t)
    rng = np.random.default_rng([config.seed, 3])
    drawn = rng.choice(window.run.samples, size=n, p=window.run.weights)

    def positions(poses):
        return np.array([pose_vector(pose)[:2] for pose in poses])

    part = slice(window.t, window.t + windows.WIDTH)
    return (
        level.baseline.world.poses[part, :2],
        level.baseline.solution.poses[part, :2],
        np.array([positions(likelihood.variables(xi)) for xi in drawn]),
        positions(window.poses),
    )


def mean_cost(window: refine.RefinedWindow) -> float:
    """Expected loss of log posterior by taking a sampled mean for the maximum, d / 2n, [nats].

    n is the effective sample size. For a Gaussian, independent samples, and a prior that is
    wide compared with the likelihood.
    """
    n_samples, dimension = window.run.samples.shape
    return dimension / (2 * window.run.ess_share * n_samples)


def spread_ratios(level: Refinement, window: refine.RefinedWindow) -> tuple[float, float]:
    """Sampled standard deviation over the marginal, and over the conditional with the rest held.

    Geometric means over the window's nine coordinates.
    """
    solution, keys = level.baseline.solution, windows.window_keys(window.t)
    marginal = level.baseline.covariances[window.t]
    conditional = closure.conditional_covariance(solution.graph, solution.estimate, keys)

    def ratio(reference):
        variances = np.diag(window.run.covariance) / np.diag(reference)
        return float(np.exp(0.5 * np.mean(np.log(variances))))

    return ratio(marginal), ratio(conditional)
