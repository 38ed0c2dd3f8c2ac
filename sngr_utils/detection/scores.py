"""Scores of windows: what may tell that an estimate has failed, without knowing the truth.

Each function gives (N,) scores, one for each window of three poses; higher is more suspicious.
The chi-square of the ranges is in `leverage`.
"""

import numpy as np

from sngr_utils.detection import mirror_image
from sngr_utils.slam.selected_inverse import ChainCovariance
from sngr_utils.sngr import failure, trigger, windows
from sngr_utils.sngr.windows import WIDTH, n_windows
from sngr_utils.world.simulation import World

# score -> what it asks
SCORES = {
    "condition": "the paper's: log10 of the condition number of Sigma_w",
    "eigenvalue": "log10 of the largest variance of the window's positions, [m^2]",
    "chi_square": "do the window's ranges fit the plain estimate? -log10 of the p-value",
    "either": "condition number or chi-square, -log10 of a joint p-value",
    "chi_square_robust": "do they fit the robust estimate? -log10 of the p-value",
    "mirror": "could a landmark it sees be on the other side? weight of the mirror image",
    "disagreement": "distance between the plain and the robust estimate, [m]",
    "disagreement_sigmas": "the same beyond the failure limit, in its own standard deviations",
}


def largest_eigenvalue(covariances: np.ndarray) -> np.ndarray:
    """(N,) log10 of the largest eigenvalue of the windows' position covariances, [m^2].

    Unlike the condition number it has a unit, and no heading in it.

    Parameters
    ----------
    covariances : (N, 9, 9), [m, m, rad] per pose
    """
    places = np.setdiff1d(np.arange(3 * WIDTH), np.arange(2, 3 * WIDTH, 3))
    return trigger.log_extremes(covariances[:, places[:, None], places])[:, 1]


def disagreement(poses: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(N,) mean distance over a window's poses between two estimates (T, 3), [m].

    The same mean that makes a failure of it (`failure.failures`) if the reference is the truth.
    """
    return windows.means(np.linalg.norm((poses - reference)[:, :2], axis=1))


def disagreement_sigmas(
    poses: np.ndarray, reference: np.ndarray, covariance: ChainCovariance
) -> np.ndarray:
    """(N,) by how many standard deviations the disagreement exceeds the failure limit of 0.5 m.

    The plain estimate's error is its distance to the truth, and the truth is scattered about
    the reference. Only the scatter along the line between the two changes that distance, to
    first order: (D - 0.5 m) / sigma_D, sigma_D^2 = g^T Sigma_w g with g the gradient of D.

    Parameters
    ----------
    poses, reference : (T, 3), the plain and the robust estimate, [m, m, rad]
    covariance : of the reference, see `selected_inverse`
    """
    offset = (poses - reference)[:, :2]
    distance = np.linalg.norm(offset, axis=1)
    apart = distance > 0  # where they coincide any direction will do
    along = np.where(apart[:, None], offset, [1.0, 0.0]) / np.where(apart, distance, 1)[:, None]
    cos, sin = np.cos(reference[:, 2]), np.sin(reference[:, 2])
    body = np.column_stack([
        cos * along[:, 0] + sin * along[:, 1],
        -sin * along[:, 0] + cos * along[:, 1],
        np.zeros(len(along)),
    ])
    n = n_windows(len(poses))
    gradient = np.hstack([body[i : i + n] for i in range(WIDTH)]) / WIDTH
    variance = np.einsum("ni,nij,nj->n", gradient, covariance.windows, gradient)
    return (windows.means(distance) - failure.FAILURE_ERROR) / np.sqrt(variance)


def mirror_weight(world: World, poses: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """(N,) largest weight of the mirror image of a landmark that a window sees, in [0, 1].

    With the ranges up to the window's last pose, as one would ask while driving. Landmark and
    image weigh exp(-cost) each, so one half says that the ranges cannot tell them apart.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2) estimates, [m, m, rad] and [m]; NaN for absent ones
    """
    first = np.arange(n_windows(len(poses)))
    weights = np.zeros(len(first))
    variances = np.full(len(world.ranges), world.scenario.range_sigma**2)
    for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
        mine = world.label_of == k
        seen_from, ranges = world.pose_of[mine], world.ranges[mine]
        counts = np.searchsorted(seen_from, first + WIDTH)
        seen = np.flatnonzero(np.searchsorted(seen_from, first) < counts)  # by this window
        gaps = mirror_image.gaps(
            poses[seen_from, :2].copy(), ranges, variances, landmarks[k], counts[seen]
        )
        weights[seen] = np.maximum(weights[seen], 1 / (1 + np.exp(np.minimum(gaps, 700.0))))
    return weights


def either(*surprises: np.ndarray) -> np.ndarray:
    """(N,) -log10 of the joint p-value of several tests, any of which may fire (their OR).

    The smallest p-value times the number of tests: firing at it below alpha is firing where any
    single one is below alpha over their number, and has at most rate alpha however they depend.

    Parameters
    ----------
    surprises : (N,) each, -log10 of valid p-values

    Source: Bonferroni's inequality.
    """
    return np.maximum(np.max(surprises, axis=0) - np.log10(len(surprises)), 0.0)
