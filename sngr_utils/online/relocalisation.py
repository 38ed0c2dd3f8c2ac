"""Where a stretch of the path lies in a known map, its shape being known and any label wrong.

After a step that slipped, the poses behind it are one rigid body. Its first pose is unknown in
place, perhaps in heading; every two ranges of a scan and every two landmarks give starts, as does
a grid of headings. The best of them are refined, and their evidence is Laplace's.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special, stats

from sngr_utils.online.data_association import RESOLVED
from sngr_utils.robust import association, mutual_exclusion
from sngr_utils.robust.association import Shares
from sngr_utils.slam import landmark_starts
from sngr_utils.world.dead_reckoning import wrap_angle
from sngr_utils.world.log import Log

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
        log_prior = np.log(np.column_stack([prior[:, :-1][:, present], none]))
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
    """(C, 2) places that have a range of a scan from one landmark, and another from another."""
    ranges, landmarks = part.ranges[mine], part.landmarks
    pairs = np.column_stack([part.ranges[mine].repeat(len(landmarks)),
                             np.tile(np.arange(len(landmarks)), len(ranges))])  # fmt: skip
    found = landmark_starts.crossings(landmarks[pairs[:, 1].astype(int)], pairs[:, 0].copy())
    return found[np.isfinite(found).all(axis=1)]


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
    distances = np.linalg.norm(_ahead(part, starts), axis=-1)
    peaks = np.exp(part.log_prior[:, :-1]) / np.sqrt(2 * np.pi * part.variances)
    right = peaks * np.exp(-0.5 * (part.ranges[:, None] - distances) ** 2 / part.variances)
    return np.log(right.sum(axis=-1) + np.exp(part.log_prior[:, -1])).sum(axis=-1)


def _ahead(part: Stretch, poses: np.ndarray) -> np.ndarray:
    """(S, M, K, 2) from the landmarks to where the ranges were measured, at (S, 3) first poses."""
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x, y = part.offsets.T
    places = poses[:, None, :2] + np.stack([c * x - s * y, s * x + c * y], axis=-1)
    return places[:, :, None] - part.landmarks


def _joint(part: Stretch, pose: np.ndarray, width: float):
    """(M, K+1) log of prior times likelihood; (M, K) residuals and (M, K, 2) unit vectors."""
    (ahead,) = _ahead(part, pose[None])
    distances = np.maximum(np.linalg.norm(ahead, axis=-1), 1e-300)
    residuals = part.ranges[:, None] - distances
    variances = width**2 * part.variances
    fit = -0.5 * residuals**2 / variances - 0.5 * np.log(2 * np.pi * variances)
    joint = np.column_stack([part.log_prior[:, :-1] + fit, part.log_prior[:, -1]])
    return joint, residuals, ahead / distances[..., None]


def refined(part: Stretch, start: np.ndarray, mean: np.ndarray, sigmas: np.ndarray) -> Found:
    """EM from a start to the nearest maximum, and the evidence of what is about it."""
    pose, precision = start.copy(), np.asarray(sigmas, float) ** -2
    for width in WIDTHS:
        joint, residuals, units = _joint(part, pose, width)
        weights = special.softmax(joint, axis=-1)[:, :-1] / (width**2 * part.variances)
        across = part.offsets @ _rotation(pose[2] + np.pi / 2).T
        by_pose = np.concatenate([units, units @ across[:, :, None]], axis=2)
        matrix = np.einsum("mk,mki,mkj->ij", weights, by_pose, by_pose) + np.diag(precision)
        slope = np.einsum("mk,mki,mk->i", weights, by_pose, residuals)
        pose = pose + np.linalg.solve(matrix, slope - precision * _away(pose, mean))
    fit = log_likelihoods(part, pose[None])[0] - 0.5 * precision @ _away(pose, mean) ** 2
    pose[2] = wrap_angle(pose[2])
    volume = 0.5 * np.log(precision).sum() - 0.5 * np.linalg.slogdet(matrix)[1]
    return Found(pose, float(fit + volume))


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
