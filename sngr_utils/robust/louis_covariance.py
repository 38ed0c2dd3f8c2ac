"""Louis' covariance: what an EM estimate knows, less what the associations leave open."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from scipy import linalg

from sngr_utils.robust.association import NEGLIGIBLE, weighted_factors
from sngr_utils.slam import solution
from sngr_utils.world import simulation

MOST_MISSING = 0.9  # of the information in any direction, see `position_covariances`


def position_covariances(
    sure: gtsam.NonlinearFactorGraph,
    the_world: simulation.World,
    poses: np.ndarray,
    landmarks: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """(T, 2, 2) position covariances in the world frame, [m^2], associations integrated out.

    The information is that of the weighted graph less what the unknown associations withhold,
    the covariance of its score over them, range by range. Where they withhold more than 90 % in
    a direction, the posterior is no Gaussian about this estimate, and 10 % are kept.

    Source: Louis, JRSS B 44, 1982.
    """
    ordering = gtsam.Ordering()
    present = np.flatnonzero(np.isfinite(landmarks[:, 0]))
    for key in [*(X(t) for t in range(len(poses))), *(L(int(k)) for k in present)]:
        ordering.push_back(key)
    factors = weighted_factors(sure, the_world, weights, 1.0)
    jacobian, _ = factors.linearize(solution.values_of(poses, landmarks)).jacobian(ordering)
    complete = jacobian.T @ jacobian
    missing = _missing_information(the_world, poses, landmarks, present, weights)
    if missing.any():
        share, directions = linalg.eigh(missing, complete)  # their complete information is 1
        scaled = directions / np.sqrt(1 - np.clip(share, 0, MOST_MISSING))
        covariance = scaled @ scaled.T
    else:
        covariance = linalg.inv(complete)
    blocks = []
    for t, heading in enumerate(poses[:, 2]):
        cos, sin = np.cos(heading), np.sin(heading)
        rotation = np.array([[cos, -sin], [sin, cos]])
        body = covariance[3 * t : 3 * t + 2, 3 * t : 3 * t + 2]
        blocks.append(rotation @ body @ rotation.T)
    return np.array(blocks)


def _missing_information(
    the_world: simulation.World,
    poses: np.ndarray,
    landmarks: np.ndarray,
    present: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """(D, D) covariance of the score over the associations; poses first, then landmarks."""
    size = 3 * len(poses) + 2 * len(present)
    missing = np.zeros((size, size))
    open_ranges = np.flatnonzero(weights[:, :-1].max(axis=1) < 1 - NEGLIGIBLE)
    for m in open_ranges:
        t, mine = int(the_world.pose_of[m]), weights[m, present]
        offset = poses[t, :2] - landmarks[present]  # (P, 2)
        distance = np.linalg.norm(offset, axis=1)
        unit = offset / distance[:, None]
        cos, sin = np.cos(poses[t, 2]), np.sin(poses[t, 2])
        slope = (the_world.ranges[m] - distance) / the_world.scenario.range_sigma**2
        scores = np.zeros((len(present), size))
        scores[:, 3 * t : 3 * t + 2] = unit @ np.array([[cos, -sin], [sin, cos]])
        for row in range(len(present)):
            scores[row, 3 * len(poses) + 2 * row :][:2] = -unit[row]
        scores *= slope[:, None]
        mean = mine @ scores
        missing += scores.T @ (mine[:, None] * scores) - np.outer(mean, mean)
    return missing
