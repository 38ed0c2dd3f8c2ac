"""The tables and figures of notebook 01, and what it records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from dynesty.plotting import runplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from sngr_utils.metrics.bimodality import bimodality_coefficient
from sngr_utils.publish import cells, report
from sngr_utils.publish.film import Film
from sngr_utils.show import style
from sngr_utils.show.common import draw_printed, legend_above

if TYPE_CHECKING:
    from sngr_utils.bimodal import Config, Result
    from sngr_utils.sampling.weighted_samples import WeightedSamples


def hessian_table(config: Config) -> pd.DataFrame:
    """Eigenvalues of both Hessians at the saddle and at a mode, [1/m^2]."""
    rows = []
    for name, at in (("saddle", config.saddle), ("mode", config.modes[0])):
        for kind, hessian in (
            ("Gauss-Newton", config.gauss_newton_hessian(at)),
            ("full", config.full_hessian(at)),
        ):
            low, high = np.linalg.eigvalsh(hessian)
            condition = np.log10(high / low) if low > 0 else None
            rows.append([name, kind, *map(cells.number, (low, high, condition))])
    return pd.DataFrame(rows, columns=["at", "Hessian", "smallest", "largest", "log10 cond."])


def comparison_table(result: Result) -> pd.DataFrame:
    """tab:bimodal, printed value beside ours."""
    printed = report.printed_values()["bimodal"]

    def row(name, key, *ours, form="{:.2f}"):
        was = printed[key] if len(ours) > 1 else [printed[key]]
        return [name, cells.cell(form, *was), cells.cell(form, *ours)]

    point, distances = "({:.3f}, {:.3f})", map(result.mode_distance, (result.map, result.best))
    return pd.DataFrame(
        [
            row("iSAM2 estimate [m]", "map", *result.map, form=point),
            row("best nested sample [m]", "ns_best", *result.best, form=point),
            row("log-likelihood, iSAM2", "loglik_map", result.loglik_map),
            row("log-likelihood, best sample", "loglik_ns", result.loglik_best),
            row("gain Δ log p", "delta_logp", result.delta_logp),
            row("distance to a mode, iSAM2 [m]", "error_from_mode_map", next(distances),
                form="{:.3f}"),
            row("distance to a mode, best [m]", "error_from_mode_ns", next(distances),
                form="{:.3f}"),
            row("weighted σ of y [m]", "weighted_sigma_y", result.sigma_y),
            row("bimodality coefficient", "bimodality_coefficient", result.bimodality),
            ["mass of the upper mode", cells.NONE,
             cells.with_error(result.upper_mass, result.upper_mass_error)],
            [f"same, mean of {len(result.upper_masses)} runs", cells.NONE,
             cells.mean_error(result.upper_masses)],
        ],
        columns=["quantity", "printed", "ours"],
    )  # fmt: skip


def record(result: Result, to: report.Report) -> None:
    """Hand the experiment's values to the paper, and one number per repeated run to the claims."""
    for name, factor in (("as_printed", 0.5), ("correct", 1.0)):
        saddle = result.config.profile(np.array(0.0), factor)
        to.value(f"bimodal.loglik_saddle_{name}", saddle, unit="nats")
    to.value("bimodal.upper_mass", result.upper_mass, error=result.upper_mass_error)
    to.value("bimodal.resampled_error", result.resampled_error)
    printed_best = np.array(report.printed_values()["bimodal"]["ns_best"])
    to.value("bimodal.printed_distance", result.mode_distance(printed_best), ".4f", "m")
    for name, value in (("map_x", result.map[0]), ("map_y", result.map[1]),
                        ("map_distance", result.mode_distance(result.map))):  # fmt: skip
        to.value(f"bimodal.{name}", value, ".3f", "m")
    bests = [result.map + run.best for run in result.runs]
    to.sample("bimodal.best_x", [float(best[0]) for best in bests], ".3f", "m")
    to.sample("bimodal.best_abs_y", [abs(float(best[1])) for best in bests], ".3f", "m")
    to.sample("bimodal.best_distance", [result.mode_distance(best) for best in bests], ".3f", "m")
    loglik = [float(run.log_likelihoods.max()) for run in result.runs]
    to.sample("bimodal.loglik_best", loglik, ".3f", "nats")
    to.sample("bimodal.gains", [value - result.loglik_map for value in loglik], ".3f", "nats")
    sigmas = [float(np.sqrt(run.covariance[1, 1])) for run in result.runs]
    to.sample("bimodal.sigmas_y", sigmas, ".3f", "m")
    coefficients = [
        bimodality_coefficient(result.map[1] + run.samples[:, 1], run.weights)
        for run in result.runs
    ]
    to.sample("bimodal.bimodalities", coefficients, ".3f")
    to.sample("bimodal.upper_masses", list(map(float, result.upper_masses)), ".3f")


def draw_circles(ax: Axes, anchors: np.ndarray, radius: float, points: dict) -> None:
    """Circles of equal range around known anchors, and labelled points (name -> (2,)), [m]."""
    for anchor in anchors:
        ax.add_patch(Circle(anchor, radius, fill=False, color=style.ESTIMATE))
    ax.plot(*anchors.T, "^", color=style.TRUTH, label="anchors")
    looks = zip(points.items(), "x+*od", [style.ESTIMATE, *4 * [style.TRUTH]], strict=False)
    for (name, point), marker, colour in looks:
        ax.plot(*np.atleast_2d(point).T, marker, color=colour, ms=5, label=name)
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.margins(0.05)
    ax.autoscale_view()
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_profile(ax: Axes, y: np.ndarray, curves: dict[str, np.ndarray]) -> None:
    """Curves (name -> (N,)) of log-likelihood along a line of y, [nats] against [m]."""
    looks = [(style.PRINTED, "--"), (style.ESTIMATE, "-"), (style.SAMPLES, ":")]
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
    best = report.printed_values()["bimodal"]["ns_best"]
    draw_printed(ax, *np.transpose([best]), "best", ms=6)
    ax.set(xlabel="x [m]", ylabel="y [m]")
    legend_above(ax, ncols=2)


def draw_histogram(ax: Axes, y: np.ndarray, weights: np.ndarray, marks: Sequence[float]) -> None:
    """Weighted histogram of y with vertical lines at `marks`, [m]; the printed weighted sigma."""
    ax.hist(y, bins=np.linspace(-4, 4, 41), weights=weights, color=style.SAMPLES, density=True)
    for mark in marks:
        ax.axvline(mark, color=style.TRUTH, lw=0.6, ls=":")
    sigma, height = report.printed_values()["bimodal"]["weighted_sigma_y"], ax.get_ylim()[1]
    draw_printed(ax, [-sigma, sigma], [height / 2] * 2, r"$\pm\sigma_y$", line=True)
    ax.set(xlabel="y [m]", ylabel="density [1/m]")
    legend_above(ax)


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


def run_plot(run: WeightedSamples) -> Figure:
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


def draw_shrinkage(ax: Axes, assumed: np.ndarray, true: np.ndarray) -> None:
    """Log of the prior volume left at each step (N,), as the law has it and as it is."""
    ax.plot(true, color=style.SAMPLES, label="as it is, on a grid")
    ax.plot(assumed, "--", color=style.TRUTH, label=r"$-i/n$")
    ax.set(xlabel="points discarded, $i$", ylabel="log volume left")
    ax.legend()


def draw_weights(
    ax: Axes, heights: np.ndarray, log_volume: np.ndarray, weights: np.ndarray
) -> None:
    """Likelihood, volume left and posterior weight at each step (N,), each over its largest."""
    looks = {
        "likelihood": (np.exp(heights - heights.max()), style.ESTIMATE, "-"),
        "volume left": (np.exp(log_volume), style.PRIOR, "--"),
        "weight": (weights / weights.max(), style.SAMPLES, "-"),
    }
    for name, (values, colour, dash) in looks.items():
        ax.plot(values, dash, color=colour, label=name)
    ax.set(xlabel="points discarded, $i$", ylabel="share of the largest")
    ax.legend()


def draw_live_panels(
    axes: Sequence[Axes], history: Sequence[np.ndarray], steps: Sequence[int], config: Config
) -> None:
    """Live points (n, 2) in the plane after some of the steps, with the two circles, [m]."""
    for ax, step in zip(axes, steps, strict=True):
        for anchor in config.anchors:
            circle = Circle(anchor, config.measured_range, fill=False, color=style.PRINTED, lw=0.6)
            ax.add_patch(circle)
        ax.plot(*history[step].T, ".", ms=2.5, color=style.SAMPLES)
        ax.set(title=f"after {step}", xlabel="x [m]", aspect="equal")
        ax.set(xlim=(-6, 10), ylim=(-8, 8))
    axes[0].set_ylabel("y [m]")


def live_film(history: Sequence[np.ndarray], config: Config) -> Film:
    """The live points of a run at 21 of its steps."""
    alt = (
        "Live points of nested sampling and the two circles. The points gather about both rings,"
        " then at the crossings. Notice when no point is left between the clusters."
    )
    return Film("Live points", alt, "points discarded", _live(history, config))


def _live(history: Sequence[np.ndarray], config: Config) -> Iterator[tuple[str, Figure]]:
    for step in np.linspace(0, len(history) - 1, 21).astype(int):
        fig, ax = style.figure(3.2, 3.2)
        draw_live_panels([ax], history, [step], config)
        yield f"{step} points discarded", fig
