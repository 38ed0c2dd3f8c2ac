"""The linear problem behind a Gauss-Newton step, as the rows that GTSAM makes of a graph."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.slam import landmark_starts
from sngr_utils.slam.solution import Solution, values_of
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.simulation import World


def start_of(world: World) -> gtsam.Values:
    """Dead-reckoned poses, and each landmark from the first three of them that saw it."""
    poses = dead_reckoning(world.x0_mean, world.odometry)
    log = world.log([1.0, 1.0, 1.0])  # no start depends on the prior of the first pose
    return values_of(poses, landmark_starts.start_landmarks(log, poses, "first_poses"))


def variables(solution: Solution) -> list[int]:
    """Keys of all poses, then of the landmarks that were started: the order of the columns."""
    landmarks = [L(k) for k in range(solution.n_landmarks) if solution.estimate.exists(L(k))]
    return [X(t) for t in range(solution.n_poses)] + landmarks


def linearised(solution: Solution, values: gtsam.Values) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian (M, N) and right-hand side (M,) of all factors at `values`, each over its sigma.

    Columns are [x, y, theta] of each pose in its own frame and [x, y] of each landmark, see
    `variables`; rows stand in the order in which the factors were added.
    """
    ordering = gtsam.Ordering()
    for key in variables(solution):
        ordering.push_back(key)
    return solution.graph.linearize(values).jacobian(ordering)


def moved(solution: Solution, values: gtsam.Values, step: np.ndarray) -> gtsam.Values:
    """`values` after a step (N,) in the columns of `linearised`."""
    parts, at = gtsam.VectorValues(), 0
    for key in variables(solution):
        width = 3 if gtsam.Symbol(key).chr() == ord("x") else 2
        parts.insert(key, step[at : at + width])
        at += width
    return values.retract(parts)
