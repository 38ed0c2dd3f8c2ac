"""Rigid alignment of an estimated path with the true one: no scale, no mirror image."""

import numpy as np


def rigid(estimate: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (2, 2) and translation (2,) [m] that bring N positions nearest to the truth.

    Source: Umeyama, IEEE Transactions on Pattern Analysis 13, 1991, with a scale of one.
    """
    from_centre, to_centre = estimate.mean(axis=0), truth.mean(axis=0)
    left, _, right = np.linalg.svd((truth - to_centre).T @ (estimate - from_centre))
    turned = np.diag([1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ turned @ right
    return rotation, to_centre - rotation @ from_centre


def aligned_errors(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(N, 2) errors of positions after their rigid alignment, in the frame of the truth, [m]."""
    rotation, shift = rigid(estimate, truth)
    return estimate @ rotation.T + shift - truth


def aligned_rmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square of `aligned_errors` of N positions, [m]."""
    return float(np.sqrt(np.mean(np.sum(aligned_errors(estimate, truth) ** 2, axis=1))))


def incremental_rmse(estimate: np.ndarray, truth: np.ndarray, distance: float) -> float:
    """By how much `aligned_errors` of N positions change over a distance of the true way, [m].

    NaN where the way is shorter. Root mean square.
    """
    errors = aligned_errors(estimate, truth)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(truth, axis=0), axis=1)))
    ahead = np.searchsorted(way, way + distance)
    here = np.flatnonzero(ahead < len(way))
    changes = errors[ahead[here]] - errors[here]
    return float(np.sqrt(np.mean(np.sum(changes**2, axis=1)))) if len(here) else float("nan")
