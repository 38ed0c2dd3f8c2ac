"""The likelihood of a few variables, compiled: GTSAM's factor errors without GTSAM.

GTSAM stays the definition. `flatten` reads a GTSAM factor graph into plain arrays, `energy` and
`residuals` compute from them what GTSAM's ``error()`` and whitened errors are, to rounding. A
point is the same tangent vector xi about the MAP as everywhere (`likelihood.LocalLikelihood`).
More than 300 lines, for every kind of factor is read, evaluated and dispatched in one place.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import gtsam
import numpy as np
from numba.extending import overload

from sngr_utils.numerics.jit import OPTIONS, compile_once
from sngr_utils.slam import range_density

TWO_PI = 2 * math.pi


class Factors(NamedTuple):
    """Factors around d numbers that move: 3 per pose, then 2 per point. Plain arrays.

    Attributes
    ----------
    poses : (P, 5) x, y, theta, cos, sin of every pose involved; the first n_poses move
    points : (Q, 2) every landmark involved; the first n_points move
    counts : (7,) n_poses, n_points, and the numbers of odometry factors, pose priors, point
        priors, ranges between points and ranges from poses: the order of the next two
    of : (F, 2) rows of the poses or points of each factor
    measured : (F, 8) the measurement (a pose in five numbers, a point in two, a range in one)
        and, in the last three columns, 1 / sigma. The second number of a range from a pose or
        a point is its floor, see `range_residual`; 0 for an ordinary one
    quadratic : (d, d) Q of an additional energy 1/2 xi^T Q xi; (0, 0) for none
    linear : (d,) g of an additional energy g^T xi; (0,) for none
    factor : on the sum of GTSAM's error(), see `settings.SamplerSettings`
    """

    poses: np.ndarray
    points: np.ndarray
    counts: np.ndarray
    of: np.ndarray
    measured: np.ndarray
    quadratic: np.ndarray
    linear: np.ndarray
    factor: float

    @property
    def dimension(self) -> int:
        return int(3 * self.counts[0] + 2 * self.counts[1])

    @property
    def n_residuals(self) -> int:
        return int(np.array([3, 3, 2, 1, 1]) @ self.counts[2:])


def flatten(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: list[int], factor: float
) -> Factors:
    """The factors of `graph` as arrays, `keys` moving and everything else held at `values`.

    Parameters
    ----------
    keys : variables that move, poses before points
    factor : on the sum of GTSAM's error()

    Raises
    ------
    ValueError : a factor or a noise model of another kind, or a point before a pose in `keys`
    """
    rows: tuple[list, list] = ([], [])  # of poses, of points
    index: dict[int, int] = {}

    def place(key: int) -> int:
        if key not in index:
            is_pose = _is_pose(key)
            kind = rows[0] if is_pose else rows[1]
            index[key] = len(kind)
            kind.append(_row(values.atPose2(key)) if is_pose else values.atPoint2(key))
        return index[key]

    poses_first = [_is_pose(key) for key in keys]
    if poses_first != sorted(poses_first, reverse=True):
        raise ValueError("keys must name poses before points")
    for key in keys:
        place(key)
    read: dict[type, list] = {kind: [] for kind in _MEASUREMENT}
    for i in range(graph.size()):
        one = graph.at(i)
        if type(one) not in read:
            raise ValueError(f"factor {i} is a {type(one).__name__}: it has no compiled form")
        of = list(map(place, one.keys()))
        row = (*_MEASUREMENT[type(one)](one), *_weights(one))
        read[type(one)].append(((of[0], of[-1]), row))
    ordered = [pair for kind in read.values() for pair in kind]
    n_poses = sum(poses_first)
    counts = [n_poses, len(keys) - n_poses, *(len(kind) for kind in read.values())]
    return Factors(
        np.array(rows[0], dtype=float).reshape(-1, 5),
        np.array(rows[1], dtype=float).reshape(-1, 2),
        np.array(counts),
        np.array([of for of, _ in ordered], dtype=np.uint64).reshape(-1, 2),
        np.array([row for _, row in ordered]).reshape(-1, 8),
        quadratic=np.zeros((0, 0)),
        linear=np.zeros(0),
        factor=float(factor),
    )


def _is_pose(key: int) -> bool:
    return gtsam.Symbol(key).chr() == ord("x")


def _row(pose: gtsam.Pose2) -> tuple[float, ...]:
    theta = pose.theta()
    return pose.x(), pose.y(), theta, math.cos(theta), math.sin(theta)


def _weights(factor: gtsam.NoiseModelFactor) -> tuple[float, ...]:
    """1 / sigma of each component, filled up to three."""
    noise = factor.noiseModel()
    if not isinstance(noise, gtsam.noiseModel.Diagonal):
        raise ValueError(f"noise model {type(noise).__name__}: only diagonal ones are compiled")
    weights = [1 / sigma for sigma in noise.sigmas().tolist()]
    return (*weights, 0.0, 0.0)[:3]


# How to read what each kind of factor measured, as five numbers; the order is that of the loops
# below.
_MEASUREMENT: dict[type, Callable] = {
    gtsam.BetweenFactorPose2: lambda factor: _row(factor.measured()),
    gtsam.PriorFactorPose2: lambda factor: _row(factor.prior()),
    gtsam.PriorFactorPoint2: lambda factor: (*factor.prior().tolist(), 0.0, 0.0, 0.0),
    gtsam.RangeFactor2: lambda factor: (factor.measured(), 0.0, 0.0, 0.0, 0.0),
    gtsam.RangeFactor2D: lambda factor: (factor.measured(), 0.0, 0.0, 0.0, 0.0),
}


@compile_once
def place_variables(factors, xi, poses, points):
    """Move the first poses and points of the work arrays to MAP.retract(xi).

    Source: the exponential map of SE(2), Sola et al., A micro Lie theory, 2018, eq. 156.
    """
    for i in range(factors.counts[0]):
        vx, vy, turn = xi[3 * i], xi[3 * i + 1], xi[3 * i + 2]
        sin_half, cos_half = math.sin(0.5 * turn), math.cos(0.5 * turn)
        along, across = 1.0, 0.0
        if abs(turn) > 1e-10:
            chord = 2 * sin_half / turn
            along, across = chord * cos_half, chord * sin_half
        dx, dy = along * vx - across * vy, across * vx + along * vy
        c, s = factors.poses[i, 3], factors.poses[i, 4]
        cos, sin = 1 - 2 * sin_half * sin_half, 2 * sin_half * cos_half
        poses[i, 0] = factors.poses[i, 0] + c * dx - s * dy
        poses[i, 1] = factors.poses[i, 1] + s * dx + c * dy
        poses[i, 2] = factors.poses[i, 2] + turn
        poses[i, 3], poses[i, 4] = c * cos - s * sin, s * cos + c * sin
    for k in range(factors.counts[1]):
        at = 3 * factors.counts[0] + 2 * k
        points[k, 0] = factors.points[k, 0] + xi[at]
        points[k, 1] = factors.points[k, 1] + xi[at + 1]


@compile_once
def _pose_residual(x, y, theta, measured, f):
    """Whitened logarithm of measured^-1 * (x, y, theta): GTSAM's local coordinates.

    Source: Sola et al., eq. 158; h cot h by its series for turns below 0.1 rad, exact there to
    rounding, since nearly all turns are and the tangent is slow.
    """
    dx, dy, c, s = x - measured[f, 0], y - measured[f, 1], measured[f, 3], measured[f, 4]
    x, y = c * dx + s * dy, c * dy - s * dx
    turn = theta - measured[f, 2]
    if abs(turn) > math.pi:
        turn -= TWO_PI * math.floor(turn / TWO_PI + 0.5)
    across = 0.5 * turn
    if abs(turn) < 0.1:
        q = turn * turn
        along = 1 - q / 12 * (1 + q / 60 * (1 + q / 42 * (1 + q / 40)))
    else:
        along = across / math.tan(across)
    x, y = along * x + across * y, along * y - across * x
    return x * measured[f, 5], y * measured[f, 6], turn * measured[f, 7]


@compile_once
def between_residual(poses, of, measured, f):
    """Three whitened residuals of factor f, an odometry."""
    a, b = of[f, 0], of[f, 1]
    dx, dy, c, s = poses[b, 0] - poses[a, 0], poses[b, 1] - poses[a, 1], poses[a, 3], poses[a, 4]
    x, y, turn = c * dx + s * dy, c * dy - s * dx, poses[b, 2] - poses[a, 2]
    return _pose_residual(x, y, turn, measured, f)


@compile_once
def prior_residual(poses, of, measured, f):
    """Three whitened residuals of factor f, a prior on a pose."""
    a = of[f, 0]
    return _pose_residual(poses[a, 0], poses[a, 1], poses[a, 2], measured, f)


@compile_once
def point_residual(points, of, measured, f):
    """Two whitened residuals of factor f, a prior on a point."""
    dx, dy = points[of[f, 0], 0] - measured[f, 0], points[of[f, 0], 1] - measured[f, 1]
    return dx * measured[f, 5], dy * measured[f, 6]


@compile_once
def range_residual(from_rows, points, of, measured, f):
    """The whitened residual e of factor f, a range from a pose or a point to a point.

    Of a range that may be wrong it is the number whose half square is `range_density.loss`.
    """
    i, k = of[f, 0], of[f, 1]
    dx, dy = from_rows[i, 0] - points[k, 0], from_rows[i, 1] - points[k, 1]
    e = (math.sqrt(dx * dx + dy * dy) - measured[f, 0]) * measured[f, 5]
    floor = measured[f, 1]
    if floor == 0.0:
        return e
    return math.copysign(math.sqrt(2 * max(range_density.loss(e * e, floor), 0.0)), e)


@compile_once
def residuals(factors, xi, poses, points, out):
    """Whitened residuals of all factors at a (d,) point into `out`, factor by factor.

    poses, points : work arrays, copies of those of `factors`
    """
    place_variables(factors, xi, poses, points)
    of, measured = factors.of, factors.measured
    priors = factors.counts[2]
    anchors = priors + factors.counts[3]
    between_points = anchors + factors.counts[4]
    n = 0
    for f in range(len(of)):
        if f < priors:
            out[n], out[n + 1], out[n + 2] = between_residual(poses, of, measured, f)
            n += 3
        elif f < anchors:
            out[n], out[n + 1], out[n + 2] = prior_residual(poses, of, measured, f)
            n += 3
        elif f < between_points:
            out[n], out[n + 1] = point_residual(points, of, measured, f)
            n += 2
        else:
            near = points if f < between_points + factors.counts[5] else poses
            out[n] = range_residual(near, points, of, measured, f)
            n += 1


@compile_once
def energy(factors, x, poses, points, limit):
    """Minus the log-likelihood at xi = x, [nats]; stops adding once it exceeds `limit`.

    Errors are never negative, so a sum above the limit stays above it: a sampler that only asks
    whether a point lies below the limit gets the same answer sooner. `math.inf` for the value.
    No loop has a second way out: the arrays' references would be counted on every call.
    """
    place_variables(factors, x, poses, points)
    extra = 0.0
    for i in range(len(factors.quadratic)):
        row = 0.5 * factors.quadratic[i, i] * x[i]
        for j in range(i):
            row += factors.quadratic[i, j] * x[j]
        extra += row * x[i]
    for i in range(len(factors.linear)):
        extra += factors.linear[i] * x[i]
    of, measured, half = factors.of, factors.measured, 0.5 * factors.factor
    enough = (limit - extra) / half
    total, f = 0.0, 0
    end = factors.counts[2]
    while f < end and total <= enough:
        dx, dy, turn = between_residual(poses, of, measured, f)
        total += dx * dx + dy * dy + turn * turn
        f += 1
    end += factors.counts[3]
    while f < end and total <= enough:
        dx, dy, turn = prior_residual(poses, of, measured, f)
        total += dx * dx + dy * dy + turn * turn
        f += 1
    end += factors.counts[4]
    while f < end and total <= enough:
        dx, dy = point_residual(points, of, measured, f)
        total += dx * dx + dy * dy
        f += 1
    end += factors.counts[5]
    while f < end and total <= enough:
        e = range_residual(points, points, of, measured, f)
        total += e * e
        f += 1
    while f < len(of) and total <= enough:
        e = range_residual(poses, points, of, measured, f)
        total += e * e
        f += 1
    return extra + half * total


@compile_once
def log_likelihoods(factors, points_xi):
    """(N,) log-likelihoods at (N, d) points, [nats]."""
    poses, points = factors.poses.copy(), factors.points.copy()
    out = np.empty(len(points_xi))
    for n in range(len(points_xi)):
        out[n] = -energy(factors, points_xi[n], poses, points, math.inf)
    return out


@compile_once
def log_likelihood(factors, xi):
    """Log-likelihood at one (d,) point, [nats]."""
    return -energy(factors, xi, factors.poses.copy(), factors.points.copy(), math.inf)


def evaluate(factors, x, poses, points, limit):
    """Minus the log-likelihood at x, [nats]; compiled code chooses by the type of `factors`."""
    raise NotImplementedError


def evaluated_by(kind: type, function: Callable) -> None:
    """Let `evaluate` be a compiled function of the same arguments where `factors` are of a type.

    The function itself, for a call in between would count the references of all arrays anew.
    """

    @overload(evaluate, jit_options=OPTIONS)
    def chosen(factors, x, poses, points, limit):
        return function.py_func if getattr(factors, "instance_class", None) is kind else None


evaluated_by(Factors, energy)


@compile_once
def energy_at(factors, x):
    """`evaluate` at one (d,) point, to the end."""
    return evaluate(factors, x, factors.poses.copy(), factors.points.copy(), math.inf)
