"""Least squares on the newest poses and all landmarks, the past summed up in one Gaussian.

A chain of poses with a border of landmarks is solved in linear time, and what its first poses say
about the rest is a Gaussian on the next pose and the landmarks. So a step costs the same after
ten thousand poses as after a hundred.
"""

from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam import chain_cost, damped_step, information
from sngr_utils.slam.chain_cost import State
from sngr_utils.slam.range_loss import LEAST_SQUARES

MOST_STEPS, SETTLED = 30, 1e-7  # of Levenberg-Marquardt; decrease [nats] that is none
LEAST_DAMPING, MOST_DAMPING, DAMPER = 1e-9, 1e6, 10.0


class Past(NamedTuple):
    """What the poses before the window say: a Gaussian on its first pose and the landmarks.

    Attributes
    ----------
    frame, landmarks : (1, 4) and (K, 2) where it was linearised; NaN for an absent landmark
    information, slope : (3+2K, 3+2K) and (3+2K,) of its cost there, the pose in its body frame
    """

    frame: np.ndarray
    landmarks: np.ndarray
    information: np.ndarray
    slope: np.ndarray


def nothing(n_landmarks: int) -> Past:
    """The past before the first pose."""
    size = 3 + 2 * n_landmarks
    here = np.array([[0.0, 0.0, 1.0, 0.0]])
    unseen = np.full((n_landmarks, 2), np.nan)
    return Past(here, unseen, np.zeros((size, size)), np.zeros(size))


def without(past: Past, k: int) -> Past:
    """The past that has nothing to say about landmark k."""
    own = np.array([3 + 2 * k, 4 + 2 * k])
    block = past.information[np.ix_(own, own)]
    landmarks = past.landmarks.copy()
    landmarks[k] = np.nan
    if not block.any():
        return past._replace(landmarks=landmarks)
    gain = np.linalg.solve(block, past.information[own]).T
    matrix = past.information - gain @ past.information[own]
    slope = past.slope - gain @ past.slope[own]
    matrix[own], matrix[:, own], slope[own] = 0.0, 0.0, 0.0
    return Past(past.frame, landmarks, matrix, slope)


@compile_once
def _moved(past, at):
    """(3+2K,) from where the past was linearised to a point."""
    delta = np.zeros(len(past.slope))
    frame = information.frame_at(at.frames, 0)
    delta[:3] = np.array(information.prior_residual(information.frame_at(past.frame, 0), frame))
    for k in range(len(at.landmarks)):
        for i in range(2):
            step = at.landmarks[k, i] - past.landmarks[k, i]
            delta[3 + 2 * k + i] = 0.0 if np.isnan(step) else step
    return delta


@compile_once
def cost(chain, past, at):
    """Minus the log posterior of the window but for a constant, [nats]; fills the residuals."""
    delta = _moved(past, at)
    quadratic = 0.5 * delta @ (past.information @ delta) + past.slope @ delta
    return chain_cost.cost(chain, LEAST_SQUARES, at) + quadratic


@compile_once
def linearise(chain, past, at):
    """The system at a point whose residuals `cost` has filled."""
    system = chain_cost.linearise(chain, LEAST_SQUARES, at)
    slope = past.slope + past.information @ _moved(past, at)
    system.own[0] += past.information[:3, :3]
    system.rest[0, :, 3:] += past.information[:3, 3:]
    system.front[3:, 3:] += past.information[3:, 3:]
    system.slope[0] += slope[:3]
    system.pull[:] += slope[3:]
    return system


@compile_once
def minimise(chain, past, at):
    """From a point to the minimum near it; the point is used up. Returns it and its cost."""
    to = State(at.frames.copy(), at.landmarks.copy(), at.calibration.copy(), at.residuals.copy())
    steps, border = np.empty((len(at.frames), 3)), np.empty(at.landmarks.size)
    now, damping = cost(chain, past, at), LEAST_DAMPING
    for _ in range(MOST_STEPS):
        system, then = linearise(chain, past, at), np.inf
        while damping < MOST_DAMPING:
            if damped_step.solve(system, damping, True, steps, border) >= 0.0:
                damped_step.move(at, steps, border, chain.columns, to)
                then = cost(chain, past, to)
            if then <= now:
                break
            damping *= DAMPER
        if not then <= now:
            break
        at, to, decrease, now = to, at, now - then, then
        damping = max(damping / DAMPER, LEAST_DAMPING)
        if decrease < SETTLED:
            break
    cost(chain, past, at)
    return at, now


@compile_once
def marginalise(chain, past, at):
    """What all poses of a chain but the last say of that one and of the landmarks, as a `Past`.

    The chain has no ranges of its last pose and no priors on landmarks.
    """
    cost(chain, past, at)
    system = linearise(chain, past, at)
    n, width = len(at.frames) - 1, len(past.slope)
    for k in range(len(at.landmarks)):
        if np.isnan(at.landmarks[k, 0]):  # what holds an absent one
            system.front[3 + 2 * k, 3 + 2 * k] = system.front[4 + 2 * k, 4 + 2 * k] = 0.0
    matrix = system.front
    information.eliminate(system.own[:n], system.rest[:n], matrix, system.lost)
    slope = np.zeros(width)
    slope[3:] = system.pull
    for t in range(n):
        here = system.slope[t] + slope[:3]
        slope[:3] = 0.0
        slope -= system.rest[t].T @ here
    slope[:3] += system.slope[n]
    matrix[:3, :3] += system.own[n]
    for i in range(width):
        for j in range(i):
            matrix[i, j] = matrix[j, i]
    return Past(at.frames[n:].copy(), at.landmarks.copy(), matrix, slope)
