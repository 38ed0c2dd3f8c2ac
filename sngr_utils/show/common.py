"""What the figures of several notebooks share."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from sngr_utils.publish import cells, report
from sngr_utils.show.methods import PRINTED
from sngr_utils.show.style import PRESET_COLOURS, PRESET_MARKERS, WRONG_LABEL


def legend_above(ax: Axes, ncols: int = 3) -> None:
    """A legend above the panel, where it hides nothing; above half a column, in two columns.

    In a figure of two columns its letters are larger, as a page that shows it shrinks it more.
    """
    wide = ax.figure.get_figwidth()
    if wide < 2:
        ncols = min(ncols, 2)
    size = 6.5 if wide > 6.5 else 6
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=ncols, fontsize=size,
              columnspacing=0.8, handlelength=1.5, handletextpad=0.2, borderpad=0.1)  # fmt: skip


def draw_printed(
    ax: Axes, x: Sequence[float], y: Sequence[float], what: str = "", line: bool = False, **looks
) -> None:
    """Numbers that the paper prints, by their one marker; joined if they are a curve or a level.

    Parameters
    ----------
    what : follows "printed" in the legend
    looks : as matplotlib's ``Axes.plot`` takes them
    """
    ax.plot(
        x, y, ls=PRINTED.dash if line else "none", marker=PRINTED.marker, color=PRINTED.colour,
        lw=PRINTED.width, mfc="none", label=f"{PRINTED.name} {what}".strip(), **{"ms": 4, **looks},
    )  # fmt: skip


def draw_ellipse(ax: Axes, mean: np.ndarray, covariance: np.ndarray, colour: str) -> None:
    """The ellipse of two standard deviations."""
    squares, axes = np.linalg.eigh(covariance)
    width, height = 4 * np.sqrt(squares)
    angle = np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))
    ax.add_patch(Ellipse(mean, width, height, angle=angle, fill=False, color=colour, lw=0.8))


def printed_fires(p: float) -> str:
    """In brackets, how many windows of the first world fire by the paper."""
    fired = report.printed_values()["baseline"].get(p, {}).get("triggered", cells.NONE)
    return f"({fired})"


def draw_intervals(
    ax: Axes,
    series: dict[str, tuple[np.ndarray, ...]],
    printed: tuple[Sequence[float], Sequence[float]] | None,
    label: str,
) -> None:
    """Mean and 95 % interval against p: preset -> (p, mean, low, high), beside printed values."""
    for i, (name, (p, mean, low, high)) in enumerate(series.items()):
        shift = 0.006 * (i - 1)  # so that the bars do not hide each other
        bars = np.array([mean - low, high - mean])
        ax.errorbar(
            p + shift, mean, bars, fmt=PRESET_MARKERS[name] + "-", color=PRESET_COLOURS[name],
            mfc="none", capsize=2, lw=0.8, label=f"preset {name}",
        )  # fmt: skip
    if printed is not None:
        draw_printed(ax, *printed, line=True)
    ax.set(xlabel=WRONG_LABEL, ylabel=label)
    legend_above(ax, ncols=4 if ax.figure.get_figwidth() > 3 else 2)
