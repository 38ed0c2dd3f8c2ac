"""Small posteriors that need not be Gaussian, as functions of many points at once.

Two kinds. A `Landmark` in the plane whose poses are integrated out, to first order in their
uncertainty. A `Window` of poses in the noises of its chain (prior on the first pose, then one
odometry after the other), whose ranges may belong to any of several landmarks. Every factor is a
normalised density, so that the integral over the points is the evidence of the ranges.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba.extending import overload

from sngr_utils.compiled_nested import evaluate
from sngr_utils.jit import compile_once
from sngr_utils.world import World, dead_reckoning

STEP = 1e-5  # of the forward differences, in standard deviations of a noise
LOG_TAU = math.log(2 * math.pi)


@dataclass(frozen=True)
class Landmark:
    """Posterior density of a landmark's place, with n ranges from uncertain positions.

    Attributes
    ----------
    positions : (n, 2) means of the positions the ranges were taken from, [m]
    covariance : (2n, 2n) of these positions, all zeros if they are known, [m^2]
    ranges : (n,), [m]
    range_sigma : standard deviation of a range, [m]
    centre, prior_sigma : (2,) mean and standard deviation of the landmark's prior, [m]
    """

    positions: np.ndarray
    covariance: np.ndarray
    ranges: np.ndarray
    range_sigma: float
    centre: np.ndarray
    prior_sigma: float
    dimension = 2

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(N,) log of prior times likelihood at (N, 2) places, [nats].

        A range varies with its position along the ray only, so the ranges are Gaussian with
        covariance sigma^2 I + U P U^T, the rows of U holding the rays.
        """
        return _landmark(
            np.ascontiguousarray(points, dtype=float), self.positions, self.covariance,
            self.ranges, self.range_sigma**2, self.centre, self.prior_sigma,
        )  # fmt: skip

    @property
    def first_sigma(self) -> float:
        """Standard deviation of the first range about the distance from the mean position, [m].

        The first position is as uncertain along x as along y.
        """
        return math.sqrt(self.range_sigma**2 + 0.5 * np.trace(self.covariance[:2, :2]))

    def gauss_newton_covariance(self, at: np.ndarray) -> np.ndarray:
        """(2, 2) inverse of J^T W J at a place: the covariance that a MAP solver reports, [m^2]"""
        offsets = at - self.positions
        rays = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
        spread = np.einsum(
            "ia,iajb,jb->ij", rays, self.covariance.reshape(len(rays), 2, -1, 2), rays
        )
        spread += self.range_sigma**2 * np.eye(len(rays))
        return np.linalg.inv(
            rays.T @ np.linalg.solve(spread, rays) + np.eye(2) / self.prior_sigma**2
        )

    @property
    def variances(self) -> np.ndarray:
        """(n,) of each range about the distance, all directions alike, [m^2]"""
        own = np.diag(self.covariance).reshape(-1, 2).mean(axis=1)
        return self.range_sigma**2 + own


@dataclass(frozen=True)
class Window:
    """Posterior density of the noises of a chain of n poses, given M ranges.

    A point holds 3n standardised noises, of the first pose and of each odometry in turn, and
    then, if `unknown` is set, the place of landmark 0.

    Attributes
    ----------
    x0_mean, x0_sigmas : (3,) prior on the first pose, [m, m, rad]
    odometry, odometry_sigmas : (n-1, 3) and (3,), [m, m, rad]
    pose_of, ranges : (M,) pose of each range, ascending, and the range, [m]
    log_shares : (M, K) log of the probability that a range belongs to a landmark
    landmarks : (K, 2), [m]
    range_sigma : [m]
    unknown : whether landmark 0 is to be found too; `landmarks` then holds its prior mean
    prior_sigma : of an unknown landmark, [m]
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
    unknown: bool = False
    prior_sigma: float = 1.0

    @property
    def n_noises(self) -> int:
        return 3 * (len(self.odometry) + 1)

    @property
    def dimension(self) -> int:
        return self.n_noises + 2 * self.unknown

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(N,) log of prior times likelihood at (N, d) points, [nats]"""
        points = np.ascontiguousarray(points, dtype=float)
        n = self.n_noises
        prior = -0.5 * (np.sum(points[:, :n] ** 2, axis=1) + n * LOG_TAU)
        if self.unknown:
            offsets = (points[:, n:] - self.landmarks[0]) / self.prior_sigma
            prior -= 0.5 * np.sum(offsets**2, axis=1) + LOG_TAU + 2 * math.log(self.prior_sigma)
        return prior + self.log_likelihoods(points, 0, len(self.odometry) + 1)

    def over(self, mean: np.ndarray, lower: np.ndarray) -> "WindowFactors":
        """The target over the prior N(mean, L L^T), `lower` being the (d, d) L.

        Raises
        ------
        ValueError : a landmark is unknown
        """
        if self.unknown:
            raise ValueError("unknown is set: only windows with known landmarks are compiled")
        inverse = np.linalg.inv(lower)
        return WindowFactors(
            np.zeros((len(self.odometry) + 1, 2)), self.landmarks, np.array(mean, dtype=float),
            inverse.T @ inverse, float(np.log(np.diag(lower)).sum()),
            np.asarray(self.x0_mean, dtype=float), np.asarray(self.x0_sigmas, dtype=float),
            self.odometry, self.odometry_sigmas, self.pose_of, self.ranges, self.log_shares,
            float(self.range_sigma),
        )  # fmt: skip

    def log_likelihoods(self, points: np.ndarray, first: int, stop: int) -> np.ndarray:
        """(N,) log-likelihood of the ranges of the poses first ... stop - 1, [nats]"""
        where = self.positions(points[:, : self.n_noises])
        found = points[:, self.n_noises :] if self.unknown else np.zeros((len(points), 0))
        return _ranges(where, found, self.pose_of, self.ranges, self.log_shares, self.landmarks,
                       self.range_sigma, first, stop)  # fmt: skip

    def positions(self, noises: np.ndarray) -> np.ndarray:
        """(N, n, 2) positions that (N, 3n) noises lead to, [m]"""
        return _chain(np.ascontiguousarray(noises), self.x0_mean, self.x0_sigmas, self.odometry,
                      self.odometry_sigmas)  # fmt: skip


class WindowFactors(NamedTuple):
    """A window with known landmarks over a Gaussian prior N(mean, L L^T) on its noises.

    What `compiled_nested.sample` calls `factors`; a point is the offset from the mean.

    Attributes
    ----------
    poses, points : work array (n, 2) and the (K, 2) landmarks
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


@overload(evaluate)
def _evaluate_window(factors, x, poses, points, limit):
    if getattr(factors, "instance_class", None) is WindowFactors:
        return lambda factors, x, poses, points, limit: _window_energy(factors, x, poses)
    return None


def landmark_of(
    world: World, x0_sigmas: list[float], prior_sigma: float, label: int, n: int
) -> Landmark:
    """The posterior of a landmark after n poses, each with one range attached to it.

    Its prior is centred on the first pose, from which no direction is preferred.

    Parameters
    ----------
    x0_sigmas : (3,) prior on the first pose, [m, m, rad]
    prior_sigma : of the landmark, [m]

    Raises
    ------
    ValueError : the landmark was seen from fewer than n poses
    """
    mine = np.flatnonzero(world.label_of == label)[:n]
    if len(mine) < n or not np.array_equal(world.pose_of[mine], np.arange(n)):
        raise ValueError(f"n is {n}: landmark {label} needs one range from each of the first {n}")
    positions, covariance = predicted_positions(world, x0_sigmas, n)
    return Landmark(positions, covariance, world.ranges[mine], world.scenario.range_sigma,
                    positions[0], prior_sigma)  # fmt: skip


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
    sigmas = np.array([s.odometry_sigma_xy, s.odometry_sigma_xy, s.odometry_sigma_theta])
    return Window(
        np.array(world.x0_mean), np.array(x0_sigmas), world.odometry, sigmas, world.pose_of[kept],
        world.ranges[kept], log_shares, world.landmarks, s.range_sigma,
    )  # fmt: skip


def predicted_positions(
    world: World, x0_sigmas: list[float], n: int
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) dead-reckoned positions and their (2n, 2n) covariance to first order, [m], [m^2]"""
    s = world.scenario
    sigmas = np.array([s.odometry_sigma_xy, s.odometry_sigma_xy, s.odometry_sigma_theta])
    steps = STEP * np.vstack([np.zeros(3 * n), np.eye(3 * n)])
    reached = _chain(steps, world.x0_mean, np.array(x0_sigmas), world.odometry[: n - 1], sigmas)
    flat = reached.reshape(len(steps), -1)
    jacobian = (flat[1:] - flat[0]) / STEP
    return dead_reckoning(world.x0_mean, world.odometry[: n - 1])[:, :2], jacobian.T @ jacobian


@compile_once
def _place(noises, x0_mean, x0_sigmas, odometry, sigmas, out):
    """(n, 2) positions of `world.dead_reckoning` with every motion disturbed, into `out`."""
    x, y, theta = x0_mean[0], x0_mean[1], x0_mean[2]
    for t in range(len(odometry) + 1):
        dx, dy, turn = 0.0, 0.0, 0.0
        scale = x0_sigmas
        if t > 0:
            dx, dy, turn = odometry[t - 1, 0], odometry[t - 1, 1], odometry[t - 1, 2]
            scale = sigmas
        dx += scale[0] * noises[3 * t]
        dy += scale[1] * noises[3 * t + 1]
        cos, sin = math.cos(theta), math.sin(theta)
        x, y = x + cos * dx - sin * dy, y + sin * dx + cos * dy
        theta += turn + scale[2] * noises[3 * t + 2]
        out[t, 0], out[t, 1] = x, y


@compile_once
def _chain(noises, x0_mean, x0_sigmas, odometry, sigmas):
    """(N, n, 2) positions that (N, 3n) noises lead to."""
    out = np.empty((len(noises), len(odometry) + 1, 2))
    for k in range(len(noises)):
        _place(noises[k], x0_mean, x0_sigmas, odometry, sigmas, out[k])
    return out


@compile_once
def _range_term(where, points, pose_of, ranges, log_shares, sigma, first, stop):
    """Log-likelihood of the ranges of the poses first ... stop - 1, mixtures over the points."""
    total = 0.0
    for m in range(len(ranges)):
        t = pose_of[m]
        if t < first or t >= stop:
            continue
        top, summed = -math.inf, 0.0  # of the terms so far: the largest, and the sum over it
        for j in range(len(points)):
            if log_shares[m, j] == -math.inf:
                continue
            dx, dy = where[t, 0] - points[j, 0], where[t, 1] - points[j, 1]
            error = (math.sqrt(dx * dx + dy * dy) - ranges[m]) / sigma
            term = log_shares[m, j] - 0.5 * error * error
            if term > top:
                top, summed = term, summed * math.exp(top - term) + 1.0
            else:
                summed += math.exp(term - top)
        total += top + math.log(summed) - math.log(sigma) - 0.5 * math.log(2 * math.pi)
    return total


@compile_once
def _window_energy(f, offset, where):
    """Minus the log of the target over the prior, [nats]."""
    d, noises, half = len(offset), np.empty(len(offset)), 0.0
    for i in range(d):
        noises[i] = f.mean[i] + offset[i]
        half += 0.5 * noises[i] * noises[i]
        for j in range(d):
            half -= 0.5 * offset[i] * f.precision[i, j] * offset[j]
    _place(noises, f.x0_mean, f.x0_sigmas, f.odometry, f.sigmas, where)
    ranges = _range_term(
        where, f.points, f.pose_of, f.ranges, f.log_shares, f.range_sigma, 0, len(where)
    )
    return half - ranges - f.log_constant


@compile_once
def _ranges(where, found, pose_of, ranges, log_shares, landmarks, sigma, first, stop):
    """(N,) `_range_term`, landmark 0 at (N, 2) places found where there are such."""
    out, points = np.empty(len(where)), landmarks.copy()
    for k in range(len(where)):
        if found.shape[1] > 0:
            points[0] = found[k]
        out[k] = _range_term(where[k], points, pose_of, ranges, log_shares, sigma, first, stop)
    return out


@compile_once
def _landmark(points, positions, covariance, ranges, variance, centre, prior_sigma):
    """Log prior plus log N(ranges; distances, variance I + U P U^T) at every point."""
    n = len(ranges)
    out, lower, error = np.empty(len(points)), np.empty((n, n)), np.empty(n)
    rays = np.empty((n, 2))
    constant = -0.5 * n * math.log(2 * math.pi)
    constant -= math.log(2 * math.pi) + 2 * math.log(prior_sigma)
    for k in range(len(points)):
        dx, dy = points[k, 0] - centre[0], points[k, 1] - centre[1]
        total = constant - 0.5 * (dx * dx + dy * dy) / (prior_sigma * prior_sigma)
        for i in range(n):
            dx, dy = points[k, 0] - positions[i, 0], points[k, 1] - positions[i, 1]
            distance = math.sqrt(dx * dx + dy * dy) + 1e-12
            rays[i, 0], rays[i, 1], error[i] = dx / distance, dy / distance, distance - ranges[i]
        for i in range(n):
            for j in range(i + 1):
                value = variance if i == j else 0.0
                for a in range(2):
                    for b in range(2):
                        value += rays[i, a] * covariance[2 * i + a, 2 * j + b] * rays[j, b]
                for m in range(j):
                    value -= lower[i, m] * lower[j, m]
                lower[i, j] = math.sqrt(value) if i == j else value / lower[j, j]
            for j in range(i):
                error[i] -= lower[i, j] * error[j]
            error[i] /= lower[i, i]
            total -= 0.5 * error[i] * error[i] + math.log(lower[i, i])
        out[k] = total
    return out
