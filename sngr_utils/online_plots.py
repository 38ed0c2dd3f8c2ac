"""``draw_*(ax, data)`` of notebook 08: one run as a film strip, and all methods in one figure."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from sngr_utils import style

# name -> colour, dash and width: what a method does with a label, and ours in bold
OURS = {
    "association-aware SNGR, online": (style.SAMPLES, "-", 2.2),
    "the same idea over the batch": (style.ESTIMATE, "--", 1.6),
}
FAMILIES = {
    "believes every label": (style.TRIGGERED, ("iSAM2", "SNGR", "least squares")),
    "asks where a range is from": (
        style.SAMPLES, ("max-mixture, all", "FastSLAM", "EM")
    ),
    "uses no range": (style.TRUTH, ("dead reckoning",)),
}  # fmt: skip
FORGETS = style.PRINTED  # all others: what does not fit counts less, or not at all
MARKERS = "osD^v<>xP*hd1+"


def draw_frame(ax: Axes, frame) -> None:
    """What is believed at one pose (`online_study.Frame`), and the ranges of that pose.

    A line goes from the pose to the landmark that a range is credited to: green if that is its
    label's, orange if it was swapped; red and dotted to its label's if it is credited to none.
    """
    for cloud in frame.clouds.values():
        ax.plot(*cloud.T, ".", ms=0.8, color=style.PRIOR, alpha=0.4)
    ax.plot(*frame.truth.T, "-", lw=2.5, color="0.8")
    ax.plot(*frame.plain.T, ":", color=style.ESTIMATE)
    ax.plot(*frame.poses.T, "-", color=style.TRUTH, lw=0.9)
    ax.plot(*frame.true_landmarks.T, "+", ms=6, mew=0.6, color=style.TRUTH)
    ax.plot(*frame.landmarks.T, "^", mfc="none", ms=5, color=style.LANDMARK)
    here = frame.poses[-1]
    for label, used in zip(frame.label_of, frame.used, strict=True):
        colour, dash, end = style.SAMPLES, "-", frame.landmarks[used]
        if used < 0:
            colour, dash, end = style.TRIGGERED, ":", frame.true_landmarks[label]
        elif used != label:
            colour = style.LANDMARK
        ax.plot(*np.array([here, end]).T, dash, color=colour, lw=0.7)
    ax.plot(*here, "o", color=style.TRUTH)
    ax.set(xlim=(-7.5, 7.5), ylim=(-7.5, 7.5), aspect="equal", xticks=[], yticks=[])
    ax.set_title(f"pose {len(frame.poses) - 1}")


def film_legend() -> list[Line2D]:
    """What the marks of `draw_frame` mean."""
    looks = {
        "true path": {"lw": 2.5, "color": "0.8"},
        "ours": {"color": style.TRUTH},
        "plain iSAM2": {"ls": ":", "color": style.ESTIMATE},
        "landmark": {"ls": "", "marker": "+", "color": style.TRUTH},
        "ours, started": {"ls": "", "marker": "^", "mfc": "none", "color": style.LANDMARK},
        "posterior of one that waits": {"ls": "", "marker": ".", "color": style.PRIOR},
        "range, label kept": {"color": style.SAMPLES},
        "swapped": {"color": style.LANDMARK},
        "credited to none": {"ls": ":", "color": style.TRIGGERED},
    }
    return [Line2D([], [], label=label, **look) for label, look in looks.items()]


def look(name: str) -> tuple[str, str, float]:
    """Colour, dash and width of a method in `draw_summary`."""
    for colour, members in FAMILIES.values():
        if name in members:
            return colour, "-", 0.8
    return OURS.get(name, (FORGETS, "-", 0.8))


def draw_summary(ax: Axes, series: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Ratio of the pose RMSE to the oracle's against p, name -> (P,) p and (P, 3) mean, low, high.

    One is as good as knowing the associations. The legend is in the order of the last points.
    """
    worst_first = sorted(series, key=lambda name: -series[name][1][-1, 0])
    for i, name in enumerate(worst_first):
        p, values = series[name]
        mean, low, high = values.T
        # an interval that reaches zero has no lower end on a log axis
        bars = np.array([mean - np.maximum(low, 0.6 * mean), high - mean])
        colour, dash, width = look(name)
        ax.errorbar(
            p, mean, yerr=bars, ls=dash, color=colour, lw=width, zorder=2 + width, elinewidth=0.6,
            marker=None if name in OURS else MARKERS[i % len(MARKERS)], mfc="none", label=name,
        )  # fmt: skip
    ax.axhline(1, color=style.TRUTH, lw=0.6, zorder=1)
    ax.set(yscale="log", xlabel="share of wrong associations p", yticks=[1, 2, 5, 10, 20, 50])
    ax.set(ylabel="pose RMSE over the oracle's")
    ax.set_ylim(bottom=0.85)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    methods = ax.legend(loc="upper left", bbox_to_anchor=(1, 1))
    ax.add_artist(methods)
    colours = {**{name: colour for name, (colour, _) in FAMILIES.items()}, "forgets": FORGETS}
    handles = [Line2D([], [], color=c, lw=2, label=name) for name, c in colours.items()]
    ax.legend(handles=handles, loc="upper left")


def draw_posteriors(ax: Axes, panel) -> None:
    """A landmark's posterior after a few poses: (P, 2) places, poses, landmark, mass of a mode."""
    cloud, positions, landmark, mass = panel
    ax.plot(*cloud.T, ".", ms=0.8, color=style.PRIOR, alpha=0.5)
    ax.plot(*positions.T, "o-", color=style.TRUTH, ms=2.5)
    ax.plot(*landmark, "+", ms=8, color=style.TRUTH)
    ax.set(xlim=(-2, 12), ylim=(-6, 8), aspect="equal", xticks=[], yticks=[])
    ax.set_title(f"{len(positions)} poses: first mode {mass:.2f}")
