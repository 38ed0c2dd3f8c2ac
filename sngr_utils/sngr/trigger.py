"""The trigger: the score of a window, and whether it fires (section "Trigger")."""

import numpy as np

from sngr_utils.sngr.windows import WIDTH

FIRST_ELIGIBLE = WIDTH - 1  # the paper's "t >= W - 1"


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


def triggers(window_scores: np.ndarray, tau: float) -> np.ndarray:
    """(N,) bool: score above tau and t >= W - 1 (paper, Algorithm 1).

    So the first two windows never trigger: of 28 windows, 26 can.
    """
    eligible = np.arange(len(window_scores)) >= FIRST_ELIGIBLE
    return (window_scores > tau) & eligible
