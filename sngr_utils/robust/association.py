"""Data association: the posterior of which landmark a range came from.

A range is credited to a landmark, rightly with probability 1 - p, else it came from any other
landmark alike. Given distances that posterior is a softmax, range by range; if the ranges of one
scan come from different landmarks, it is a sum over all matchings of the scan.
"""

import gtsam
import numpy as np
from scipy import special

from sngr_utils.robust.mutual_exclusion import exclusive_posterior
from sngr_utils.slam.factors import range_factor
from sngr_utils.world import simulation

JEFFREYS = (0.5, 0.5)  # wrong and right labels that count as seen before the first
LOG_CLUTTER = -np.inf  # log density of a range from no landmark, [1/m]: there is none so far
NEGLIGIBLE = 1e-3  # responsibilities below it make no factor


def log_prior(labels: np.ndarray, n_landmarks: int, p: float) -> np.ndarray:
    """(N, K) log probability that a range came from each landmark, knowing its label only."""
    prior = np.full((len(labels), n_landmarks), np.log(p / (n_landmarks - 1)))
    prior[np.arange(len(labels)), labels] = np.log1p(-p)
    return prior


def posterior(log_weights: np.ndarray) -> np.ndarray:
    """(N, K+1) posterior of each range over K landmarks and "none of these", each on its own.

    Parameters
    ----------
    log_weights : (N, K+1) log of prior times likelihood, the last column that of "none"; -inf
        for what cannot be, but not all along a row
    """
    return special.softmax(log_weights, axis=1)


def responsibilities(
    the_world: simulation.World,
    poses: np.ndarray,
    landmarks: np.ndarray,
    p: float,
    width: float,
    exclusive: bool,
) -> np.ndarray:
    """(M, K+1) posterior of every range over landmarks and "none", at given places.

    A landmark that is absent (NaN) may be the source all the same; its ranges are uniform up to
    the longest there is, and its weight goes to "none".

    Parameters
    ----------
    p : probability of a wrong label, in (0, 1)
    width : of the range noise, in range sigmas
    """
    found = residuals(the_world, poses, landmarks)
    variances = np.full(found.shape, (width * the_world.scenario.range_sigma) ** 2)
    log_weights = log_joint(the_world, found, variances, p)
    if not exclusive:
        return posterior(log_weights)
    return exclusive_posterior(log_weights, the_world.pose_of)


def residuals(the_world: simulation.World, poses: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """(M, K) measured range less the distance to every landmark, [m]; NaN for a NaN landmark."""
    offsets = landmarks - poses[the_world.pose_of, None, :2]
    return the_world.ranges[:, None] - np.linalg.norm(offsets, axis=2)


def log_joint(
    the_world: simulation.World, residuals: np.ndarray, variances: np.ndarray, p: float
) -> np.ndarray:
    """(M, K+1) log of prior times likelihood of every range over landmarks and "none of these".

    "None" stands for landmarks that are not in the map, whose residuals are NaN: they may be the
    source all the same, of a range that is uniform up to the longest there is. And it stands for
    no landmark at all, with `LOG_CLUTTER`.

    Parameters
    ----------
    residuals, variances : (M, K), [m] and [m^2]
    p : probability of a wrong label
    """
    prior = log_prior(the_world.label_of, the_world.n_landmarks, p)
    absent = np.isnan(residuals).all(axis=0)
    joint = np.full((len(prior), prior.shape[1] + 1), LOG_CLUTTER)
    gaussian = -0.5 * (residuals**2 / variances + np.log(2 * np.pi * variances))
    joint[:, :-1] = np.where(absent, -np.inf, prior + gaussian)
    if absent.any():
        elsewhere = special.logsumexp(prior[:, absent], axis=1) - np.log(the_world.ranges.max())
        joint[:, -1] = np.logaddexp(LOG_CLUTTER, elsewhere)
    return joint


def share_wrong(weights: np.ndarray, labels: np.ndarray, prior: tuple = JEFFREYS) -> float:
    """Posterior mean of the share of wrong labels under a Beta prior.

    Parameters
    ----------
    weights : (M, K+1) posterior of every range's source
    prior : wrong and right labels that count as seen beforehand
    """
    right = weights[np.arange(len(labels)), labels].sum()
    return float((prior[0] + len(labels) - right) / (sum(prior) + len(labels)))


def weighted_factors(
    sure: gtsam.NonlinearFactorGraph, the_world: simulation.World, weights: np.ndarray, width: float
) -> gtsam.NonlinearFactorGraph:
    """The sure factors, and each range to each landmark by its responsibility."""
    factors = gtsam.NonlinearFactorGraph(sure)
    sigma = width * the_world.scenario.range_sigma
    for m, k in np.argwhere(weights[:, :-1] > NEGLIGIBLE):
        t, distance = int(the_world.pose_of[m]), the_world.ranges[m]
        factors.push_back(range_factor(t, k, distance, sigma / np.sqrt(weights[m, k])))
    return factors
