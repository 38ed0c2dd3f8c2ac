"""Data association: the posterior of which landmark a range came from.

A range is clutter, from no landmark at all and uniform up to the longest there is; or it is from
the landmark of its label; or, the label being wrong, from any other landmark alike. Given
distances that posterior is a softmax, range by range; if the ranges of one scan come from
different landmarks, it is a sum over all matchings of the scan.
"""

from typing import NamedTuple

import numpy as np
from scipy import special

from sngr_utils.robust.mutual_exclusion import exclusive_posterior
from sngr_utils.world.log import NO_LABEL, Log

JEFFREYS = (0.5, 0.5)  # wrong and right labels that count as seen before the first
RARE = (0.5, 9.5)  # ranges from no landmark, and from one: one in twenty, and hardly known
NEGLIGIBLE = 1e-3  # responsibilities below it count for nothing


class Shares(NamedTuple):
    """How often what can go wrong does.

    Attributes
    ----------
    wrong : of the labels, among ranges that came from a landmark, in (0, 1)
    clutter : ranges that came from no landmark, of all, in [0, 1)
    """

    wrong: float
    clutter: float


def log_prior(log: Log, shares: Shares) -> np.ndarray:
    """(M, K+1) log probability of each source of a range, knowing its label only.

    The last column is "no landmark". A range without a label may be from any landmark alike.
    Label probabilities say which landmark the label may mean, and what they leave over is for
    none.
    """
    meant, wrong = _meant(log), shares.wrong if log.n_landmarks > 1 else 0.0
    total = meant.sum(axis=1, keepdims=True)
    source = (1 - wrong) * meant + wrong * (total - meant) / max(log.n_landmarks - 1, 1)
    none = shares.clutter + (1 - shares.clutter) * np.maximum(1 - total, 0)
    with np.errstate(divide="ignore"):
        return np.log(np.hstack([(1 - shares.clutter) * source, none]))


def _meant(log: Log) -> np.ndarray:
    """(M, K) probability of each landmark to be the one that the label means."""
    if log.label_probabilities is not None:
        return log.label_probabilities
    meant = np.full((len(log.ranges), log.n_landmarks), 1 / max(log.n_landmarks, 1))
    labelled = log.label_of != NO_LABEL
    meant[labelled] = np.eye(log.n_landmarks)[log.label_of[labelled]]
    return meant


def posterior(log_weights: np.ndarray) -> np.ndarray:
    """(N, K+1) posterior of each range over K landmarks and "none of these", each on its own.

    Parameters
    ----------
    log_weights : (N, K+1) log of prior times likelihood, the last column that of "none"; -inf
        for what cannot be, but not all along a row
    """
    return special.softmax(log_weights, axis=1)


def responsibilities(
    log: Log,
    poses: np.ndarray,
    landmarks: np.ndarray,
    shares: Shares,
    width: float,
    exclusive: bool,
    calibration: np.ndarray | None = None,
) -> np.ndarray:
    """(M, K+1) posterior of every range over landmarks and "none of these", at given places.

    Parameters
    ----------
    width : of the range noise, in range sigmas
    exclusive : no two ranges of a scan come from the same landmark
    calibration : as for `residuals`
    """
    found = residuals(log, poses, landmarks, calibration)
    variances = np.broadcast_to((width * log.range_sigmas[:, None]) ** 2, found.shape)
    log_weights = log_joint(log, found, variances, shares)
    if not exclusive:
        return posterior(log_weights)
    return exclusive_posterior(log_weights, log.pose_of)


def residuals(
    log: Log, poses: np.ndarray, landmarks: np.ndarray, calibration: np.ndarray | None = None
) -> np.ndarray:
    """(M, K) measured range less the one expected of every landmark, [m]; NaN for a NaN landmark.

    Parameters
    ----------
    calibration : (2,) range scale, and offset [m]; None for the means of the log's
    """
    scale, offset = (log.scale[0], log.offset[0]) if calibration is None else calibration
    distances = np.linalg.norm(landmarks - poses[log.pose_of, None, :2], axis=2)
    return log.ranges[:, None] - (scale * distances + offset)


def log_joint(log: Log, residuals: np.ndarray, variances: np.ndarray, shares: Shares) -> np.ndarray:
    """(M, K+1) log of prior times likelihood of every range over landmarks and "none of these".

    "None" stands for no landmark at all, and for those that are not in the map, whose residuals
    are NaN: they may be the source all the same. Either way the range is uniform up to the
    longest there is.

    Parameters
    ----------
    residuals, variances : (M, K), [m] and [m^2]
    """
    joint = log_prior(log, shares)
    absent = np.append(np.isnan(residuals).all(axis=0), True)
    elsewhere = special.logsumexp(joint[:, absent], axis=1) - np.log(_longest(log))
    joint[:, :-1] -= 0.5 * (residuals**2 / variances + np.log(2 * np.pi * variances))
    joint[:, absent] = -np.inf
    joint[:, -1] = elsewhere
    return joint


def _longest(log: Log) -> float:
    """The longest range, [m]; of no matter if there is none."""
    return float(log.ranges.max(initial=np.finfo(float).tiny))


def estimate_shares(
    log: Log,
    weights: np.ndarray,
    landmarks: np.ndarray,
    shares: Shares,
    prior: tuple[float, float] = JEFFREYS,
) -> Shares:
    """Posterior means of both shares, given the sources of the ranges; a clutter of 0 stays 0.

    What a range has of "none of these" is clutter, and landmarks that are not in the map, as
    likely as before it was measured. Labels are judged by what is a landmark's, where there are
    labels.

    Parameters
    ----------
    weights : (M, K+1) posterior of every range's source
    landmarks : (K, 2), NaN for one that is not in the map
    shares : with which the weights were found
    prior : wrong and right labels that count as seen beforehand
    """
    chances = np.exp(log_prior(log, shares))
    none = np.append(np.isnan(landmarks[:, 0]), True)
    split = chances[:, none] / np.maximum(chances[:, none].sum(axis=1, keepdims=True), 1e-300)
    sources = weights.copy()
    sources[:, none] = weights[:, -1:] * split
    judged = (log.label_of != NO_LABEL) | (log.label_probabilities is not None)
    from_landmark = sources[judged, :-1]
    right = (1 - shares.wrong) * (1 - shares.clutter) * _meant(log)[judged]
    right = np.sum(from_landmark * right / np.maximum(chances[judged, :-1], 1e-300))
    wrong = _mean(from_landmark.sum() - right, from_landmark.sum(), prior)
    if shares.clutter == 0:
        return Shares(wrong, 0.0)
    return Shares(wrong, _mean(sources[:, -1].sum(), len(sources), RARE))


def _mean(count: float, total: float, prior: tuple[float, float]) -> float:
    """Posterior mean of a share under a Beta prior."""
    return float((prior[0] + count) / (sum(prior) + total))
