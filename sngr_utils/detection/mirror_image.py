"""The mirror test: would the mirror image of a landmark explain its ranges as well?

Ranges taken from a straight line cannot tell its two sides apart. So a landmark is reflected in
the line that fits the positions best, both places are refitted, and their costs compared. A few
microseconds, no sampling.
"""

import math
from dataclasses import dataclass

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.world import checks

MAX_STEPS = 200
SAME = 0.1  # places nearer than this share of the best range's standard deviation are one
DECIDED = 40.0  # nats: a weight of e^-40 is none, in floating point
MANY = 100  # ranges, up to which a refit costs too little to be spared
FRESH = 1.02  # times the ranges of the last refit, beyond which there is another one


@dataclass(frozen=True)
class Mirror:
    """A landmark, its mirror image, and how much worse the image is.

    Attributes
    ----------
    landmark, image : (2,) the two places after the refit, [m]
    cost, image_cost : half the sum of squared whitened residuals there, [nats]
    spread : largest standard deviation of the landmark by the Gauss-Newton Hessian, [m];
        infinite where the ranges do not hold it
    distinct : whether the refit of the image ended in another place than that of the landmark
    """

    landmark: np.ndarray
    image: np.ndarray
    cost: float
    image_cost: float
    spread: float
    distinct: bool

    @property
    def gap(self) -> float:
        """Cost of the image less that of the landmark, [nats].

        0 for two equally good places, negative if the image is the better one, infinite if
        there is no second place.
        """
        return self.image_cost - self.cost if self.distinct else math.inf


def mirror_test(
    positions: np.ndarray, ranges: np.ndarray, variances: np.ndarray, landmark: np.ndarray
) -> Mirror:
    """Refit a landmark and its reflection in the line of the trajectory, and compare them.

    The refits start at least one standard deviation of a range off the line, so that a landmark
    that sits on it, at a saddle between two places, still has both.

    Parameters
    ----------
    positions : (n, 2) where the ranges were taken, [m]; one alone leaves a ring, and a gap of 0
    ranges : (n,), [m]
    variances : (n,) of each range about the distance, [m^2]
    landmark : (2,) estimate to start from, [m]

    Raises
    ------
    ValueError : shapes that do not fit, a value that is not finite, or a variance that is not
        positive
    """
    return Mirror(*reflect(*_checked(positions, ranges, variances, landmark)))


@compile_once
def reflect(positions, ranges, variances, landmark):
    """The fields of `Mirror` from arguments of `mirror_test` that need no check, as arrays."""
    centre, normal = trajectory_line(positions)
    sigma = math.sqrt(variances.min())
    height = (landmark[0] - centre[0]) * normal[0] + (landmark[1] - centre[1]) * normal[1]
    foot = landmark - height * normal
    start = math.copysign(max(abs(height), sigma), height) * normal
    here, cost, spread = _refit(positions, ranges, 1 / variances, foot + start)
    there, image_cost, _ = _refit(positions, ranges, 1 / variances, foot - start)
    distinct = math.hypot(here[0] - there[0], here[1] - there[1]) > SAME * sigma
    return here, there, cost, image_cost, spread, distinct


@compile_once
def gaps(positions, ranges, variances, landmark, counts):
    """Gaps of `Mirror` with the first n of a landmark's ranges, for ascending (C,) counts n.

    A range more raises the cost of a place, and by no more than it costs where that place was.
    So a gap that is wide stays so until the new ranges have cost what it exceeds `DECIDED` by,
    and until then that bound is given instead of a refit, from `MANY` ranges on. That holds while
    the two places are there: where the ranges contradict each other, one may vanish into the
    other or a second one appear. So all are refitted when there are `FRESH` times the ranges.
    """
    out, gap, fitted, seen = np.empty(len(counts)), 0.0, 0, 0
    here, there, rise, image_rise = landmark, landmark, 0.0, 0.0
    for c in range(len(counts)):
        n = counts[c]
        for i in range(seen, n):
            rise += _cost(positions[i], ranges[i], variances[i], here)
            image_rise += _cost(positions[i], ranges[i], variances[i], there)
        seen = n
        decided = gap - rise > DECIDED or gap + image_rise < -DECIDED
        if n <= MANY or n > FRESH * fitted or not decided:
            here, there, cost, image_cost, _, distinct = reflect(
                positions[:n], ranges[:n], variances[:n], landmark
            )
            gap = image_cost - cost if distinct else math.inf
            fitted, rise, image_rise = n, 0.0, 0.0
        out[c] = gap - rise if gap > 0 else gap + image_rise
    return out


@compile_once
def _cost(position, distance, variance, place):
    """Half the squared whitened residual of one range, [nats]."""
    error = math.hypot(place[0] - position[0], place[1] - position[1]) - distance
    return 0.5 * error * error / variance


@compile_once
def trajectory_line(positions):
    """Total least squares line of (n, 2) positions: (2,) a point on it and its (2,) unit normal."""
    x, y = positions[:, 0].mean(), positions[:, 1].mean()
    xx = xy = yy = 0.0
    for i in range(len(positions)):
        dx, dy = positions[i, 0] - x, positions[i, 1] - y
        xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    angle = 0.5 * math.atan2(2 * xy, xx - yy)  # of the long axis
    return np.array([x, y]), np.array([-math.sin(angle), math.cos(angle)])


def _checked(positions, ranges, variances, landmark) -> list[np.ndarray]:
    """The arguments as float arrays of one layout, so that the refit compiles once."""
    if not (n := checks.count("ranges", ranges)):
        raise ValueError("ranges is empty: a landmark needs one at least")
    return [
        checks.finite("positions", positions, (n, 2)),
        checks.finite("ranges", ranges, (n,)),
        checks.positive("variances", variances, (n,)),
        checks.finite("landmark", landmark, (2,)),
    ]


@compile_once
def _linearise(positions, ranges, weights, x, y):
    """Cost, its gradient (2) and the Gauss-Newton Hessian (xx, xy, yy) at a place."""
    cost, gx, gy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(ranges)):
        dx, dy = x - positions[i, 0], y - positions[i, 1]
        distance = math.sqrt(dx * dx + dy * dy) + 1e-12
        error, ux, uy, w = distance - ranges[i], dx / distance, dy / distance, weights[i]
        cost += 0.5 * w * error * error
        gx += w * error * ux
        gy += w * error * uy
        hxx += w * ux * ux
        hxy += w * ux * uy
        hyy += w * uy * uy
    return cost, gx, gy, hxx, hxy, hyy


@compile_once
def _refit(positions, ranges, weights, start):
    """Levenberg-Marquardt in the plane: (2,) place, its cost, largest standard deviation."""
    x, y, damping = start[0], start[1], 1e-4
    cost, gx, gy, hxx, hxy, hyy = _linearise(positions, ranges, weights, x, y)
    for _ in range(MAX_STEPS):
        extra = damping * (hxx + hyy)
        det = (hxx + extra) * (hyy + extra) - hxy * hxy
        sx = ((hyy + extra) * gx - hxy * gy) / det
        sy = ((hxx + extra) * gy - hxy * gx) / det
        there = _linearise(positions, ranges, weights, x - sx, y - sy)
        if there[0] <= cost:
            x, y, damping = x - sx, y - sy, max(0.1 * damping, 1e-12)
            cost, gx, gy, hxx, hxy, hyy = there
        else:
            damping = 10 * damping
        if (sx * sx + sy * sy) * (hxx + hyy) < 1e-12:  # a millionth of a standard deviation
            break
    middle, half = 0.5 * (hxx + hyy), math.hypot(0.5 * (hxx - hyy), hxy)
    smallest = max(middle - half, 0.0)
    spread = math.inf if smallest < 1e-12 * middle else 1 / math.sqrt(smallest)
    return np.array([x, y]), cost, spread
