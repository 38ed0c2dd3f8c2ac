"""Driver of notebook 02: what the condition number sees as wrong associations grow."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from sngr_utils import report
from sngr_utils.metrics import standard_error
from sngr_utils.settings import Positive, Probability, Seed
from sngr_utils.slam.conventions import PRESETS, preset_conventions
from sngr_utils.sngr import trigger
from sngr_utils.sngr.baseline import Baseline, run_baseline
from sngr_utils.world.scenario import Scenario


class Config(Scenario):
    """Parameters of the sweep; the defaults are the paper's values where it states them.

    p_levels : wrong-association probabilities; must hold p_clean and p_noisy
    seeds : worlds of the mean and standard deviation; the first is the single-world column
    tau : threshold of the tables; tau_grid : thresholds of the sensitivity table
    preset, conventions : see `conventions.preset_conventions`
    """

    p_levels: Annotated[list[Probability], Field(min_length=1)] = [0.0, 0.1, 0.2, 0.3, 0.4]
    p_clean: Probability = 0.0
    p_noisy: Probability = 0.3
    seeds: Annotated[list[Seed], Field(min_length=1)] = [0, 1, 2, 3, 4]
    tau: Positive = 3.96
    tau_grid: Annotated[list[Positive], Field(min_length=1)] = [3.90, 3.92, 3.96, 4.0]
    preset: str = "B"
    conventions: dict = {}

    @model_validator(mode="after")
    def _consistent(self):
        preset_conventions(self.preset, self.conventions)
        for name in ("p_clean", "p_noisy"):
            if getattr(self, name) not in self.p_levels:
                raise ValueError(f"{name} is {getattr(self, name)}: it must be one of p_levels")
        for name in ("p_levels", "seeds"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} is {getattr(self, name)}: it must not repeat a value")
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
    conventions = preset_conventions(config.preset, config.conventions)
    scenario = config.part(Scenario)
    return Sweep(
        config,
        {
            (p, seed): run_baseline(scenario, conventions, p, seed)
            for p in config.p_levels
            for seed in config.seeds
        },
    )


def run_presets(config: Config) -> dict[str, Sweep]:
    """The sweep under each preset of the open conventions, on the same data."""
    return {
        preset: run(config.model_copy(update={"preset": preset, "conventions": {}}))
        for preset in PRESETS
    }


def preset_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """RMSE over the seeds [m] at every p: as printed, and under each preset."""
    printed, rows = report.printed_values()["baseline"], []
    config = next(iter(presets.values())).config
    for p in config.p_levels:
        was = printed.get(p)
        shown = f"{report.text(was['rmse'])} ± {report.text(was['rmse_std'])}" if was else "–"
        ours = [
            report.mean_std([run.pose_rmse for run in sweep.level(p)]) for sweep in presets.values()
        ]
        rows.append([f"{p:g}", shown, *ours])
    return pd.DataFrame(rows, columns=["p", "printed", *(f"preset {name}" for name in presets)])


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


def tau_table(sweep: Sweep) -> pd.DataFrame:
    """tab:tau: triggered windows against tau on clean and noisy data, printed beside ours."""
    printed, c = report.printed_values()["tau_sensitivity"], sweep.config
    clean, noisy = triggers_by_tau(sweep, c.p_clean), triggers_by_tau(sweep, c.p_noisy)
    rows = [
        [
            report.text(tau),
            report.text(printed.get(tau, {}).get("clean"), "d"),
            str(clean[i]),
            report.text(printed.get(tau, {}).get("noisy_p0.3"), "d"),
            str(noisy[i]),
        ]
        for i, tau in enumerate(c.tau_grid)
    ]
    heads = [("", "τ")] + [
        (f"p = {p:g}", who) for p in (c.p_clean, c.p_noisy) for who in ("printed", "ours")
    ]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(heads))


def baseline_table(sweep: Sweep) -> pd.DataFrame:
    """tab:baseline: RMSE over seeds; NEES, precision, recall, counts of the first seed."""
    printed, t, rows = report.printed_values()["baseline"], report.text, []
    for p in sweep.config.p_levels:
        was, single = printed.get(p, {}), sweep.single(p)
        found = single.detection(sweep.config.tau)
        rmses = [run.pose_rmse for run in sweep.level(p)]
        was_rmse = f"{t(was['rmse'])} ± {t(was['rmse_std'])}" if was else report.NONE
        rows.append([
            f"{p:g}", was_rmse, report.mean_std(rmses),
            t(was.get("nees"), ".1f"), t(single.nees, ".1f"),
            t(was.get("precision")), t(found.precision), t(was.get("recall")), t(found.recall),
            t(was.get("triggered"), "d"), str(found.triggered),
            t(was.get("failed"), "d"), str(found.failed), t(single.base_rate),
        ])  # fmt: skip
    groups = ["RMSE [m]", "NEES", "precision", "recall", "triggered", "failed"]
    heads = [("", "p")] + [(name, who) for name in groups for who in ("printed", "ours")]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([*heads, ("base rate", "ours")]))


def per_seed_table(sweep: Sweep) -> pd.DataFrame:
    """tab:perseed: detection at the noisy p, seed by seed, printed beside ours."""
    printed, t, rows = report.printed_values()["per_seed_p0.3"], report.text, []
    for run in sweep.level(sweep.config.p_noisy):
        was, found = printed.get(run.seed, {}), run.detection(sweep.config.tau)
        counts = {
            "triggered": found.triggered, "tp": found.true_positives,
            "fp": found.false_positives, "fn": found.false_negatives,
        }  # fmt: skip
        row = [str(run.seed)]
        for name, ours in counts.items():
            row += [t(was.get(name), "d"), str(ours)]
        for name in ("precision", "recall"):
            row += [t(was.get(name)), t(getattr(found, name))]
        rows.append(row)
    groups = ["triggered", "TP", "FP", "FN", "precision", "recall"]
    heads = [("", "seed")] + [(name, who) for name in groups for who in ("printed", "ours")]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(heads))


def clean_table(sweep: Sweep) -> pd.DataFrame:
    """Every world without a single wrong association: does the trigger stay silent?"""
    rows = []
    for run in sweep.level(sweep.config.p_clean):
        found = run.detection(sweep.config.tau)
        counts = [str(found.triggered), str(found.failed)]
        rows.append([
            str(run.seed),
            report.text(run.pose_rmse),
            report.text(run.nees, ".1f"),
            *counts,
        ])
    return pd.DataFrame(rows, columns=["seed", "RMSE [m]", "NEES", "triggered", "failed"])


def record(sweep: Sweep, to: report.Report) -> None:
    """Hand the sweep's values to the paper: its levels by their role, so that they may change."""
    config = sweep.config
    to.value("sweep.n_seeds", len(config.seeds), ".0f")
    to.value("sweep.seed", config.seeds[0], ".0f")
    to.value("sweep.tau", config.tau)
    clean_fired = [r.detection(config.tau).triggered for r in sweep.level(config.p_clean)]
    to.value("sweep.clean_worlds_firing", np.count_nonzero(clean_fired), ".0f")
    to.value("sweep.clean_most_fired", max(clean_fired), ".0f")
    most = [r.detection(config.tau).triggered for r in sweep.level(config.p_noisy)]
    to.value("sweep.noisy_most_fired", max(most), ".0f")
    for role, p in roles(config).items():
        to.value(f"sweep.p_{role}", p, "g")
        rmses = [run.pose_rmse for run in sweep.level(p)]
        error = standard_error.standard_error(rmses)
        to.value(f"sweep.rmse.{role}", np.mean(rmses), unit="m", error=error, n=len(rmses))
        single = sweep.single(p)
        found = single.detection(config.tau)
        to.value(f"sweep.nees.{role}", single.nees, ".1f")
        to.value(f"sweep.triggered.{role}", found.triggered, ".0f")
        to.value(f"sweep.failed.{role}", found.failed, ".0f")
        to.value(f"sweep.base_rate.{role}", single.base_rate)
        scores = pooled_scores(sweep, p)
        to.value(f"sweep.median_score.{role}", np.median(scores), n=len(scores))


def roles(config: Config) -> dict[str, float]:
    """The levels the paper's text speaks of: clean, noisy, the least and the most contaminated."""
    positive = [p for p in config.p_levels if p > 0] or config.p_levels
    return {
        "clean": config.p_clean,
        "noisy": config.p_noisy,
        "least": min(positive),
        "most": max(config.p_levels),
    }


def pooled_scores(sweep: Sweep, p: float) -> np.ndarray:
    """(N * seeds,) scores of all windows of all worlds at one p."""
    return np.concatenate([run.scores for run in sweep.level(p)])


def score_in_units(covariance: np.ndarray, per_metre: float) -> float:
    """Score of a (9, 9) covariance with positions in another unit, `per_metre` to the metre."""
    return trigger.score(trigger.in_units(covariance, per_metre))
