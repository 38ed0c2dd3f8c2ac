"""One damped step of Levenberg-Marquardt on a linearised chain, and where it leads; compiled.

Poses are eliminated in order onto the border, the border is solved for, and the poses follow from
the last one to the first: O(T K^2).
"""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import invert
from sngr_utils.slam import information

LEAST_DIAGONAL, MOST_DIAGONAL = 1e-6, 1e32  # of what scales the damping, as in GTSAM


@compile_once
def _scale(diagonal, scaled):
    """What lambda multiplies, D, for a variable with this diagonal of the information."""
    if scaled:
        return min(max(diagonal, LEAST_DIAGONAL), MOST_DIAGONAL)
    return 1.0


@compile_once
def solve(system, damping, scaled, steps, border):
    """Solve (H + lambda D) delta = -g for lambda = `damping` into `steps` (T, 3) and `border` (B,).

    Returns the decrease -g delta - delta H delta / 2 that the linearised cost promises, negative
    if the damped information is not positive definite.
    """
    own, rest, front, lost = (
        system.own.copy(), system.rest.copy(), system.front.copy(), system.lost.copy()
    )  # fmt: skip
    for t in range(len(own)):
        for i in range(3):
            own[t, i, i] += damping * _scale(own[t, i, i], scaled)
    for i in range(3, len(front)):
        front[i, i] += damping * _scale(front[i, i], scaled)
    if information.eliminate(own, rest, front, lost) >= 0:
        return -1.0
    covariance = np.empty((len(border), len(border)))
    for i in range(len(border)):
        for j in range(i, len(border)):
            covariance[i, j] = front[3 + i, 3 + j]
    if invert(covariance) >= 0:
        return -1.0
    _substitute_gradient(own, rest, covariance, system.slope, system.pull, steps, border)
    decrease = 0.0
    for t in range(len(own)):
        for i in range(3):
            pulled = damping * _scale(system.own[t, i, i], scaled) * steps[t, i]
            decrease += 0.5 * steps[t, i] * (pulled - system.slope[t, i])
    for i in range(len(border)):
        pulled = damping * _scale(system.front[3 + i, 3 + i], scaled) * border[i]
        decrease += 0.5 * border[i] * (pulled - system.pull[i])
    return decrease


@compile_once
def _substitute_gradient(own, rest, covariance, slope, pull, steps, border):
    """Minus covariance times gradient, from what `information.eliminate` leaves.

    own, rest : covariances of the poses given what comes later, and gains
    covariance : (B, B) of the border
    """
    n_poses, _, width = rest.shape
    carried = np.zeros(width)  # gradient of the next pose and of the border, poses eliminated
    for j in range(len(pull)):
        carried[3 + j] = pull[j]
    for t in range(n_poses):
        for i in range(3):
            steps[t, i] = slope[t, i] + carried[i]
            carried[i] = 0.0
        for i in range(3):
            for j in range(width):
                carried[j] -= rest[t, i, j] * steps[t, i]
    later = np.zeros(width)  # step of the next pose and of the border
    for i in range(len(border)):
        border[i] = 0.0
        for j in range(len(border)):
            border[i] -= covariance[i, j] * carried[3 + j]
        later[3 + i] = border[i]
    for t in range(n_poses - 1, -1, -1):
        x, y, angle = steps[t, 0], steps[t, 1], steps[t, 2]
        for i in range(3):
            steps[t, i] = -own[t, i, 0] * x - own[t, i, 1] * y - own[t, i, 2] * angle
            for j in range(width):
                steps[t, i] -= rest[t, i, j] * later[j]
        for i in range(3):
            later[i] = steps[t, i]


@compile_once
def move(at, steps, border, columns, to):
    """The point `at`, moved by a step, into `to`."""
    _retract(at.frames, steps, to.frames)
    for k in range(len(at.landmarks)):
        for i in range(2):
            to.landmarks[k, i] = at.landmarks[k, i] + border[2 * k + i]
    for i in range(2):
        if columns[i] >= 0:
            to.calibration[i] = at.calibration[i] + border[columns[i]]


@compile_once
def _retract(frames, steps, moved):
    """Move frames by body-frame steps through the exponential map of SE(2), into `moved`."""
    for t in range(len(frames)):
        vx, vy, angle = steps[t, 0], steps[t, 1], steps[t, 2]
        cos, sin = math.cos(angle), math.sin(angle)
        if abs(angle) < 1e-10:
            x, y = vx, vy
        else:
            x = (sin * vx - (1.0 - cos) * vy) / angle
            y = ((1.0 - cos) * vx + sin * vy) / angle
        c, s = frames[t, 2], frames[t, 3]
        moved[t, 0] = frames[t, 0] + c * x - s * y
        moved[t, 1] = frames[t, 1] + s * x + c * y
        c, s = c * cos - s * sin, s * cos + c * sin
        norm = math.sqrt(c * c + s * s)
        moved[t, 2], moved[t, 3] = c / norm, s / norm
