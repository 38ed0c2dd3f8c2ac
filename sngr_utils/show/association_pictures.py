"""Pictures of what is associated with what: the ranges of one scan, and the frames of a run."""

from collections.abc import Iterable, Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from sngr_utils.experiments.one_range import Scan
from sngr_utils.publish.film import Film
from sngr_utils.show import style


def draw_scan(ax: Axes, scan: Scan) -> None:
    """The pose of a scan, the circle of its open range, and the landmarks that may explain it."""
    m, points = scan.open, np.vstack([scan.landmarks, scan.position])
    ax.add_patch(Circle(scan.position, scan.ranges[m], fill=False, color=style.ESTIMATE, lw=0.8))
    ax.plot(*scan.position, "o", color=style.ESTIMATE, label="pose")
    ax.plot(*scan.landmarks.T, **style.FOUND_LANDMARK, label="landmarks, found")
    for k, landmark in enumerate(scan.landmarks):
        ax.annotate(str(k), landmark, (7, 5), textcoords="offset points")  # clear of the marks
    label, source = scan.landmarks[scan.labels[m]], scan.landmarks[scan.sources[m]]
    ax.plot(*label, "s", mfc="none", ms=9, color=style.TRIGGERED, label="label")
    ax.plot(*source, "o", mfc="none", ms=11, color=style.SAMPLES, label="source")
    low, high = points.min(axis=0) - 1, points.max(axis=0) + 1
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)


def draw_shares(ax: Axes, shares: np.ndarray, scan: Scan) -> None:
    """How much of each range each landmark gets, (M, K), as shades; labels and sources marked."""
    rows = np.arange(len(shares))
    ax.imshow(shares, cmap="Greys", vmin=0, vmax=1, aspect="auto")
    ax.plot(scan.labels, rows, "s", mfc="none", ms=19, color=style.TRIGGERED)
    ax.plot(scan.sources, rows, "o", mfc="none", ms=17, color=style.SAMPLES)
    for m, k in zip(*np.nonzero(shares > 0.05), strict=True):
        colour = "white" if shares[m, k] > 0.5 else "black"
        ax.text(k, m, f"{shares[m, k]:.2f}", ha="center", va="center", fontsize=7, color=colour)
    ax.set(xlabel="landmark", ylabel="range of the scan", xticks=range(shares.shape[1]))
    ax.set_yticks(rows, [f"{m}, open" if m == scan.open else m for m in rows])


def draw_frame(ax: Axes, frame) -> None:
    """What is believed at one pose (`online_variants.Frame`), and the ranges of that pose.

    A line goes from the pose to the landmark that a range is assigned to: green if that is its
    label's, orange if it is another; red and dotted to its label's if it is assigned to none.
    """
    for cloud in frame.clouds.values():
        ax.plot(*cloud.T, ".", ms=0.8, color=style.PRIOR, alpha=0.4)
    ax.plot(*frame.truth.T, "-", lw=2.5, color="0.8")
    ax.plot(*frame.plain.T, ":", color=style.ESTIMATE)
    ax.plot(*frame.poses.T, "-", color=style.TRUTH, lw=0.9)
    ax.plot(*frame.landmarks.T, **style.FOUND_LANDMARK)
    ax.plot(*frame.true_landmarks.T, **style.TRUE_LANDMARK)
    here = frame.poses[-1]
    for label, used in zip(frame.label_of, frame.used, strict=True):
        colour, dash, end = style.SAMPLES, "-", frame.landmarks[used]
        if used < 0:
            colour, dash, end = style.TRIGGERED, ":", frame.true_landmarks[label]
        elif used != label:
            colour = style.LANDMARK
        ax.plot(*np.array([here, end]).T, dash, color=colour, lw=0.7)
    ax.plot(*here, "o", color=style.TRUTH)
    ax.set(xlim=(-7.5, 7.5), ylim=(-7.5, 7.5), aspect="equal")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    ax.set_title(f"pose {len(frame.poses) - 1}")


def film_legend() -> list[Line2D]:
    """What the marks of `draw_frame` mean."""
    looks = {
        "true path": {"lw": 2.5, "color": "0.8"},
        "ours": {"color": style.TRUTH},
        "plain iSAM2": {"ls": ":", "color": style.ESTIMATE},
        "landmark": style.TRUE_LANDMARK,
        "landmark, found": style.FOUND_LANDMARK,
        "posterior of one not yet found": {"ls": "", "marker": ".", "color": style.PRIOR},
        "range, label kept": {"color": style.SAMPLES},
        "given to another landmark": {"color": style.LANDMARK},
        "given to none": {"ls": ":", "color": style.TRIGGERED},
    }
    return [Line2D([], [], label=label, **look) for label, look in looks.items()]


def film(frames: Iterable) -> Film:
    """Every frame as a picture of its own, with the legend below."""
    alt = (
        "One run of the online estimator, pose by pose. Landmarks are clouds, rings or pairs at"
        " first. Notice when each is initialised, and how the path follows the true one."
    )
    return Film("One run, pose by pose", alt, "pose", _pictures(frames))


def _pictures(frames: Iterable) -> Iterator[tuple[str, Figure]]:
    for frame in frames:
        fig, ax = style.figure(3.5, 4.5)
        draw_frame(ax, frame)
        fig.legend(handles=film_legend(), loc="outside lower center", ncols=2)
        known = np.isfinite(frame.landmarks[:, 0]).sum()
        yield f"pose {len(frame.poses) - 1}: {known} landmarks initialised", fig
