"""The tables and figures of notebook 02, and what it records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from sngr_utils.metrics import standard_error
from sngr_utils.publish import cells, report
from sngr_utils.show import style
from sngr_utils.show.common import legend_above
from sngr_utils.show.style import WRONG_LABEL
from sngr_utils.trigger_sweep import Sweep, pooled_scores, roles, triggers_by_tau

if TYPE_CHECKING:
    from sngr_utils.sngr.baseline import Baseline


def preset_table(presets: dict[str, Sweep]) -> pd.DataFrame:
    """RMSE over the seeds [m] at every p: as printed, and under each preset."""
    printed, rows = report.printed_values()["baseline"], []
    config = next(iter(presets.values())).config
    for p in config.p_levels:
        was = printed.get(p)
        shown = f"{cells.text(was['rmse'])} ± {cells.text(was['rmse_std'])}" if was else "–"
        ours = [
            cells.mean_std([run.pose_rmse for run in sweep.level(p)]) for sweep in presets.values()
        ]
        rows.append([f"{p:g}", shown, *ours])
    return pd.DataFrame(rows, columns=["p", "printed", *(f"preset {name}" for name in presets)])


def tau_table(sweep: Sweep) -> pd.DataFrame:
    """tab:tau: triggered windows against tau on clean and noisy data, printed beside ours."""
    printed, c = report.printed_values()["tau_sensitivity"], sweep.config
    clean, noisy = triggers_by_tau(sweep, c.p_clean), triggers_by_tau(sweep, c.p_noisy)
    rows = [
        [
            cells.text(tau),
            cells.text(printed.get(tau, {}).get("clean"), "d"),
            str(clean[i]),
            cells.text(printed.get(tau, {}).get("noisy_p0.3"), "d"),
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
    printed, t, rows = report.printed_values()["baseline"], cells.text, []
    for p in sweep.config.p_levels:
        was, single = printed.get(p, {}), sweep.single(p)
        found = single.detection(sweep.config.tau)
        rmses = [run.pose_rmse for run in sweep.level(p)]
        was_rmse = f"{t(was['rmse'])} ± {t(was['rmse_std'])}" if was else cells.NONE
        rows.append([
            f"{p:g}", was_rmse, cells.mean_std(rmses),
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
    printed, t, rows = report.printed_values()["per_seed_p0.3"], cells.text, []
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
            cells.text(run.pose_rmse),
            cells.text(run.nees, ".1f"),
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


def draw_world(ax: Axes, base: Baseline, tau: float | None = None) -> None:
    """True and estimated trajectory and landmarks; poses of triggered windows marked."""
    true, estimate = base.world.poses, base.solution.poses
    ax.plot(*true[:, :2].T, "-", color=style.TRUTH, lw=0.7, label="truth")
    ax.plot(*estimate[:, :2].T, "o-", color=style.ESTIMATE, lw=0.7, ms=2, label="iSAM2")
    if tau is not None:
        marked = base.fired_poses(tau)
        ax.plot(*estimate[marked, :2].T, "o", color=style.TRIGGERED, ms=3, label="fires")
    ax.plot(*base.world.landmarks.T, "*", color=style.TRUTH, ms=5, label="landmark")
    ax.plot(*base.solution.landmarks.T, "+", color=style.ESTIMATE, ms=5, label="estimate")
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    legend_above(ax)


def draw_ranges(ax: Axes, base: Baseline, t: int) -> None:
    """The circles that the ranges of pose t draw around the landmarks they are credited to."""
    the_world = base.world
    draw_world_truth(ax, base)
    looks = {False: (style.ESTIMATE, "-", "right"), True: (style.TRIGGERED, "--", "wrong")}
    for m in np.flatnonzero(the_world.pose_of == t):
        colour, line, _ = looks[bool(the_world.label_of[m] != the_world.source_of[m])]
        centre = the_world.landmarks[the_world.label_of[m]]
        ax.add_patch(Circle(centre, the_world.ranges[m], fill=False, color=colour, lw=0.7, ls=line))
        ax.plot(*centre, "o", mfc="none", color=colour, ms=7)
    for colour, line, name in looks.values():
        ax.plot([], [], ls=line, color=colour, label=f"credited to the {name} landmark")
    ax.plot(*the_world.poses[t, :2], "o", color=style.TRUTH, ms=5)
    reach = 1.7 * np.abs(the_world.poses[:, :2]).max()
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    legend_above(ax, ncols=2)


def draw_world_truth(ax: Axes, base: Baseline) -> None:
    """The true path and landmarks."""
    ax.plot(*base.world.poses[:, :2].T, "-", color=style.TRUTH, lw=0.7)
    ax.plot(*base.world.landmarks.T, "*", color=style.TRUTH, ms=5)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")


def draw_scores(ax: Axes, base: Baseline, tau: float) -> None:
    """Score of every window, those that fire and those that failed marked, with the threshold."""
    t, fired = np.arange(len(base.scores)), base.fired(tau)
    ax.plot(t[~fired], base.scores[~fired], "o", color=style.ESTIMATE, ms=2.5)
    ax.plot(t[fired], base.scores[fired], "o", color=style.TRIGGERED, ms=2.5, label="fires")
    ax.plot(t[base.failed], base.scores[base.failed] + 0.08, "v", color=style.TRUTH, ms=2,
            label="failed")  # fmt: skip
    ax.axhline(tau, color=style.TRIGGERED, lw=0.8, ls="--", label=rf"$\tau$ = {tau:g}")
    ax.set(xlabel="window", ylabel="score")
    ax.margins(y=0.12)
    legend_above(ax)


def draw_nees(ax: Axes, p: Sequence[float], ours: Sequence[float], printed: Sequence) -> None:
    """NEES against p, log scale, ours and as printed (None where the paper has no value)."""
    pairs = [(x, y) for x, y in zip(p, printed, strict=True) if y is not None]
    if pairs:
        ax.semilogy(*zip(*pairs, strict=True), "s--", color=style.PRINTED, label="printed")
    ax.semilogy(p, ours, "o-", color=style.ESTIMATE, label="ours")
    ax.axhline(2, color=style.TRUTH, lw=0.6, ls=":", label="consistent")
    ax.set(xlabel=WRONG_LABEL, ylabel="NEES")
    legend_above(ax)


def draw_score_boxes(
    ax: Axes, p: Sequence[float], scores: Sequence[np.ndarray], tau: float
) -> None:
    """Box plots of the pooled scores per p (whiskers to 1.5 interquartile ranges)."""
    ax.boxplot(
        list(scores), tick_labels=[f"{x:g}" for x in p], widths=0.6,
        flierprops={"marker": ".", "markersize": 2}, medianprops={"color": style.ESTIMATE},
    )  # fmt: skip
    ax.axhline(tau, color=style.TRIGGERED, lw=0.8, ls="--", label=rf"$\tau$ = {tau:g}")
    ax.set(xlabel=WRONG_LABEL, ylabel="score")
    legend_above(ax)
