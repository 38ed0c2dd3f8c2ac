"""GTSAM's linearisation of a range-only graph as blocks of information, and their inversion.

All of it compiled; `chain` is the way in. Pose tangents are [x, y, theta] in the pose's own body
frame. GTSAM retracts by the exponential map and differentiates the logarithm of the residual
too, for priors and odometry alike; so the Jacobians depend on the measured motion, and not only
on the poses. Those of a range do not depend on its value.
"""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import invert

SMALL_ANGLE = 1e-5  # rad, up to it GTSAM's derivative of the logarithm is a first-order series
SMALL_RANGE = 1e-10  # m, up to it GTSAM takes (1, 1) for the direction to a landmark


@compile_once
def _frame(pose):
    """Pose [x, y, theta] as (x, y, cos theta, sin theta)."""
    return pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])


@compile_once
def _relative(a, b):
    """Frame b seen from frame a, both (x, y, cos, sin)."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    x, y = a[2] * dx + a[3] * dy, a[2] * dy - a[3] * dx
    return x, y, a[2] * b[2] + a[3] * b[3], a[2] * b[3] - a[3] * b[2]


@compile_once
def _log_derivative(frame, out):
    """Derivative (3, 3) of the SE(2) logarithm by a body-frame step, into `out`.

    In GTSAM's own form: 1 - cos cancels for residual headings between 1e-5 and 1e-3 rad, and the
    error of it (up to some 10 % of a residual metre per radian) is part of the linearisation we
    have to equal. There GTSAM's own answer moves by 1e-7 if a heading moves in its last place.

    Source: Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, sec. 10.6.
    """
    x, y, cos, sin = frame
    angle = math.atan2(sin, cos)
    out[2, 0] = out[2, 1] = 0.0
    out[2, 2] = 1.0
    if abs(angle) < 1e-10:
        vx, vy = x, y
    else:
        ux, uy = cos * x + sin * y - x, cos * y - sin * x - y
        scale = angle / ((cos - 1.0) * (cos - 1.0) + sin * sin)
        vx, vy = -scale * uy, scale * ux
    if abs(angle) <= SMALL_ANGLE:
        out[0, 0] = out[1, 1] = 1.0
        out[0, 1] = out[1, 0] = 0.0
        out[0, 2], out[1, 2] = 0.5 * vy, -0.5 * vx
        return
    inverse = 1.0 / angle
    cotangent = 0.5 * math.sin(angle) / (1.0 - math.cos(angle))
    out[0, 0] = out[1, 1] = angle * cotangent
    out[0, 1], out[1, 0] = -0.5 * angle, 0.5 * angle
    out[0, 2] = vx * inverse - vx * cotangent + 0.5 * vy
    out[1, 2] = vy * inverse - 0.5 * vx - vy * cotangent


@compile_once
def _odometry_jacobians(first, second, motion, by_first, by_second):
    """(3, 3) Jacobians of log(motion^-1 * first^-1 * second) by both poses, into the last two."""
    step = _relative(first, second)
    _log_derivative(_relative(motion, step), by_second)
    x, y, cos, sin = step
    back_x, back_y = -cos * x - sin * y, sin * x - cos * y
    for i in range(3):  # by_first = -by_second times the adjoint of the step's inverse
        a, b, c = by_second[i, 0], by_second[i, 1], by_second[i, 2]
        by_first[i, 0] = -a * cos + b * sin
        by_first[i, 1] = -a * sin - b * cos
        by_first[i, 2] = -a * back_y + b * back_x - c


@compile_once
def _add_product(left, weights, right, out):
    """Add left^T diag(weights) right, (3, 3), to the first columns of `out`."""
    for i in range(3):
        for j in range(3):
            for k in range(3):
                out[i, j] += left[k, i] * weights[k] * right[k, j]


@compile_once
def add_odometry(poses, x0_mean, x0_weights, odometry, odometry_weights, own, rest):
    """Add the prior on pose 0 and the T-1 odometry factors to the information blocks.

    odometry_weights : (T-1, 3) one over the squared sigmas of each step
    """
    by_first, by_second = np.empty((3, 3)), np.empty((3, 3))
    frame = _frame(poses[0])
    _log_derivative(_relative(_frame(x0_mean), frame), by_first)
    _add_product(by_first, x0_weights, by_first, own[0])
    for t in range(len(odometry)):
        following = _frame(poses[t + 1])
        _odometry_jacobians(frame, following, _frame(odometry[t]), by_first, by_second)
        _add_product(by_first, odometry_weights[t], by_first, own[t])
        _add_product(by_second, odometry_weights[t], by_second, own[t + 1])
        _add_product(by_first, odometry_weights[t], by_second, rest[t])
        frame = following


@compile_once
def _accumulate(sums, lost, i, j, term):
    """Add `term` to ``sums[i, j]``, what rounding loses kept in ``lost[i, j]``.

    Source: Kahan, Communications of the ACM 8, 1965.
    """
    term -= lost[i, j]
    total = sums[i, j] + term
    lost[i, j] = (total - sums[i, j]) - term
    sums[i, j] = total


@compile_once
def add_ranges(poses, landmarks, pose_of, label_of, weight, own, rest, front, lost):
    """Add the ranges to landmarks that are present to the information blocks.

    The thousands of terms of a landmark all but cancel in what fixes the whole map (the prior on
    pose 0), so `front` is summed with compensation here and in `eliminate`.
    """
    row, ahead = np.zeros(2), np.zeros(2)
    for m in range(len(pose_of)):
        t, k = pose_of[m], label_of[m]
        if math.isnan(landmarks[k, 0]):
            continue
        x, y, cos, sin = _frame(poses[t])
        dx, dy = landmarks[k, 0] - x, landmarks[k, 1] - y
        distance = math.sqrt(dx * dx + dy * dy)
        if distance > SMALL_RANGE:
            ahead[0], ahead[1] = dx / distance, dy / distance
        else:
            ahead[0] = ahead[1] = 1.0
        row[0], row[1] = -cos * ahead[0] - sin * ahead[1], sin * ahead[0] - cos * ahead[1]
        column = 3 + 2 * k
        for i in range(2):
            for j in range(2):
                own[t, i, j] += weight * row[i] * row[j]
                rest[t, i, column + j] += weight * row[i] * ahead[j]
                term = weight * ahead[i] * ahead[j]
                _accumulate(front, lost, column + i, column + j, term)


@compile_once
def eliminate(own, rest, front, lost):
    """Eliminate the poses in order; leaves their conditionals, and the landmarks' information.

    own : (T, 3, 3) information of each pose -> its covariance, given all that come later
    rest : (T, 3, 3+2K) information between pose t and [pose t+1 | landmarks] -> the gain G in
        x_t = -G [x_{t+1} | l] + noise
    front : (3+2K, 3+2K) information of the landmarks in the lower right, else zero -> the same
        with the poses eliminated; upper triangle only
    lost : the rounding errors of `front`, as `add_ranges` leaves them
    """
    n_poses, _, width = rest.shape
    gain = np.empty((3, width))
    for t in range(n_poses):
        for i in range(3):  # what the earlier poses left for this one
            for j in range(width):
                if j < 3:
                    own[t, i, j] += front[i, j]
                else:
                    rest[t, i, j] += front[i, j]
                front[i, j] = lost[i, j] = 0.0
        invert(own[t])
        for i in range(3):
            for j in range(width):
                gain[i, j] = 0.0
                for k in range(3):
                    gain[i, j] += own[t, i, k] * rest[t, k, j]
        for i in range(width):
            for j in range(i, width):
                term = 0.0
                for k in range(3):
                    term -= rest[t, k, i] * gain[k, j]
                _accumulate(front, lost, i, j, term)
        for i in range(3):
            for j in range(width):
                rest[t, i, j] = gain[i, j]


@compile_once
def substitute(own, rest, later, second):
    """Go back over the poses; leaves covariances where `eliminate` left conditionals.

    own, rest : as `eliminate` leaves them -> covariances of pose t with itself and with
        [pose t+1 | landmarks]
    later : (3+2K, 3+2K) covariance of the landmarks in the lower right, else zero; overwritten
    second : (T-2, 3, 3), filled with the covariances of poses t and t+2
    """
    n_poses, _, width = rest.shape
    block = np.empty((3, width))
    for t in range(n_poses - 1, -1, -1):
        for i in range(3):
            for j in range(3):
                if t < n_poses - 2:
                    second[t, i, j] = 0.0
                    for k in range(width):
                        met = rest[t + 1, k, j] if k < 3 else rest[t + 2, j, k]
                        second[t, i, j] -= rest[t, i, k] * met
            for j in range(width):
                block[i, j] = 0.0
            for k in range(width):
                for j in range(width):
                    block[i, j] -= rest[t, i, k] * later[k, j]
        for i in range(3):
            for j in range(i + 1):
                for k in range(width):
                    own[t, i, j] -= block[i, k] * rest[t, j, k]
                own[t, j, i] = later[i, j] = later[j, i] = own[t, i, j]
        for i in range(3):
            for j in range(width):
                rest[t, i, j] = block[i, j]
                if j >= 3:
                    later[i, j] = later[j, i] = block[i, j]
