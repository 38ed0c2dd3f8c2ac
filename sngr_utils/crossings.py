"""Where ranges from several places may put a landmark: crossings of their circles, refined.

Compiled, for FastSLAM starts every landmark in every particle.
"""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once

OUTLIER_SHARE = 0.5  # of the ranges a landmark is started from: right or wrong alike
REFINEMENTS = 6  # reweighted Gauss-Newton steps
TWO_PI = 2 * math.pi


@compile_once
def distance_between(a, b):
    """Of two (2,) points, [m]."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)


@compile_once
def crossings(positions, distances):
    """(C, 2) crossings of every two circles, or where they come nearest, [m]."""
    n = len(distances)
    found = np.empty((n * (n - 1), 2))
    i = 0
    for a in range(n):
        for b in range(a):
            dx, dy = positions[b] - positions[a]
            base = max(math.sqrt(dx * dx + dy * dy), 1e-9)
            along = 0.5 * (base + (distances[a] ** 2 - distances[b] ** 2) / base)
            across = math.sqrt(max(distances[a] ** 2 - along**2, 0.0))
            x, y = positions[a, 0] + along * dx / base, positions[a, 1] + along * dy / base
            found[i] = x - across * dy / base, y + across * dx / base
            found[i + 1] = x + across * dy / base, y - across * dx / base
            i += 2
    return found


@compile_once
def evidence(place, positions, distances, sigma, longest):
    """Log-likelihood of ranges to a place, each right or an outlier, [nats]."""
    total = 0.0
    for i in range(len(distances)):
        error = (distance_between(place, positions[i]) - distances[i]) / sigma
        right = math.exp(-0.5 * error * error) / (math.sqrt(TWO_PI) * sigma)
        total += math.log((1 - OUTLIER_SHARE) * right + OUTLIER_SHARE / longest)
    return total


@compile_once
def refine(place, positions, distances, range_sigma, longest, landmark_sigma):
    """Move a place to the nearest maximum of `evidence`; its covariance (xx, xy, yy), [m^2].

    EM: each range weighs as much as it is probably right; the sigma shrinks to its own.

    landmark_sigma : of the weak prior about the place itself, [m]
    """
    covariance = np.empty(3)
    for step in range(REFINEMENTS):
        sigma = range_sigma * max(1.0, 3.0 - step)
        xx = yy = landmark_sigma**-2
        xy = gx = gy = 0.0
        for i in range(len(distances)):
            dx, dy = place - positions[i]
            expected = max(math.sqrt(dx * dx + dy * dy), 1e-9)
            error = distances[i] - expected
            likelihood = math.exp(-0.5 * (error / sigma) ** 2) / (math.sqrt(TWO_PI) * sigma)
            right = (1 - OUTLIER_SHARE) * likelihood
            weight = right / (right + OUTLIER_SHARE / longest) / sigma**2
            ux, uy = dx / expected, dy / expected
            xx, xy, yy = xx + weight * ux * ux, xy + weight * ux * uy, yy + weight * uy * uy
            gx, gy = gx + weight * ux * error, gy + weight * uy * error
        determinant = xx * yy - xy * xy
        covariance[0], covariance[1], covariance[2] = yy, -xy, xx
        covariance /= determinant
        place[0] += covariance[0] * gx + covariance[1] * gy
        place[1] += covariance[1] * gx + covariance[2] * gy
    return covariance
