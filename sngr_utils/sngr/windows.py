"""Windows of three consecutive poses."""

import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.slam.marginals import gtsam_marginals, joint_covariance
from sngr_utils.slam.solution import Solution

WIDTH = 3  # poses in a window, W in the paper


def window_keys(t: int) -> list[int]:
    """Keys of the window w(t) = {x_t, x_{t+1}, x_{t+2}}."""
    return [X(t + i) for i in range(WIDTH)]


def n_windows(n_poses: int) -> int:
    """T - W + 1."""
    return n_poses - WIDTH + 1


def means(values: np.ndarray) -> np.ndarray:
    """(T-W+1,) means of (T,) values over the poses of each window."""
    return np.convolve(values, np.full(WIDTH, 1 / WIDTH), mode="valid")


def counts(values: np.ndarray) -> np.ndarray:
    """(T-W+1,) int: sums of (T,) counts over the poses of each window."""
    return np.convolve(values, np.ones(WIDTH, dtype=int), mode="valid")


def covariances(solution: Solution) -> np.ndarray:
    """(T-W+1, 9, 9) joint marginal covariance Sigma_w of every window."""
    all_marginals = gtsam_marginals(solution)
    return np.array([
        joint_covariance(all_marginals, window_keys(t)) for t in range(n_windows(solution.n_poses))
    ])
