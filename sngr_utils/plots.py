"""``draw_*(ax, data)``: each draws one panel on the axes it is given. Never ``show``."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from dynesty.plotting import runplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from sngr_utils import style
from sngr_utils.sampling.weighted_samples import NestedRun
from sngr_utils.sngr import windows
from sngr_utils.sngr.baseline import Baseline

PRESET_COLOURS = {"A": style.LANDMARK, "B": style.ESTIMATE, "C": style.SAMPLES}
WRONG_LABEL = "share p of wrong associations"
PRESET_MARKERS = {"A": "^", "B": "o", "C": "s"}


def draw_circles(ax: Axes, anchors: np.ndarray, radius: float, points: dict) -> None:
    """Circles of equal range around known anchors, and labelled points (name -> (2,)), [m]."""
    for anchor in anchors:
        ax.add_patch(Circle(anchor, radius, fill=False, color=style.ESTIMATE))
    ax.plot(*anchors.T, "^", color=style.TRUTH, label="anchors")
    for (name, point), marker in zip(points.items(), "xoo*+", strict=False):
        ax.plot(*np.atleast_2d(point).T, marker, color=style.TRIGGERED, mfc="none", label=name)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.margins(0.05)
    ax.autoscale_view()
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_profile(ax: Axes, y: np.ndarray, curves: dict[str, np.ndarray]) -> None:
    """Curves (name -> (N,)) of log-likelihood along a line of y, [nats] against [m]."""
    looks = [(style.ESTIMATE, "-"), (style.PRIOR, "--"), (style.SAMPLES, ":")]
    for (name, values), (colour, dash) in zip(curves.items(), looks, strict=False):
        ax.plot(y, values, dash, color=colour, label=name)
    ax.set(xlabel="y [m]", ylabel="log-likelihood [nats]")
    ax.legend()


def draw_samples(
    ax: Axes, samples: np.ndarray, weights: np.ndarray, points: dict[str, np.ndarray]
) -> None:
    """Weighted samples (N, 2) in the plane, area by weight, and labelled points, [m]."""
    size = 30 * weights / weights.max()
    kept = size > 0.05
    ax.scatter(*samples[kept].T, s=size[kept], color=style.SAMPLES, alpha=0.4, lw=0,
               label="samples")  # fmt: skip
    colours = (style.ESTIMATE, style.TRUTH)
    for (name, point), marker, colour in zip(points.items(), "x+", colours, strict=False):
        ax.plot(*np.atleast_2d(point).T, marker, ms=6, color=colour, label=name)
    ax.set(xlabel="x [m]", ylabel="y [m]")
    legend_above(ax)


def legend_above(ax: Axes, ncols: int = 3) -> None:
    """A legend in one line above the panel, where it hides nothing."""
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=ncols, fontsize=6,
              columnspacing=0.8, handlelength=1.5, handletextpad=0.2, borderpad=0.1)  # fmt: skip


def draw_histogram(ax: Axes, y: np.ndarray, weights: np.ndarray, marks: Sequence[float]) -> None:
    """Weighted histogram of y with vertical lines at `marks`, [m]."""
    ax.hist(y, bins=np.linspace(-4, 4, 41), weights=weights, color=style.SAMPLES, density=True)
    for mark in marks:
        ax.axvline(mark, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(xlabel="y [m]", ylabel="density [1/m]")


def draw_repeated_masses(ax: Axes, masses: np.ndarray, single_error: float, spread: float) -> None:
    """Mode mass of repeated runs (n,), with two claims of a single run's standard error."""
    ax.plot(np.arange(1, len(masses) + 1), masses, "o", color=style.SAMPLES, label="one run each")
    ax.axhline(0.5, color=style.TRUTH, lw=0.6, ls=":", label="symmetry")
    ax.axhspan(0.5 - spread, 0.5 + spread, color=style.SAMPLES, alpha=0.15, lw=0,
               label="± spread of the runs")  # fmt: skip
    ax.axhspan(0.5 - single_error, 0.5 + single_error, color=style.PRIOR, alpha=0.3, lw=0,
               label="± by resampling one run")  # fmt: skip
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set(xlabel="run", ylabel="mass of the upper mode", ylim=(0, 1))
    ax.legend(loc="lower right", ncols=2)


def draw_live_points(ax: Axes, log_volume: np.ndarray, y: np.ndarray) -> None:
    """Discarded points' y [m] against the log prior volume left, as the run goes on."""
    ax.plot(log_volume, y, ".", ms=1.5, color=style.SAMPLES)
    ax.invert_xaxis()
    ax.set_yscale("symlog", linthresh=3)
    ax.set_yticks([-100, -10, 0, 10, 100])
    ax.set(xlabel="log prior volume left", ylabel="y of the discarded point [m]")


def run_plot(run: NestedRun) -> Figure:
    """dynesty's own summary of a run: live points, likelihood, weight, evidence.

    Without its smoothing of the weights, which draws from an unseeded generator.
    """
    fig, axes = plt.subplots(4, 1, figsize=(style.COLUMN_WIDTH * 1.5, 5.5), sharex=True)
    runplot(run.results, fig=(fig, axes), color=style.SAMPLES, kde=False, lnz_error=False)
    for ax in axes:
        ax.tick_params(labelsize=7)
        ax.xaxis.label.set_size(8)
        ax.yaxis.label.set_size(8)
    return fig


def draw_world(ax: Axes, base: Baseline, tau: float | None = None) -> None:
    """True and estimated trajectory and landmarks; poses of triggered windows marked."""
    true, estimate = base.world.poses, base.solution.poses
    ax.plot(*true[:, :2].T, "-", color=style.TRUTH, lw=0.7, label="truth")
    ax.plot(*estimate[:, :2].T, "o-", color=style.ESTIMATE, lw=0.7, ms=2, label="iSAM2")
    if tau is not None:
        fired = np.flatnonzero(base.fired(tau))
        marked = sorted({int(t) + i for t in fired for i in range(windows.WIDTH)})
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


def draw_gains(ax: Axes, presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Gain per window: name -> (windows (n,), delta log p (n,) [nats]); symmetric log scale."""
    _draw_by_preset(ax, presets)
    ax.axhline(0, color=style.TRUTH, lw=0.6, ls=":")
    ax.set_yscale("symlog", linthresh=0.1)
    ax.margins(y=0.1)
    ax.set(xlabel="window", ylabel=r"$\Delta$ log p [nats]")
    legend_above(ax)


def draw_ess(ax: Axes, presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """ESS per window as a share of the samples: name -> (windows (n,), shares (n,))."""
    _draw_by_preset(ax, presets)
    ax.set(xlabel="window", ylabel="ESS / samples", ylim=(0, 1))
    legend_above(ax)


def _draw_by_preset(ax: Axes, presets: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    for i, (name, (t, values)) in enumerate(presets.items()):
        label = name if i else f"preset {name}"
        ax.plot(
            t, values, PRESET_MARKERS[name], color=PRESET_COLOURS[name], mfc="none", label=label
        )


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
        (truth, "*", style.TRUTH, "truth"),
    ):
        ax.plot(*points.T, marker, color=colour, ms=5, mfc="none", label=name)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_rmse(ax: Axes, p: Sequence[float], series: dict[str, Sequence[float]]) -> None:
    """RMSE [m] against p, one line per method."""
    looks = {
        "dead reckoning": (style.TRUTH, ":", None),
        "iSAM2": (style.ESTIMATE, "-", "o"),
        "SNGR": (style.SAMPLES, "--", "x"),
        "SNGR as printed": (style.PRINTED, "-", "s"),
    }
    for name, values in series.items():
        colour, line, marker = looks[name]
        ax.plot(p, values, ls=line, marker=marker, color=colour, ms=6, mfc="none", label=name)
    ax.set(xlabel=WRONG_LABEL, ylabel="pose RMSE [m]")
    ax.set_ylim(bottom=0)
    legend_above(ax, ncols=4)


def draw_saving(
    ax: Axes, series: dict[str, tuple[Sequence[int], Sequence[float]]], total: int
) -> None:
    """Saving against the number of windows that fire, "ours" and "printed", with total / n."""
    n = np.arange(1, total + 1)
    ax.plot(n, total / n, "-", color=style.TRUTH, lw=0.6, label=f"{total} / n")
    looks = {"ours": (style.SAMPLES, "o"), "printed": (style.PRINTED, "s")}
    for name, (fired, saving) in series.items():
        colour, marker = looks[name]
        ax.plot(fired, saving, marker, color=colour, label=name)
    ax.set(xlabel="windows that fire, n", ylabel="exhaustive / selective", ylim=(0, 10))
    ax.legend()


def draw_engines(
    ax: Axes, names: Sequence[str], milliseconds: Sequence[float], limits: Sequence[float]
) -> None:
    """CPU time of a window per engine, log scale, with the time of its likelihood calls alone."""
    y = np.arange(len(names))[::-1]
    ax.hlines(y, limits, milliseconds, color=style.SAMPLES, lw=0.8)
    ax.plot(milliseconds, y, "o", color=style.SAMPLES, label="measured")
    ax.plot(limits, y, "|", color=style.TRUTH, ms=7, label="likelihood calls alone, compiled")
    ax.set_xscale("log")
    ax.set_yticks(y, names)
    ax.set(xlabel="ms per window", ylim=(-0.6, len(names) - 0.4))
    legend_above(ax, ncols=2)


def draw_growth(ax: Axes, lengths: np.ndarray, seconds: dict[str, np.ndarray],
                slopes: dict[str, float]) -> None:  # fmt: skip
    """CPU time [s] against the number of poses, log-log, one line per method with its slope."""
    looks = zip(
        (style.ESTIMATE, style.PRINTED, style.TRIGGERED, style.LANDMARK, style.SAMPLES),
        "os^vD", strict=True,
    )  # fmt: skip
    for (name, values), (colour, marker) in zip(seconds.items(), looks, strict=True):
        label = f"{name}: slope {slopes[name]:.2f}"
        ax.loglog(lengths, values, marker=marker, color=colour, label=label)
    ax.set(xlabel="poses", ylabel="CPU time [s]")
    ax.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=1)


def draw_intervals(
    ax: Axes,
    series: dict[str, tuple[np.ndarray, ...]],
    printed: tuple[Sequence[float], Sequence[float]] | None,
    label: str,
    log: bool = False,
) -> None:
    """Mean and 95 % interval against p: preset -> (p, mean, low, high), beside printed values."""
    for i, (name, (p, mean, low, high)) in enumerate(series.items()):
        shift = 0.006 * (i - 1)  # so that the bars do not hide each other
        bars = np.array([mean - low, high - mean])
        if log:
            bars[0] = np.minimum(bars[0], 0.9 * mean)
        ax.errorbar(
            p + shift, mean, bars, fmt=PRESET_MARKERS[name] + "-", color=PRESET_COLOURS[name],
            mfc="none", capsize=2, lw=0.8, label=f"preset {name}",
        )  # fmt: skip
    if printed is not None:
        ax.plot(*printed, "s--", color=style.PRINTED, lw=0.8, label="printed")
    if log:
        ax.set_yscale("log")
    ax.set(xlabel=WRONG_LABEL, ylabel=label)
    legend_above(ax, ncols=4 if ax.figure.get_figwidth() > 3 else 2)


def draw_detection_curves(axes: Sequence[Axes], curves: dict[str, tuple]) -> None:
    """ROC (left) and precision-recall curves (right); dotted: what firing at random gives."""
    looks = zip(curves.items(), style.SEQUENCE, strict=False)
    for (name, (roc, precision_recall, base_rate)), colour in looks:
        axes[0].plot(*roc, color=colour, label=name)
        axes[1].plot(*precision_recall, color=colour)
        axes[1].axhline(base_rate, color=colour, lw=0.6, ls=":")
    axes[0].plot([0, 1], [0, 1], ":", color=style.TRUTH, lw=0.6)
    axes[0].set(xlabel="false positive rate", ylabel="true positive rate", aspect="equal")
    axes[1].set(xlabel="recall", ylabel="precision", ylim=(0, 1.02))
    legend_above(axes[0], ncols=2)


def draw_robust(ax: Axes, series: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Mean pose RMSE [m] against p, log scale: method -> (p, rmse)."""
    fixed = {"dead reckoning": style.TRUTH, "least squares": style.ESTIMATE}
    others = [name for name in series if name not in fixed]
    colours = fixed | dict(zip(others, style.SEQUENCE, strict=False))
    for (name, (p, rmse)), marker in zip(series.items(), "osD^v<>xP", strict=False):
        ax.semilogy(p, rmse, marker=marker, mfc="none", color=colours[name], label=name)
    ax.set(xlabel=WRONG_LABEL, ylabel="pose RMSE [m]")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    legend_above(ax, ncols=3)
