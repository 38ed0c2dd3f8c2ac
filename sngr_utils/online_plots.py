"""``draw_*(ax, data)`` of notebook 08: one run as a film strip, and all methods in one figure."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from sngr_utils import style

# what `draw_summary` shows by name -> colour, dash, width, marker; all others are one grey band
NAMED = {
    "SNGR": (style.TRIGGERED, "-", 0.9, "x"),
    "iSAM2": (style.ESTIMATE, "--", 0.9, "o"),
    "least squares": (style.LANDMARK, "-", 0.9, "s"),
    "dead reckoning": (style.TRUTH, ":", 0.9, None),
    "Huber": (style.PRIOR, "-", 0.9, "D"),
    "FastSLAM": (style.SEQUENCE[0], "-", 0.9, "^"),
    "max-mixture, all": (style.PRIOR, "--", 0.9, "v"),
    "EM": (style.SEQUENCE[0], "--", 0.9, "+"),
    "EM, exclusive": (style.TRUTH, "--", 1.4, None),
    "association-aware SNGR": (style.SAMPLES, "-", 2.4, None),
}
FORGETTING = "seven that forget"  # redescending losses, switches, max-mixture with a null


def draw_frame(ax: Axes, frame) -> None:
    """What is believed at one pose (`online_variants.Frame`), and the ranges of that pose.

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


def draw_summary(ax: Axes, series: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Ratio of the pose RMSE to the oracle's against p, name -> (P,) p and (P, 3) mean, low, high.

    One is as good as knowing the associations. The legend is in the order of the last points.
    """
    grey = [series[name] for name in series if name not in NAMED]
    handles = {}
    for p, values in grey:
        ax.plot(p, values[:, 0], color=style.PRINTED, lw=0.7)
        handles[FORGETTING] = Line2D([], [], color=style.PRINTED, lw=0.7), values[-1, 0]
    for name, (p, values) in series.items():
        if name in NAMED:
            colour, dash, width, marker = NAMED[name]
            mean, low, high = values.T
            # an interval that reaches zero has no lower end on a log axis
            bars = np.array([mean - np.maximum(low, 0.6 * mean), high - mean])
            bar = ax.errorbar(p, mean, bars, ls=dash, color=colour, lw=width, zorder=2 + width,
                              elinewidth=0.6, marker=marker, ms=3.5, mfc="none")  # fmt: skip
            handles[name] = bar, mean[-1]
    ax.axhline(1, color=style.TRUTH, lw=0.6, zorder=1)
    ax.set(yscale="log", xlabel="share of wrong associations p", yticks=[1, 2, 5, 10, 20, 50])
    ax.set(ylabel="pose RMSE over the oracle's")
    ax.set_ylim(bottom=0.9)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    order = sorted(handles, key=lambda name: -handles[name][1])
    ax.legend([handles[name][0] for name in order], order, loc="lower center", ncols=3,
              bbox_to_anchor=(0.45, 1), fontsize=6.5, columnspacing=1)  # fmt: skip


def draw_posteriors(ax: Axes, panel) -> None:
    """A landmark's posterior after a few poses: (P, 2) places, poses, landmark, mass of a mode."""
    cloud, positions, landmark, mass = panel
    ax.plot(*cloud.T, ".", ms=0.8, color=style.PRIOR, alpha=0.5)
    ax.plot(*positions.T, "o-", color=style.TRUTH, ms=2.5)
    ax.plot(*landmark, "+", ms=8, color=style.TRUTH)
    ax.set(xlim=(-2, 12), ylim=(-6, 8), aspect="equal", xticks=[], yticks=[])
    ax.set_title(f"{len(positions)} poses: first mode {mass:.2f}")
