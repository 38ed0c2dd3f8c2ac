"""Windows of three consecutive poses: their score, their failure, the factors around them."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.slam.marginals import gtsam_marginals, joint_covariance
from sngr_utils.slam.solution import Solution

WIDTH = 3  # poses in a window, W in the paper
FAILURE_ERROR = 0.5  # m, mean position error above which a window has failed
FIRST_ELIGIBLE = WIDTH - 1  # the paper's "t >= W - 1"


def window_keys(t: int) -> list[int]:
    """Keys of the window w(t) = {x_t, x_{t+1}, x_{t+2}}."""
    return [X(t + i) for i in range(WIDTH)]


def n_windows(n_poses: int) -> int:
    """T - W + 1."""
    return n_poses - WIDTH + 1


def score(covariance: np.ndarray) -> float:
    """log10 of the condition number of a (D, D) covariance (paper eq. "score").

    Not invariant to units: a pose mixes metres and radians.
    """
    eigenvalues = np.linalg.eigvalsh(covariance)
    return float(np.log10(eigenvalues[-1] / eigenvalues[0]))


def in_units(covariances: np.ndarray, per_metre: float) -> np.ndarray:
    """(..., 9, 9) window covariances with positions in another unit, `per_metre` to the metre.

    Headings stay in radians: 100 gives [cm, cm, rad] per pose.
    """
    scale = np.tile([per_metre, per_metre, 1.0], WIDTH)
    return covariances * np.outer(scale, scale)


def log_extremes(covariances: np.ndarray) -> np.ndarray:
    """(..., 2) log10 of lambda_min and lambda_max of (..., D, D) covariances.

    The score is their difference (paper eq. "score").
    """
    return np.log10(np.linalg.eigvalsh(covariances)[..., [0, -1]])


def position_sigma(tau: float, log_lambda_min: float) -> float:
    """The position standard deviation of a pose that `tau` stands for, about, [m].

    With lambda_min fixed by the odometry, score > tau is lambda_max > 10^(tau + log_lambda_min).
    The largest direction moves the window's poses together, so its variance is nearly WIDTH
    times that of one pose along the direction in which it is least certain.

    Parameters
    ----------
    tau : threshold on the score with positions in metres
    log_lambda_min : log10 of the smallest eigenvalue, a heading difference, [rad^2]
    """
    return float(np.sqrt(10 ** (tau + log_lambda_min) / WIDTH))


def covariances(solution: Solution) -> np.ndarray:
    """(T-W+1, 9, 9) joint marginal covariance Sigma_w of every window."""
    all_marginals = gtsam_marginals(solution)
    return np.array([
        joint_covariance(all_marginals, window_keys(t)) for t in range(n_windows(solution.n_poses))
    ])


def triggers(window_scores: np.ndarray, tau: float) -> np.ndarray:
    """(N,) bool: score above tau and t >= W - 1 (paper, Algorithm 1).

    So the first two windows never trigger: of 28 windows, 26 can.
    """
    eligible = np.arange(len(window_scores)) >= FIRST_ELIGIBLE
    return (window_scores > tau) & eligible


def failures(position_errors: np.ndarray) -> np.ndarray:
    """(T-W+1,) bool: mean position error over the window's poses above 0.5 m.

    Parameters
    ----------
    position_errors : (T,) distance of each estimated pose to the truth, [m]
    """
    means = np.convolve(position_errors, np.full(WIDTH, 1 / WIDTH), mode="valid")
    return means > FAILURE_ERROR


def touching_factors(
    graph: gtsam.NonlinearFactorGraph, keys: list[int]
) -> gtsam.NonlinearFactorGraph:
    """The factors with at least one of `keys`: all that change when the window moves."""
    index, subset = gtsam.VariableIndex(graph), gtsam.NonlinearFactorGraph()
    for i in sorted({i for key in keys for i in index.at(key)}):
        subset.push_back(graph.at(i))
    return subset


def conditional_covariance(
    graph: gtsam.NonlinearFactorGraph, estimate: gtsam.Values, keys: list[int]
) -> np.ndarray:
    """(9, 9) covariance of a window with all other variables held, linearised at `estimate`.

    The inverse of the window's block of the information matrix; in the body-frame tangent.
    """
    factors, ordering = touching_factors(graph, keys), gtsam.Ordering()
    held = [key for key in factors.keyVector() if key not in keys]
    for key in [*keys, *held]:
        ordering.push_back(key)
    jacobian, _ = factors.linearize(estimate).jacobian(ordering)
    own = jacobian[:, : 3 * len(keys)]
    return np.linalg.inv(own.T @ own)


def closure(graph: gtsam.NonlinearFactorGraph, keys: list[int]) -> set[int]:
    """Closure C_w: all variables joined to `keys` by factors, to a fixed point.

    In a connected graph this is every variable, whatever the window.
    """
    neighbours: dict[int, set[int]] = {}
    for i in range(graph.size()):
        factor_keys = graph.at(i).keys()
        for key in factor_keys:
            neighbours.setdefault(key, set()).update(factor_keys)
    closed, frontier = set(keys), list(keys)
    while frontier:
        new = neighbours.get(frontier.pop(), set()) - closed
        closed |= new
        frontier.extend(new)
    return closed
