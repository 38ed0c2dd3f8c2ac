"""The tables and figures of notebook 00, and what it records."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from sngr_utils.publish import cells, report
from sngr_utils.show import methods, style
from sngr_utils.show.common import draw_ellipse, legend_above
from sngr_utils.start_here import LANDMARKS, POSES, Drive

LOOKS = [(style.ESTIMATE, "--"), (style.LANDMARK, "-."), (style.TRUTH, "-")]


def draw_scene(ax: Axes, drive: Drive) -> None:
    """The drive as it was, dead reckoning, and a line for each range."""
    for pose, label in zip(drive.pose_of, drive.label_of, strict=True):
        ends = np.transpose([POSES[pose], LANDMARKS[label]])
        ax.plot(*ends, "-", color=style.PRINTED, lw=0.5, zorder=1)
    ax.plot([], [], "-", color=style.PRINTED, lw=0.5, label="a measured range")
    ax.plot(*POSES.T, "-o", color=style.TRUTH, label="truth")
    reckoned = methods.METHODS["dead_reckoning"]
    look = {"ls": reckoned.dash, "color": reckoned.colour, "label": reckoned.name}
    ax.plot(*drive.dead_reckoning.T, marker="x", ms=5, **look)
    ax.plot(*LANDMARKS.T, **style.TRUE_LANDMARK, label="landmarks")
    _metres(ax)
    legend_above(ax, ncols=4)


def draw_densities(ax: Axes, x: np.ndarray, densities: Mapping[str, np.ndarray]) -> None:
    """Up to three densities (name -> (N,)) of one distance, [1/m] against [m]."""
    for (name, density), (colour, dash) in zip(densities.items(), LOOKS, strict=False):
        ax.plot(x, density, dash, color=colour, label=name)
    ax.set(xlabel="distance [m]", ylabel="density [1/m]")
    ax.legend()


def draw_grids(axes: Sequence[Axes], x: np.ndarray, y: np.ndarray, grids: Mapping) -> None:
    """Functions on a grid, one panel each: title -> (len(y), len(x)), dark where large."""
    for ax, (title, values) in zip(axes, grids.items(), strict=True):
        extent = [x[0], x[-1], y[0], y[-1]]
        ax.imshow(values, origin="lower", extent=extent, cmap="Greys", interpolation="nearest")
        ax.plot(*LANDMARKS.T, **style.TRUE_LANDMARK)
        ax.set(title=title, xlabel="x [m]")
    axes[0].set_ylabel("y [m]")


def draw_descents(
    ax: Axes, ranges: Sequence[float], paths: Mapping[str, np.ndarray], ellipse: tuple
) -> None:
    """The steps of Gauss-Newton between two rings.

    Parameters
    ----------
    ranges : distance from each of the two landmarks, [m]
    paths : name -> (steps + 1, 2), [m]
    ellipse : (mean (2,), covariance (2, 2)) drawn at two standard deviations
    """
    for landmark, radius in zip(LANDMARKS, ranges, strict=True):
        ax.add_patch(Circle(landmark, radius, fill=False, color=style.PRINTED, lw=0.8))
    ax.plot(*LANDMARKS.T, **style.TRUE_LANDMARK)
    colours = (style.ESTIMATE, style.SAMPLES, style.TRIGGERED)
    for (name, path), colour in zip(paths.items(), colours, strict=False):
        ax.plot(*path.T, "-o", color=colour, label=name)
        ax.plot(*path[-1], "o", ms=6, mfc="none", color=colour)
    draw_ellipse(ax, *ellipse, style.TRUTH)
    ax.plot([], [], color=style.TRUTH, label="2 σ of the fit")
    _metres(ax)
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_patterns(
    axes: Sequence[Axes], matrices: Mapping[str, np.ndarray], names: Mapping[str, Sequence[str]]
) -> None:
    """Which blocks of two columns are not zero: title -> matrix, title -> names of its columns."""
    for ax, (title, matrix) in zip(axes, matrices.items(), strict=True):
        ax.spy(np.abs(matrix) > 1e-9, markersize=3, color=style.TRUTH)
        for edge in range(2, matrix.shape[1], 2):
            ax.axvline(edge - 0.5, color=style.PRINTED, lw=0.3)
        ticks = np.arange(0.5, matrix.shape[1], 2)
        ax.set_xticks(ticks, [rf"${name[0]}_{name[1]}$" for name in names[title]])
        ax.set(yticks=[], title=title)
        ax.tick_params(length=0)


def draw_fits(axes: Sequence[Axes], fits: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Fitted drives beside the truth: title -> ((14,) places [m], (14, 14) covariance)."""
    for ax, (title, (fitted, covariance)) in zip(axes, fits.items(), strict=True):
        at = fitted.reshape(-1, 2)
        ax.plot(*POSES.T, "-", color=style.TRUTH, lw=0.7, label="truth")
        ax.plot(*LANDMARKS.T, **style.TRUE_LANDMARK, label="landmarks")
        ax.plot(*at[:5].T, "o-", color=style.ESTIMATE, label="estimate, 2 σ")
        ax.plot(*at[5:].T, **style.FOUND_LANDMARK, label="landmarks, found")
        for number, place in enumerate(at):
            block = slice(2 * number, 2 * number + 2)
            colour = style.ESTIMATE if number < 5 else style.LANDMARK
            draw_ellipse(ax, place, covariance[block, block], colour)
        _metres(ax)
        ax.set(title=title, xlim=(-1, 9), ylim=(-1, 4))
    axes[0].legend(loc="upper center")


def spot_table(rows: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> pd.DataFrame:
    """Where a spot is and how wide: how it was found -> (mean (2,), sigmas (2,)), [m]"""
    heads = ["found by", "x [m]", "y [m]", "σ of x [m]", "σ of y [m]"]
    found = [[name, *map(cells.text, [*mean, *sigmas])] for name, (mean, sigmas) in rows.items()]
    return pd.DataFrame(found, columns=heads)


def label_table(drives: Mapping[str, tuple[float, np.ndarray, np.ndarray]]) -> pd.DataFrame:
    """What a fit says of itself and what it is: name -> (least cost, places, covariance)."""
    heads = ["labels", "least cost", "σ of the last place [m]", "its error [m]", "error / σ"]
    rows = []
    for name, (cost, fitted, covariance) in drives.items():
        sigma, error = last_place(fitted, covariance)
        rows.append([name, *map(cells.text, (cost, sigma, error, error / sigma))])
    return pd.DataFrame(rows, columns=heads)


def last_place(fitted: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """How far off the last place may be (its larger sigma) and how far off it is, [m]"""
    sigma = float(np.sqrt(np.diag(covariance)[8:10].max()))
    return sigma, float(np.linalg.norm(fitted[8:10] - POSES[-1]))


def record(drives: Mapping, upper_mass: float, to: report.Report) -> None:
    """Hand on what `make verify` compares."""
    to.value("start.upper_mass", upper_mass)
    for name, (cost, fitted, covariance) in drives.items():
        sigma, error = last_place(fitted, covariance)
        for what, value in (("cost", cost), ("sigma", sigma), ("error", error)):
            to.value(f"start.{name}.{what}", value, unit="" if what == "cost" else "m")


def _metres(ax: Axes) -> None:
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.margins(0.08)
    ax.autoscale_view()
