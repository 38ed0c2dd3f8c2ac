"""``draw_*(ax, data)`` of notebook 09: posteriors in the plane, divergences, errors of masses."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Ellipse

from sngr_utils import style
from sngr_utils.plots import legend_above

WHITE_TO_GREEN = LinearSegmentedColormap.from_list("", ["white", style.SAMPLES])
LEAST = 1e-3  # what a logarithmic axis shows for less
COLOURS = [style.ESTIMATE, style.TRIGGERED, style.LANDMARK, style.SAMPLES, style.PRIOR]


def draw_posterior(ax: Axes, view) -> None:
    """Posterior of a landmark (a `multimodal.View`), the poses, two sigma of one Gaussian.

    The shade is the root of the density, so that a light mode is seen beside a heavy one.
    """
    places = np.concatenate([view.places, view.places[:, :1]], axis=1)
    shade = np.exp(0.5 * (view.log_density - view.log_density.max()))
    shade = np.concatenate([shade, shade[:, :1]], axis=1)
    ax.pcolormesh(places[..., 0], places[..., 1], shade, cmap=WHITE_TO_GREEN, shading="gouraud",
                  rasterized=True)  # fmt: skip
    if view.gaussian is not None:
        variances, axes = np.linalg.eigh(view.gaussian[1])
        width, height = 4 * np.sqrt(variances)
        angle = np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))
        ax.add_patch(Ellipse(view.gaussian[0], width, height, angle=angle, fill=False,
                             color=style.ESTIMATE))  # fmt: skip
    ax.plot(*view.positions.T, ".", color=style.PRINTED)
    ax.plot(*view.truth, "+", color=style.TRUTH, ms=6)
    # the ring of the first range, which holds both places
    reach = 1.2 * np.linalg.norm(view.truth - view.positions[0]) + 1
    x, y = np.array([-reach, reach]) + view.positions[0][:, None]
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=x, ylim=y)


def draw_divergences(ax: Axes, found: pd.DataFrame, kl_limit: float, fires: np.ndarray) -> None:
    """KL of one Gaussian, a dot per case, beside the number of poses; filled where it fires."""
    rank = found.groupby("n")["kl"].rank(pct=True).to_numpy()
    across, height = found["n"].to_numpy() + 0.7 * (rank - 0.5), np.maximum(found["kl"], LEAST)
    for flag, face, name in ((True, style.TRIGGERED, "fires"), (False, "none", "is silent")):
        here = fires == flag
        ax.plot(across[here], height[here], "o", ms=2.5, mew=0.5, color=style.TRIGGERED, mfc=face,
                label=f"mirror test {name}")  # fmt: skip
    ax.axhline(kl_limit, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(
        yscale="log", ylabel="KL(posterior ‖ one Gaussian) [nats]", xticks=sorted(set(found["n"])),
        xlabel="poses that saw the landmark",
    )  # fmt: skip
    legend_above(ax, 2)


def draw_look(ax: Axes, prior: np.ndarray, samples: np.ndarray, weights: np.ndarray) -> None:
    """Draws (N, 2) of a prior, and the weighted samples that nested sampling found in it, [m]."""
    ax.plot(*prior.T, ".", ms=1.5, color=style.PRIOR, alpha=0.6, label="prior", zorder=1)
    kept = weights > 0.02 * weights.max()
    ax.scatter(*samples[kept].T, s=8 * weights[kept] / weights.max(), color=style.SAMPLES, lw=0,
               alpha=0.5, label="posterior found", zorder=2)  # fmt: skip
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-5, 9), ylim=(-7, 7))


def draw_mass_errors(
    ax: Axes, errors: Mapping[str, Mapping[str, np.ndarray]], target: float
) -> None:  # fmt: skip
    """Largest error of a mode's mass, a dot per run: case -> method -> (n,), target dotted."""
    methods = list(next(iter(errors.values())))
    for i, (case, by_method) in enumerate(errors.items()):
        for k, method in enumerate(methods):
            values = np.maximum(by_method.get(method, np.zeros(0)), LEAST)
            place = k + 0.18 * (i - 0.5 * (len(errors) - 1))
            ax.plot(np.full(len(values), place), values, "o", ms=2.5, mew=0, alpha=0.6,
                    color=COLOURS[i], label=case if k == 0 else None)  # fmt: skip
    ax.axhline(target, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(yscale="log", ylabel="largest error of a mode's mass", xticks=range(len(methods)),
           xticklabels=[method.replace(" ", "\n") for method in methods])  # fmt: skip
    legend_above(ax, 2)
