"""The posterior of all poses and landmarks of a small log, ranges from one of several landmarks.

A point holds standardised noises: of the prior on the first pose, of one odometry after the
other, and of the place of each landmark. So the prior is a standard Gaussian, and all that is not
Gaussian is in the ranges.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.sampling.targets.ambiguous_window import LOG_TAU
from sngr_utils.sampling.targets.compiled import evaluated_by
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import NO_LABEL, Log

MOST = 40  # unknowns: walks in more of them take longer than anybody waits


class GraphFactors(NamedTuple):
    """What `compiled_nested.sample` calls `factors`; a point is one of noises.

    Attributes
    ----------
    poses, points : work arrays (T, 3) and (K, 2)
    precision : (d, d) of the prior
    first, first_sigmas : (3,) prior on the first pose, [m, m, rad]
    odometry, roots : (T-1, 3), and (T-1, 3, 3) lower factors of its covariances
    pose_of, ranges, sigmas, shares : (M,) and (M, K) probability of each landmark
    centres, spreads : (K, 2) and (K,) prior on the landmarks, [m]
    """

    poses: np.ndarray
    points: np.ndarray
    precision: np.ndarray
    first: np.ndarray
    first_sigmas: np.ndarray
    odometry: np.ndarray
    roots: np.ndarray
    pose_of: np.ndarray
    ranges: np.ndarray
    sigmas: np.ndarray
    shares: np.ndarray
    centres: np.ndarray
    spreads: np.ndarray


@dataclass(frozen=True)
class WholeGraph:
    """Posterior density of the noises of a log."""

    factors: GraphFactors

    @property
    def root(self) -> tuple[np.ndarray, np.ndarray]:
        """(d,) mean and (d, d) lower factor of the Gaussian that the target holds as a factor."""
        d = len(self.factors.precision)
        return np.zeros(d), np.eye(d)

    def over(self, mean: np.ndarray, lower: np.ndarray) -> GraphFactors:
        """The target over its own prior, which is the only one it knows.

        Raises
        ------
        ValueError : another prior
        """
        if not all(np.array_equal(a, b) for a, b in zip((mean, lower), self.root, strict=True)):
            raise ValueError("a whole graph is sampled over its own prior")
        return self.factors

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(N,) log of prior times likelihood at (N, d) points, [nats]"""
        points = np.ascontiguousarray(points, dtype=float)
        prior = -0.5 * (np.sum(points**2, axis=1) + points.shape[1] * LOG_TAU)
        return prior + _all(self.factors, points)[0]

    def placed(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, T, 3) poses and (N, K, 2) landmarks that (N, d) noises stand for, [m, m, rad]."""
        return _all(self.factors, np.ascontiguousarray(points, dtype=float))[1:]


def of_log(log: Log) -> WholeGraph:
    """The posterior of a log.

    A landmark without a survey has a Gaussian prior about the middle of the dead-reckoned path,
    whose sigma is the longest range.

    Raises
    ------
    ValueError : no range, a calibration to be estimated, more than `MOST` unknowns, or a range
        that may come from no landmark
    """
    d = 3 * log.n_poses + 2 * log.n_landmarks
    if not len(log.ranges):
        raise ValueError("there is no range")
    if log.scale != (1.0, 0.0) or log.offset != (0.0, 0.0):
        raise ValueError("scale and offset must be 1 and 0: correct the ranges before")
    if d > MOST:
        raise ValueError(f"{d} unknowns: at most {MOST} are sampled together")
    shares = log.label_probabilities
    if shares is None:
        shares = np.where(
            log.label_of[:, None] == NO_LABEL,
            1 / log.n_landmarks,
            log.label_of[:, None] == np.arange(log.n_landmarks),
        )
    clutter = np.flatnonzero(np.sum(shares, axis=1) < 1 - 1e-9)
    if len(clutter):
        raise ValueError(f"label_probabilities of row {clutter[0]} must sum to one")
    middle = dead_reckoning(log.x0_mean, log.odometry)[:, :2].mean(axis=0)
    surveyed = log.surveyed
    return WholeGraph(GraphFactors(
        np.empty((log.n_poses, 3)), np.empty((log.n_landmarks, 2)), np.eye(d),
        log.x0_mean, log.x0_sigmas, log.odometry, np.linalg.cholesky(log.odometry_covariances),
        log.pose_of, log.ranges, log.range_sigmas, np.ascontiguousarray(shares, dtype=float),
        np.where(surveyed[:, None], log.landmark_means, middle),
        np.where(surveyed, log.landmark_sigmas, log.ranges.max()),
    ))  # fmt: skip


@compile_once
def _energy(factors, x, poses, points, limit):
    """Minus the log-likelihood of the ranges, [nats]; where all is, into `poses` and `points`."""
    f, noises, turned = factors, x, 0.0
    for t in range(len(poses)):
        x0, y0, theta, step = 0.0, 0.0, 0.0, np.empty(3)
        if t == 0:
            x0, y0, turned = f.first[0], f.first[1], f.first[2]
            for i in range(3):
                step[i] = f.first_sigmas[i] * noises[i]
        else:
            x0, y0, turned = poses[t - 1, 0], poses[t - 1, 1], poses[t - 1, 2]
            for i in range(3):
                step[i] = f.odometry[t - 1, i]
                for j in range(i + 1):
                    step[i] += f.roots[t - 1, i, j] * noises[3 * t + j]
        cos, sin, theta = math.cos(turned), math.sin(turned), turned + step[2]
        poses[t, 0], poses[t, 1] = (
            x0 + cos * step[0] - sin * step[1],
            y0 + sin * step[0] + cos * step[1],
        )
        poses[t, 2] = theta
    for k in range(len(points)):
        for i in range(2):
            noise = noises[3 * len(poses) + 2 * k + i]
            points[k, i] = f.centres[k, i] + f.spreads[k] * noise
    total = 0.0
    for m in range(len(f.ranges)):
        t, density = f.pose_of[m], 0.0
        for k in range(len(points)):
            dx, dy = points[k, 0] - poses[t, 0], points[k, 1] - poses[t, 1]
            error = (math.sqrt(dx * dx + dy * dy) - f.ranges[m]) / f.sigmas[m]
            density += f.shares[m, k] * math.exp(-0.5 * error * error)
        total -= math.log(density + 1e-300) - math.log(f.sigmas[m]) - 0.5 * LOG_TAU
    return total


evaluated_by(GraphFactors, _energy)


@compile_once
def _all(f, points):
    """(N,) log-likelihoods, (N, T, 3) poses and (N, K, 2) landmarks of (N, d) noises."""
    n = len(points)
    found = np.empty(n)
    poses, landmarks = np.empty((n, *f.poses.shape)), np.empty((n, *f.points.shape))
    for i in range(n):
        found[i] = -_energy(f, points[i], poses[i], landmarks[i], math.inf)
    return found, poses, landmarks
