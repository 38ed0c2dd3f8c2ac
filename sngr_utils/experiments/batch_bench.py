"""The compiled batch estimates and GTSAM's on the same worlds, in turn: their times and ends."""

import numpy as np

from sngr_utils.experiments import gtsam_estimates
from sngr_utils.experiments.engine_bench import timed
from sngr_utils.robust import em, losses
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.landmark_starts import start_landmarks
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import World, simulate

ROBUST = tuple(name for name in losses.METHODS if name != "oracle")
EM = ("em", "em_exclusive")


def compare(
    scenario: Scenario, conventions: Conventions, p: float, seeds: range
) -> dict[str, np.ndarray]:
    """(S, 3) of every method: CPU seconds of ours and of GTSAM, largest difference of poses [m].

    Starts and covariances are not timed; the first world comes twice, first to compile.
    """
    rows: dict[str, list] = {method: [] for method in (*ROBUST, *EM)}
    for seed in (seeds[0], *seeds):
        the_world = simulate(scenario, p, rng=np.random.default_rng(seed))
        for method, row in rows.items():
            row.append(_one(the_world, conventions, method))
    return {method: np.array(row[1:]) for method, row in rows.items()}


def _one(the_world: World, conventions: Conventions, method: str) -> tuple[float, float, float]:
    log = the_world.log(conventions.x0_sigmas)
    blind = dead_reckoning(log.x0_mean, log.odometry)
    start, exclusive = (blind, start_landmarks(log, blind, "grid")), method == "em_exclusive"
    if method in EM:
        ours, taken = timed(
            lambda: em.fit(log, conventions, start, exclusive=exclusive, clutter=False).poses
        )
        theirs, by_gtsam = timed(
            lambda: gtsam_estimates.fit(the_world, conventions, start, exclusive)[0]
        )
    else:
        ours, taken = timed(lambda: losses.solve(log, conventions, method, start).poses)
        theirs, by_gtsam = timed(
            lambda: gtsam_estimates.solve(the_world, conventions, method, start).poses
        )
    return taken, by_gtsam, float(np.abs(ours - theirs)[:, :2].max())


def print_all(conventions: Conventions) -> None:
    """A line for each method, on ten worlds with two and with four wrong labels in ten."""
    print("batch estimate      ours ms  GTSAM ms  ratio  largest difference, m")
    for p in (0.2, 0.4):
        for name, rows in compare(Scenario(), conventions, p, range(100, 110)).items():
            ours, theirs = 1e3 * rows[:, :2].mean(axis=0)
            numbers = f"{ours:7.2f} {theirs:9.2f} {theirs / ours:6.1f}  {rows[:, 2].max():.1e}"
            print(f"{name:14s} p={p} {numbers}")
