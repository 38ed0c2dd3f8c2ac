"""A window of poses whose ranges may each belong to any of several landmarks.

A point holds the standardised noises of the window's chain: of the prior on the first pose, then
of one odometry after the other. So the prior of the chain is a standard Gaussian, and all that is
not Gaussian is in the ranges. Every factor is a normalised density, so that the integral over the
points is the evidence of the ranges.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.sampling.targets.compiled import evaluated_by
from sngr_utils.world.simulation import World

LOG_TAU = math.log(2 * math.pi)
NOTHING = 40.0  # nats below the largest term of a sum: less than its rounding error


class WindowFactors(NamedTuple):
    """A window over a Gaussian prior N(mean, L L^T) on its noises.

    What `compiled_nested.sample` calls `factors`; a point is the offset from the mean.

    Attributes
    ----------
    poses, points : work array (n, 2) and `Window.points`
    mean, precision : (d,) and (d, d) of the prior
    log_constant : log of the standard normal's constant over that of the prior
    x0_mean, x0_sigmas, odometry, sigmas, pose_of, ranges, log_shares, range_sigma : `Window`
    """

    poses: np.ndarray
    points: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    log_constant: float
    x0_mean: np.ndarray
    x0_sigmas: np.ndarray
    odometry: np.ndarray
    sigmas: np.ndarray
    pose_of: np.ndarray
    ranges: np.ndarray
    log_shares: np.ndarray
    range_sigma: float


@dataclass(frozen=True)
class Window:
    """Posterior density of the noises of a chain of n poses, given M ranges.

    A point holds d = 3n standardised noises, of the first pose and of each odometry in turn.

    Attributes
    ----------
    x0_mean, x0_sigmas : (3,) prior on the first pose, [m, m, rad]
    odometry, odometry_sigmas : (n-1, 3) and (3,), [m, m, rad]
    pose_of, ranges : (M,) pose of each range, ascending, and the range, [m]
    log_shares : (M, K) log of the probability that a range belongs to a landmark
    landmarks : (K, 2), [m]
    range_sigma : [m]
    """

    x0_mean: np.ndarray
    x0_sigmas: np.ndarray
    odometry: np.ndarray
    odometry_sigmas: np.ndarray
    pose_of: np.ndarray
    ranges: np.ndarray
    log_shares: np.ndarray
    landmarks: np.ndarray
    range_sigma: float

    @property
    def dimension(self) -> int:
        return 3 * (len(self.odometry) + 1)

    @property
    def root(self) -> tuple[np.ndarray, np.ndarray]:
        """(d,) mean and (d, d) lower factor of the Gaussian that the target holds as a factor."""
        return np.zeros(self.dimension), np.eye(self.dimension)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(N,) log of prior times likelihood at (N, d) points, [nats]"""
        points = np.ascontiguousarray(points, dtype=float)
        prior = -0.5 * (np.sum(points**2, axis=1) + self.dimension * LOG_TAU)
        return prior + self.log_likelihoods(points, 0, len(self.odometry) + 1)

    def over(self, mean: np.ndarray, lower: np.ndarray) -> WindowFactors:
        """The target over the prior N(mean, L L^T), `lower` being the (d, d) L."""
        inverse = np.linalg.inv(lower)
        return WindowFactors(
            np.zeros((len(self.odometry) + 1, 2)), self.points, np.array(mean, dtype=float),
            inverse.T @ inverse, float(np.log(np.diag(lower)).sum()),
            np.asarray(self.x0_mean, dtype=float), np.asarray(self.x0_sigmas, dtype=float),
            self.odometry, self.odometry_sigmas, self.pose_of, self.ranges, self.log_shares,
            float(self.range_sigma),
        )  # fmt: skip

    def log_likelihoods(self, points: np.ndarray, first: int, stop: int) -> np.ndarray:
        """(N,) log-likelihood of the ranges of the poses first ... stop - 1, [nats]"""
        return _ranges(self.positions(points), self.points, self.pose_of, self.ranges,
                       self.log_shares, self.range_sigma, first, stop)  # fmt: skip

    @property
    def points(self) -> np.ndarray:
        """(K, 3) landmarks, and room for the distances to them, for `range_term`, [m]"""
        return np.column_stack([self.landmarks, np.zeros(len(self.landmarks))])

    def positions(self, noises: np.ndarray) -> np.ndarray:
        """(N, n, 2) positions that (N, 3n) noises lead to, [m]"""
        return chain_positions(
            np.ascontiguousarray(noises), self.x0_mean, self.x0_sigmas, self.odometry,
            self.odometry_sigmas,
        )  # fmt: skip


def window_of(world: World, x0_sigmas: list[float], p: float, n_ranges: int) -> Window:
    """The posterior of all poses of a world, the first n_ranges of each pose being kept.

    The map is known, as after an earlier visit. Which landmark a range belongs to is not: with
    probability 1 - p the one it is attached to, else any other.

    Parameters
    ----------
    x0_sigmas : (3,) prior on the first pose, [m, m, rad]
    p : probability of a wrong association, in [0, 1)

    Raises
    ------
    ValueError : p outside [0, 1), or n_ranges less than 1
    """
    if not 0 <= p < 1:
        raise ValueError(f"p is {p!r}: a wrong-association probability lies in [0, 1)")
    if n_ranges < 1:
        raise ValueError(f"n_ranges is {n_ranges}: a pose keeps at least one")
    s, poses = world.scenario, np.arange(world.n_poses)
    kept = np.concatenate([np.flatnonzero(world.pose_of == t)[:n_ranges] for t in poses])
    shares = np.full((len(kept), world.n_landmarks), p / (world.n_landmarks - 1))
    shares[np.arange(len(kept)), world.label_of[kept]] = 1 - p
    with np.errstate(divide="ignore"):
        log_shares = np.log(shares)
    sigmas = s.odometry_sigmas
    return Window(
        np.array(world.x0_mean), np.array(x0_sigmas), world.odometry, sigmas, world.pose_of[kept],
        world.ranges[kept], log_shares, world.landmarks, s.range_sigma,
    )  # fmt: skip


@compile_once
def place(noises, mean, x0_mean, x0_sigmas, odometry, sigmas, out):
    """(n, 2) positions of dead reckoning with every motion disturbed, into `out`.

    noises, mean : (3n,), whose sum disturbs
    """
    x, y, theta = x0_mean[0], x0_mean[1], x0_mean[2]
    for t in range(len(odometry) + 1):
        dx, dy, turn = 0.0, 0.0, 0.0
        scale = x0_sigmas
        if t > 0:
            dx, dy, turn = odometry[t - 1, 0], odometry[t - 1, 1], odometry[t - 1, 2]
            scale = sigmas
        dx += scale[0] * (mean[3 * t] + noises[3 * t])
        dy += scale[1] * (mean[3 * t + 1] + noises[3 * t + 1])
        cos, sin = math.cos(theta), math.sin(theta)
        x, y = x + cos * dx - sin * dy, y + sin * dx + cos * dy
        theta += turn + scale[2] * (mean[3 * t + 2] + noises[3 * t + 2])
        out[t, 0], out[t, 1] = x, y


@compile_once
def chain_positions(noises, x0_mean, x0_sigmas, odometry, sigmas):
    """(N, n, 2) positions that (N, 3n) noises lead to."""
    out, none = np.empty((len(noises), len(odometry) + 1, 2)), np.zeros(noises.shape[1])
    for k in range(len(noises)):
        place(noises[k], none, x0_mean, x0_sigmas, odometry, sigmas, out[k])
    return out


@compile_once
def range_term(where, points, pose_of, ranges, log_shares, sigma, first, stop, floor):
    """Log-likelihood of the ranges of the poses first ... stop - 1, mixtures over the points.

    The last column of the points is used up: an array of its own would take longer than a range.
    -inf as soon as it must end below `floor`: a mixture's density never exceeds its Gaussians'
    largest.
    """
    total, best, left = 0.0, -math.log(sigma) - 0.5 * math.log(2 * math.pi), len(ranges)
    at, scale = -1, 1 / sigma
    for m in range(len(ranges)):
        t = pose_of[m]
        left -= 1
        if t < first or t >= stop:
            continue
        if t != at:
            at = t
            for j in range(len(points)):
                dx, dy = where[t, 0] - points[j, 0], where[t, 1] - points[j, 1]
                points[j, 2] = math.sqrt(dx * dx + dy * dy)
        top, summed = -math.inf, 0.0  # of the terms so far: the largest, and the sum over it
        for j in range(len(points)):
            error = (points[j, 2] - ranges[m]) * scale
            term = log_shares[m, j] - 0.5 * error * error
            if term > top + NOTHING:
                top, summed = term, 1.0
            elif term > top:
                top, summed = term, summed * math.exp(top - term) + 1.0
            elif term > top - NOTHING:
                summed += math.exp(term - top)
        if summed != 1.0:
            top += math.log(summed)
        total += top + best
        if total + left * max(best, 0.0) < floor:
            return -math.inf
    return total


@compile_once
def _window_energy(factors, x, poses, points, limit):
    """Minus the log of the target over the prior, [nats]; inf once it must exceed `limit`."""
    f, d, half = factors, len(x), 0.0
    for i in range(d):
        noise, pull = f.mean[i] + x[i], 0.0
        for j in range(d):
            pull += f.precision[i, j] * x[j]
        half += 0.5 * (noise * noise - x[i] * pull)
    half -= f.log_constant
    place(x, f.mean, f.x0_mean, f.x0_sigmas, f.odometry, f.sigmas, poses)
    return half - range_term(
        poses, points, f.pose_of, f.ranges, f.log_shares, f.range_sigma, 0, len(poses), half - limit
    )


evaluated_by(WindowFactors, _window_energy)


@compile_once
def _ranges(where, points, pose_of, ranges, log_shares, sigma, first, stop):
    """(N,) `range_term`."""
    out = np.empty(len(where))
    for k in range(len(where)):
        out[k] = range_term(
            where[k], points, pose_of, ranges, log_shares, sigma, first, stop, -math.inf
        )
    return out
