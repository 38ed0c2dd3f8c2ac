"""EM over the batch: poses, landmarks and the share of wrong labels together.

The posterior of the associations alternates with a weighted least-squares estimate.
"""

from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np

from sngr_utils.robust import losses
from sngr_utils.robust.association import responsibilities, share_wrong, weighted_factors
from sngr_utils.robust.louis_covariance import position_covariances
from sngr_utils.slam import landmark_starts, solution
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import sure_factors
from sngr_utils.world import dead_reckoning, simulation

WIDEST = 6.0  # range sigmas that the annealed one starts with: a landmark start errs that much
COOLING = 0.7  # per iteration

ITERATIONS, SETTLED = 60, 1e-4  # of EM: at most, and when no position moves more, [m]


@dataclass(frozen=True)
class SoftEstimate:
    """What EM found. M ranges, K landmarks.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN where none was started
    weights : (M, K+1) posterior of each range's source, the last column "none of these"
    p : share of wrong labels, estimated
    the_world, sure : what it was found from
    """

    poses: np.ndarray
    landmarks: np.ndarray
    weights: np.ndarray
    p: float
    the_world: simulation.World
    sure: gtsam.NonlinearFactorGraph

    @property
    def responsibilities(self) -> np.ndarray:
        """(M, K) posterior that a range came from a landmark"""
        return self.weights[:, :-1]

    @cached_property
    def position_covariances(self) -> np.ndarray:
        """(T, 2, 2) in the world frame, [m^2], with what the associations leave open"""
        return position_covariances(
            self.sure, self.the_world, self.poses, self.landmarks, self.weights
        )


def estimate(
    the_world: simulation.World, conventions: Conventions, start: str, exclusive: bool
) -> SoftEstimate:
    """EM over the batch from dead reckoning, landmarks started as `start` says.

    Parameters
    ----------
    start : one of `landmark_starts.STARTS`
    exclusive : whether the ranges of one pose come from different landmarks

    Raises
    ------
    ValueError : unknown start
    """
    if start not in landmark_starts.STARTS:
        raise ValueError(f"start is {start!r}: it must be one of {sorted(landmark_starts.STARTS)}")
    poses = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
    landmarks = landmark_starts.start_landmarks(the_world, poses, start)
    return fit(the_world, conventions, (poses, landmarks), exclusive)


def fit(
    the_world: simulation.World,
    conventions: Conventions,
    start: losses.Estimate,
    exclusive: bool,
    widest: float = WIDEST,
    sure: gtsam.NonlinearFactorGraph | None = None,
) -> SoftEstimate:
    """EM from the poses and landmarks of `start`, the range sigma annealed from `widest` times.

    Each iteration: responsibilities at the present estimate, p from them (Jeffreys' prior), then
    Levenberg-Marquardt on ranges weighted by them. A wide sigma at first lets a range look
    beyond the landmark that a bad start makes likely.

    Parameters
    ----------
    sure : the factors that are not doubted; None for those of `factors.sure_factors`

    Source: Dempster, Laird, Rubin, JRSS B 39, 1977; soft association in SLAM: Bowman et al.,
    ICRA 2017; annealing: Ueda, Nakano, Neural Networks 11, 1998.
    """
    poses, landmarks = start[0].copy(), start[1].copy()
    sure = sure or sure_factors(the_world, conventions, landmarks)
    p, width = 0.5, widest
    for _ in range(ITERATIONS):
        weights = responsibilities(the_world, poses, landmarks, p, width, exclusive)
        p = share_wrong(weights, the_world.label_of)
        factors = weighted_factors(sure, the_world, weights, width)
        moved_poses, moved_landmarks = _optimise(factors, poses, landmarks)
        moved = np.abs(moved_poses[:, :2] - poses[:, :2]).max()
        poses, landmarks = moved_poses, moved_landmarks
        if width == 1.0 and moved < SETTLED:
            break
        width = max(1.0, COOLING * width)
    return SoftEstimate(poses, landmarks, weights, p, the_world, sure)


def _optimise(
    factors: gtsam.NonlinearFactorGraph, poses: np.ndarray, landmarks: np.ndarray
) -> losses.Estimate:
    params = gtsam.LevenbergMarquardtParams.CeresDefaults()
    values = solution.values_of(poses, landmarks)
    result = gtsam.LevenbergMarquardtOptimizer(factors, values, params).optimize()
    return solution.poses_of(result, len(poses)), solution.landmarks_of(result, len(landmarks))
