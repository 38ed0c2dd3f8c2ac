"""The trigger: the score of a window, and whether it fires (section "Trigger")."""

import numpy as np

from sngr_utils.sngr.windows import WIDTH

FIRST_ELIGIBLE = WIDTH - 1  # the paper's "t >= W - 1"


def score(covariances: np.ndarray) -> np.ndarray:
    """(...,) log10 of the condition numbers of (..., D, D) covariances (paper eq. "score").

    Not invariant to units: a pose mixes metres and radians.
    """
    eigenvalues = np.linalg.eigvalsh(covariances)
    return np.log10(eigenvalues[..., -1] / eigenvalues[..., 0])


def in_units(covariances: np.ndarray, per_metre: float) -> np.ndarray:
    """(..., 9, 9) window covariances with positions in another unit, `per_metre` to the metre.

    Headings stay in radians: 100 gives [cm, cm, rad] per pose.
    """
    scale = np.tile([per_metre, per_metre, 1.0], WIDTH)
    return covariances * np.outer(scale, scale)


def log_extremes(covariances: np.ndarray) -> np.ndarray:
    """(..., 2) log10 of lambda_min and lambda_max of (..., D, D) covariances.

    Their difference is the `score`.
    """
    return np.log10(np.linalg.eigvalsh(covariances)[..., [0, -1]])


def triggers(window_scores: np.ndarray, tau: float) -> np.ndarray:
    """(N,) bool: score above tau and t >= W - 1 (paper, Algorithm 1).

    So the first two windows never trigger: of 28 windows, 26 can.
    """
    eligible = np.arange(len(window_scores)) >= FIRST_ELIGIBLE
    return (window_scores > tau) & eligible


def regardless(window_scores: np.ndarray, which: int | list[int] | slice) -> np.ndarray:
    """(N,) bool: the windows `which`, whatever their scores."""
    fires = np.zeros(len(window_scores), dtype=bool)
    fires[which] = True
    return fires
