"""The cost of a chain and its linearisation, compiled: residuals as in GTSAM, losses reweighted."""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam import information, range_loss


class State(NamedTuple):
    """A point at which the cost is asked.

    Attributes
    ----------
    frames : (T, 4) poses, as `information.frames_of` makes them
    landmarks : (K, 2), [m]; NaN for one that is absent, with all its ranges
    calibration : (2,) range scale, and offset [m]
    residuals : (N,) of the ranges, [m], as `cost` leaves them
    """

    frames: np.ndarray
    landmarks: np.ndarray
    calibration: np.ndarray
    residuals: np.ndarray


@compile_once
def _quadratic(metric, residual):
    """Half the squared length of a (3,) residual in the (3, 3) metric of its information."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += residual[i] * metric[i, j] * residual[j]
    return 0.5 * total


@compile_once
def cost(chain, loss, at):
    """Minus the log posterior but for a constant, as `gtsam.NonlinearFactorGraph.error`, [nats].

    Fills the residuals of `at`.
    """
    frames, prior, motions = at.frames, chain.prior, chain.motions
    first = information.frame_at(frames, 0)
    residual = information.prior_residual(information.frame_at(prior, 0), first)
    total = _quadratic(chain.prior_information, residual)
    for t in range(len(motions)):
        second = information.frame_at(frames, t + 1)
        residual = information.odometry_residual(first, second, information.frame_at(motions, t))
        total += _quadratic(chain.step_information[t], residual)
        first = second
    for k in range(len(at.landmarks)):
        if not math.isnan(at.landmarks[k, 0]):
            for i in range(2):
                error = at.landmarks[k, i] - chain.landmark_means[k, i]
                total += 0.5 * chain.landmark_information[k] * error * error
    for i in range(2):
        error = at.calibration[i] - chain.calibration_means[i]
        total += 0.5 * chain.calibration_information[i] * error * error
    return total + _range_cost(chain, loss, at)


@compile_once
def _range_cost(chain, loss, at):
    """Weighted loss of all ranges to landmarks that are present (eq. range)."""
    total, residuals = 0.0, at.residuals
    for m in range(len(residuals)):
        t, k = chain.pose_of[m], chain.landmark_of[m]
        residuals[m] = 0.0
        if k < 0 or chain.weights[m] == 0.0 or math.isnan(at.landmarks[k, 0]):
            continue
        distance, _, _ = information.distance_and_direction(at.frames, at.landmarks, t, k)
        residuals[m] = at.calibration[0] * distance + at.calibration[1] - chain.ranges[m]
        total += chain.weights[m] * range_loss.rho(loss, residuals[m] / chain.sigmas[m])
    return total


@compile_once
def linearise(chain, loss, at):
    """The system at a point whose residuals `cost` has filled, ranges reweighted by the loss."""
    size = at.landmarks.size + (chain.columns[0] >= 0) + (chain.columns[1] >= 0)
    system = information.empty_system(len(at.frames), size)
    information.add_odometry(
        at.frames, chain.prior, chain.prior_information, chain.motions, chain.step_information,
        True, system,
    )  # fmt: skip
    weights = np.empty(len(at.residuals))
    for m in range(len(weights)):
        sigma = chain.sigmas[m]
        reweighted = chain.weights[m] * range_loss.weight(loss, at.residuals[m] / sigma)
        weights[m] = reweighted / sigma**2
    information.add_ranges(
        at.frames, at.landmarks, at.calibration[0], chain.columns, chain.pose_of,
        chain.landmark_of, weights, at.residuals, system,
    )  # fmt: skip
    _add_border_priors(chain, at, system.front, system.pull)
    return system


@compile_once
def _add_border_priors(chain, at, front, pull):
    """Priors on landmarks, range scale and offset; an absent landmark is held where it is."""
    for k in range(len(at.landmarks)):
        absent = math.isnan(at.landmarks[k, 0])
        for i in range(2):
            if absent:
                front[3 + 2 * k + i, 3 + 2 * k + i] = 1.0
            else:
                error = at.landmarks[k, i] - chain.landmark_means[k, i]
                _add_prior(front, pull, 2 * k + i, chain.landmark_information[k], error)
    for i in range(2):
        if chain.columns[i] >= 0:
            error = at.calibration[i] - chain.calibration_means[i]
            _add_prior(front, pull, chain.columns[i], chain.calibration_information[i], error)


@compile_once
def _add_prior(front, pull, column, weight, error):
    """Half of weight times a squared error, in one column of the border."""
    front[3 + column, 3 + column] += weight
    pull[column] += weight * error
