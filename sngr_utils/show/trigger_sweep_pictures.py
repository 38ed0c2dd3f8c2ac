"""Pictures of one world of notebook 02: trajectory, landmarks, ranges."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from sngr_utils.publish.film import Film
from sngr_utils.show import style
from sngr_utils.show.common import draw_printed, legend_above, printed_fires

if TYPE_CHECKING:
    from sngr_utils.sngr.baseline import Baseline
    from sngr_utils.trigger_sweep import Sweep


def draw_world(ax: Axes, base: Baseline, tau: float | None = None) -> None:
    """True and estimated trajectory and landmarks, ranges as edges; poses that fire are ringed.

    An edge joins a pose to the landmark that its range is labelled with. In brackets: how many
    windows fire, and how many by the paper.
    """
    the_world, estimate = base.world, base.solution.poses
    _draw_edges(ax, base)
    ax.plot(*the_world.poses[:, :2].T, "-", color=style.TRUTH, lw=0.7, label="truth")
    ax.plot(*estimate[:, :2].T, "o-", color=style.ESTIMATE, lw=0.7, ms=3, label="iSAM2")
    if tau is not None:
        marked = base.fired_poses(tau)
        ax.plot(*estimate[marked, :2].T, "o", color=style.TRIGGERED, mfc="none", ms=5.5,
                label=f"fires ({base.fired(tau).sum()})")  # fmt: skip
        draw_printed(ax, [], [], printed_fires(base.p))
    ax.plot(*base.solution.landmarks.T, **style.FOUND_LANDMARK, label="landmark, found")
    ax.plot(*the_world.landmarks.T, **style.TRUE_LANDMARK, label="landmark")
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    legend_above(ax)


def _draw_edges(ax: Axes, base: Baseline) -> None:
    """The range factors at the estimate: right labels grey, wrong ones dashed."""
    the_world, solution = base.world, base.solution
    wrong = the_world.label_of != the_world.source_of
    looks = ((~wrong, style.PRINTED, "-", 0.3), (wrong, style.TRIGGERED, "--", 0.5))
    for chosen, colour, dash, width in looks:
        ends = np.stack([
            solution.poses[the_world.pose_of[chosen], :2],
            solution.landmarks[the_world.label_of[chosen]],
        ])  # fmt: skip
        ax.plot(*ends.transpose(2, 0, 1), color=colour, ls=dash, lw=width, zorder=0)
    ax.plot([], [], "--", color=style.TRIGGERED, lw=0.8, label="wrong label")


def draw_ranges(ax: Axes, base: Baseline, t: int) -> None:
    """The circles that the ranges of pose t draw around the landmarks of their labels."""
    the_world = base.world
    ax.plot(*the_world.poses[:, :2].T, "-", color=style.TRUTH, lw=0.7)
    ax.plot(*the_world.landmarks.T, **style.TRUE_LANDMARK)
    looks = {False: (style.ESTIMATE, "-", "right"), True: (style.TRIGGERED, "--", "wrong")}
    for m in np.flatnonzero(the_world.pose_of == t):
        colour, line, _ = looks[bool(the_world.label_of[m] != the_world.source_of[m])]
        centre = the_world.landmarks[the_world.label_of[m]]
        ax.add_patch(Circle(centre, the_world.ranges[m], fill=False, color=colour, lw=0.7, ls=line))
        ax.plot(*centre, "o", mfc="none", color=colour, ms=7)
    for colour, line, name in looks.values():
        ax.plot([], [], ls=line, color=colour, label=f"{name} label")
    ax.plot(*the_world.poses[t, :2], "o", color=style.TRUTH, ms=5)
    reach = 1.7 * np.abs(the_world.poses[:, :2]).max()
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x [m]",
           ylabel="y [m]")  # fmt: skip
    legend_above(ax, ncols=2)


def draw_scores(ax: Axes, base: Baseline, tau: float) -> None:
    """Score of every window, those that fire and those that failed marked, with the threshold.

    In brackets: how many fire, and how many by the paper.
    """
    t, fired = np.arange(len(base.scores)), base.fired(tau)
    ax.plot(t[~fired], base.scores[~fired], "o", color=style.ESTIMATE, ms=3)
    ax.plot(t[fired], base.scores[fired], "o", color=style.TRIGGERED, ms=3,
            label=f"fires ({fired.sum()})")  # fmt: skip
    ax.plot(t[base.failed], base.scores[base.failed] + 0.1, "v", color=style.TRUTH, ms=2.5,
            label="failed")  # fmt: skip
    ax.axhline(tau, color=style.TRIGGERED, lw=0.8, ls="--", label=rf"$\tau$ = {tau:g}")
    draw_printed(ax, [], [], printed_fires(base.p))
    ax.set(xlabel="window", ylabel="score")
    ax.margins(y=0.12)
    legend_above(ax)


def film(sweep: Sweep, tau: float) -> Film:
    """The first world at each level of p: its factor graph beside its scores."""
    alt = (
        "Factor graph and scores of one world as the share p of wrong labels grows. The estimate"
        " leaves the true circle, and windows fail. Notice how little the arch of the scores moves."
    )
    return Film("One world, p from 0 to 0.4", alt, "share p of wrong labels", _levels(sweep, tau))


def _levels(sweep: Sweep, tau: float) -> Iterator[tuple[str, Figure]]:
    for p in sweep.config.p_levels:
        fig, (left, right) = style.panels(6.4, 3.0, 2)
        base = sweep.single(p)
        draw_world(left, base, tau)
        left.set(xlim=(-7, 7), ylim=(-7, 7))
        draw_scores(right, base, tau)
        right.set(ylim=(2.5, 5))
        yield f"p = {p:g}: {base.failed.sum()} of {len(base.failed)} windows have failed", fig
