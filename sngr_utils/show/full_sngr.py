"""The tables and figures of notebook 03, and what it records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.full_sngr import Config, example_window, noop_means
from sngr_utils.metrics import standard_error
from sngr_utils.publish import cells, report
from sngr_utils.show import methods, style
from sngr_utils.show.common import draw_printed, legend_above
from sngr_utils.show.presets import beside_printed
from sngr_utils.show.style import PRESET_COLOURS, PRESET_MARKERS, WRONG_LABEL

if TYPE_CHECKING:
    from sngr_utils.sngr.refined_world import RefinedWorld


def rmse_series(levels: dict[float, RefinedWorld]) -> dict[str, list[float]]:
    """Pose RMSE [m] per level and method, with the printed values where the paper has them."""
    printed = report.printed_values()["sngr"]
    return {
        "dead_reckoning": [level.odometry_rmse for level in levels.values()],
        "isam2": [level.baseline.pose_rmse for level in levels.values()],
        "sngr": [level.pose_rmse for level in levels.values()],
        "printed": [printed.get(p, {}).get("pose_rmse", np.nan) for p in levels],
    }


def per_window(
    config: Config, presets: dict[str, dict[float, RefinedWorld]], what: str
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Preset -> (windows, their "delta_logp" [nats] or "ess_share"), at p_diagnosed."""
    chosen = {}
    for name, levels in presets.items():
        level = levels[config.p_diagnosed]
        values = level.gains if what == "delta_logp" else level.ess_shares
        chosen[name] = (np.array([window.t for window in level.windows]), values)
    return chosen


SNGR = {
    "isam2_rmse": ("iSAM2 RMSE [m]", ".2f"),
    "pose_rmse": ("SNGR RMSE [m]", ".2f"),
    "landmark_rmse": ("landmark RMSE [m]", ".2f"),
    "nees": ("NEES", ".1f"),
    "triggered": ("triggered", "d"),
    "accepted": ("accepted", "d"),
    "precision": ("precision", ".2f"),
    "recall": ("recall", ".2f"),
}


def sngr_table(config: Config, presets: dict[str, dict[float, RefinedWorld]]) -> pd.DataFrame:
    """tab:sngr, printed beside ours, with the RMSE of iSAM2 before refinement."""
    ours = {
        name: {p: _numbers(level, config.tau) for p, level in levels.items()}
        for name, levels in presets.items()
    }
    return beside_printed(SNGR, report.printed_values()["sngr"], ours)


def _numbers(level: RefinedWorld, tau: float) -> dict[str, float]:
    found = level.baseline.detection(tau)
    return {
        "isam2_rmse": level.baseline.pose_rmse, "pose_rmse": level.pose_rmse,
        "landmark_rmse": level.baseline.landmark_rmse, "nees": level.nees,
        "triggered": found.triggered, "accepted": level.accepted,
        "precision": found.precision, "recall": found.recall,
    }  # fmt: skip


def gain_table(levels: dict[float, RefinedWorld]) -> pd.DataFrame:
    """Gain of the refined windows, what the gate made of them, what the trajectory gained.

    Three decimals where no window gains a tenth of a nat, and one elsewhere, as in `preset_table`.
    """
    rows = [
        [f"{p:g}", *_gain_cells(level, ".1f" if level.largest_gain > 0.1 else ".3f")]
        for p, level in levels.items()
    ]
    return pd.DataFrame(rows, columns=["p", *GAIN_COLUMNS]).drop(columns=LEAST)


def preset_table(config: Config, presets: dict[str, dict[float, RefinedWorld]]) -> pd.DataFrame:
    """The same at p_diagnosed under each preset, after what the paper prints.

    One decimal: iSAM2's lazy relinearisation (A, C) turns rounding, which differs between
    processors, into differences of hundredths of a nat.
    """
    low, high = report.printed_values()["diagnostics_p0.2"]["delta_logp_range"]
    refined = report.printed_values()["sngr"][0.2]["triggered"]
    columns = {"printed": [refined, cells.NONE, cells.number(low, ".1f"), cells.NONE,
                           cells.number(high, ".1f"), cells.NONE, cells.NONE]}  # fmt: skip
    for preset, levels in presets.items():
        level = levels[config.p_diagnosed]
        rmse = cells.number(level.baseline.pose_rmse)
        columns[f"preset {preset}"] = [*_gain_cells(level, ".1f"), rmse]
    return pd.DataFrame({"": [*GAIN_COLUMNS, "iSAM2 RMSE [m]"], **columns})


LEAST = "least Δ log p"
GAIN_COLUMNS = ["refined", "accepted", LEAST, "median", "largest", "RMSE change [mm]"]


def _gain_cells(level: RefinedWorld, fmt: str) -> list[cells.Cell | int]:
    gains = level.gains
    spread = (gains.min(), np.median(gains), gains.max()) if len(gains) else [None] * 3
    numbers = [*spread, level.rmse_change]
    return [len(gains), level.accepted, *map(cells.number, numbers, [fmt, fmt, fmt, "+.0f"])]


def record(
    config: Config,
    levels: dict[float, RefinedWorld],
    presets: dict[str, dict[float, RefinedWorld]],
    to: report.Report,
) -> None:
    """Hand the pipeline's values to the paper."""
    to.value("sngr.seed", config.seed, ".0f")
    to.value("sngr.tau", config.tau)
    to.value("sngr.p_diagnosed", config.p_diagnosed, "g")
    window = example_window(config, levels[config.p_diagnosed])
    to.value("sngr.mean_cost", window.expected_loss, ".3f", unit="nats")
    for preset in ("B", "C"):
        level = presets[preset][config.p_diagnosed]
        to.value(f"sngr.refined.{preset}", len(level.windows), ".0f")
        to.value(f"sngr.gain_median.{preset}", level.median_gain, ".1f", "nats", within=0.1)
        # the gate is finer than the noise of what it judges: single windows may go either way
        to.value(f"sngr.accepted.{preset}", level.accepted, ".0f", within=2)
    to.value("sngr.gain_max.C", level.largest_gain, ".1f", "nats", within=0.1)
    to.value("sngr.rmse_change.C", level.rmse_change, "+.0f", "mm", within=1)
    to.value("sngr.isam2_rmse.C", level.baseline.pose_rmse, unit="m")
    most = max(levels)
    to.value("sngr.p_most", most, "g")
    to.value("sngr.rmse", levels[most].pose_rmse, unit="m")
    to.value("sngr.isam2_rmse", levels[most].baseline.pose_rmse, unit="m")
    to.value("sngr.odometry_rmse", levels[most].odometry_rmse, unit="m")
    ess = np.concatenate([level.ess_shares for level in levels.values()])
    to.value("sngr.ess_median", np.median(ess) if len(ess) else np.nan, n=len(ess))
    weights, _ = noop_means(config, levels[config.p_noop])
    mean = weights.mean() if len(weights) else np.nan
    error = standard_error.standard_error(weights) if len(weights) > 1 else None
    to.value("noop.mean_log_weight", mean, ".0f", "nats", error, n=len(weights))


def draw_gains(ax: Axes, presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Gain per window: name -> (windows (n,), delta log p (n,) [nats]); symmetric log scale.

    The paper prints the largest gain with its window, and the least, drawn as a level.
    """
    _draw_by_preset(ax, presets)
    printed = report.printed_values()["diagnostics_p0.2"]
    low, high = printed["delta_logp_range"]
    draw_printed(ax, [printed["peak_window"]], [high], "peak")
    draw_printed(ax, _ends(presets), [low, low], "least", line=True, markevery=2)
    ax.axhline(0, color=style.TRUTH, lw=0.6, ls=":")
    ax.set_yscale("symlog", linthresh=0.1)
    ax.margins(y=0.1)
    ax.set(xlabel="window", ylabel=r"$\Delta$ log p [nats]")
    legend_above(ax)


def draw_ess(ax: Axes, presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """ESS per window as a share of the samples: name -> (windows (n,), shares (n,))."""
    _draw_by_preset(ax, presets)
    share = report.printed_values()["diagnostics_p0.2"]["ess_share"]
    draw_printed(ax, _ends(presets), [share, share], line=True)
    ax.set(xlabel="window", ylabel="ESS / samples", ylim=(0, 1))
    legend_above(ax)


def _ends(presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[int]:
    """First and last of all windows."""
    windows = np.concatenate([t for t, _ in presets.values()])
    return [windows.min(initial=0), windows.max(initial=0)]


def _draw_by_preset(ax: Axes, presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    for i, (name, (t, values)) in enumerate(presets.items()):
        label = name if i else f"preset {name}"
        ax.plot(
            t, values, PRESET_MARKERS[name], color=PRESET_COLOURS[name], mfc="none", label=label
        )


def draw_losses(
    ax: Axes, drawn: dict[int, np.ndarray], d: int, tolerance: float, own: float
) -> None:
    """Losses of sampled means against the number of samples, with d/2n and the gate's tolerance.

    Parameters
    ----------
    drawn : n -> (m,) losses, [nats]
    own : effective samples of the window at hand
    """
    for n, losses in drawn.items():
        ax.plot(np.full(len(losses), n), losses, ".", color=style.SAMPLES, ms=2, zorder=1)
    n = np.array(list(drawn))
    ax.loglog(n, d / (2 * n), "-", color=style.TRUTH, label="d / 2n")
    ax.plot(own, d / (2 * own), "o", color=style.ESTIMATE, ms=6, mfc="none", label="this window")
    ax.axhline(tolerance, color=style.TRIGGERED, ls="--", lw=0.8, label="tolerance of the gate")
    ax.set(xlabel="samples n", ylabel="loss [nats]")
    legend_above(ax)


def draw_step_gains(ax: Axes, sampled: Sequence[float], stepped: Sequence[float]) -> None:
    """Gain of each window by sampling against that by one Gauss-Newton step, with the diagonal."""
    ax.plot(stepped, sampled, "s", color=style.SAMPLES, mfc="none", ms=5, label="a window")
    gains = [*stepped, *sampled] or [0.0]  # where no window fires
    ends = [min(gains), max(gains)]
    ax.plot(ends, ends, ":", color=style.TRUTH, lw=0.6, label="equal")
    scale = {"linthresh": 0.1}
    ax.set_xscale("symlog", **scale)
    ax.set_yscale("symlog", **scale)
    ax.set(xlabel="gain by one Gauss-Newton step [nats]", ylabel="gain by sampling [nats]")
    legend_above(ax)


def draw_window_samples(
    ax: Axes, truth: np.ndarray, estimate: np.ndarray, samples: np.ndarray, mean: np.ndarray
) -> None:
    """Positions of a window's three poses: truth, iSAM2 and mean (3, 2), samples (N, 3, 2)."""
    for i in range(len(truth)):
        ax.plot(*samples[:, i].T, ".", color=style.SAMPLES, ms=1.5, alpha=0.5, zorder=1)
        ax.plot(*np.transpose([estimate[i], truth[i]]), ":", color=style.TRUTH, lw=0.6)
    ax.plot([], [], ".", color=style.SAMPLES, label="samples")
    for points, marker, colour, name in (
        (estimate, "o", style.ESTIMATE, "iSAM2"),
        (mean, "x", style.TRIGGERED, "sample mean"),
        (truth, "+", style.TRUTH, "truth"),
    ):
        ax.plot(*points.T, marker, color=colour, ms=5, mfc="none", label=name)
    ax.margins(x=0.5)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_rmse(ax: Axes, p: Sequence[float], series: dict[str, Sequence[float]]) -> None:
    """RMSE [m] against p, one line per method."""
    for name, values in series.items():
        if name == "printed":
            draw_printed(ax, p, values, "(SNGR)", line=True)
            continue
        look = methods.METHODS[name]
        ax.plot(p, values, ls=look.dash, marker=look.marker, color=look.colour, ms=6, mfc="none",
                label=look.name)  # fmt: skip
    ax.set(xlabel=WRONG_LABEL, ylabel="pose RMSE [m]")
    ax.set_ylim(bottom=0)
    legend_above(ax, ncols=4)
