"""``draw_*(ax, data)`` of notebook 07: kernels, one range in doubt, ratios to the oracle."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.ticker import NullFormatter

from sngr_utils import style

MARKERS = "osD^v<>xP"


def looks(names: list[str]) -> dict[str, tuple[str, str]]:
    """Colour and dash of each curve; the quadratic loss has the colour of iSAM2, which uses it."""
    dashes = ["-", "--", "-.", ":"]
    return {
        name: (style.ESTIMATE if i == 0 else style.SEQUENCE[(i - 1) % 6], dashes[i % 4])
        for i, name in enumerate(names)
    }


def draw_curves(ax: Axes, x: np.ndarray, curves: dict[str, np.ndarray], **labels: str) -> None:
    """Curves (name -> (N,)) over x, which keep their look from panel to panel."""
    for (name, values), (colour, dash) in zip(
        curves.items(), looks(list(curves)).values(), strict=True
    ):
        ax.plot(x, values, dash, color=colour, label=style.method_name(name))
    ax.set(**labels)


def legend_right(ax: Axes) -> None:
    """A legend beside the panel, for panels that share it."""
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_pull(
    ax: Axes, ranges: np.ndarray, n_wrong: int, x: np.ndarray, costs: dict[str, np.ndarray]
) -> None:
    """Costs (name -> (N,)) of a distance, each over its own range, and the ranges they come from.

    The last `n_wrong` of the (M,) ranges are another landmark's, [m].
    """
    draw_curves(ax, x, costs, xlabel="distance to the landmark [m]", ylabel="cost, scaled")
    for given, colour in ((ranges[:-n_wrong], style.TRUTH), (ranges[-n_wrong:], style.TRIGGERED)):
        ax.plot(given, np.full(len(given), -0.06), "|", color=colour, ms=6)
    ax.margins(y=0.03)


def draw_range(
    ax: Axes, position: np.ndarray, distance: float, landmarks: np.ndarray, label: int, source: int
) -> None:
    """The circle of one range about its pose, and the (K, 2) landmarks that may be its source."""
    ax.add_patch(Circle(position, distance, fill=False, color=style.ESTIMATE, lw=0.8))
    ax.plot(*position, "o", color=style.ESTIMATE, label="pose")
    ax.plot(*landmarks.T, "^", color=style.LANDMARK, label="landmarks")
    for k, landmark in enumerate(landmarks):
        ax.annotate(str(k), landmark, (2, 3), textcoords="offset points", fontsize=7)
    ax.plot(*landmarks[label], "s", mfc="none", ms=8, color=style.TRIGGERED, label="label")
    ax.plot(*landmarks[source], "o", mfc="none", ms=10, color=style.SAMPLES, label="source")
    low, high = (f(np.vstack([landmarks, position]), axis=0) for f in (np.min, np.max))
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.set(xlim=(low[0] - 1, high[0] + 1), ylim=(low[1] - 1, high[1] + 1))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)


def draw_beliefs(ax: Axes, beliefs: dict[str, np.ndarray]) -> None:
    """How much of a range each landmark gets: bars, one group for each of name -> (K,)."""
    width = 0.8 / len(beliefs)
    for i, (name, shares) in enumerate(beliefs.items()):
        place = np.arange(len(shares)) + (i - (len(beliefs) - 1) / 2) * width
        ax.bar(place, shares, width, color=style.SEQUENCE[i], label=style.method_name(name))
    ax.set(xlabel="landmark", ylabel="share of the range", xticks=range(len(shares)))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)


def draw_ratios(ax: Axes, series: dict[float, tuple[list[str], np.ndarray]]) -> None:
    """Ratio to the oracle, p -> names and (M, 3) mean, low, high: a row per method, log scale."""
    for i, (p, (names, values)) in enumerate(series.items()):
        rows = -np.arange(len(names)) + 0.18 * ((len(series) - 1) / 2 - i)
        mean, low, high = values.T
        bars = np.array([mean - np.maximum(low, 0.5 * mean), high - mean])
        ax.errorbar(
            mean, rows, xerr=bars, fmt=MARKERS[i], color=style.SEQUENCE[i], ms=2.5, lw=0.8,
            label=f"p = {p:g}",
        )  # fmt: skip
    ax.axvline(1, color=style.TRUTH, lw=0.6)
    ax.set(xscale="log", xlabel="pose RMSE over the oracle's", xticks=[1, 2, 5, 10, 20])
    ax.set_yticks(-np.arange(len(names)), names)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.grid(axis="y", lw=0.3)
    ax.legend(loc="lower center", bbox_to_anchor=(0.4, 1), ncols=len(series))
