"""The posterior of one landmark in the plane, with the poses integrated out.

To first order in the uncertainty of the poses, which the tests bound. Every factor is a normalised
density, so that the integral over the plane is the evidence of the ranges.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import factorise, solve_lower
from sngr_utils.numerics.normal import normal_quantile
from sngr_utils.sampling.targets.ambiguous_window import chain_positions
from sngr_utils.sampling.targets.compiled import evaluated_by
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.simulation import World

STEP = 1e-5  # of the forward differences, in standard deviations of a noise


class LandmarkFactors(NamedTuple):
    """A landmark over a prior to look in: what `compiled_nested.sample` calls `factors`.

    Attributes
    ----------
    positions : (n, 2) mean positions of the ranges, [m]
    poses, points : room for `_density`, (n, 2) and (n + 1, n)
    covariance, ranges, variance, centre, prior_sigma : of `Landmark`
    is_ring : whether the prior is a ring; a point is then two normals, else an offset from `mean`
    mean : (2,) of the Gaussian, or the centre of the ring, [m]
    precision, log_det : (2, 2) of the Gaussian, and the log of its determinant
    distance, sigma : radius of the ring and its standard deviation, [m]
    """

    positions: np.ndarray
    poses: np.ndarray
    points: np.ndarray
    covariance: np.ndarray
    ranges: np.ndarray
    variance: float
    centre: np.ndarray
    prior_sigma: float
    is_ring: bool
    mean: np.ndarray
    precision: np.ndarray
    log_det: float
    distance: float
    sigma: float


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

    @property
    def root(self) -> tuple[np.ndarray, np.ndarray]:
        """(2,) mean and (2, 2) lower factor of the Gaussian that the target holds as a factor."""
        return self.centre, self.prior_sigma * np.eye(2)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(N,) log of prior times likelihood at (N, 2) places, [nats].

        A range varies with its position along the ray only, so the ranges are Gaussian with
        covariance sigma^2 I + U P U^T, the rows of U holding the rays.
        """
        return _landmark(
            np.ascontiguousarray(points, dtype=float), self.positions, self.covariance,
            self.ranges, self.range_sigma**2, self.centre, self.prior_sigma,
        )  # fmt: skip

    def over_ring(self) -> LandmarkFactors:
        """The target over the ring of its first range around the first mean position."""
        return self._over(self.positions[0], np.eye(2), True)

    def over(self, mean: np.ndarray, lower: np.ndarray) -> LandmarkFactors:
        """The target over the prior N(mean, L L^T), `lower` being the (2, 2) L."""
        return self._over(mean, lower, False)

    def _over(self, mean: np.ndarray, lower: np.ndarray, is_ring: bool) -> LandmarkFactors:
        inverse = np.linalg.inv(lower)
        n = len(self.ranges)
        return LandmarkFactors(
            self.positions, np.zeros((n, 2)), np.zeros((n + 1, n)), self.covariance, self.ranges,
            self.range_sigma**2, self.centre, float(self.prior_sigma), is_ring,
            np.array(mean, dtype=float),
            inverse.T @ inverse, 2 * float(np.log(np.diag(inverse)).sum()), float(self.ranges[0]),
            float(self.first_sigma),
        )  # fmt: skip

    @property
    def first_sigma(self) -> float:
        """Standard deviation of the first range about the distance from the mean position, [m].

        The first position is as uncertain along x as along y.
        """
        return math.sqrt(self.range_sigma**2 + 0.5 * np.trace(self.covariance[:2, :2]))

    @property
    def variances(self) -> np.ndarray:
        """(n,) of each range about the distance, all directions alike, [m^2]"""
        own = np.diag(self.covariance).reshape(-1, 2).mean(axis=1)
        return self.range_sigma**2 + own


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


def predicted_positions(
    world: World, x0_sigmas: list[float], n: int
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) dead-reckoned positions and their (2n, 2n) covariance to first order, [m], [m^2]"""
    s = world.scenario
    sigmas = s.odometry_sigmas
    steps = STEP * np.vstack([np.zeros(3 * n), np.eye(3 * n)])
    reached = chain_positions(
        steps, world.x0_mean, np.array(x0_sigmas), world.odometry[: n - 1], sigmas
    )
    flat = reached.reshape(len(steps), -1)
    jacobian = (flat[1:] - flat[0]) / STEP
    # Contiguous, or every compiled function that takes them is compiled a second time.
    means = np.ascontiguousarray(dead_reckoning(world.x0_mean, world.odometry[: n - 1])[:, :2])
    return means, jacobian.T @ jacobian


@compile_once
def _landmark(points, positions, covariance, ranges, variance, centre, prior_sigma):
    """(N,) `_density` at (N, 2) places."""
    n = len(ranges)
    out, rays, room = np.empty(len(points)), np.empty((n, 2)), np.empty((n + 1, n))
    lower, error = room[:n], room[n]
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        out[k] = _density(x, y, positions, covariance, ranges, variance, centre, prior_sigma,
                          rays, lower, error)  # fmt: skip
    return out


@compile_once
def _density(x, y, positions, covariance, ranges, variance, centre, prior_sigma, rays, lower,
             error):  # fmt: skip
    """Log prior plus log N(ranges; distances, variance I + U P U^T), by a Cholesky factor.

    rays, lower, error : room for (n, 2), (n, n) and (n,) numbers
    """
    n = len(ranges)
    dx, dy = (x - centre[0]) / prior_sigma, (y - centre[1]) / prior_sigma
    total = -0.5 * (dx * dx + dy * dy + (n + 2) * math.log(2 * math.pi)) - 2 * math.log(prior_sigma)
    for i in range(n):
        dx, dy = x - positions[i, 0], y - positions[i, 1]
        distance = math.sqrt(dx * dx + dy * dy) + 1e-12
        rays[i, 0], rays[i, 1], error[i] = dx / distance, dy / distance, distance - ranges[i]
    for i in range(n):
        for j in range(i + 1):
            value = variance if i == j else 0.0
            for a in range(2):
                for b in range(2):
                    value += rays[i, a] * covariance[2 * i + a, 2 * j + b] * rays[j, b]
            lower[i, j] = value
    factorise(lower)
    solve_lower(lower, error)
    for i in range(n):
        total -= 0.5 * error[i] * error[i] + math.log(lower[i, i])
    return total


@compile_once
def ring_place(centre, distance, sigma, z):
    """Place at a uniform angle and a Gaussian radius that is not negative, from two normals."""
    angle = math.pi * math.erfc(-z[0] / math.sqrt(2))
    below = 0.5 * math.erfc(distance / (sigma * math.sqrt(2)))
    share = below + (1 - below) * 0.5 * math.erfc(-z[1] / math.sqrt(2))
    radius = distance + sigma * normal_quantile(min(max(share, 1e-300), 1 - 1e-16))
    return centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)


@compile_once
def ring_density(dx, dy, distance, sigma):
    """Log density of `ring_place` over the plane at an offset from its centre, [nats].

    A ring of radius r is 2 pi r long, so that the density over the plane is that of the radius
    over 2 pi r. The range factor itself has no such term: leaving it out of the weights would
    favour the outside of the ring.
    """
    radius = math.sqrt(dx * dx + dy * dy)
    error = (radius - distance) / sigma
    held = 0.5 * math.erfc(-distance / (sigma * math.sqrt(2)))
    return -0.5 * error * error - math.log(sigma * held * radius) - 1.5 * math.log(2 * math.pi)


@compile_once
def _landmark_energy(factors, x, poses, points, limit):
    """Minus the log of the target over the prior, [nats]."""
    f = factors
    if f.is_ring:
        px, py = ring_place(f.mean, f.distance, f.sigma, x)
        prior = ring_density(px - f.mean[0], py - f.mean[1], f.distance, f.sigma)
    else:
        px, py, q = f.mean[0] + x[0], f.mean[1] + x[1], f.precision
        half = 0.5 * (q[0, 0] * x[0] * x[0] + q[1, 1] * x[1] * x[1]) + q[0, 1] * x[0] * x[1]
        prior = -half - math.log(2 * math.pi) + 0.5 * f.log_det
    return prior - _density(
        px, py, f.positions, f.covariance, f.ranges, f.variance, f.centre, f.prior_sigma,
        poses, points[:-1], points[-1],
    )  # fmt: skip


evaluated_by(LandmarkFactors, _landmark_energy)
