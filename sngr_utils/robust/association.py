"""Data association: the posterior of which landmark a range came from.

A range is clutter, from no landmark at all and uniform up to the longest there is; or it is from
the landmark of its label; or, the label being wrong, from any other landmark alike. Given
distances that posterior is a softmax, range by range; if the ranges of one scan come from
different landmarks, it is a sum over all matchings of the scan.
"""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.robust import mutual_exclusion
from sngr_utils.world.log import NO_LABEL, Log

JEFFREYS = (0.5, 0.5)  # wrong and right labels that count as seen before the first
RARE = (0.5, 9.5)  # ranges from no landmark, and from one: one in twenty, and hardly known
NEGLIGIBLE = 1e-3  # responsibilities below it count for nothing
ROUNDING = 1e-12  # of chances that sum to one


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
    with np.errstate(divide="ignore"):
        return np.log(_prior(_meant(log), *shares))


def _meant(log: Log) -> np.ndarray:
    """(M, K) probability of each landmark to be the one that the label means."""
    if log.label_probabilities is not None:
        return log.label_probabilities
    return _of_labels(log.label_of, log.n_landmarks)


@compile_once
def _of_labels(label_of, k):
    """(M, K) rows with a one; without a label all alike."""
    meant = np.zeros((len(label_of), k))
    for m in range(len(meant)):
        if label_of[m] == NO_LABEL:
            meant[m] = 1 / k
        else:
            meant[m, label_of[m]] = 1.0
    return meant


@compile_once
def _prior(meant, wrong, clutter):
    """(M, K+1) probability of each source, see `log_prior`."""
    n, k = meant.shape
    prior = np.empty((n, k + 1))
    for m in range(n):
        total = meant[m].sum()
        for j in range(k):
            other = (total - meant[m, j]) / (k - 1) if k > 1 else meant[m, j]
            prior[m, j] = (1 - clutter) * ((1 - wrong) * meant[m, j] + wrong * other)
        left = 1 - total if total < 1 - ROUNDING else 0.0
        prior[m, k] = clutter + (1 - clutter) * left
    return prior


@compile_once
def posterior(log_weights):
    """(N, K+1) posterior of each range over K landmarks and "none of these", each on its own.

    Parameters
    ----------
    log_weights : (N, K+1) log of prior times likelihood, the last column that of "none"; -inf
        for what cannot be, but not all along a row
    """
    found = np.empty(log_weights.shape)
    for m in range(len(found)):
        largest, total = log_weights[m].max(), 0.0
        for k in range(found.shape[1]):
            found[m, k] = math.exp(log_weights[m, k] - largest)
            total += found[m, k]
        for k in range(found.shape[1]):
            found[m, k] /= total
    return found


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
    places = np.ascontiguousarray(poses), np.ascontiguousarray(landmarks)
    at = *places, _calibration(log, calibration)
    numbers = (float(number) for number in (*shares, width))  # of one type, compiled once
    return sources(model_of(log, exclusive), *at, *numbers)


class Model(NamedTuple):
    """What compiled code knows of the sources of M ranges.

    Attributes
    ----------
    meant : (M, K) probability of each landmark to be the one that the label means
    judged : (M,) bool, whether there is a label, which can be right or wrong
    pose_of, ranges, sigmas : (M,) int, [m] and [m]
    longest : the longest range, [m]
    ends : (S,) int, behind the last range of each scan; empty where there is no exclusion
    """

    meant: np.ndarray
    judged: np.ndarray
    pose_of: np.ndarray
    ranges: np.ndarray
    sigmas: np.ndarray
    longest: float
    ends: np.ndarray


def model_of(log: Log, exclusive: bool) -> Model:
    """The model of a log's ranges."""
    ends = mutual_exclusion.ends_of(len(log.ranges), log.pose_of)
    judged = (log.label_of != NO_LABEL) | (log.label_probabilities is not None)
    measured = log.pose_of, log.ranges, log.range_sigmas, _longest(log)
    return Model(_meant(log), judged, *measured, ends if exclusive else ends[:0])


@compile_once
def sources(model, poses, landmarks, calibration, wrong, clutter, width):
    """`responsibilities`."""
    found = _residuals(model.pose_of, model.ranges, poses, landmarks, calibration)
    variances = np.empty(found.shape)
    for m in range(len(found)):
        variances[m] = (width * model.sigmas[m]) ** 2
    joint = _log_joint(model.meant, found, variances, wrong, clutter, model.longest)
    if len(model.ends):
        return mutual_exclusion.matched(joint, model.ends)
    return posterior(joint)


def residuals(
    log: Log, poses: np.ndarray, landmarks: np.ndarray, calibration: np.ndarray | None = None
) -> np.ndarray:
    """(M, K) measured range less the one expected of every landmark, [m]; NaN for a NaN landmark.

    Parameters
    ----------
    calibration : (2,) range scale, and offset [m]; None for the means of the log's
    """
    places = np.ascontiguousarray(poses), np.ascontiguousarray(landmarks)
    return _residuals(log.pose_of, log.ranges, *places, _calibration(log, calibration))


def _calibration(log: Log, calibration: np.ndarray | None) -> np.ndarray:
    return np.array([log.scale[0], log.offset[0]]) if calibration is None else calibration


@compile_once
def _residuals(pose_of, ranges, poses, landmarks, calibration):
    """See `residuals`."""
    found = np.empty((len(ranges), len(landmarks)))
    for m in range(len(ranges)):
        t = pose_of[m]
        for k in range(len(landmarks)):
            dx, dy = landmarks[k, 0] - poses[t, 0], landmarks[k, 1] - poses[t, 1]
            expected = calibration[1] + calibration[0] * math.sqrt(dx * dx + dy * dy)
            found[m, k] = ranges[m] - expected
    return found


def log_joint(log: Log, residuals: np.ndarray, variances: np.ndarray, shares: Shares) -> np.ndarray:
    """(M, K+1) log of prior times likelihood of every range over landmarks and "none of these".

    "None" stands for no landmark at all, and for those that are not in the map, whose residuals
    are NaN: they may be the source all the same. Either way the range is uniform up to the
    longest there is.

    Parameters
    ----------
    residuals, variances : (M, K), [m] and [m^2]
    """
    variances = np.ascontiguousarray(variances)
    return _log_joint(_meant(log), residuals, variances, *shares, _longest(log))


def _longest(log: Log) -> float:
    """The longest range, [m]; of no matter if there is none."""
    return float(log.ranges.max(initial=np.finfo(float).tiny))


@compile_once
def _log_joint(meant, residuals, variances, wrong, clutter, longest):
    """See `log_joint`."""
    joint = _prior(meant, wrong, clutter)
    for m in range(len(joint)):
        for k in range(residuals.shape[1]):
            if math.isnan(residuals[m, k]):
                joint[m, -1] += joint[m, k]
                joint[m, k] = -math.inf
            else:
                peak = joint[m, k] / math.sqrt(2 * math.pi * variances[m, k])
                joint[m, k] = math.log(peak) - 0.5 * residuals[m, k] ** 2 / variances[m, k]
        joint[m, -1] = math.log(joint[m, -1] / longest)
    return joint


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
    model, prior = model_of(log, exclusive=False), (float(prior[0]), float(prior[1]))
    return Shares(*updated(model, weights, np.ascontiguousarray(landmarks), *shares, prior))


@compile_once
def updated(model, weights, landmarks, wrong, clutter, prior):
    """`estimate_shares`: of wrong labels, and of clutter."""
    n, k = model.meant.shape
    right, total, nobody, chances = 0.0, 0.0, 0.0, _prior(model.meant, wrong, clutter)
    for m in range(n):
        none = chances[m, k]
        for j in range(k):
            none += chances[m, j] if math.isnan(landmarks[j, 0]) else 0.0
        share = weights[m, k] / none if none > 0.0 else 0.0
        nobody += share * chances[m, k]
        for j in range(k if model.judged[m] else 0):
            source = share * chances[m, j] if math.isnan(landmarks[j, 0]) else weights[m, j]
            if chances[m, j] > 0.0:
                meant = model.meant[m, j] * (1 - clutter) * (1 - wrong if k > 1 else 1.0)
                total += source
                right += source * meant / chances[m, j]
    share = (RARE[0] + nobody) / (RARE[0] + RARE[1] + n) if clutter > 0.0 else 0.0
    return (prior[0] + total - right) / (prior[0] + prior[1] + total), share
