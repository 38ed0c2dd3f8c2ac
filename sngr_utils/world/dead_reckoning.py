"""Motion in SE(2): relative motion, dead reckoning, and how uncertain it is."""

import numpy as np

from sngr_utils.world.scenario import Scenario


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """Angle in [-pi, pi), [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def relative_motion(poses: np.ndarray) -> np.ndarray:
    """(T-1, 3) motion between consecutive poses, in the body frame of the first of each pair."""
    step = np.diff(poses, axis=0)
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    dx = cos * step[:, 0] + sin * step[:, 1]
    dy = -sin * step[:, 0] + cos * step[:, 1]
    return np.column_stack([dx, dy, wrap_angle(step[:, 2])])


def dead_reckoning(start: np.ndarray, odometry: np.ndarray) -> np.ndarray:
    """(T, 3) poses that the measured odometry alone leads to from the pose `start`."""
    poses = [np.asarray(start, dtype=float)]
    for dx, dy, dtheta in odometry:
        x, y, theta = poses[-1]
        cos, sin = np.cos(theta), np.sin(theta)
        poses.append(np.array([x + cos * dx - sin * dy, y + sin * dx + cos * dy, theta + dtheta]))
    poses = np.array(poses)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def dead_reckoning_variances(poses: np.ndarray, scenario: Scenario) -> np.ndarray:
    """(T,) variance of each dead-reckoned position about the first pose, [m^2], mean of x and y.

    To first order: every step adds its own variance, and its heading error turns all that
    follows about its end. What is turned moves across the line between the two places, so half
    of that goes to each axis on average.

    Parameters
    ----------
    poses : (T, 3), [m, m, rad]
    """
    steps = np.arange(len(poses))
    places = poses[:, :2] - poses[0, :2]  # about the first, so that little cancels below
    squares = np.sum(places**2, axis=1)
    along = np.sum(places * np.cumsum(places, axis=0), axis=1)
    # the sum of |x_t - x_s|^2 over the ends s = 1 ... t of the steps, multiplied out
    turned = np.maximum(steps * squares - 2 * along + np.cumsum(squares), 0.0)
    return steps * scenario.odometry_sigma_xy**2 + 0.5 * scenario.odometry_sigma_theta**2 * turned


def rigid_covariances(poses: np.ndarray, x0_sigmas: list[float]) -> np.ndarray:
    """(T, 2, 2) covariance of positions that move rigidly with the first pose, [m^2].

    Parameters
    ----------
    poses : (T, 3), [m, m, rad]
    x0_sigmas : (3,) of the first pose in its body frame, [m, m, rad]
    """
    cos, sin = np.cos(poses[0, 2]), np.sin(poses[0, 2])
    by_x0 = np.zeros((len(poses), 2, 3))
    by_x0[:, :, :2] = [[cos, -sin], [sin, cos]]
    by_x0[:, 0, 2], by_x0[:, 1, 2] = -(poses - poses[0])[:, 1], (poses - poses[0])[:, 0]
    scaled = by_x0 * np.asarray(x0_sigmas)
    return scaled @ scaled.transpose(0, 2, 1)
