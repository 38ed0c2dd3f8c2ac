"""The loops of FastSLAM, compiled; `fastslam` is the way in."""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam.landmark_starts import crossings, distance_between, evidence, refine

APART = 0.5  # m, between the hypotheses of a landmark at its start
TWO_PI = 2 * math.pi


class Setup(NamedTuple):
    """odometry_sigmas : (3,) per step, [m, m, rad]
    range_sigma, landmark_sigma : of a range, and of the weak prior on a landmark's start, [m]
    longest : range up to which an outlier is uniform, [m]
    start_after : distinct poses that must have seen a landmark
    enough : effective sample size below which particles are resampled
    """

    odometry_sigmas: np.ndarray
    range_sigma: float
    landmark_sigma: float
    longest: float
    start_after: int
    enough: float


class State(NamedTuple):
    """N particles, T poses, K landmarks, H hypotheses each.

    paths : (N, T, 3), [m, m, rad]
    means : (N, K, H, 2), [m]; NaN before a landmark is started
    covariances : (N, K, H, 3) xx, xy, yy, [m^2]
    shares : (N, K, H) weights of the hypotheses, of sum 1
    counts : (N, 2) ranges credited to their label, and to another landmark
    log_weights : (N,), not normalised
    """

    paths: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    shares: np.ndarray
    counts: np.ndarray
    log_weights: np.ndarray


def empty(n_particles: int, n_poses: int, n_landmarks: int, n_hypotheses: int) -> State:
    """Particles that know nothing yet."""
    shape = (n_particles, n_landmarks, n_hypotheses)
    return State(
        np.zeros((n_particles, n_poses, 3)), np.full((*shape, 2), np.nan), np.zeros((*shape, 3)),
        np.zeros(shape), np.zeros((n_particles, 2)), np.zeros(n_particles),
    )  # fmt: skip


@compile_once
def run(setup, state, odometry, pose_of, label_of, ranges, rng):
    """Fill `state`, whose particles stand at the first pose, from all odometry and ranges."""
    n_particles, n_poses, _ = state.paths.shape
    started = np.zeros(state.means.shape[1], np.bool_)
    seen_from = np.empty((len(started), len(ranges)), np.int64)  # of a landmark that waits
    seen_at = np.empty((len(started), len(ranges)))
    seen, distinct = np.zeros(len(started), np.int64), np.zeros(len(started), np.int64)
    m = 0
    for t in range(n_poses):
        if t > 0:
            move(setup, state.paths, t, odometry[t - 1], rng)
        while m < len(ranges) and pose_of[m] == t:
            k = label_of[m]
            if started[k]:
                for n in range(n_particles):
                    credit(setup, state, started, n, t, k, ranges[m], rng)
            else:
                distinct[k] += seen[k] == 0 or seen_from[k, seen[k] - 1] < t
                seen_from[k, seen[k]], seen_at[k, seen[k]] = t, ranges[m]
                seen[k] += 1
            m += 1
        for k in range(len(started)):
            if not started[k] and distinct[k] >= setup.start_after:
                started[k] = True
                for n in range(n_particles):
                    start(setup, state, n, k, seen_from[k, : seen[k]], seen_at[k, : seen[k]])
        resample(setup, state, rng)


@compile_once
def move(setup, paths, t, motion, rng):
    """Extend every path by one step of odometry with its noise, in the body frame."""
    for n in range(len(paths)):
        x, y, theta = paths[n, t - 1]
        cos, sin = math.cos(theta), math.sin(theta)
        dx = motion[0] + setup.odometry_sigmas[0] * rng.standard_normal()
        dy = motion[1] + setup.odometry_sigmas[1] * rng.standard_normal()
        turn = motion[2] + setup.odometry_sigmas[2] * rng.standard_normal()
        paths[n, t, 0] = x + cos * dx - sin * dy
        paths[n, t, 1] = y + sin * dx + cos * dy
        paths[n, t, 2] = theta + turn


@compile_once
def density(setup, state, n, k, x, y, distance):
    """Density of a range to landmark k from (x, y) in particle n, [1/m]."""
    total = 0.0
    for h in range(state.shares.shape[2]):
        error, variance, _, _ = innovation(setup, state, n, k, h, x, y, distance)
        likelihood = math.exp(-0.5 * error * error / variance) / math.sqrt(TWO_PI * variance)
        total += state.shares[n, k, h] * likelihood
    return total


@compile_once
def innovation(setup, state, n, k, h, x, y, distance):
    """Error of a range to a hypothesis, its variance, and the unit vector towards it."""
    dx, dy = state.means[n, k, h, 0] - x, state.means[n, k, h, 1] - y
    expected = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    ux, uy = dx / expected, dy / expected
    xx, xy, yy = state.covariances[n, k, h]
    variance = setup.range_sigma**2 + ux * ux * xx + 2 * ux * uy * xy + uy * uy * yy
    return distance - expected, variance, ux, uy


@compile_once
def credit(setup, state, started, n, t, label, distance, rng):
    """Weigh particle n by a range, credit the range to a landmark, update its filter."""
    x, y = state.paths[n, t, 0], state.paths[n, t, 1]
    n_landmarks = len(started)
    right, other = state.counts[n]
    wrong = (other + 1) / (right + other + 2)  # mean of its posterior from a uniform prior
    chances = np.empty(n_landmarks)
    total = 0.0
    for k in range(n_landmarks):
        prior = 1 - wrong if k == label else wrong / (n_landmarks - 1)
        if started[k]:
            chances[k] = prior * density(setup, state, n, k, x, y, distance)
        else:
            chances[k] = prior / setup.longest
        total += chances[k]
    total = max(total, 1e-300)
    state.log_weights[n] += math.log(total)
    left, chosen = rng.random() * total, 0
    while chosen < n_landmarks - 1 and left >= chances[chosen]:
        left -= chances[chosen]
        chosen += 1
    state.counts[n, 0 if chosen == label else 1] += 1
    if started[chosen]:
        update(setup, state, n, chosen, x, y, distance)


@compile_once
def update(setup, state, n, k, x, y, distance):
    """Extended Kalman update of every hypothesis of a landmark, and of their shares."""
    total = 0.0
    for h in range(state.shares.shape[2]):
        error, variance, ux, uy = innovation(setup, state, n, k, h, x, y, distance)
        xx, xy, yy = state.covariances[n, k, h]
        gain_x, gain_y = (xx * ux + xy * uy) / variance, (xy * ux + yy * uy) / variance
        state.means[n, k, h, 0] += gain_x * error
        state.means[n, k, h, 1] += gain_y * error
        state.covariances[n, k, h, 0] -= gain_x * gain_x * variance
        state.covariances[n, k, h, 1] -= gain_x * gain_y * variance
        state.covariances[n, k, h, 2] -= gain_y * gain_y * variance
        state.shares[n, k, h] *= math.exp(-0.5 * error * error / variance) / math.sqrt(variance)
        total += state.shares[n, k, h]
    for h in range(state.shares.shape[2]):
        if total > 0.0:
            state.shares[n, k, h] /= total
        else:  # a range that no hypothesis foresees tells nothing between them
            state.shares[n, k, h] = 1.0 / state.shares.shape[2]


@compile_once
def start(setup, state, n, k, seen_from, distances):
    """Start landmark k in particle n: the likeliest crossings of two of its circles, refined.

    Any of the (R,) ranges may be an outlier, uniform up to the longest. The particle is weighed
    by their evidence, a sum of Laplace's approximations.
    """
    positions, sigma = state.paths[n, :, :2][seen_from], setup.range_sigma
    candidates = crossings(positions, distances)
    scores = np.empty(len(candidates))
    for i in range(len(candidates)):
        # a crossing of two noisy circles errs by more than a range
        scores[i] = evidence(candidates[i], positions, distances, 3 * sigma, setup.longest)
    evidences = np.full(state.shares.shape[2], -np.inf)
    for h in range(len(evidences)):
        best = int(np.argmax(scores))
        if scores[best] == -np.inf and h > 0:
            _settle(state, n, k, h, state.means[n, k, 0], state.covariances[n, k, 0])
            continue
        chosen = candidates[best].copy()
        for i in range(len(candidates)):
            if distance_between(candidates[i], chosen) < APART:
                scores[i] = -np.inf
        covariance = refine(
            chosen, positions, distances, sigma, setup.longest, setup.landmark_sigma
        )
        _settle(state, n, k, h, chosen, covariance)
        determinant = covariance[0] * covariance[2] - covariance[1] ** 2
        evidences[h] = evidence(chosen, positions, distances, sigma, setup.longest)
        evidences[h] += 0.5 * math.log(determinant)
    largest = evidences.max()
    shares = np.exp(evidences - largest)
    state.log_weights[n] += largest + math.log(shares.sum())
    total = shares.sum()
    for h in range(len(shares)):
        state.shares[n, k, h] = shares[h] / total


@compile_once
def _settle(state, n, k, h, mean, covariance):
    """Put a hypothesis of landmark k in particle n where it is believed to be."""
    state.means[n, k, h, 0], state.means[n, k, h, 1] = mean[0], mean[1]
    for i in range(3):
        state.covariances[n, k, h, i] = covariance[i]


@compile_once
def resample(setup, state, rng):
    """Systematic resampling where the effective sample size is too small."""
    weights = np.exp(state.log_weights - state.log_weights.max())
    weights /= weights.sum()
    if 1 / (weights**2).sum() >= setup.enough:
        return
    chosen, n = systematic(weights, rng.random()), len(weights)
    take(state.paths.reshape((n, -1)), chosen)
    take(state.means.reshape((n, -1)), chosen)
    take(state.covariances.reshape((n, -1)), chosen)
    take(state.shares.reshape((n, -1)), chosen)
    take(state.counts, chosen)
    state.log_weights[:] = 0.0


@compile_once
def take(rows, chosen):
    """Put the (N,) chosen ones of (N, D) rows in their place."""
    kept = rows.copy()
    for i in range(len(chosen)):
        for j in range(rows.shape[1]):
            rows[i, j] = kept[chosen[i], j]


@compile_once
def systematic(weights, uniform):
    """(N,) indices, each drawn floor or ceil of N times its weight, from one uniform number.

    Source: Kitagawa, Journal of Computational and Graphical Statistics 5, 1996.
    """
    n = len(weights)
    chosen = np.empty(n, np.int64)
    cumulated, i = weights[0], 0
    for j in range(n):
        while i < n - 1 and (j + uniform) / n >= cumulated:
            i += 1
            cumulated += weights[i]
        chosen[j] = i
    return chosen
