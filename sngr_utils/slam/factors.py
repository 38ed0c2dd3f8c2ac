"""The factors of the graph (section "Problem"): priors, odometry, ranges.

Keys are ``X(t)`` for poses (SE(2)) and ``L(k)`` for landmarks (R^2). GTSAM's tangent vectors of
a pose are [x, y, theta] in the pose's own body frame; every covariance here is in that frame
unless it says "world".
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.slam.conventions import Conventions
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario


def pose_prior(pose: np.ndarray, sigmas: list[float]) -> gtsam.PriorFactorPose2:
    """Prior factor on x_0 (paper, section "Problem")."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(sigmas))
    return gtsam.PriorFactorPose2(X(0), gtsam.Pose2(*pose), noise)


def odometry_factor(t: int, motion: np.ndarray, scenario: Scenario) -> gtsam.BetweenFactorPose2:
    """N(x_{t+1}; x_t (+) u_t, Sigma_u), u_t in the body frame of x_t (paper eq. "odometry")."""
    s = scenario
    sigmas = s.odometry_sigmas
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    return gtsam.BetweenFactorPose2(X(t), X(t + 1), gtsam.Pose2(*motion), noise)


def range_factor(t: int, k: int, distance: float, sigma: float) -> gtsam.RangeFactor2D:
    """N(z; ||x_t.xy - l_k||, sigma^2), a circle about the landmark (paper eq. "range")."""
    return gtsam.RangeFactor2D(X(t), L(k), distance, gtsam.noiseModel.Isotropic.Sigma(1, sigma))


def landmark_prior(k: int, position: np.ndarray, sigma: float) -> gtsam.PriorFactorPoint2:
    """Weak prior on landmark k, centred where it was started."""
    return gtsam.PriorFactorPoint2(L(k), position, gtsam.noiseModel.Isotropic.Sigma(2, sigma))


def sure_factors(
    the_world: simulation.World, conventions: Conventions, landmarks: np.ndarray
) -> gtsam.NonlinearFactorGraph:
    """The factors that cannot be outliers: x0 prior, odometry, weak landmark priors.

    The last are centred on the (K, 2) `landmarks`, [m]; there is none where that is NaN.
    """
    factors = gtsam.NonlinearFactorGraph()
    factors.push_back(pose_prior(the_world.x0_mean, conventions.x0_sigmas))
    for t, motion in enumerate(the_world.odometry):
        factors.push_back(odometry_factor(t, motion, the_world.scenario))
    for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
        sigma = conventions.landmark_prior_sigma
        factors.push_back(landmark_prior(k, landmarks[k], sigma))
    return factors


def range_factors(the_world: simulation.World) -> gtsam.NonlinearFactorGraph:
    """All ranges, by label."""
    factors, sigma = gtsam.NonlinearFactorGraph(), the_world.scenario.range_sigma
    for t, k, distance in zip(the_world.pose_of, the_world.label_of, the_world.ranges, strict=True):
        factors.push_back(range_factor(int(t), int(k), distance, sigma))
    return factors


def range_derivatives(
    poses: np.ndarray, landmarks: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances between poses and landmarks, and their derivatives, of arrays that broadcast.

    The residual of a range factor is this distance less the measured one. `information` has the
    same compiled, for one pair at a time.

    Parameters
    ----------
    poses : (..., 3), [m, m, rad]
    landmarks : (..., 2), [m]

    Returns
    -------
    distances : (...), [m]
    by_pose : (..., 2) by the position in the pose's own body frame; by the heading it is 0
    by_landmark : (..., 2) the unit vector from the pose to the landmark
    """
    offsets = landmarks - poses[..., :2]
    distances = np.linalg.norm(offsets, axis=-1)
    ahead = offsets / distances[..., None]
    cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y = ahead[..., 0], ahead[..., 1]
    return distances, np.stack([-cos * x - sin * y, sin * x - cos * y], axis=-1), ahead
