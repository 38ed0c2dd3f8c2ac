"""The linearisation of a range-only graph as blocks of information, and their inversion.

All of it compiled; `selected_inverse` and `chain_solver` are the ways in. The information is block
tridiagonal in the poses, with a border: the landmarks, and a range scale and offset where those
are estimated. Pose tangents are [x, y, theta] in the pose's own body frame. GTSAM retracts by
the exponential map and differentiates the logarithm of the residual too, for priors and odometry
alike; so the Jacobians depend on the measured motion, and not only on the poses. Those of a
range do not depend on its value.
More than 300 lines: linearisation and elimination are compiled into each other.
"""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import invert

# rad, up to which the derivative of the logarithm is a first-order series: GTSAM's, and the exact
SMALL_ANGLE, TINY_ANGLE = 1e-5, 1e-8
SMALL_RANGE = 1e-10  # m, up to it GTSAM takes (1, 1) for the direction to a landmark


class System(NamedTuple):
    """A linearised chain of T poses with B columns in its border: information, and gradient.

    Attributes
    ----------
    own, rest : (T, 3, 3) of each pose, and (T, 3, 3+B) between pose t and [pose t+1 | border]
    front, lost : (3+B, 3+B) of the border in the lower right, else zero; and its rounding errors
    slope, pull : (T, 3) and (B,) gradient of the cost by poses and border
    """

    own: np.ndarray
    rest: np.ndarray
    front: np.ndarray
    lost: np.ndarray
    slope: np.ndarray
    pull: np.ndarray


@compile_once
def empty_system(n_poses, n_border):
    """A system without factors."""
    width = 3 + n_border
    return System(
        np.zeros((n_poses, 3, 3)), np.zeros((n_poses, 3, width)), np.zeros((width, width)),
        np.zeros((width, width)), np.zeros((n_poses, 3)), np.zeros(n_border),
    )  # fmt: skip


@compile_once
def frames_of(poses):
    """(T, 4) rows x, y, cos theta, sin theta of (T, 3) poses x, y, theta."""
    frames = np.empty((len(poses), 4))
    for t in range(len(poses)):
        frames[t, 0], frames[t, 1] = poses[t, 0], poses[t, 1]
        frames[t, 2], frames[t, 3] = math.cos(poses[t, 2]), math.sin(poses[t, 2])
    return frames


def poses_of(frames: np.ndarray) -> np.ndarray:
    """(T, 3) poses of frames as `frames_of` makes them."""
    return np.column_stack([frames[:, :2], np.arctan2(frames[:, 3], frames[:, 2])])


def in_world_frame(blocks: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    """(T, 2, 2) covariances of positions, from those in the frames of poses with such headings."""
    rotations = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
    return rotations @ blocks @ rotations.swapaxes(1, 2)


@compile_once
def _relative(a, b):
    """Frame b seen from frame a, both (x, y, cos, sin)."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    x, y = a[2] * dx + a[3] * dy, a[2] * dy - a[3] * dx
    return x, y, a[2] * b[2] + a[3] * b[3], a[2] * b[3] - a[3] * b[2]


@compile_once
def frame_at(frames, t):
    """Row t of `frames` as a tuple."""
    return frames[t, 0], frames[t, 1], frames[t, 2], frames[t, 3]


@compile_once
def _logarithm(frame):
    """Logarithm (v_x, v_y, angle) of a frame of SE(2), in GTSAM's own form."""
    x, y, cos, sin = frame
    angle = math.atan2(sin, cos)
    if abs(angle) < 1e-10:
        return x, y, angle
    ux, uy = cos * x + sin * y - x, cos * y - sin * x - y
    scale = angle / ((cos - 1.0) * (cos - 1.0) + sin * sin)
    return -scale * uy, scale * ux, angle


@compile_once
def _log_derivative(logarithm, exact, out):
    """Derivative (3, 3) of the SE(2) logarithm by a body-frame step, into `out`.

    GTSAM divides by 1 - cos, which cancels for residual headings between 1e-5 and 1e-3 rad. The
    error of it (up to some 10 % of a residual metre per radian) is part of the covariances that
    have to equal GTSAM's; a minimum is sought with the exact derivative, else the search ends
    millimetres beside it.

    Source: Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, sec. 10.6.
    """
    vx, vy, angle = logarithm
    out[2, 0] = out[2, 1] = 0.0
    out[2, 2] = 1.0
    if abs(angle) <= (TINY_ANGLE if exact else SMALL_ANGLE):
        out[0, 0] = out[1, 1] = 1.0
        out[0, 1] = out[1, 0] = 0.0
        out[0, 2], out[1, 2] = 0.5 * vy, -0.5 * vx
        return
    inverse = 1.0 / angle
    if exact:
        cotangent = 0.5 / math.tan(0.5 * angle)
    else:
        cotangent = 0.5 * math.sin(angle) / (1.0 - math.cos(angle))
    out[0, 0] = out[1, 1] = angle * cotangent
    out[0, 1], out[1, 0] = -0.5 * angle, 0.5 * angle
    out[0, 2] = vx * inverse - vx * cotangent + 0.5 * vy
    out[1, 2] = vy * inverse - 0.5 * vx - vy * cotangent


@compile_once
def prior_residual(prior, frame):
    """(3,) residual log(prior^-1 * frame) of the prior on a pose, [m, m, rad]."""
    return _logarithm(_relative(prior, frame))


@compile_once
def odometry_residual(first, second, motion):
    """(3,) residual log(motion^-1 * first^-1 * second) of a step (eq. odometry), [m, m, rad]."""
    return _logarithm(_relative(motion, _relative(first, second)))


@compile_once
def _odometry_jacobians(first, second, residual, exact, by_first, by_second):
    """(3, 3) Jacobians of `odometry_residual` by both poses, into the last two."""
    x, y, cos, sin = _relative(first, second)
    _log_derivative(residual, exact, by_second)
    back_x, back_y = -cos * x - sin * y, sin * x - cos * y
    for i in range(3):  # by_first = -by_second times the adjoint of the step's inverse
        a, b, c = by_second[i, 0], by_second[i, 1], by_second[i, 2]
        by_first[i, 0] = -a * cos + b * sin
        by_first[i, 1] = -a * sin - b * cos
        by_first[i, 2] = -a * back_y + b * back_x - c


@compile_once
def _weigh(jacobian, information, residual, weighted, slope):
    """jacobian^T information into `weighted`, and times the residual added to `slope`."""
    for i in range(3):
        a, b, c = jacobian[0, i], jacobian[1, i], jacobian[2, i]
        for k in range(3):
            total = a * information[0, k] + b * information[1, k] + c * information[2, k]
            weighted[i, k] = total
            slope[i] += total * residual[k]


@compile_once
def _add_product(weighted, right, out):
    """Add the product of two (3, 3) to the first columns of `out`."""
    for i in range(3):
        a, b, c = weighted[i, 0], weighted[i, 1], weighted[i, 2]
        for j in range(3):
            out[i, j] = out[i, j] + a * right[0, j] + b * right[1, j] + c * right[2, j]


@compile_once
def add_odometry(frames, prior, prior_information, motions, information, exact, system):
    """Add the prior on pose 0 and the T-1 odometry factors to a system.

    frames, motions : (T, 4) and (T-1, 4) poses and measured motions, as `frames_of` makes them
    prior : (1, 4), the mean of pose 0
    prior_information, information : (3, 3) and (T-1, 3, 3), of [x, y, theta]
    exact : see `_log_derivative`
    """
    own, rest, slope = system.own, system.rest, system.slope
    by_first, by_second = np.empty((3, 3)), np.empty((3, 3))
    weighted = np.empty((3, 3))
    frame = frame_at(frames, 0)
    residual = prior_residual(frame_at(prior, 0), frame)
    _log_derivative(residual, exact, by_first)
    _weigh(by_first, prior_information, residual, weighted, slope[0])
    _add_product(weighted, by_first, own[0])
    for t in range(len(motions)):
        following = frame_at(frames, t + 1)
        residual = odometry_residual(frame, following, frame_at(motions, t))
        _odometry_jacobians(frame, following, residual, exact, by_first, by_second)
        _weigh(by_first, information[t], residual, weighted, slope[t])
        _add_product(weighted, by_first, own[t])
        _add_product(weighted, by_second, rest[t])
        _weigh(by_second, information[t], residual, weighted, slope[t + 1])
        _add_product(weighted, by_second, own[t + 1])
        frame = following


@compile_once
def accumulate(sums, lost, i, j, term):
    """Add `term` to ``sums[i, j]``, what rounding loses kept in ``lost[i, j]``.

    Source: Kahan, Communications of the ACM 8, 1965.
    """
    term -= lost[i, j]
    total = sums[i, j] + term
    lost[i, j] = (total - sums[i, j]) - term
    sums[i, j] = total


@compile_once
def distance_and_direction(frames, landmarks, t, k):
    """Distance from pose t to landmark k, [m], and the direction to it, as GTSAM takes it."""
    dx, dy = landmarks[k, 0] - frames[t, 0], landmarks[k, 1] - frames[t, 1]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > SMALL_RANGE:
        return distance, dx / distance, dy / distance
    return distance, 1.0, 1.0


@compile_once
def add_ranges(
    frames, landmarks, scale, columns, pose_of, landmark_of, weights, residuals, system
):  # fmt: skip
    """Add the ranges to landmarks that are present to a system.

    The residual of a range is scale * distance + offset - range. The thousands of terms of a
    landmark all but cancel in what fixes the whole map (the prior on pose 0), so `front` is
    summed with compensation here and in `eliminate`.

    landmarks : (K, 2), NaN for one that is absent
    columns : (2,) int, columns of the scale and of the offset in the border; -1 if not estimated
    pose_of, landmark_of, weights, residuals : (N,) of each range, a landmark of -1 for none,
        one over its variance [1 / m^2], and its residual [m]
    """
    own, rest, front, lost = system.own, system.rest, system.front, system.lost
    row, border, column = np.zeros(2), np.ones(4), np.zeros(4, dtype=np.int64)
    size = 2 + (columns[0] >= 0) + (columns[1] >= 0)
    for m in range(len(pose_of)):
        t, k = pose_of[m], landmark_of[m]
        if k < 0 or weights[m] == 0.0 or math.isnan(landmarks[k, 0]):
            continue
        distance, ahead_x, ahead_y = distance_and_direction(frames, landmarks, t, k)
        cos, sin = frames[t, 2], frames[t, 3]
        row[0] = scale * (-cos * ahead_x - sin * ahead_y)
        row[1] = scale * (sin * ahead_x - cos * ahead_y)
        border[0], border[1] = scale * ahead_x, scale * ahead_y
        column[0], column[1] = 2 * k, 2 * k + 1
        if columns[0] >= 0:
            border[2], column[2] = distance, columns[0]
        if columns[1] >= 0:
            border[size - 1], column[size - 1] = 1.0, columns[1]
        weight, force = weights[m], weights[m] * residuals[m]
        for i in range(2):
            system.slope[t, i] += force * row[i]
            for j in range(2):
                own[t, i, j] += weight * row[i] * row[j]
            for j in range(size):
                rest[t, i, 3 + column[j]] += weight * row[i] * border[j]
        for i in range(size):
            system.pull[column[i]] += force * border[i]
            for j in range(size):
                term = weight * border[i] * border[j]
                accumulate(front, lost, 3 + column[i], 3 + column[j], term)


@compile_once
def eliminate(own, rest, front, lost):
    """Eliminate the poses in order; leaves their conditionals, and the landmarks' information.

    own : (T, 3, 3) information of each pose -> its covariance, given all that come later
    rest : (T, 3, 3+2K) information between pose t and [pose t+1 | landmarks] -> the gain G in
        x_t = -G [x_{t+1} | l] + noise
    front : (3+2K, 3+2K) information of the landmarks in the lower right, else zero -> the same
        with the poses eliminated; upper triangle only
    lost : the rounding errors of `front`, as `add_ranges` leaves them

    Returns the first pose whose information is not positive definite, -1 if there is none.
    """
    gain = np.empty((3, rest.shape[2]))
    for t in range(len(own)):
        take_over(t, own, rest, front, lost)
        if invert(own[t]) >= 0:
            return t
        hand_on(t, own, rest, front, lost, gain)
    return -1


@compile_once
def take_over(t, own, rest, front, lost):
    """Add to pose t what the earlier poses left for it, see `eliminate`."""
    for i in range(3):
        for j in range(rest.shape[2]):
            if j < 3:
                own[t, i, j] += front[i, j]
            else:
                rest[t, i, j] += front[i, j]
            front[i, j] = lost[i, j] = 0.0


@compile_once
def hand_on(t, own, rest, front, lost, gain):
    """The gain of pose t, whose information is inverted, and what it leaves for later poses.

    gain : (3, 3+2K), work
    """
    width = rest.shape[2]
    for i in range(3):
        a, b, c = own[t, i, 0], own[t, i, 1], own[t, i, 2]
        for j in range(width):
            gain[i, j] = a * rest[t, 0, j] + b * rest[t, 1, j] + c * rest[t, 2, j]
    for i in range(width):
        a, b, c = rest[t, 0, i], rest[t, 1, i], rest[t, 2, i]
        for j in range(i, width):
            term = -(a * gain[0, j]) - b * gain[1, j] - c * gain[2, j]
            accumulate(front, lost, i, j, term)
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
                factor = rest[t, i, k]
                for j in range(width):
                    block[i, j] -= factor * later[k, j]
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
