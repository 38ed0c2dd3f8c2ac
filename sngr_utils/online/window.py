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
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.chain_solver import CERES
from sngr_utils.slam.range_loss import LEAST_SQUARES

MOST_STEPS, SETTLED = 30, 1e-7  # of Levenberg-Marquardt; decrease [nats] that is none
LEAST_DAMPING, MOST_DAMPING, DAMPER = 1e-9, 1e6, 10.0


class Past(NamedTuple):
    """What the poses before the window say: a Gaussian on its first pose and the landmarks.

    Landmarks are taken as that pose sees them. How the whole map is turned is hardly known, its
    shape to centimetres; in coordinates of the world a turn along the tangent would stretch it.

    Attributes
    ----------
    frame : (1, 4) the pose where it was linearised
    landmarks : (K, 2) there, in the frame of the pose; NaN for an absent one
    information, slope : (3+2K, 3+2K) and (3+2K,) of its cost there

    Source: Castellanos, Martinez-Cantin, Tardos, Neira, Robotics and Autonomous Systems 55, 2007.
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
def _seen(frame, landmark):
    """Coordinates of a landmark in a frame."""
    x, y = landmark[0] - frame[0], landmark[1] - frame[1]
    return frame[2] * x + frame[3] * y, frame[2] * y - frame[3] * x


@compile_once
def _moved(past, at):
    """(3+2K,) from where the past was linearised to a point."""
    delta = np.zeros(len(past.slope))
    frame = information.frame_at(at.frames, 0)
    turned = information.prior_residual(information.frame_at(past.frame, 0), frame)
    delta[0], delta[1], delta[2] = turned
    for k in range(len(at.landmarks)):
        seen = _seen(frame, at.landmarks[k])
        for i in range(2):
            step = seen[i] - past.landmarks[k, i]
            delta[3 + 2 * k + i] = 0.0 if np.isnan(step) else step
    return delta


@compile_once
def _by_step(frame, landmarks):
    """(3+2K, 3+2K) how landmarks as seen move with a step of the frame and of landmarks."""
    jacobian = np.eye(3 + landmarks.size)
    for k in range(len(landmarks)):
        x, y = _seen(frame, landmarks[k])
        if np.isnan(x):
            continue
        i = 3 + 2 * k
        jacobian[i, i], jacobian[i, i + 1] = frame[2], frame[3]
        jacobian[i + 1, i], jacobian[i + 1, i + 1] = -frame[3], frame[2]
        jacobian[i, 0], jacobian[i + 1, 1] = -1.0, -1.0
        jacobian[i, 2], jacobian[i + 1, 2] = y, -x
    return jacobian


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
    jacobian = _by_step(information.frame_at(at.frames, 0), at.landmarks)
    slope = jacobian.T @ (past.slope + past.information @ _moved(past, at))
    matrix = jacobian.T @ past.information @ jacobian
    for i in range(len(slope)):
        if i < 3:
            system.slope[0, i] += slope[i]
        else:
            system.pull[i - 3] += slope[i]
        for j in range(len(slope)):
            if i < 3 and j < 3:
                system.own[0, i, j] += matrix[i, j]
            elif i < 3:
                system.rest[0, i, j] += matrix[i, j]
            elif j >= 3:
                system.front[i, j] += matrix[i, j]
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
            if damped_step.solve(system, damping, CERES.scaled, steps, border) >= 0.0:
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


def marginalise(chain: Chain, past: Past, at: State) -> Past:
    """What all poses of a chain but the last say of that one and of the landmarks, as a `Past`.

    The chain has no ranges of its last pose and no priors on landmarks. Three calls from Python
    take microseconds; as one function all of it would be compiled a second time.
    """
    cost(chain, past, at)
    return _onto_last(linearise(chain, past, at), at)


@compile_once
def _onto_last(system, at):
    """`marginalise`, of the system at the point, which is used up."""
    n, width = len(at.frames) - 1, 3 + at.landmarks.size
    for k in range(len(at.landmarks)):
        if np.isnan(at.landmarks[k, 0]):  # what holds an absent one
            system.front[3 + 2 * k, 3 + 2 * k] = system.front[4 + 2 * k, 4 + 2 * k] = 0.0
    matrix = system.front
    information.eliminate(system.own[:n], system.rest[:n], matrix, system.lost)
    slope = np.zeros(width)
    for i in range(3, width):
        slope[i] = system.pull[i - 3]
    for t in range(n):
        here = system.slope[t] + slope[:3]
        slope[0] = slope[1] = slope[2] = 0.0
        slope -= system.rest[t].T @ here
    for i in range(3):
        slope[i] += system.slope[n, i]
        for j in range(3):
            matrix[i, j] += system.own[n, i, j]
    for i in range(width):
        for j in range(i):
            matrix[i, j] = matrix[j, i]
    frame, seen = information.frame_at(at.frames, n), at.landmarks.copy()
    for k in range(len(seen)):
        seen[k, 0], seen[k, 1] = _seen(frame, at.landmarks[k])
    back = np.linalg.inv(_by_step(frame, at.landmarks))
    return Past(at.frames[n:].copy(), seen, back.T @ matrix @ back, back.T @ slope)
