"""Reference posteriors of small problems, with their own error.

A landmark in the plane: the rectangle rule on a polar grid about the first pose, where the first
range leaves a thin ring. For smooth densities that fall to nothing it converges faster than any
power of the step (Trefethen & Weideman, SIAM Review 56, 2014). A window of poses: particle filters
with very many particles, several of them, so that their spread is their error.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.sampling.targets.ambiguous_window import Window, place, range_term
from sngr_utils.sampling.targets.landmark import Landmark
from sngr_utils.sampling.weighted_samples import WeightedSamples

N_RADII, N_ANGLES = 40, 720  # cells of the polar grid
EMPTY = 1e-14  # mass of a cell that is left out
REACH = 7.0  # standard deviations of the first range that the grid covers to either side


@dataclass(frozen=True)
class Reference(WeightedSamples):
    """Weighted samples of a target, made of several parts that would each do alone.

    Attributes
    ----------
    part : (N,) int, which part each sample is of
    """

    part: np.ndarray = field(kw_only=True)

    def expectation(self, values: np.ndarray) -> tuple[float, float]:
        """Posterior mean of (N,) values, and its error from the spread of the parts.

        The parts of a grid are grids of twice the step, so theirs bounds the error of the whole;
        those of particle filters are independent, and their spread gives a standard error.
        """
        sums = np.bincount(self.part, self.weights * values) / np.bincount(self.part, self.weights)
        return float(self.weights @ values), float(sums.std(ddof=1) / math.sqrt(len(sums)))

    def masses(self, labels: np.ndarray, n: int) -> np.ndarray:
        """(n,) posterior mass of each of n classes of points, from (N,) int labels"""
        return np.bincount(labels, self.weights, minlength=n)

    def mass_error(self, labels: np.ndarray, n: int) -> float:
        """Largest error of these masses, from the spread of the parts."""
        return max(self.expectation((labels == one).astype(float))[1] for one in range(n))

    def divergence(self, log_other: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
        """KL(posterior || other), [nats], and its error; `log_other` of (N, d) points."""
        log_density = self.log_likelihoods - self.log_evidence
        return self.expectation(log_density - log_other(self.samples))


def landmark_reference(
    target: Landmark, n_radii: int = N_RADII, n_angles: int = N_ANGLES
) -> Reference:
    """Quadrature of a landmark's posterior on a polar grid about the first mean position.

    Parameters
    ----------
    n_radii, n_angles : cells, both even; 7 standard deviations of the first range to each side

    Raises
    ------
    ValueError : n_radii or n_angles odd or less than 4
    """
    for name, n in (("n_radii", n_radii), ("n_angles", n_angles)):
        if n < 4 or n % 2:
            raise ValueError(f"{name} is {n}: it must be even and at least 4")
    points, areas = polar_grid(target, n_radii, n_angles)
    log_density = target(points)
    log_cells = log_density + np.log(areas)
    i, j = np.indices((n_radii, n_angles))
    part = (2 * (i % 2) + j % 2).ravel()
    top = log_cells.max()
    cells = np.exp(log_cells - top)
    log_evidence = float(top + np.log(cells.sum()))
    error = float(np.std(np.log(4 * np.bincount(part, cells)), ddof=1) / 2)
    kept = cells > EMPTY * cells.sum()
    return Reference(points[kept], cells[kept] / cells[kept].sum(), log_density[kept],
                     log_evidence, error, len(points), part=part[kept])  # fmt: skip


def polar_grid(target: Landmark, n_radii: int, n_angles: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) centres [m] and (N,) areas [m^2] of N = n_radii n_angles cells, radius by radius."""
    reach, distance = REACH * target.first_sigma, float(target.ranges[0])
    edges = np.linspace(max(0.0, distance - reach), distance + reach, n_radii + 1)
    radii, step = 0.5 * (edges[1:] + edges[:-1]), edges[1] - edges[0]
    angles = 2 * np.pi * np.arange(n_angles) / n_angles
    radius, angle = (axis.ravel() for axis in np.meshgrid(radii, angles, indexing="ij"))
    points = target.positions[0] + np.column_stack([np.cos(angle), np.sin(angle)]) * radius[:, None]
    return points, radius * step * 2 * np.pi / n_angles


def window_reference(
    target: Window, n: int, kept: int | None = None, filters: int = 10, *, rng: np.random.Generator
) -> Reference:
    """Particle filters along the chain of a window, each with n particles.

    A filter's estimate of the evidence is unbiased, whatever the posterior's shape: the root
    draws cover every place that the prior of the chain allows.

    Parameters
    ----------
    kept : of a filter's particles at the end; all if None

    Source: Gordon, Salmond & Smith, IEE Proceedings F 140 (1993) 107; systematic resampling.
    """
    kept = kept or n
    runs = [
        _filter(
            n, kept, target.x0_mean, target.x0_sigmas, target.odometry, target.odometry_sigmas,
            target.pose_of, target.ranges, target.log_shares, target.points, target.range_sigma,
            rng,
        ) for _ in range(filters)
    ]  # fmt: skip
    evidences = np.array([log_evidence for _, log_evidence in runs])
    log_evidence = float(np.logaddexp.reduce(evidences) - math.log(filters))
    shares = np.exp(evidences - log_evidence)
    points = np.concatenate([noises for noises, _ in runs])
    part = np.repeat(np.arange(filters), kept)
    return Reference(points, shares[part] / (filters * kept), target(points), log_evidence,
                     float(shares.std(ddof=1) / math.sqrt(filters)),
                     filters * n * (len(target.odometry) + 1), part=part)  # fmt: skip


@compile_once
def _filter(n, kept, x0_mean, x0_sigmas, odometry, sigmas, pose_of, ranges, log_shares, points,
            range_sigma, rng):  # fmt: skip
    """(kept, d) equally weighted draws of the noises, and the log of the evidence estimate."""
    poses = len(odometry) + 1
    noises, log_evidence = np.zeros((n, 3 * poses)), 0.0
    where, log_weights, none = np.empty((poses, 2)), np.empty(n), np.zeros(3 * poses)
    for t in range(poses):
        moved = odometry[:t]
        for k in range(n):
            for i in range(3 * t, 3 * t + 3):
                noises[k, i] = rng.standard_normal()
            place(noises[k], none, x0_mean, x0_sigmas, moved, sigmas, where)
            log_weights[k] = range_term(
                where, points, pose_of, ranges, log_shares, range_sigma, t, t + 1, -math.inf
            )
        top = log_weights.max()
        steps = np.cumsum(np.exp(log_weights - top))
        log_evidence += top + math.log(steps[-1] / n)
        out = n if t < poses - 1 else kept
        drawn = np.searchsorted(steps, (np.arange(out) + rng.random()) / out * steps[-1])
        noises = noises[np.minimum(drawn, n - 1)]
    return noises, log_evidence
