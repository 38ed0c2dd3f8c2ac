"""The figures of notebook 05."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from sngr_utils.metrics import summaries
from sngr_utils.show import methods, style
from sngr_utils.show.common import draw_intervals, draw_printed, legend_above
from sngr_utils.show.style import PRESET_COLOURS, PRESET_MARKERS, WRONG_LABEL

DASHES = ["-", "--", "-.", (0, (4, 1)), (0, (1, 0.7))]  # told apart in grey print too
ACCEPTED = "#9BD6C2"  # preset C's green, so light that a printed value shows on it
FLOOR = 1e-4  # nats: gains below are drawn there, for the axis is logarithmic


def draw_verdicts(ax: Axes, found: Mapping[str, tuple[float, float, float, str]]) -> None:
    """What a verdict would accept, on the natural range of each number, from 0 to 1.

    Parameters
    ----------
    found : number -> ends of the accepted interval, place of the printed one, verdict
    """
    for y, (low, high, _, verdict) in enumerate(found.values()):
        ax.plot([0, 1], [y, y], color=style.TRUTH, lw=0.4, zorder=1)
        ours = "our worlds accept" if y == 0 else None
        ax.plot([low, high], [y, y], color=ACCEPTED, lw=6, solid_capstyle="butt", label=ours)
        ax.plot([low, high], [y, y], "|", color=ACCEPTED, ms=8, mew=2)  # a bar of no width too
        ax.text(1.03, y, verdict, va="center")
    draw_printed(ax, [printed for _, _, printed, _ in found.values()], range(len(found)), mew=1.4)
    ax.set_yticks(range(len(found)), list(found))
    ax.set(xlim=(-0.02, 1.45), xticks=[0, 0.5, 1], xlabel="place within the natural range",
           ylim=(len(found) - 0.5, -0.5))  # fmt: skip
    legend_above(ax)


def curve_series(frame: pd.DataFrame, value: str) -> dict[str, tuple[np.ndarray, ...]]:
    """preset -> p, mean, low, high for `common.draw_intervals`."""
    table = summaries.summary(frame, value)
    return {
        preset: tuple(group[name].to_numpy() for name in ("p", "mean", "low", "high"))
        for preset, group in table.groupby("preset", sort=False)
    }


def draw_worlds(axes: Sequence[Axes], changes: pd.DataFrame, unit: str) -> None:
    """One dot per world and its median, a panel per preset: what a change is, level by level.

    Parameters
    ----------
    changes : preset, level (words), change; above the dots stands how many fall and how many rise
    """
    most = 2 * changes["change"].abs().max()
    for ax, (preset, rows) in zip(axes, changes.groupby("preset", sort=False), strict=True):
        for x, (_, group) in enumerate(rows.groupby("level", sort=False)):
            values = np.sort(group["change"].to_numpy())
            spread = np.linspace(-0.3, 0.3, len(values))
            ax.plot(x + spread, values, PRESET_MARKERS[preset], color=PRESET_COLOURS[preset],
                    ms=2.5, mfc="none", mew=0.6)  # fmt: skip
            ax.plot([x - 0.4, x + 0.4], 2 * [np.median(values)], color=style.TRUTH, lw=1.4)
            less, more, _ = summaries.sign_test(values / 1e3)
            ax.text(x, 1.01, f"{less} : {more}", transform=ax.get_xaxis_transform(), ha="center")
        ax.axhline(0, color=style.TRUTH, lw=0.5, ls=":")
        ax.set_yscale("symlog", linthresh=1)
        ax.set_ylim(-most, most)
        ax.set_xticks(range(x + 1), list(dict.fromkeys(rows["level"])))
        ax.set_title(f"preset {preset}", pad=14)
    axes[0].set_ylabel(unit)


def steps_of(mended: pd.DataFrame) -> pd.DataFrame:
    """The changes of `draw_worlds`: what settling and refining do to the pose RMSE, [mm]."""
    steps = [
        ("as printed", "paper", "sngr", "base"), ("settling", "conditional", "base", "isam2"),
        ("conditional", "conditional", "sngr", "base"), ("marginal", "marginal", "sngr", "base"),
    ]  # fmt: skip
    return pd.concat([
        mended[mended["variant"] == variant].assign(
            level=level,
            change=lambda rows, a=after, b=before: (
                1e3 * (rows[f"{a}_pose_rmse"] - rows[f"{b}_pose_rmse"])
            ),
        )
        for level, variant, after, before in steps
    ]).sort_values("preset", kind="stable")


def draw_auc(axes: Sequence[Axes], rows: pd.DataFrame) -> None:
    """AUC against p, pooled over worlds (left) and of pairs of the same world (right)."""
    for column, ax, title in zip(
        ("pooled", "within"), axes, ("all windows pooled", "pairs of one world"), strict=True
    ):
        series = {}
        for preset, group in rows.groupby("preset", sort=False):
            ends = [group[end] if column == "within" else group[column] for end in ("low", "high")]
            series[preset] = tuple(x.to_numpy() for x in (group["p"], group[column], *ends))
        draw_intervals(ax, series, None, "AUC")
        ax.axhline(0.5, color=style.TRUTH, lw=0.6, ls=":")
        ax.set(ylim=(0.2, 1.02))
        ax.text(0.02, 0.03, title, transform=ax.transAxes)


def draw_settling(ax: Axes, gains: pd.DataFrame) -> None:
    """Median gain that a window could still have, [nats], against further empty updates."""
    bases = list(dict.fromkeys(gains["base"]))
    medians = gains.groupby(["preset", "base"], sort=False)["gain"].median()
    for size, preset in zip((7, 5, 3), dict.fromkeys(gains["preset"]), strict=False):
        left = np.maximum(medians[preset][bases].to_numpy(), FLOOR)
        ax.semilogy(left, PRESET_MARKERS[preset] + "-", color=PRESET_COLOURS[preset], mfc="none",
                    ms=size, label=f"preset {preset}")  # A shows around C  # fmt: skip
    ax.set_xticks(range(len(bases)), bases)
    ax.set(xlabel="further updates without data, then batch", ylabel="median gain left [nats]")
    legend_above(ax)


def draw_detection_curves(axes: Sequence[Axes], curves: dict[str, tuple]) -> None:
    """ROC (left) and precision-recall curves (right); dotted: what firing at random gives."""
    looks = zip(curves.items(), style.SEQUENCE, DASHES, strict=False)
    for (name, (roc, precision_recall, base_rate)), colour, dash in looks:
        axes[0].plot(*roc, ls=dash, color=colour, label=name)
        axes[1].plot(*precision_recall, ls=dash, color=colour)
        axes[1].axhline(base_rate, color=colour, lw=0.6, ls=":")
    axes[0].plot([0, 1], [0, 1], ":", color=style.TRUTH, lw=0.6)
    axes[0].set(xlabel="false positive rate", ylabel="true positive rate", aspect="equal")
    axes[1].set(xlabel="recall", ylabel="precision", ylim=(0, 1.02))
    legend_above(axes[0], ncols=2)


def robust_series(runs: pd.DataFrame, start: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """key of a method -> p and mean pose RMSE [m], from one start, beside dead reckoning."""
    chosen = runs[runs["start"].isin([start, "none"])]
    means = chosen.groupby(["method", "p"], sort=False)["pose_rmse"].mean()
    return {
        method: (group.index.get_level_values("p").to_numpy(), group.to_numpy())
        for method, group in means.groupby(level="method", sort=False)
    }


def draw_robust(ax: Axes, series: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Mean pose RMSE [m] against p, log scale: key of a method -> (p, rmse)."""
    for key, (p, rmse) in series.items():
        look = methods.METHODS[key]
        ax.semilogy(p, rmse, look.dash, marker=look.marker, mfc="none", color=look.colour,
                    label=look.name)  # fmt: skip
    ax.set(xlabel=WRONG_LABEL, ylabel="pose RMSE [m]")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    legend_above(ax, ncols=3)
