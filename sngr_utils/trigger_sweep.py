"""What notebook 02 runs: what the condition number sees as wrong associations grow.

A helper's `Config` is read to check parameters before anything runs. So what is slow to load is
imported by the functions that need it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, model_validator

from sngr_utils.settings import Distinct, Levels, Positive, Probability, Seed
from sngr_utils.slam.conventions import PRESETS, OpenConventions
from sngr_utils.world.scenario import Scenario

if TYPE_CHECKING:
    from sngr_utils.sngr.baseline import Baseline


class Config(Scenario, OpenConventions):
    """Parameters of the sweep; the defaults are the paper's values where it states them.

    p_levels : wrong-association probabilities; must hold p_clean and p_noisy
    seeds : worlds of the mean and standard deviation; the first is the single-world column
    tau : threshold of the tables; tau_grid : thresholds of the sensitivity table
    """

    p_levels: Levels = [0.0, 0.1, 0.2, 0.3, 0.4]
    p_clean: Probability = 0.0
    p_noisy: Probability = 0.3
    seeds: Annotated[list[Seed], Field(min_length=1), Distinct] = [0, 1, 2, 3, 4]
    tau: Positive = 3.96
    tau_grid: Annotated[list[Positive], Field(min_length=1)] = [3.90, 3.92, 3.96, 4.0]

    @model_validator(mode="after")
    def _levels_are_run(self):
        for name in ("p_clean", "p_noisy"):
            if getattr(self, name) not in self.p_levels:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be one of p_levels")
        return self


@dataclass(frozen=True)
class Sweep:
    """All runs of the sweep, by (p, seed)."""

    config: Config
    runs: dict[tuple[float, int], Baseline]

    def level(self, p: float) -> list[Baseline]:
        """The runs at one p, in the order of the seeds."""
        return [self.runs[p, seed] for seed in self.config.seeds]

    def single(self, p: float) -> Baseline:
        """The run at one p that the single-world columns show: the first seed's."""
        return self.runs[p, self.config.seeds[0]]


def run(config: Config) -> Sweep:
    """iSAM2 on every world of the sweep."""
    from sngr_utils.sngr.baseline import run_baseline

    scenario = config.part(Scenario)
    return Sweep(
        config,
        {
            (p, seed): run_baseline(scenario, config.chosen, p, seed)
            for p in config.p_levels
            for seed in config.seeds
        },
    )


def run_presets(config: Config, sweep: Sweep) -> dict[str, Sweep]:
    """The sweep under each preset of the open conventions, on the same data.

    Parameters
    ----------
    sweep : what `run` gave: one preset's sweep, if no field was replaced
    """
    wanted = {preset: config.under(preset) for preset in PRESETS}
    return {preset: sweep if other == config else run(other) for preset, other in wanted.items()}


def triggers_by_tau(sweep: Sweep, p: float) -> list[int]:
    """Number of windows that fire at each tau of the grid, first seed."""
    return [sweep.single(p).detection(tau).triggered for tau in sweep.config.tau_grid]


def choose_tau(sweep: Sweep) -> float | None:
    """The paper's rule: of the grid, no trigger on clean data and the most recall on noisy.

    Ties go to the largest tau. None if every tau of the grid fires on clean data.
    """
    quiet = [
        (sweep.single(sweep.config.p_noisy).detection(tau).triggered, tau)
        for tau, fired in zip(
            sweep.config.tau_grid, triggers_by_tau(sweep, sweep.config.p_clean), strict=True
        )
        if fired == 0
    ]
    return max(quiet)[1] if quiet else None


def roles(config: Config) -> dict[str, float]:
    """The levels the paper's text speaks of: clean, noisy, the least and the most contaminated."""
    positive = [p for p in config.p_levels if p > 0] or config.p_levels
    return {
        "clean": config.p_clean,
        "noisy": config.p_noisy,
        "least": min(positive),
        "most": max(config.p_levels),
    }


def ranking(sweep: Sweep, p: float) -> tuple[float, float]:
    """Area under the ROC curve of the score against failure: within worlds, and pooled over them.

    Over the windows that may fire. Within worlds: the mean over those that have failed windows
    and others; NaN where there is no such world.
    """
    from sngr_utils.metrics.precision_recall import roc_auc
    from sngr_utils.sngr.trigger import FIRST_ELIGIBLE

    scores = [run.scores[FIRST_ELIGIBLE:] for run in sweep.level(p)]
    failed = [run.failed[FIRST_ELIGIBLE:] for run in sweep.level(p)]
    areas = [roc_auc(*world) for world in zip(scores, failed, strict=True)]
    known = [area for area in areas if not np.isnan(area)]
    within = float(np.mean(known)) if known else float("nan")
    return within, roc_auc(np.concatenate(scores), np.concatenate(failed))


def pooled_scores(sweep: Sweep, p: float) -> np.ndarray:
    """(N * seeds,) scores of all windows of all worlds at one p."""
    return np.concatenate([run.scores for run in sweep.level(p)])


def score_in_units(covariance: np.ndarray, per_metre: float) -> float:
    """Score of a (9, 9) covariance with positions in another unit, `per_metre` to the metre."""
    from sngr_utils.sngr import trigger

    return trigger.score(trigger.in_units(covariance, per_metre))
