"""The incremental iSAM2 run of the paper."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.slam import indeterminate
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import landmark_prior, odometry_factor, pose_prior, range_factor
from sngr_utils.slam.landmark_starts import START_AFTER, start_landmark
from sngr_utils.slam.solution import Solution, pose_vector
from sngr_utils.world.simulation import World


def run_isam2(world: World, conventions: Conventions) -> Solution:
    """Feed the world to iSAM2 pose by pose, one update per pose (paper, Algorithm 1, line 1).

    Poses start from the last estimate and the odometry. A landmark is initialised when three
    distinct poses have seen it (or something attached to it): it starts from those three ranges,
    gets its weak prior, and its delayed factors enter the graph.

    Raises
    ------
    ValueError : a landmark or pose that the data leave open, with its ranges

    Source: Kaess et al., IJRR 31 (2012) 216.
    """
    params = gtsam.ISAM2Params()
    params.setRelinearizeThreshold(conventions.relinearize_threshold)
    params.relinearizeSkip = conventions.relinearize_skip
    isam, graph = gtsam.ISAM2(params), gtsam.NonlinearFactorGraph()
    estimate = gtsam.Values()
    waiting: dict[int, list[tuple[int, float]]] = {}

    for t in range(world.n_poses):
        factors, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
        if t == 0:
            factors.push_back(pose_prior(world.x0_mean, conventions.x0_sigmas))
            new_pose = gtsam.Pose2(*world.x0_mean)
        else:
            motion = world.odometry[t - 1]
            factors.push_back(odometry_factor(t - 1, motion, world.scenario))
            new_pose = estimate.atPose2(X(t - 1)).compose(gtsam.Pose2(*motion))
        start.insert(X(t), new_pose)
        estimate.insert(X(t), new_pose)
        for m in np.flatnonzero(world.pose_of == t):
            k, distance = int(world.label_of[m]), float(world.ranges[m])
            if estimate.exists(L(k)):
                factors.push_back(range_factor(t, k, distance, world.scenario.range_sigma))
                continue
            waiting.setdefault(k, []).append((t, distance))
            if len({s for s, _ in waiting[k]}) == START_AFTER:
                position = _start_from_waiting(waiting[k], estimate)
                start.insert(L(k), position)
                estimate.insert(L(k), position)
                factors.push_back(landmark_prior(k, position, conventions.landmark_prior_sigma))
                for s, waited in waiting.pop(k):
                    factors.push_back(range_factor(s, k, waited, world.scenario.range_sigma))
        graph.push_back(factors)
        with indeterminate.named(graph, estimate):
            isam.update(factors, start)
        estimate = isam.calculateEstimate()
    return Solution(isam, graph, estimate, world.n_poses, world.n_landmarks)


def _start_from_waiting(waiting: list[tuple[int, float]], estimate: gtsam.Values) -> np.ndarray:
    """Initialise a landmark from the first range of each distinct pose that has seen it."""
    first = {}
    for t, distance in waiting:
        first.setdefault(t, distance)
    positions = np.array([pose_vector(estimate.atPose2(X(t)))[:2] for t in first])
    return start_landmark(positions, np.array(list(first.values())))
