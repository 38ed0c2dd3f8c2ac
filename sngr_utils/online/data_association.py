"""To which landmark each range is assigned: innovations, gate, posterior, decision.

A range that passes the gate of the landmark it is labelled with keeps its label at no cost. One
that does not puts its whole scan in question: then all ranges of the scan are weighed against
all landmarks.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sngr_utils.numerics.jit import compile_once
from sngr_utils.robust import association, diagnosis, mutual_exclusion
from sngr_utils.slam import selected_inverse
from sngr_utils.world.log import NO_LABEL, Log

GATE = stats.chi2.ppf(0.99, 1)  # squared normalised innovation that puts a range in question
IMPOSSIBLE = stats.chi2.ppf(1 - 1e-6, 1)  # and one that no right range has
VAGUE = diagnosis.VAGUE
RESOLVED = 0.6  # posterior above which a range is assigned to a landmark
DROPPED = -1  # the label of a range that is assigned to none


@dataclass(frozen=True)
class Innovations:
    """How far each of M ranges is from what each of K landmarks predicts; NaN if it is absent.

    Attributes
    ----------
    residuals : (M, K) [m]
    variances : (M, K) of a range that does come from the landmark, [m^2]
    """

    residuals: np.ndarray
    variances: np.ndarray

    @property
    def squared(self) -> np.ndarray:
        """(M, K) squared normalised innovation, chi-square with one degree if right."""
        return self.residuals**2 / self.variances


@dataclass(frozen=True)
class Assignment:
    """What was decided about M ranges and K landmarks.

    Attributes
    ----------
    used : (M,) int, landmark each range is assigned to, or `DROPPED`
    weights : (M, K+1) posterior of its source, the last column that of none in the map
    """

    used: np.ndarray
    weights: np.ndarray


def nowhere(n_ranges: int, n_landmarks: int) -> Assignment:
    """Ranges that are assigned to no landmark, all of which are yet to be found."""
    used = np.full(n_ranges, DROPPED)
    return Assignment(used, np.eye(n_landmarks + 1)[used])  # the last column for -1


def innovations(
    log: Log, poses: np.ndarray, landmarks: np.ndarray, used: np.ndarray,
    covariance: selected_inverse.ChainCovariance,
) -> Innovations:  # fmt: skip
    """Innovations of all ranges, those that are in the graph predicted without themselves.

    Parameters
    ----------
    poses, landmarks : the estimate, (T, 3) and (K, 2)
    used : (M,) int, landmark each range is assigned to in the graph that has `covariance`

    Source: prediction without one measurement, from the estimate with it: Cook & Weisberg,
    Residuals and Influence in Regression, 1982, section 2.2.
    """
    at = (np.ascontiguousarray(array) for array in (
        poses, landmarks, covariance.poses, covariance.pose_landmark, covariance.landmarks
    ))  # fmt: skip
    return Innovations(*_innovations(*at, log.pose_of, log.ranges, log.range_sigmas, used))


@compile_once
def _innovations(poses, landmarks, own, cross, joint, pose_of, ranges, sigmas, used):
    """The fields of `innovations`; own, cross and joint are blocks of the covariance."""
    n = len(landmarks)
    distances, spread = np.empty((len(poses), n)), np.empty((len(poses), n))
    for t in range(len(poses)):
        cos, sin = math.cos(poses[t, 2]), math.sin(poses[t, 2])
        for k in range(n):
            x, y = landmarks[k, 0] - poses[t, 0], landmarks[k, 1] - poses[t, 1]
            distance = math.sqrt(x * x + y * y)
            ahead = x / distance, y / distance
            by_pose = -cos * ahead[0] - sin * ahead[1], sin * ahead[0] - cos * ahead[1]
            of_pose = of_both = of_landmark = 0.0
            for i in range(2):
                for j in range(2):
                    of_pose += by_pose[i] * own[t, i, j] * by_pose[j]
                    of_both += by_pose[i] * cross[t, i, 2 * k + j] * ahead[j]
                    of_landmark += ahead[i] * joint[2 * k + i, 2 * k + j] * ahead[j]
            distances[t, k], spread[t, k] = distance, of_pose + 2 * of_both + of_landmark
    residuals, variances = np.empty((len(ranges), n)), np.empty((len(ranges), n))
    for m in range(len(ranges)):
        noise = sigmas[m] ** 2
        for k in range(n):
            residuals[m, k] = ranges[m] - distances[pose_of[m], k]
            variances[m, k] = spread[pose_of[m], k]
            if k == used[m]:
                without = noise / max(noise - variances[m, k], 1e-3 * noise)
                residuals[m, k] *= without
                variances[m, k] *= without
            variances[m, k] += noise
    return residuals, variances


def decide(
    log: Log, found: Innovations, used: np.ndarray, shares: association.Shares,
    exclusive: bool, swap: bool,
) -> Assignment:  # fmt: skip
    """Assign every range anew: label kept, swapped for a likelier one, or dropped.

    Scans without a doubt keep their labels. In the others a range goes to the landmark that has
    more than `RESOLVED` of its posterior, if it is not impossible there, and to none otherwise.

    Parameters
    ----------
    used : (M,) int, landmark each range is assigned to so far, or `DROPPED`
    shares : of wrong labels and of clutter
    exclusive : the ranges of a scan come from different landmarks
    swap : a range may go to another landmark than that of its label
    """
    squared, n_landmarks, label_of = found.squared, log.n_landmarks, log.label_of
    rows = np.arange(len(log.ranges))
    sharp = found.variances < (VAGUE * log.range_sigmas[:, None]) ** 2
    with np.errstate(invalid="ignore"):
        plain = (label_of != NO_LABEL) & ((squared < GATE) & sharp)[rows, label_of]
    doubtful = ~plain | (used != label_of) | (_repeated(log, plain) if exclusive else False)
    used = np.where(plain, label_of, DROPPED)
    weights = np.eye(n_landmarks + 1)[label_of]
    in_question = np.zeros(log.n_poses, dtype=bool)
    in_question[log.pose_of[doubtful]] = True
    asked = np.flatnonzero(in_question[log.pose_of])
    if len(asked) == 0:
        return Assignment(used, weights)
    logs = association.log_joint(log, found.residuals, found.variances, shares)[asked]
    weights[asked] = (
        mutual_exclusion.exclusive_posterior(logs, log.pose_of[asked])
        if exclusive
        else association.posterior(logs)
    )
    best = np.argmax(weights[asked], axis=1)
    known = best < n_landmarks
    place = np.where(known, best, 0)
    good = known & (weights[asked, best] > RESOLVED) & sharp[asked, place]
    good &= squared[asked, place] < IMPOSSIBLE
    if not swap:
        good &= best == label_of[asked]
    used[asked] = np.where(good, best, DROPPED)
    return Assignment(used, weights)


def _repeated(log: Log, marked: np.ndarray) -> np.ndarray:
    """(M,) bool, the marked ranges that are not alone in their scan with their label."""
    pair = log.pose_of * log.n_landmarks + log.label_of
    counts = np.bincount(pair[marked], minlength=log.n_poses * log.n_landmarks + 1)
    return marked & (counts[pair] > 1)
