"""Errors of an estimate: RMSE, and NEES, which holds them against its covariance."""

import math

import numpy as np


def rmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square distance between two (N, 2) sets of positions, [m].

    Rows that are NaN in `estimate` (landmarks that were never started) are left out; NaN if
    nothing is left. No alignment: the first pose's prior fixes the frame.
    """
    squared = np.sum((np.asarray(estimate) - np.asarray(truth)) ** 2, axis=1)
    squared = squared[np.isfinite(squared)]
    return float(np.sqrt(squared.mean())) if len(squared) else math.nan


def nees(errors: np.ndarray, covariances: np.ndarray) -> float:
    """Normalised estimation error squared, e^T P^-1 e, averaged over N poses.

    Its expectation is the dimension (2 for positions) if the errors follow the covariances.

    Parameters
    ----------
    errors : (N, d), [m]
    covariances : (N, d, d), [m^2]

    Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
    Navigation, section 5.4.
    """
    solved = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    return float(np.mean(np.sum(errors * solved, axis=1)))
