"""What notebook 03 runs: the whole algorithm, from trigger to gate.

A helper's `Config` is read to check parameters before anything runs. So what is slow to load is
imported by the functions that need it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from pydantic import model_validator

from sngr_utils.sampling.settings import EngineChoice, SamplerSettings
from sngr_utils.settings import Levels, PosesOfWindows, Positive, Probability, Seed
from sngr_utils.slam.conventions import PRESETS, OpenConventions
from sngr_utils.sngr.gate import Gate
from sngr_utils.sngr.noop_baseline import TriggerOnly, noop_expected_log_weight, noop_log_weights
from sngr_utils.world.scenario import Scenario

if TYPE_CHECKING:
    from sngr_utils.sampling.targets.likelihood import LocalLikelihood
    from sngr_utils.sngr.baseline import Baseline
    from sngr_utils.sngr.refine import RefinedWindow
    from sngr_utils.sngr.refined_world import RefinedWorld


class Config(Scenario, EngineChoice, SamplerSettings, Gate, TriggerOnly, OpenConventions):
    """Parameters of the full pipeline; the defaults are the paper's values where it states them.

    p_levels : wrong-association probabilities; must hold p_diagnosed and p_noop
    p_diagnosed : level of the diagnostics figure
    p_noop : level of the trigger-only baseline
    """

    n_poses: PosesOfWindows = 30
    seed: Seed = 0
    p_levels: Levels = [0.0, 0.1, 0.2, 0.3]
    p_diagnosed: Probability = 0.2
    p_noop: Probability = 0.3
    tau: Positive = 3.9

    @model_validator(mode="after")
    def _levels_are_run(self):
        for name in ("p_diagnosed", "p_noop"):
            if getattr(self, name) not in self.p_levels:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be one of p_levels")
        return self


def run(config: Config) -> dict[float, RefinedWorld]:
    """SNGR at every p, on the world of `seed` (paper, Algorithm 1)."""
    return {p: run_level(config, p) for p in config.p_levels}


def run_level(config: Config, p: float) -> RefinedWorld:
    """SNGR at one p. The sampler's stream depends on the seed, not on p or the other levels."""
    from sngr_utils.sngr import baseline, trigger

    base = baseline.run_baseline(config.part(Scenario), config.chosen, p, config.seed)
    return _refine(config, base, partial(trigger.triggers, tau=config.tau))


def _refine(
    config: Config, base: Baseline, fires: Callable[[np.ndarray], np.ndarray]
) -> RefinedWorld:
    from sngr_utils.sngr import refine, refined_world

    return refined_world.refine_world(
        base,
        config.chosen,
        fires,
        refine.Paper(config.part(SamplerSettings), config.engine),
        config.part(Gate),
        rng=np.random.default_rng([config.seed, 1]),
    )


def run_presets(
    config: Config, levels: dict[float, RefinedWorld]
) -> dict[str, dict[float, RefinedWorld]]:
    """SNGR at every p under each preset of the open conventions, on the same data.

    What is not in `levels`, which `run` gave, is sampled by the compiled nested sampler.
    """
    runs = {}
    for preset in PRESETS:
        other = config.under(preset)
        compiled = other.model_copy(update={"engine": "nested"})
        runs[preset] = levels if other == config else run(compiled)
    return runs


def noop_means(config: Config, level: RefinedWorld) -> tuple[np.ndarray, np.ndarray]:
    """Mean log importance weight of the no-op sampler on each triggered window, [nats].

    Returns
    -------
    (n,) sampled, and (n,) in closed form
    """
    base, settings = level.baseline, config.part(TriggerOnly)
    fired = np.flatnonzero(base.fired(config.tau))
    streams = np.random.default_rng([config.seed, 2]).spawn(len(base.covariances))
    draws = [noop_log_weights(base.covariances[t], settings, rng=streams[t]) for t in fired]
    exact = [noop_expected_log_weight(base.covariances[t], config.noop_sigma) for t in fired]
    return np.array([weights.mean() for weights in draws]), np.array(exact)


def example_window(config: Config, level: RefinedWorld) -> RefinedWindow:
    """The window of highest score, refined whether it triggered or not: one to look at."""
    from sngr_utils.sngr import trigger

    scores = level.baseline.scores
    best = trigger.FIRST_ELIGIBLE + int(np.argmax(scores[trigger.FIRST_ELIGIBLE :]))
    only = partial(trigger.regardless, which=best)
    return _refine(config, level.baseline, only).windows[0]


def likelihood_of(config: Config, level: RefinedWorld, t: int) -> LocalLikelihood:
    """Local log-likelihood of window t, as the sampler sees it."""
    from sngr_utils.sngr import refine

    return refine.window_likelihood(level.baseline.solution, t, config.likelihood_factor)


def window_positions(
    config: Config, level: RefinedWorld, window: RefinedWindow, n: int = 300
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions of a window's poses: truth (3, 2), iSAM2 (3, 2), n samples (n, 3, 2), mean (3, 2).

    The samples are drawn by weight.
    """
    from sngr_utils.slam.solution import pose_vector

    likelihood = likelihood_of(config, level, window.t)
    rng = np.random.default_rng([config.seed, 3])
    drawn = rng.choice(window.run.samples, size=n, p=window.run.weights)

    def positions(poses):
        return np.array([pose_vector(pose)[:2] for pose in poses])

    part = slice(window.t, window.t + len(window.poses))
    return (
        level.baseline.world.poses[part, :2],
        level.baseline.solution.poses[part, :2],
        np.array([positions(likelihood.variables(xi)) for xi in drawn]),
        positions(window.poses),
    )
