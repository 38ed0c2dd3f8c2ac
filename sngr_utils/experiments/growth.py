"""How the time of the marginals grows with the length of the trajectory."""

from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np

from sngr_utils.experiments.engine_bench import FactorLoop, spread_evenly, timed
from sngr_utils.slam import selected_inverse
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import range_factors, sure_factors
from sngr_utils.slam.isam2 import run_isam2
from sngr_utils.slam.marginals import gtsam_marginals, joint_covariance
from sngr_utils.slam.solution import Solution, values_of
from sngr_utils.sngr import windows
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import World, simulate

# What is timed, and up to how many poses.
GROWTH = {
    "iSAM2, pose by pose": 1000,
    "all factors one by one, once": 3000,
    "marginals, GTSAM, asked anew for each window": 3000,
    "marginals, GTSAM": 3000,
    "marginals, selected inverse": 30_000,
}
SAMPLED_WINDOWS = 3  # behind the row that is asked anew for each window


@dataclass(frozen=True)
class Growth:
    """CPU time against the number of poses.

    Attributes
    ----------
    lengths : (n,) numbers of poses
    seconds : name -> (n,) CPU time, NaN where it was not measured, [s]
    """

    lengths: np.ndarray
    seconds: dict[str, np.ndarray]

    def slope(self, name: str) -> float:
        """Fitted slope of log time against log length."""
        known = np.isfinite(self.seconds[name])
        logs = np.log(self.lengths[known]), np.log(self.seconds[name][known])
        return float(np.polyfit(*logs, 1)[0]) if known.sum() > 1 else float("nan")


def long_world(n_poses: int, scenario: Scenario, *, rng: np.random.Generator) -> World:
    """A clean world of any length whose steps are as long as those of `scenario`."""
    times = n_poses / scenario.n_poses
    longer = {"n_poses": n_poses, "radius": scenario.radius * times,
              "landmark_half_width": scenario.landmark_half_width * times}  # fmt: skip
    return simulate(scenario.model_copy(update=longer), 0.0, rng=rng)


def growth(lengths: list[int], scenario: Scenario, conventions: Conventions, seed: int) -> Growth:
    """Time iSAM2, the literal closure and the window marginals at every length.

    Linearised at the truth, which is as good as any point for a time.
    """
    seconds = {name: np.full(len(lengths), np.nan) for name in GROWTH}
    for i, n_poses in enumerate(lengths):
        the_world = long_world(n_poses, scenario, rng=np.random.default_rng(seed))
        works = _works(the_world, conventions)
        for name, limit in GROWTH.items():
            if n_poses <= limit:
                seconds[name][i] = works[name]()
    return Growth(np.array(lengths), seconds)


def _works(the_world: World, conventions: Conventions) -> dict[str, Callable[[], float]]:
    """Name -> a function that times one entry of `GROWTH` on this world, [s]."""

    def best(work, repeats=3):
        return min(timed(work)[1] for _ in range(repeats))

    def at_truth():
        return _solution_at_truth(the_world, conventions)

    def anew():
        solution, n = at_truth(), windows.n_windows(the_world.n_poses)
        some = spread_evenly(min(SAMPLED_WINDOWS, n), n)
        each = [
            best(lambda t=t: joint_covariance(
                gtsam_marginals(solution), windows.window_keys(t)), 1)
            for t in some
        ]  # fmt: skip
        return n * float(np.mean(each))

    def one_by_one():
        solution = at_truth()
        loop = FactorLoop(solution.graph)
        return best(lambda: loop.error(solution.estimate))

    def selected():
        selected_inverse_at_truth(the_world, conventions)  # compile, or load what was compiled
        return best(lambda: selected_inverse_at_truth(the_world, conventions))

    def together():
        solution = at_truth()
        return best(lambda: windows.covariances(solution), 1 if the_world.n_poses > 300 else 3)

    return dict(zip(GROWTH, (
        lambda: best(lambda: run_isam2(the_world, conventions), 1),
        one_by_one, anew, together, selected,
    ), strict=True))  # fmt: skip


def selected_inverse_at_truth(the_world: World, conventions: Conventions) -> np.ndarray:
    """(T-2, 9, 9) window marginals of the whole graph, linearised at the truth."""
    places = the_world.poses, the_world.landmarks
    return selected_inverse.covariance_at(*places, the_world, conventions).windows


def _solution_at_truth(the_world: World, conventions: Conventions) -> Solution:
    """The whole graph with the truth for its estimate; no iSAM2."""
    factors = sure_factors(the_world, conventions, the_world.landmarks)
    factors.push_back(range_factors(the_world))
    values = values_of(the_world.poses, the_world.landmarks)
    return Solution(
        gtsam.ISAM2(), factors, values, the_world.n_poses, the_world.n_landmarks
    )  # fmt: skip
