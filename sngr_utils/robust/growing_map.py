"""A map from a whole log of which little is known: labels perhaps wrong or missing, noise a guess.

EM on growing prefixes: over a short way dead reckoning is good enough to find landmarks without
labels, and each longer prefix starts from what the shorter one has found. At the end the noise is
estimated with the map, in turn, and the estimate is asked whether it explains ranges that it has
not seen.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from sngr_utils.robust import diagnosis, em, mirrors, naming
from sngr_utils.robust.association import log_joint, residuals
from sngr_utils.robust.diagnosis import Diagnosis
from sngr_utils.slam import chain_cost, chain_solver, noise_estimation
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.landmark_starts import START_AFTER, best_cell
from sngr_utils.slam.noise_estimation import Noise
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.dead_reckoning import dead_reckoning, dead_reckoning_variances
from sngr_utils.world.log import NO_LABEL, Log

# Searches: whether labels are used, ranges that the first prefix has for each landmark, and growth
# of the number of poses from one prefix to the next. Two that agree are enough.
PER_LANDMARK, GROWTH = 60, 1.1
SEARCHES = ((True, 40, 1.25), (False, PER_LANDMARK, GROWTH), (False, 40, 1.1), (True, 40, 1.1))
AGREE = 1.0  # nats between two searches that have found the same
WIDEST, LAST = 3.0, 2.0  # range sigmas that a longer prefix starts with, and a last repair
STARVING = 0.25  # of the ranges that are promised to a landmark: with less it is started again
WIDE = 1e3  # longest ranges, the sigma of a prior that says nothing of a landmark
ROUNDS, SAME = 4, 0.01  # of noise and map in turn, and the logarithm of a sigma that has settled


@dataclass(frozen=True)
class GrownMap:
    """An estimate of a log, with the noise found in it and what it says of itself.

    Attributes
    ----------
    soft : poses, landmarks, calibration, and the sources of the ranges
    noise : sigmas found, with the log that has them
    scores : log likelihood that each search has reached, [nats]
    unexplained : share of held-out ranges that the map explains by no landmark
    doubts : reasons to doubt it, a sentence each; none if there are none
    """

    soft: em.SoftEstimate
    noise: Noise
    scores: list[float]
    unexplained: float
    doubts: list[str]

    @property
    def calibration_sigmas(self) -> np.ndarray:
        """Of those of range scale and offset [m] that are estimated, missed steps open."""
        variances = np.diagonal(self.noise.estimate.calibration_covariance)
        return np.sqrt(variances + np.sum(self.soft.missed.calibration**2, axis=0))


def estimate(log: Log, progress: Callable[[float], None] = lambda share: None) -> GrownMap:
    """Poses, landmarks, noise and doubts of a log.

    Parameters
    ----------
    progress : is told which share of the work is done, from 0 to 1

    Raises
    ------
    ValueError : a log without landmarks or ranges
    """
    if not log.n_landmarks or not len(log.ranges):
        raise ValueError("there is nothing to estimate: no landmark or no range")
    soft, scores = _search(log, progress)
    for turn in range(ROUNDS):
        noise = noise_estimation.estimate(
            _from(log, soft.calibration), soft.poses, soft.landmarks, soft.responsibilities,
            landmark_prior_sigma=_free(log).landmark_prior_sigma,
        )  # fmt: skip
        settled = abs(math.log(noise.sigmas[noise_estimation.RANGE])) < SAME
        start = noise.estimate.poses, noise.estimate.landmarks
        log = replace(noise.log, scale=log.scale, offset=log.offset)
        soft = _fit(log, start, noise.estimate.calibration, 1.0)
        progress(0.7 + 0.05 * turn)
        if settled and turn:
            break
    noise = replace(noise, log=log)
    found = _diagnosed(log, soft)
    progress(1.0)
    return GrownMap(soft, noise, scores, found.held_out, _doubts(log, soft, scores, found))


def _search(log: Log, progress: Callable[[float], None]) -> tuple[em.SoftEstimate, list[float]]:
    """The likeliest map that the searches have found, and the scores of all."""
    maps, scores = [], []
    for i, (labelled, per_landmark, growth) in enumerate(SEARCHES):
        found = grow(log if labelled else without_labels(log), per_landmark, growth)
        if not labelled:
            found = _fit(log, (found.poses, naming.named(log, found)), found.calibration, 1.0)
        maps.append(found)
        scores.append(score(log, found))
        progress(0.15 * (i + 1))
        if _found_twice(scores):
            break
    return maps[int(np.argmax(scores))], scores


def without_labels(log: Log) -> Log:
    """The log, none of whose ranges says which landmark it is from."""
    return replace(log, label_of=np.full(len(log.ranges), NO_LABEL), label_probabilities=None)


def _found_twice(scores: list[float]) -> bool:
    return sum(score > max(scores) - AGREE for score in scores) > 1


def score(log: Log, soft: em.SoftEstimate) -> float:
    """Log likelihood of a map, with the sources of the ranges summed over, [nats]."""
    unranged = soft.chain._replace(weights=np.zeros(len(log.ranges)))
    at = chain_solver.state_of(unranged, soft.poses, soft.landmarks)
    at = at._replace(calibration=soft.calibration)
    found = residuals(log, soft.poses[:, :2], soft.landmarks, soft.calibration)
    variances = np.broadcast_to(log.range_sigmas[:, None] ** 2, found.shape)
    ranges = special.logsumexp(log_joint(log, found, variances, soft.shares), axis=1).sum()
    return float(ranges - chain_cost.cost(unranged, LEAST_SQUARES, at))


def grow(log: Log, per_landmark: int, growth: float) -> em.SoftEstimate:
    """EM on prefixes of a log, each longer one from what the one before has found.

    Parameters
    ----------
    per_landmark : ranges that the first prefix has for each landmark
    growth : of the number of poses
    """
    n = _first_length(log, per_landmark * log.n_landmarks)
    part = log.first(n)
    poses, calibration = dead_reckoning(log.x0_mean, part.odometry), None
    landmarks = start_missing(part, poses, log.landmark_means, np.ones(len(part.ranges), bool))
    widest = em.WIDEST
    while True:
        soft = _fit(part, (poses, landmarks), calibration, widest)
        lost = starving(part, soft)
        if n == log.n_poses and not (lost.any() and widest > LAST):
            return soft
        widest = LAST if n == log.n_poses else WIDEST
        before, n = n, min(log.n_poses, math.ceil(growth * n))
        part, calibration = log.first(n), soft.calibration
        tail = dead_reckoning(soft.poses[-1], part.odometry[before - 1 :])
        poses = np.vstack([soft.poses, tail[1:]])
        free = np.ones(len(part.ranges), bool)
        free[: len(soft.weights)] = soft.weights[:, -1] > 0.5
        kept = np.where(lost[:, None], np.nan, soft.landmarks)
        landmarks = start_missing(part, poses, kept, free)
        landmarks = np.where(np.isnan(landmarks), soft.landmarks, landmarks)


def count_landmarks(log: Log, most: int) -> tuple[int, list[float]]:
    """How many landmarks a log without labels shows: the number with the best score by BIC.

    The log is to be a stretch on which dead reckoning is good. What it says of landmarks is not
    asked.

    Returns
    -------
    the number, and the scores of 1, 2, ... `most` landmarks, [nats]

    Source: Schwarz, Annals of Statistics 6, 1978; a landmark costs two numbers.
    """
    scores = []
    for k in range(1, most + 1):
        some = replace(
            without_labels(log), n_landmarks=k,
            landmark_means=np.full((k, 2), np.nan), landmark_sigmas=np.full(k, np.nan),
        )  # fmt: skip
        scores.append(score(some, grow(some, PER_LANDMARK, GROWTH)) - k * math.log(len(log.ranges)))
    return int(np.argmax(scores)) + 1, scores


def starving(log: Log, soft: em.SoftEstimate) -> np.ndarray:
    """(K,) landmarks with hardly a range, although labels, or their number, promise many."""
    share = soft.responsibilities.sum(axis=0)
    labels = log.label_of[log.label_of != NO_LABEL]
    promised = np.bincount(labels, minlength=log.n_landmarks).astype(float)
    if not len(labels):
        promised[:] = len(log.ranges) / log.n_landmarks
    return np.isnan(soft.landmarks[:, 0]) | (share < STARVING * promised)


def start_missing(
    log: Log, poses: np.ndarray, landmarks: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """(K, 2) landmarks, those that are NaN started by the ranges that none of them explains.

    Labelled ranges start the landmark of their label; if there are none, the best cell of the grid
    for all free ranges is a landmark, and its ranges are free no more.

    Parameters
    ----------
    free : (M,) whether a range may start a landmark
    """
    landmarks, free = landmarks.copy(), free.copy()
    labelled = np.any(log.label_of != NO_LABEL)
    places = poses[log.pose_of, :2]
    reckoned = dead_reckoning_variances(poses, log.odometry_covariances)[log.pose_of]
    variances = reckoned + log.range_sigmas**2
    for k in np.flatnonzero(np.isnan(landmarks[:, 0])):
        mine = free & (log.label_of == k) if labelled else free
        if len(np.unique(log.pose_of[mine])) < START_AFTER:
            continue
        landmarks[k] = best_cell(
            places[mine], log.ranges[mine], variances[mine], log.ranges.max()
        )  # fmt: skip
        if not labelled:
            found = log.ranges - np.linalg.norm(places - landmarks[k], axis=1)
            free &= np.abs(found) > em.WIDEST * np.sqrt(variances)
    return landmarks


def _first_length(log: Log, enough: int) -> int:
    """Poses of the first prefix, which has enough ranges."""
    if enough >= len(log.ranges):
        return log.n_poses
    return int(min(log.n_poses, max(log.pose_of[enough - 1] + 1, 2)))


def _free(log: Log) -> Conventions:
    """Nothing is known of a landmark beforehand."""
    return Conventions(landmark_prior_sigma=WIDE * float(log.ranges.max()))


def _fit(log: Log, start, calibration: np.ndarray | None, widest: float) -> em.SoftEstimate:
    log = log if calibration is None else _from(log, calibration)
    return em.fit(log, _free(log), start, exclusive=False, clutter=True, widest=widest)


def _from(log: Log, calibration: np.ndarray) -> Log:
    """The log, its range scale and offset centred where they were found, if they are open."""
    scale, offset = (
        (float(value), sigma) if sigma > 0 else (mean, sigma)
        for value, (mean, sigma) in zip(calibration, (log.scale, log.offset), strict=True)
    )
    return replace(log, scale=scale, offset=offset)


def _diagnosed(log: Log, soft: em.SoftEstimate) -> Diagnosis:
    """What there is to doubt of a map, its other sides being its rivals."""

    def fit(part, start):
        return _fit(part, start, soft.calibration, 1.0)

    sides = mirrors.rivals(soft, lambda *start: fit(log, start))
    sure = np.ones(log.n_landmarks, dtype=bool)
    gaps = [score(log, soft) - score(log, one) for one in sides if mirrors.differ(soft, one, sure)]
    gap = max(min(gaps, default=np.inf), 0.0)
    return diagnosis.diagnose(log, soft, gap, fit)


def _doubts(log: Log, soft: em.SoftEstimate, scores: list[float], told: Diagnosis) -> list[str]:
    """Why the estimate may be wrong."""
    found = list(told.reasons)
    if not _found_twice(scores):
        found.append(f"{len(scores)} searches have found {len(scores)} maps")
    run = diagnosis.worst_run(log, diagnosis.unlike_labels(log, soft))
    if run < diagnosis.RARE:  # no step is ever believed to have slipped here
        found.append(f"some poses have too many wrong labels (p {run:.0e}): has a step slipped?")
    lost = np.flatnonzero(starving(log, soft)).tolist()
    if lost:
        found.append(f"landmarks {lost} have hardly a range")
    return found
