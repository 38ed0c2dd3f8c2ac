"""The posterior of one landmark in the plane, with the poses integrated out.

To first order in the uncertainty of the poses, which the tests bound. Every factor is a normalised
density, so that the integral over the plane is the evidence of the ranges.
"""

import math
from dataclasses import dataclass

import numpy as np

from sngr_utils.jit import compile_once
from sngr_utils.window_target import chain_positions
from sngr_utils.world import World, dead_reckoning

STEP = 1e-5  # of the forward differences, in standard deviations of a noise


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
    sigmas = np.array([s.odometry_sigma_xy, s.odometry_sigma_xy, s.odometry_sigma_theta])
    steps = STEP * np.vstack([np.zeros(3 * n), np.eye(3 * n)])
    reached = chain_positions(
        steps, world.x0_mean, np.array(x0_sigmas), world.odometry[: n - 1], sigmas
    )
    flat = reached.reshape(len(steps), -1)
    jacobian = (flat[1:] - flat[0]) / STEP
    return dead_reckoning(world.x0_mean, world.odometry[: n - 1])[:, :2], jacobian.T @ jacobian


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
