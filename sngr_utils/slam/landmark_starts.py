"""Where a landmark starts: least squares on its first ranges, a grid, or crossings of circles."""

import math

import numpy as np
from scipy.optimize import leastsq

from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam.range_density import OUTLIER_SHARE, density, peak
from sngr_utils.world import dead_reckoning
from sngr_utils.world.log import Log

START_AFTER = 3  # distinct poses that must have seen a landmark before it enters the graph
STRAIGHT = 1e-9  # of the way, by which poses leave a line that is straight but for rounding
NEAREST = 1e-300  # m, so that the direction to a pose's own place is none


def start_landmark(positions: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """(2,) least-squares position of a landmark from N >= 2 ranges, started at their centroid.

    Uses data only. With few poses on a nearly straight line the answer may be the mirror image
    of the truth; nothing here can tell. On a straight line it is the place on the left of the way.

    Parameters
    ----------
    positions : (N, 2) where the ranges were taken, [m]
    ranges : (N,), [m]
    """

    def distances(offsets):  # as numpy.linalg.norm, whose own checks take longer than the sum
        return np.sqrt(np.add.reduce(offsets * offsets, axis=1))

    def residuals(point):
        return distances(point - positions) - ranges

    def jacobian(point):
        offsets = point - positions
        return offsets / np.maximum(distances(offsets), NEAREST)[:, None]

    # MINPACK without the checks of least_squares; told all, it has no warning that 1e-14 is tight
    tight = {"ftol": 1e-14, "xtol": 1e-14, "gtol": 1e-14, "maxfev": 200, "full_output": True}
    return leastsq(residuals, _off_the_line(positions, ranges), Dfun=jacobian, **tight)[0]


def _off_the_line(positions: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """(2,) centroid; of a straight line a mean range to its left, for no slope leads off it."""
    centre, ways = positions.mean(axis=0), positions - positions[0]
    ahead = ways[np.argmax(np.hypot(*ways.T))]
    left, length = np.array([-ahead[1], ahead[0]]), math.hypot(*ahead)
    if np.abs(ways @ left).max() > STRAIGHT * length**2:
        return centre
    return centre + ranges.mean() * (left / length if length else np.array([0.0, 1.0]))


STARTS = {
    "first_poses": "least squares on the ranges of a landmark's first three dead-reckoned poses",
    "grid": "the best cell of a grid, by all ranges of a landmark, any of which may be wrong",
}

GRID_CELLS, TILE = 100, 5  # per axis, and cells of it that are bounded together
NEGLIGIBLE_EXPONENT = 40.0  # e^-40 is nothing beside an outlier, in floating point
LARGE = 1e200  # product of likelihoods that is turned into a sum of logarithms
SLACK = 1e-6  # nats, more than rounding makes a bound too low


def start_landmarks(log: Log, poses: np.ndarray, start: str) -> np.ndarray:
    """(K, 2) start of each landmark, [m]; NaN if fewer than three distinct poses saw it.

    A surveyed landmark starts where it was surveyed.

    Parameters
    ----------
    poses : (T, 3) dead-reckoned poses, [m, m, rad]
    start : one of `STARTS`
    """
    landmarks = log.landmark_means.copy()
    variances = dead_reckoning.dead_reckoning_variances(poses, log.odometry_covariances)
    for k in np.flatnonzero(np.isnan(landmarks[:, 0])):
        mine = log.label_of == k
        seen_from, ranges = log.pose_of[mine], log.ranges[mine]
        distinct, first = np.unique(seen_from, return_index=True)
        if len(distinct) < START_AFTER:
            continue
        if start == "first_poses":
            few = first[:START_AFTER]
            landmarks[k] = start_landmark(poses[seen_from[few], :2], ranges[few])
        else:
            variance = variances[seen_from] + log.range_sigmas[mine] ** 2
            longest = log.ranges.max()
            landmarks[k] = best_cell(poses[seen_from, :2], ranges, variance, longest)
    return landmarks


def best_cell(
    positions: np.ndarray, ranges: np.ndarray, variances: np.ndarray, longest: float
) -> np.ndarray:
    """(2,) cell of a grid where N ranges are most likely, each of them right or an outlier.

    The grid covers every place that some range can reach from its position.

    Parameters
    ----------
    positions : (N, 2) where the ranges were taken, [m]
    ranges : (N,), [m]
    variances : (N,) of a right range about the distance, [m^2]
    longest : the longest range there is, [m]
    """
    positions, variances = np.ascontiguousarray(positions), np.ascontiguousarray(variances)
    return _best_cell(positions, np.ascontiguousarray(ranges), variances, longest)


@compile_once
def _best_cell(positions, ranges, variances, longest):
    """See `best_cell`: tile by tile, the most promising first, until no other can be better."""
    axes, width = np.empty((GRID_CELLS, 2)), 0.0
    for i in range(2):
        low, high = positions[:, i].min() - ranges.max(), positions[:, i].max() + ranges.max()
        step = (high - low) / (GRID_CELLS - 1)
        for j in range(GRID_CELLS):
            axes[j, i] = low + j * step
        width = max(width, step)
    # a point of the cell is uniform about its centre: one twelfth of the squared width
    spread = variances + width**2 / 12
    odds = peak(spread, OUTLIER_SHARE) / (OUTLIER_SHARE / longest)
    measured = positions, ranges, 0.5 / spread, odds
    n_tiles = GRID_CELLS // TILE
    bounds = np.empty(n_tiles * n_tiles)
    for tile in range(len(bounds)):
        i, j = TILE * (tile // n_tiles), TILE * (tile % n_tiles)
        bounds[tile] = _score(axes[i : i + TILE], axes[j : j + TILE], measured)
    best, found = -np.inf, np.empty(2)
    while bounds.max() >= best - SLACK:
        tile = np.argmax(bounds)
        bounds[tile] = -np.inf
        i, j = TILE * (tile // n_tiles), TILE * (tile % n_tiles)
        for row in range(i, i + TILE):
            for column in range(j, j + TILE):
                score = _score(axes[row : row + 1], axes[column : column + 1], measured)
                if score > best:
                    best, found[0], found[1] = score, axes[row, 0], axes[column, 1]
    return found


@compile_once
def _score(rows, columns, measured):
    """Log-likelihood of a rectangle of cells, at most, less that of outliers only.

    Of one cell it is the value. Likelihoods are multiplied, and their logarithm is taken when
    they grow large.
    """
    positions, ranges, sharpness, odds = measured
    total, product = 0.0, 1.0
    for n in range(len(ranges)):
        x, y = positions[n, 0], positions[n, 1]
        left, right = rows[0, 0] - x, rows[-1, 0] - x
        below, above = columns[0, 1] - y, columns[-1, 1] - y
        near_x, near_y = max(left, -right, 0.0), max(below, -above, 0.0)
        error = math.sqrt(near_x * near_x + near_y * near_y) - ranges[n]
        if error < 0.0:
            far_x, far_y = max(-left, right), max(-below, above)
            error = max(ranges[n] - math.sqrt(far_x * far_x + far_y * far_y), 0.0)
        exponent = sharpness[n] * error * error
        if exponent < NEGLIGIBLE_EXPONENT:
            product *= 1 + odds[n] * math.exp(-exponent)
            if product > LARGE:
                total += math.log(product)
                product = 1.0
    return total + math.log(product)


REFINEMENTS = 6  # reweighted Gauss-Newton steps


@compile_once
def distance_between(a, b):
    """Of two (2,) points, [m]."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)


@compile_once
def crossings(positions, distances):
    """(C, 2) crossings of every two circles, [m]; two that do not meet have one place, twice.

    It is where the line of points with the same power to both cuts that of the centres: between
    circles that lie apart, beyond the larger one of two nested; of concentric ones the centre.
    """
    n = len(distances)
    found = np.empty((n * (n - 1), 2))
    i = 0
    for a in range(n):
        for b in range(a):
            dx, dy = positions[b, 0] - positions[a, 0], positions[b, 1] - positions[a, 1]
            base = max(math.sqrt(dx * dx + dy * dy), 1e-9)
            along = 0.5 * (base + (distances[a] ** 2 - distances[b] ** 2) / base)
            across = math.sqrt(max(distances[a] ** 2 - along**2, 0.0))
            x, y = positions[a, 0] + along * dx / base, positions[a, 1] + along * dy / base
            found[i, 0], found[i, 1] = x - across * dy / base, y + across * dx / base
            found[i + 1, 0], found[i + 1, 1] = x + across * dy / base, y - across * dx / base
            i += 2
    return found


@compile_once
def evidence(place, positions, distances, sigma, longest):
    """Log-likelihood of ranges to a place, each right or an outlier, [nats]."""
    total = 0.0
    for i in range(len(distances)):
        error = (distance_between(place, positions[i]) - distances[i]) / sigma
        total += math.log(density(error * error, sigma * sigma, OUTLIER_SHARE, longest))
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
            right = peak(sigma * sigma, OUTLIER_SHARE) * math.exp(-0.5 * (error / sigma) ** 2)
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
