"""Where a stretch of the path lies in a known map, its shape being known and any label wrong.

After a step that slipped, the poses behind it are one rigid body. Its first pose is unknown in
place, perhaps in heading; every two ranges of a scan and every two landmarks give starts, as does
a grid of headings. The best of them are refined, and their evidence is Laplace's.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import stats

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import factorise, solve_lower, solve_upper
from sngr_utils.online.data_association import RESOLVED
from sngr_utils.robust import association, mutual_exclusion
from sngr_utils.robust.association import Shares
from sngr_utils.slam import landmark_starts
from sngr_utils.world.dead_reckoning import wrap_angle
from sngr_utils.world.log import Log

CIRCLES = 100  # of a scan, whose crossings are starts: all of ten ranges and ten landmarks
HEADINGS = 48  # on the grid of a heading that is not known
SINGLE, REFINED = 20, 4  # starts kept by the ranges of one scan, and by those of all
NEAR = stats.chi2.ppf(0.99, 3)  # squared normalised error of a prediction that holds
WIDTHS = (3.0, 2.0, 1.5, 1.0, 1.0, 1.0)  # range sigmas of the refinement, step by step


class Stretch(NamedTuple):
    """Ranges along a rigid stretch, and the map that they are to be explained by.

    offsets : (M, 2) where each was measured, in the frame of the first pose, [m]
    scan_of : (M,) int, the scan of each
    ranges : (M,), [m]
    log_prior : (M, K+1) of the sources, by the labels; the last column also has the density
    landmarks, variances : (K, 2) and (M, K), of a range that is from the landmark, [m], [m^2]
    """

    offsets: np.ndarray
    scan_of: np.ndarray
    ranges: np.ndarray
    log_prior: np.ndarray
    landmarks: np.ndarray
    variances: np.ndarray


@dataclass(frozen=True)
class Found:
    """The first pose of a stretch, (3,) [m, m, rad], and the log evidence, [nats]."""

    pose: np.ndarray
    log_evidence: float


def stretch(
    log: Log, poses: np.ndarray, landmarks: np.ndarray, spread: np.ndarray, shares: Shares
) -> Stretch:
    """The ranges of a part of a log, whose (T, 3) poses keep their shape.

    Parameters
    ----------
    landmarks, spread : (K, 2) the map, NaN for what is not in it, and (K,) variances, [m^2]
    """
    present = np.isfinite(landmarks[:, 0])
    prior = np.exp(association.log_prior(log, shares))
    none = prior[:, ~np.append(present, False)].sum(axis=1) / log.ranges.max(initial=1e-300)
    with np.errstate(divide="ignore"):
        log_prior = np.log(np.column_stack([prior[:, :-1][:, present], none]), order="C")
    turned = _rotation(-poses[0, 2])
    offsets = (poses[log.pose_of, :2] - poses[0, :2]) @ turned.T
    variances = log.range_sigmas[:, None] ** 2 + spread[present]
    return Stretch(offsets, log.pose_of, log.ranges, log_prior, landmarks[present], variances)


def search(
    part: Stretch, mean: np.ndarray, sigmas: np.ndarray, trusted: np.ndarray, pivot: int
) -> Found:
    """The likeliest first pose of a stretch, from many starts.

    Parameters
    ----------
    mean, sigmas : (3,) Gaussian prior of the first pose, [m, m, rad]
    trusted : (2,) bool, whether position and heading of the prior are good enough to start at
    pivot : scan whose ranges, two and two, give the starts for a position that is not known
    """
    headings = [mean[2]]
    if not trusted[1]:
        headings = mean[2] + 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    if trusted[0]:
        starts = np.array([[*mean[:2], heading] for heading in headings])
    else:
        mine = np.flatnonzero(part.scan_of == pivot)
        places = _crossings(part, mine)
        best = _best(_alone(part, mine), np.pad(places, ((0, 0), (0, 1))), SINGLE)
        arms = np.array([_rotation(heading) for heading in headings]) @ part.offsets[mine[0]]
        firsts = best[:, None, :2] - arms
        starts = np.column_stack([firsts.reshape(-1, 2), np.tile(headings, len(best))])
    found = [refined(part, start, mean, sigmas) for start in _best(part, starts, REFINED)]
    return max(found, key=lambda one: one.log_evidence)


def _crossings(part: Stretch, mine: np.ndarray) -> np.ndarray:
    """(C, 2) places that have a range of a scan from one landmark, and another from another.

    Without such a pair of circles, those of any two; of many circles the likeliest by the labels.
    """
    range_of, landmark_of = np.indices((len(mine), len(part.landmarks))).reshape(2, -1)
    if len(range_of) > CIRCLES:
        prior = part.log_prior[mine[range_of], landmark_of]
        likeliest = np.sort(np.argsort(-prior, kind="stable")[:CIRCLES])
        range_of, landmark_of = range_of[likeliest], landmark_of[likeliest]
    found = landmark_starts.crossings(part.landmarks[landmark_of], part.ranges[mine][range_of])
    pairs = np.array(np.tril_indices(len(range_of), -1))
    apart = np.ptp(range_of[pairs], axis=0) * np.ptp(landmark_of[pairs], axis=0) > 0
    return found[np.repeat(apart, 2)] if apart.any() else found


def _alone(part: Stretch, mine: np.ndarray) -> Stretch:
    """Some ranges of a stretch as if they were measured at its first pose."""
    rows = [np.zeros((len(mine), 2)), part.scan_of[mine], part.ranges[mine]]
    return Stretch(*rows, part.log_prior[mine], part.landmarks, part.variances[mine])


def _best(part: Stretch, starts: np.ndarray, most: int) -> np.ndarray:
    """The likeliest of (S, 3) starts, at most so many, no two of them near."""
    wide = part._replace(variances=part.variances * WIDTHS[0] ** 2)
    scores, chosen = log_likelihoods(wide, starts), []
    apart = WIDTHS[0] * math.sqrt(np.median(part.variances))
    reach = max(np.linalg.norm(part.offsets, axis=1).max(initial=0.0), apart)
    while len(chosen) < most and np.isfinite(scores).any():
        chosen.append(starts[np.argmax(scores)])
        moved = np.linalg.norm(starts[:, :2] - chosen[-1][:2], axis=1)
        turned = reach * np.abs(wrap_angle(starts[:, 2] - chosen[-1][2]))
        scores[(moved <= apart) & (turned <= apart)] = -np.inf
    return np.array(chosen)


def log_likelihoods(part: Stretch, starts: np.ndarray) -> np.ndarray:
    """(S,) of all ranges, their sources summed out, at (S, 3) first poses, [nats]."""
    peaks = np.exp(part.log_prior)
    peaks[:, :-1] /= np.sqrt(2 * np.pi * part.variances)
    return _log_likelihoods(part, np.ascontiguousarray(starts), peaks)


@compile_once
def _log_likelihoods(part, starts, peaks):
    """The same, given (M, K+1) prior times highest likelihood."""
    found = np.zeros(len(starts))
    for i in range(len(starts)):
        c, s = math.cos(starts[i, 2]), math.sin(starts[i, 2])
        for m in range(len(part.ranges)):
            x, y = part.offsets[m, 0], part.offsets[m, 1]
            x, y = starts[i, 0] + c * x - s * y, starts[i, 1] + s * x + c * y
            density = peaks[m, -1]
            for k in range(len(part.landmarks)):
                dx, dy = x - part.landmarks[k, 0], y - part.landmarks[k, 1]
                error = part.ranges[m] - math.sqrt(dx * dx + dy * dy)
                density += peaks[m, k] * math.exp(-0.5 * error * error / part.variances[m, k])
            found[i] += math.log(density)
    return found


@compile_once
def _joint(part, pose, width):
    """(M, K+1) log of prior times likelihood; (M, K) residuals and (M, K, 2) unit vectors."""
    n_ranges, n_landmarks = part.variances.shape
    joint, residuals = part.log_prior.copy(), np.empty((n_ranges, n_landmarks))
    units = np.empty((n_ranges, n_landmarks, 2))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for m in range(n_ranges):
        x, y = part.offsets[m, 0], part.offsets[m, 1]
        x, y = pose[0] + c * x - s * y, pose[1] + s * x + c * y
        for k in range(n_landmarks):
            dx, dy = x - part.landmarks[k, 0], y - part.landmarks[k, 1]
            distance = max(math.sqrt(dx * dx + dy * dy), 1e-300)
            units[m, k, 0], units[m, k, 1] = dx / distance, dy / distance
            residuals[m, k] = part.ranges[m] - distance
            variance = width**2 * part.variances[m, k]
            fit = residuals[m, k] ** 2 / variance + math.log(2 * math.pi * variance)
            joint[m, k] -= 0.5 * fit
    return joint, residuals, units


def refined(part: Stretch, start: np.ndarray, mean: np.ndarray, sigmas: np.ndarray) -> Found:
    """EM from a start to the nearest maximum, and the evidence of what is about it."""
    precision = np.asarray(sigmas, float) ** -2
    pose, matrix = _refined(part, start, mean, precision)
    fit = log_likelihoods(part, pose[None])[0] - 0.5 * precision @ _away(pose, mean) ** 2
    pose[2] = wrap_angle(pose[2])
    volume = 0.5 * np.log(precision).sum() - 0.5 * np.linalg.slogdet(matrix)[1]
    return Found(pose, float(fit + volume))


@compile_once
def _refined(part, start, mean, precision):
    """`refined`: (3,) pose, and the (3, 3) information of its last step."""
    pose, matrix, slope, ahead = start.copy(), np.empty((3, 3)), np.empty(3), np.empty(3)
    for width in WIDTHS:
        joint, residuals, units = _joint(part, pose, width)
        weights, c, s = association.posterior(joint), math.cos(pose[2]), math.sin(pose[2])
        away = pose - mean
        away[2] = (away[2] + math.pi) % (2 * math.pi) - math.pi
        for i in range(3):
            slope[i] = -precision[i] * away[i]
            for j in range(3):
                matrix[i, j] = precision[i] if i == j else 0.0
        for m in range(len(residuals)):
            x, y = part.offsets[m, 0], part.offsets[m, 1]
            for k in range(len(part.landmarks)):
                weight = weights[m, k] / (width**2 * part.variances[m, k])
                ahead[0], ahead[1] = units[m, k, 0], units[m, k, 1]
                ahead[2] = ahead[1] * (c * x - s * y) - ahead[0] * (s * x + c * y)
                for i in range(3):
                    slope[i] += weight * ahead[i] * residuals[m, k]
                    for j in range(3):
                        matrix[i, j] += weight * ahead[i] * ahead[j]
        lower = matrix.copy()
        factorise(lower)
        solve_lower(lower, slope)
        solve_upper(lower, slope)
        pose += slope
    return pose, matrix


def sources(part: Stretch, pose: np.ndarray) -> np.ndarray:
    """(M, K+1) posterior of the sources, a landmark once in a scan, with the first pose known."""
    return mutual_exclusion.exclusive_posterior(_joint(part, pose, 1.0)[0], part.scan_of)


def credited(part: Stretch, mean: np.ndarray, sigmas: np.ndarray) -> float:
    """Share of the ranges that are from a landmark, by any labels, near a predicted first pose.

    None are if they lead farther from it than its (3,) sigmas [m, m, rad] allow.
    """
    found = refined(part, mean, mean, sigmas).pose
    if np.sum((_away(found, mean) / sigmas) ** 2) > NEAR:
        return 0.0
    return float(np.mean(sources(part, found)[:, :-1].max(axis=1) > RESOLVED))


def _away(pose: np.ndarray, mean: np.ndarray) -> np.ndarray:
    away = pose - mean
    away[2] = wrap_angle(away[2])
    return away


def _rotation(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def moved(poses: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(T, 3) poses of a rigid stretch whose first pose is elsewhere."""
    turn = first[2] - poses[0, 2]
    places = first[:2] + (poses[:, :2] - poses[0, :2]) @ _rotation(turn).T
    return np.column_stack([places, wrap_angle(poses[:, 2] + turn)])
