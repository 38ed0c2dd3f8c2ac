"""Motion in SE(2): relative motion, dead reckoning, and how uncertain it is."""

import numpy as np


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


def dead_reckoning_variances(poses: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(T,) variance of each dead-reckoned position about the first pose, [m^2], mean of x and y.

    To first order: every step adds its own variance, and its heading error turns all that
    follows about its end. What is turned moves across the line between the two places, so half
    of that goes to each axis on average.

    Parameters
    ----------
    poses : (T, 3), [m, m, rad]
    covariances : (T-1, 3, 3) of each step, or (3, 3) of every one, in units of m and rad
    """
    covariances = np.broadcast_to(covariances, (len(poses) - 1, 3, 3))
    along = np.append(0.0, np.trace(covariances[:, :2, :2], axis1=1, axis2=2) / 2)
    turns = np.append(0.0, covariances[:, 2, 2])
    places = poses[:, :2] - poses[0, :2]  # about the first, so that little cancels below
    squares = np.sum(places**2, axis=1)
    crossed = np.sum(places * np.cumsum(turns[:, None] * places, axis=0), axis=1)
    # the sum of turns_s |x_t - x_s|^2 over the ends s = 1 ... t of the steps, multiplied out
    turned = np.cumsum(turns) * squares - 2 * crossed + np.cumsum(turns * squares)
    return np.cumsum(along) + 0.5 * np.maximum(turned, 0.0)


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
