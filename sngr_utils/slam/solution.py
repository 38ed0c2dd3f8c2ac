"""An estimate with the graph it solves, and its poses and landmarks as arrays."""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X


@dataclass(frozen=True)
class Solution:
    """An estimate and the graph it solves.

    Attributes
    ----------
    isam : the iSAM2 object after the last update; None for a batch estimate
    graph : all factors, in the order they were added
    estimate : MAP values of all variables
    n_poses, n_landmarks : T and K of the world; a landmark may be absent from `estimate`
    """

    isam: gtsam.ISAM2 | None
    graph: gtsam.NonlinearFactorGraph
    estimate: gtsam.Values
    n_poses: int
    n_landmarks: int

    @property
    def poses(self) -> np.ndarray:
        """(T, 3), [m, m, rad]"""
        return poses_of(self.estimate, self.n_poses)

    @property
    def landmarks(self) -> np.ndarray:
        """(K, 2), [m]; NaN where a landmark was never started"""
        return landmarks_of(self.estimate, self.n_landmarks)


def pose_vector(pose: gtsam.Pose2) -> np.ndarray:
    """(3,) [x, y, theta] of a pose, [m, m, rad]"""
    return np.array([pose.x(), pose.y(), pose.theta()])


def poses_of(values: gtsam.Values, n_poses: int) -> np.ndarray:
    """(T, 3) poses X(0) ... X(T-1) of `values`, [m, m, rad]"""
    return np.array([pose_vector(values.atPose2(X(t))) for t in range(n_poses)])


def landmarks_of(values: gtsam.Values, n_landmarks: int) -> np.ndarray:
    """(K, 2) landmarks L(0) ... L(K-1) of `values`, [m]; NaN where one is absent"""
    rows = [
        values.atPoint2(L(k)) if values.exists(L(k)) else (np.nan, np.nan)
        for k in range(n_landmarks)
    ]
    return np.array(rows)


def values_of(poses: np.ndarray, landmarks: np.ndarray) -> gtsam.Values:
    """Poses and the landmarks that are not NaN, as GTSAM's start."""
    values = gtsam.Values()
    for t, pose in enumerate(poses):
        values.insert(X(t), gtsam.Pose2(*pose))
    for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
        values.insert(L(k), landmarks[k])
    return values
