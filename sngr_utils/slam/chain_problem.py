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

ANY, NOT_NEGATIVE, POSITIVE = -math.inf, 0.0, math.ulp(0.0)
BOUNDS = {
    ANY: "finite", NOT_NEGATIVE: "finite and zero or more", POSITIVE: "finite and positive",
}  # fmt: skip
SYMMETRIC = 1e-9  # of the largest entry, a difference of mirror images that is rounding


class Chain(NamedTuple):
    """The data of a chain, as `make` has checked them and compiled code reads them.

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


def make(
    *,
    x0_mean: np.ndarray,
    x0_sigmas: np.ndarray,
    odometry: np.ndarray,
    odometry_covariances: np.ndarray,
    pose_of: np.ndarray,
    landmark_of: np.ndarray,
    ranges: np.ndarray,
    range_sigmas: np.ndarray | float,
    landmark_means: np.ndarray,
    landmark_sigmas: np.ndarray | float,
    weights: np.ndarray | float = 1.0,
    scale: tuple[float, float] = (1.0, 0.0),
    offset: tuple[float, float] = (0.0, 0.0),
) -> Chain:
    """Check the data of a chain, and arrange them.

    Parameters
    ----------
    x0_mean, x0_sigmas : (3,) prior on pose 0, [m, m, rad]
    odometry : (T-1, 3) measured motion in the body frame of pose t, [m, m, rad]
    odometry_covariances : (T-1, 3, 3), or (3, 3) of every step
    pose_of, landmark_of : (N,) int, what each range joins; landmark -1 for a range from none
    ranges : (N,), [m]
    range_sigmas, weights : (N,), or one of all, [m] and without unit; a weight counts the loss
        of a range so many times, 0 leaves it out
    landmark_means, landmark_sigmas : (K, 2), and (K,) or one of all, prior on each landmark, [m];
        none where the sigma is NaN or infinite, or the mean is NaN
    scale, offset : mean and sigma of the range scale and of the offset [m]; a sigma of 0 for one
        that is known, infinite for one without a prior

    Raises
    ------
    ValueError : naming the array and its first bad row: a shape that does not fit, an index out
        of bounds, what is not finite or not positive and must be
    """
    odometry = _array("odometry", odometry, (len(odometry), 3))
    steps, count, landmarks = len(odometry), np.size(ranges), len(landmark_means)
    means, landmark_information = _landmark_prior(landmark_means, landmark_sigmas, landmarks)
    calibration_means, calibration_sigmas = _calibration_prior(scale, offset)
    estimated = calibration_sigmas > 0
    x0_sigmas = _array("x0_sigmas", x0_sigmas, (3,), POSITIVE)
    return Chain(
        prior=information.frames_of(_array("x0_mean", x0_mean, (1, 3))),
        motions=information.frames_of(odometry),
        prior_information=np.diag(x0_sigmas**-2),
        step_information=_inverse("odometry_covariances", odometry_covariances, (steps, 3, 3)),
        pose_of=_index("pose_of", pose_of, count, 0, steps),
        landmark_of=_index("landmark_of", landmark_of, count, -1, landmarks - 1),
        ranges=_array("ranges", ranges, (count,)),
        sigmas=_array("range_sigmas", range_sigmas, (count,), POSITIVE),
        weights=_array("weights", weights, (count,), NOT_NEGATIVE),
        landmark_means=means,
        landmark_information=landmark_information,
        calibration_means=calibration_means,
        calibration_information=np.where(estimated, calibration_sigmas, np.inf) ** -2,
        columns=np.where(estimated, 2 * landmarks + np.cumsum(estimated) - 1, -1),
    )


def of_log(log: Log, landmarks: np.ndarray, landmark_prior_sigma: float) -> Chain:
    """The chain of a log, its ranges by label; weak priors on the landmarks that were started.

    Parameters
    ----------
    landmarks : (K, 2) where the weak priors are centred, [m], but for surveyed landmarks, which
        have their own; NaN for a landmark that is absent
    landmark_prior_sigma : of the weak priors, [m]
    """
    surveyed = np.isfinite(log.landmark_sigmas)
    return make(
        x0_mean=log.x0_mean, x0_sigmas=log.x0_sigmas, odometry=log.odometry,
        odometry_covariances=log.odometry_covariances, pose_of=log.pose_of,
        landmark_of=log.label_of, ranges=log.ranges, range_sigmas=log.range_sigmas,
        landmark_means=np.where(surveyed[:, None], log.landmark_means, landmarks),
        landmark_sigmas=np.where(surveyed, log.landmark_sigmas, landmark_prior_sigma),
        scale=log.scale, offset=log.offset,
    )  # fmt: skip


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


def _shaped(name: str, value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A copy of `value` as floats: of this shape, or of all but its first axis, then repeated."""
    array = np.asarray(value, dtype=float)
    if array.shape not in (shape, shape[1:]):
        raise ValueError(f"{name} has shape {array.shape}: it must be {shape}")
    found = np.empty(shape)  # one layout, so that numba compiles once
    found[...] = array
    return found


def _array(name: str, value: np.ndarray, shape: tuple[int, ...], least: float = ANY) -> np.ndarray:
    """The same, all finite and none below `least`."""
    array = _shaped(name, value, shape)
    row = _bad_row(array.reshape(shape[0], math.prod(shape[1:])), least)
    if row >= 0:
        raise ValueError(f"{name}[{row}] is {array[row]}: it must be {BOUNDS[least]}")
    return array


@compile_once
def _bad_row(array, least):
    """First row of a matrix that is not finite or has an entry below `least`; -1 for none."""
    for i in range(len(array)):
        for j in range(array.shape[1]):
            if not (math.isfinite(array[i, j]) and array[i, j] >= least):
                return i
    return -1


def _index(name: str, value: np.ndarray, count: int, least: int, most: int) -> np.ndarray:
    index = np.asarray(value)
    if index.shape != (count,):
        raise ValueError(f"{name} has shape {index.shape}: it must be {(count,)}")
    if count and index.dtype.kind not in "iu":
        raise ValueError(f"{name} holds {index.dtype}: it must hold integers")
    if count and (index.min() < least or index.max() > most):
        row = np.argmax((index < least) | (index > most))
        raise ValueError(f"{name}[{row}] is {index[row]}: it must be in {least} ... {most}")
    return np.array(index, dtype=np.int64, order="C")


def _inverse(name: str, value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Inverses of covariances, those of all steps or one of every step."""
    covariances = _array(name, value, shape)
    row = _invert_each(covariances)
    if row >= 0:
        raise ValueError(f"{name}[{row}] must be symmetric and positive definite")
    return covariances


@compile_once
def _invert_each(covariances):
    """Invert (S, 3, 3) covariances in place; the first that is none, -1 if all are."""
    for t in range(len(covariances)):
        largest, skew = 0.0, 0.0
        for i in range(3):
            for j in range(3):
                largest = max(largest, abs(covariances[t, i, j]))
                skew = max(skew, abs(covariances[t, i, j] - covariances[t, j, i]))
        if skew > SYMMETRIC * largest or invert(covariances[t]) >= 0:
            return t
    return -1


def _landmark_prior(
    means: np.ndarray, sigmas: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """(K, 2) means and (K,) information; 0 where there is no prior."""
    means = _shaped("landmark_means", means, (count, 2))
    sigmas = _shaped("landmark_sigmas", sigmas, (count,))
    given = np.isfinite(sigmas) & np.isfinite(means[:, 0] + means[:, 1])
    means[~given], sigmas[~given] = 0.0, np.inf
    if count and not sigmas.min() > 0:
        row = np.argmax(sigmas <= 0)
        raise ValueError(f"landmark_sigmas[{row}] is {sigmas[row]}: it must be positive")
    return means, sigmas**-2


def _calibration_prior(
    scale: tuple[float, float], offset: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """(2,) means and (2,) sigmas of the range scale and of the offset."""
    for name, (mean, sigma), least in (("scale", scale, POSITIVE), ("offset", offset, ANY)):
        if not (math.isfinite(mean) and mean >= least):
            raise ValueError(f"the mean of {name} is {mean}: it must be {BOUNDS[least]}")
        if not sigma >= 0:
            raise ValueError(f"the sigma of {name} is {sigma}: it must be zero or more")
    return np.array([scale[0], offset[0]], float), np.array([scale[1], offset[1]], float)
