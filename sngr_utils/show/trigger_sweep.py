"""The tables and figures of notebook 02, and what it records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.metrics import standard_error
from sngr_utils.publish import cells, report
from sngr_utils.show import style
from sngr_utils.show.common import draw_printed, legend_above, printed_fires
from sngr_utils.show.presets import beside_printed, draw_beside_printed
from sngr_utils.show.style import WRONG_LABEL
from sngr_utils.trigger_sweep import Sweep, pooled_scores, ranking, roles, triggers_by_tau

if TYPE_CHECKING:
    from sngr_utils.sngr.baseline import Baseline


def tau_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """tab:tau: triggered windows against tau on clean and noisy data, printed beside ours."""
    config = next(iter(presets.values())).config
    levels = {"clean": config.p_clean, "noisy": config.p_noisy}
    keys = {"clean": "clean", "noisy": f"noisy_p{config.p_noisy:g}"}
    ours = {}
    for name, sweep in presets.items():
        counts = {keys[role]: triggers_by_tau(sweep, p) for role, p in levels.items()}
        ours[name] = {
            tau: {key: fired[i] for key, fired in counts.items()}
            for i, tau in enumerate(config.tau_grid)
        }
    quantities = {keys[role]: (f"p = {p:g}", "d") for role, p in levels.items()}
    return beside_printed(quantities, report.printed_values()["tau_sensitivity"], ours, "τ")


BASELINE = {
    "rmse": ("RMSE [m], mean", ".2f"),
    "rmse_std": ("RMSE [m], std", ".2f"),
    "nees": ("NEES", ".1f"),
    "precision": ("precision", ".2f"),
    "recall": ("recall", ".2f"),
    "triggered": ("triggered", "d"),
    "failed": ("failed", "d"),
    "base_rate": ("base rate", ".2f"),
}


def baseline_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """tab:baseline: RMSE over seeds; NEES, precision, recall, counts of the first seed."""
    ours = {
        name: {p: _baseline(sweep, p) for p in sweep.config.p_levels}
        for name, sweep in presets.items()
    }
    return beside_printed(BASELINE, report.printed_values()["baseline"], ours)


def _baseline(sweep: Sweep, p: float) -> dict[str, float]:
    single, rmses = sweep.single(p), [run.pose_rmse for run in sweep.level(p)]
    return {
        "rmse": float(np.mean(rmses)),
        "rmse_std": standard_error.standard_deviation(rmses),
        "nees": single.nees,
        "base_rate": single.base_rate,
        **_detected(single, sweep.config.tau),
    }


def _detected(run: Baseline, tau: float) -> dict[str, float]:
    """Counts and rates of the trigger in one world, by the names of the printed tables."""
    found = run.detection(tau)
    return {
        "triggered": found.triggered, "failed": found.failed, "tp": found.true_positives,
        "fp": found.false_positives, "fn": found.false_negatives,
        "precision": found.precision, "recall": found.recall,
    }  # fmt: skip


PER_SEED = {
    "triggered": ("triggered", "d"),
    "tp": ("TP", "d"),
    "fp": ("FP", "d"),
    "fn": ("FN", "d"),
    "precision": ("precision", ".2f"),
    "recall": ("recall", ".2f"),
}


def per_seed_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """tab:perseed: detection at the noisy p, seed by seed, printed beside ours."""
    return beside_printed(
        PER_SEED, report.printed_values()["per_seed_p0.3"], _by_seed(presets, "noisy"), "seed"
    )


CLEAN = {
    "triggered": ("windows that fire", "d"),
    "failed": ("windows that failed", "d"),
    "fp": ("false alarms", "d"),
}


def clean_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """Every world without a single wrong association: is the trigger silent, is it right?"""
    return beside_printed(CLEAN, None, _by_seed(presets, "clean"), "seed")


def _by_seed(presets: dict[str, Sweep], role: str) -> dict[str, dict[int, dict[str, float]]]:
    return {
        name: {
            run.seed: _detected(run, sweep.config.tau)
            for run in sweep.level(roles(sweep.config)[role])
        }
        for name, sweep in presets.items()
    }


def ranking_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """Does the score rank the windows that failed above the others? Area under the ROC curve."""
    ours = {
        name: {
            p: dict(zip(("within", "pooled"), ranking(sweep, p), strict=True))
            for p in sweep.config.p_levels
        }
        for name, sweep in presets.items()
    }
    quantities = {"within": ("within a world", ".2f"), "pooled": ("all worlds pooled", ".2f")}
    return beside_printed(quantities, None, ours)


def record(sweep: Sweep, presets: dict[str, Sweep], to: report.Report) -> None:
    """Hand the sweep's values to the paper: its levels by their role, so that they may change."""
    config = sweep.config
    for name, other in presets.items():
        clean = [run.detection(config.tau) for run in other.level(config.p_clean)]
        silent = sum(found.triggered == 0 for found in clean)
        to.value(f"sweep.{name}.clean_worlds_silent", silent, ".0f")
        alarms = sum(found.false_positives for found in clean)
        to.value(f"sweep.{name}.clean_false_alarms", alarms, ".0f")
        least = other.single(roles(config)["least"]).detection(config.tau)
        to.value(f"sweep.{name}.triggered.least", least.triggered, ".0f")
        to.value(f"sweep.{name}.failed.least", least.failed, ".0f")
    to.value("sweep.n_seeds", len(config.seeds), ".0f")
    to.value("sweep.seed", config.seeds[0], ".0f")
    to.value("sweep.tau", config.tau)
    most = [r.detection(config.tau).triggered for r in sweep.level(config.p_noisy)]
    to.value("sweep.noisy_most_fired", max(most), ".0f")
    levels = roles(config)
    for role, p in levels.items():
        to.value(f"sweep.p_{role}", p, "g")
    to.value("sweep.base_rate.noisy", sweep.single(config.p_noisy).base_rate)
    for role in ("clean", "most"):
        rmses = [run.pose_rmse for run in sweep.level(levels[role])]
        error = standard_error.standard_error(rmses)
        to.value(f"sweep.rmse.{role}", np.mean(rmses), unit="m", error=error, n=len(rmses))
    for role in ("clean", "noisy", "most"):
        scores = pooled_scores(sweep, levels[role])
        to.value(f"sweep.median_score.{role}", np.median(scores), n=len(scores))


def draw_score_boxes(
    ax: Axes, p: Sequence[float], scores: Sequence[np.ndarray], tau: float
) -> None:
    """Box plots of the pooled scores per p (whiskers to 1.5 interquartile ranges).

    Below each: how many windows of 28 fire in the first world by the paper.
    """
    ax.boxplot(
        list(scores), tick_labels=[f"{x:g}" for x in p], widths=0.6,
        flierprops={"marker": ".", "markersize": 2}, medianprops={"color": style.ESTIMATE},
    )  # fmt: skip
    ax.axhline(tau, color=style.TRIGGERED, lw=0.8, ls="--", label=rf"$\tau$ = {tau:g}")
    at, below = np.arange(1, len(p) + 1) - 0.2, np.concatenate(scores).min() - 0.2
    draw_printed(ax, at, np.full(len(p), below), "(fire)")
    for x, level in zip(at, p, strict=True):
        ax.annotate(printed_fires(level)[1:-1], (x, below), (4, 0), textcoords="offset points",
                    va="center", fontsize=7)  # fmt: skip
    ax.set(xlabel=WRONG_LABEL, ylabel="score")
    legend_above(ax, ncols=2)


def draw_worlds(ax: Axes, presets: dict[str, Sweep], role: str) -> None:
    """Windows that fire in each world at the level of a role, beside those that failed.

    A bar for each preset: filled for windows that failed, hatched for false alarms; a black
    stroke at the number of windows that failed.
    """
    found = _by_seed(presets, role)
    for i, (name, worlds) in enumerate(found.items()):
        x = np.arange(len(worlds)) + 0.26 * (i - 1)
        right, false, failed = (
            np.array([world[key] for world in worlds.values()]) for key in ("tp", "fp", "failed")
        )
        colour = style.PRESET_COLOURS[name]
        ax.bar(x, right, 0.22, color=colour, label=f"preset {name}")
        ax.bar(x, false, 0.22, bottom=right, color="none", edgecolor=colour, hatch="////", lw=0.6)
        ax.plot(x, failed, "_", color=style.TRUTH, ms=8, label=None if i else "failed")
    ax.bar(0, 0, 0, color="none", edgecolor=style.TRUTH, hatch="////", lw=0.6, label="false alarm")
    ax.set_xticks(np.arange(len(worlds)), list(worlds))
    ax.set(xlabel="seed of the world", ylabel="windows", ylim=(-0.5, 30))


def draw_areas(axes: Sequence[Axes], table: pd.DataFrame) -> None:
    """The two quantities of a `ranking_table` side by side, with a line at one half."""
    for ax, pairs in zip(axes, ("within a world", "all worlds pooled"), strict=True):
        draw_beside_printed(ax, table, pairs, ylabel=f"area, {pairs}", ylim=(0.2, 1.02))
        ax.axhline(0.5, color=style.TRUTH, lw=0.6, ls=":")
    legend_above(axes[0])


def words_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """Where the trigger is silent or blind, and its score uninformative, under each preset."""
    columns = {f"preset {name}": _words(sweep) for name, sweep in presets.items()}
    return pd.DataFrame(columns).reset_index(names="")


def _words(sweep: Sweep) -> dict[str, cells.Cell]:
    config, levels = sweep.config, roles(sweep.config)
    worlds = {role: [_detected(run, config.tau) for run in sweep.level(levels[role])]
              for role in ("clean", "least", "noisy")}  # fmt: skip
    silent = sum(world["triggered"] == 0 for world in worlds["clean"])
    blind = sum(world["tp"] == 0 < world["failed"] for world in worlds["noisy"])
    alarms = sum(world["fp"] for world in worlds["clean"])
    first, of = worlds["least"][0], len(config.seeds)
    within, pooled = ranking(sweep, levels["most"])
    return {
        "silent: clean worlds in which nothing fires": cells.cell("{:d} of {:d}", silent, of),
        "windows that fire on clean data and had not failed": cells.number(alarms, "d"),
        f"blind? p = {levels['least']:g}, first world: fires, failed": cells.cell(
            "{:d}, {:d}", first["triggered"], first["failed"]
        ),
        f"blind: worlds at p = {levels['noisy']:g}, none of the failed fires": cells.cell(
            "{:d} of {:d}", blind, of
        ),
        f"informative? area within a world, p = {levels['most']:g}": cells.number(within),
        f"uninformative? area, worlds pooled, p = {levels['most']:g}": cells.number(pooled),
    }
