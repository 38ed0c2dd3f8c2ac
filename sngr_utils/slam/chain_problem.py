"""The least-squares problem of range-only SLAM as plain arrays: a chain of poses, and landmarks.

T poses joined by odometry, K landmarks, N ranges between them; a covariance for every step of
the odometry, a sigma and a weight for every range. The same range may stand there several times,
with several landmarks and a weight for each (soft data association). A range's residual is
scale * distance + offset - range; scale and offset are known, or estimated with the rest.
"""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import invert
from sngr_utils.slam import information
from sngr_utils.world.log import Log


class Chain(NamedTuple):
    """The data of a chain, as compiled code reads them.

    Attributes
    ----------
    prior, motions : (1, 4) and (T-1, 4) frames of the mean of pose 0 and of the measured steps
    prior_information, step_information : (3, 3) and (T-1, 3, 3), in units of m and rad
    pose_of, landmark_of : (N,) int; landmark -1 for a range from none
    ranges, sigmas, weights : (N,), [m], [m] and without unit
    landmark_means, landmark_information : (K, 2) [m] and (K,) [1 / m^2], 0 where there is no prior
    calibration_means, calibration_information : (2,) of the scale and of the offset [m]
    columns : (2,) int, their columns in the border; -1 for one that is known
    """

    prior: np.ndarray
    motions: np.ndarray
    prior_information: np.ndarray
    step_information: np.ndarray
    pose_of: np.ndarray
    landmark_of: np.ndarray
    ranges: np.ndarray
    sigmas: np.ndarray
    weights: np.ndarray
    landmark_means: np.ndarray
    landmark_information: np.ndarray
    calibration_means: np.ndarray
    calibration_information: np.ndarray
    columns: np.ndarray


def of_log(log: Log, landmarks: np.ndarray, landmark_prior_sigma: float) -> Chain:
    """The chain of a log, its ranges by label; weak priors on the landmarks that were started.

    Parameters
    ----------
    landmarks : (K, 2) where the weak priors are centred, [m], but for surveyed landmarks, which
        have their own; NaN for a landmark that is absent
    landmark_prior_sigma : of the weak priors, [m]
    """
    calibration = np.array([log.scale, log.offset], dtype=float)
    frames, steps, (means, sigmas), (shifts, shift_sigmas, columns) = _read(
        log.x0_mean, log.odometry, np.ascontiguousarray(log.odometry_covariances),
        log.landmark_means, log.landmark_sigmas, np.ascontiguousarray(landmarks),
        float(landmark_prior_sigma), calibration,
    )  # fmt: skip
    ranges = log.pose_of, log.label_of, log.ranges, log.range_sigmas, np.ones(len(log.ranges))
    priors = means, sigmas**-2, shifts, shift_sigmas**-2, columns
    return Chain(*frames, np.diag(log.x0_sigmas**-2), steps, *ranges, *priors)


@compile_once
def _inverses(covariances):
    """(S, 3, 3) inverses of the covariances of a log, which has seen that they are some."""
    found = covariances.copy()
    for t in range(len(found)):
        invert(found[t])
    return found


@compile_once
def _read(x0_mean, odometry, covariances, surveyed, survey_sigmas, landmarks, sigma, calibration):
    """What a `Chain` has beside the ranges, see `of_log`; infinite sigmas where it has no prior."""
    n_landmarks = len(landmarks)
    means, sigmas = np.zeros((n_landmarks, 2)), np.full(n_landmarks, np.inf)
    for k in range(n_landmarks):
        known = math.isfinite(survey_sigmas[k])
        own, place = (survey_sigmas[k], surveyed[k]) if known else (sigma, landmarks[k])
        if math.isfinite(own) and math.isfinite(place[0]) and math.isfinite(place[1]):
            means[k, 0], means[k, 1], sigmas[k] = place[0], place[1], own
    shift_sigmas, columns, column = np.full(2, np.inf), np.full(2, -1), 2 * n_landmarks
    for i in range(2):
        if calibration[i, 1] > 0.0:
            shift_sigmas[i], columns[i] = calibration[i, 1], column
            column += 1
    frames = information.frames_of(x0_mean.reshape(1, 3)), information.frames_of(odometry)
    calibrated = calibration[:, 0].copy(), shift_sigmas, columns
    return frames, _inverses(covariances), (means, sigmas), calibrated


@compile_once
def weighted(chain, weights, width, least):
    """The chain with every range to each landmark of which it has more than `least`.

    Parameters
    ----------
    weights : (N, K or more), by which it counts there
    width : of the range noise, in range sigmas
    """
    (n, k), count = (len(weights), len(chain.landmark_means)), 0
    for m in range(n):
        for j in range(k):
            count += weights[m, j] > least
    pose_of, landmark_of = np.empty(count, np.int64), np.empty(count, np.int64)
    ranges, sigmas, chances = np.empty(count), np.empty(count), np.empty(count)
    count = 0
    for m in range(n):
        for j in range(k):
            if weights[m, j] > least:
                pose_of[count], landmark_of[count] = chain.pose_of[m], j
                ranges[count], sigmas[count] = chain.ranges[m], width * chain.sigmas[m]
                chances[count] = weights[m, j]
                count += 1
    return Chain(
        chain.prior, chain.motions, chain.prior_information, chain.step_information,
        pose_of, landmark_of, ranges, sigmas, chances,
        chain.landmark_means, chain.landmark_information,
        chain.calibration_means, chain.calibration_information, chain.columns,
    )  # fmt: skip
