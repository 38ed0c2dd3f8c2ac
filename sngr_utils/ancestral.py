"""Three priors for nested sampling of one target, and the run that compares them.

A nested sampler looks for the posterior inside a prior. The paper's is a Gaussian about the MAP,
N(MAP, c Sigma). Here is also the ancestral one of NSFG: a spanning tree of the factor graph, prior
on the first pose, odometry, a landmark's first range, is itself a density that can be drawn from,
root to leaves, wherever the other factors pull. Whatever the prior, the likelihood is the target
over the prior, so all runs have the same posterior and the same evidence.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from sngr_utils import compiled_nested
from sngr_utils.landmark_target import Landmark
from sngr_utils.nested import NestedRun, SamplerSettings, run_nested
from sngr_utils.window_target import LOG_TAU, Window


@dataclass(frozen=True)
class Prior:
    """A density to look in.

    Attributes
    ----------
    dimension : d
    transform : (d,) in the unit cube to a (d,) point
    log_density : (N, d) points to (N,) log densities, [nats]
    mean, lower : (d,) and (d, d) L if it is N(mean, L L^T), else None
    """

    dimension: int
    transform: Callable[[np.ndarray], np.ndarray]
    log_density: Callable[[np.ndarray], np.ndarray]
    mean: np.ndarray | None = None
    lower: np.ndarray | None = None

    def draw(self, n: int, *, rng: np.random.Generator) -> np.ndarray:
        """(n, d) draws"""
        return np.array([self.transform(unit) for unit in rng.random((n, self.dimension))])


def gaussian(mean: np.ndarray, covariance: np.ndarray, scale: float) -> Prior:
    """N(mean, scale * covariance) (paper eq. "prior").

    Parameters
    ----------
    mean, covariance : (d,) and (d, d) positive definite
    scale : c in the paper
    """
    lower = np.linalg.cholesky(scale * covariance)
    inverse, constant = np.linalg.inv(lower), np.log(np.diag(lower)).sum()
    d = len(mean)

    def log_density(points):
        return -0.5 * (np.sum(((points - mean) @ inverse.T) ** 2, axis=1) + d * LOG_TAU) - constant

    return Prior(d, lambda unit: mean + lower @ ndtri(unit), log_density, mean, lower)


def ring_point(centre: np.ndarray, distance: float, sigma: float, unit: np.ndarray) -> np.ndarray:
    """(2,) place at a uniform angle and a Gaussian radius that is not negative, [m]"""
    below = ndtr(-distance / sigma)
    radius = distance + sigma * ndtri(below + unit[1] * (1 - below))
    angle = 2 * np.pi * unit[0]
    return centre + radius * np.array([np.cos(angle), np.sin(angle)])


def ring_log_density(offsets: np.ndarray, distance: float, sigma: float) -> np.ndarray:
    """(N,) log density of `ring_point` over the plane at (N, 2) offsets from its centre, [nats].

    A ring of radius r is 2 pi r long, so that the density over the plane is that of the radius
    over 2 pi r. The range factor itself has no such term: leaving it out of the weights would
    favour the outside of the ring.
    """
    radius = np.hypot(offsets[:, 0], offsets[:, 1])
    gauss = -0.5 * (((radius - distance) / sigma) ** 2 + LOG_TAU) - math.log(sigma)
    return gauss - math.log(ndtr(distance / sigma)) - LOG_TAU - np.log(radius)


def ring(target: Landmark) -> Prior:
    """The landmark's first range, a ring around the mean of the first position."""
    centre, distance, sigma = target.positions[0], float(target.ranges[0]), target.first_sigma
    return Prior(
        2,
        lambda unit: ring_point(centre, distance, sigma, unit),
        lambda points: ring_log_density(points - centre, distance, sigma),
    )


def tree(target: Window) -> Prior:
    """Root to leaves: the noises of the chain, then a ring around the pose of the first range.

    Without an unknown landmark the tree is the chain alone, a standard Gaussian of its noises.
    """
    n = target.n_noises
    chain = gaussian(np.zeros(n), np.eye(n), 1.0)
    if not target.unknown:
        return chain
    first, distance, sigma = target.pose_of[0], float(target.ranges[0]), target.range_sigma

    def transform(unit):
        noises = chain.transform(unit[:n])
        centre = target.positions(noises[None])[0, first]
        return np.concatenate([noises, ring_point(centre, distance, sigma, unit[n:])])

    def log_density(points):
        centres = target.positions(points[:, :n])[:, first]
        ring = ring_log_density(points[:, n:] - centres, distance, sigma)
        return chain.log_density(points[:, :n]) + ring

    return Prior(target.dimension, transform, log_density)


def sample(
    target: Landmark | Window, prior: Prior, settings: SamplerSettings, *, rng: np.random.Generator
) -> NestedRun:
    """Nested sampling of a target inside a prior, by dynesty.

    The likelihood is the target over the prior: what the tree holds already is not counted
    again. `SamplerSettings.prior_scale` and `likelihood_factor` have no say here.

    Source: Huang, Papalia, Leonard, Nested sampling for non-Gaussian inference in SLAM factor
    graphs, RA-L 2022 (ancestral sampling of the prior).
    """

    def log_likelihood(point):
        points = point[None]
        return float(target(points)[0] - prior.log_density(points)[0])

    return run_nested(log_likelihood, prior.transform, prior.dimension, settings, rng=rng)


def sample_window(
    target: Window, prior: Prior, settings: SamplerSettings, *, rng: np.random.Generator
) -> NestedRun:
    """`sample` with the project's compiled nested sampler: known landmarks, a Gaussian prior.

    Raises
    ------
    ValueError : the prior is not Gaussian
    """
    if prior.lower is None:
        raise ValueError("prior is not Gaussian: the compiled sampler has no other")
    walks = settings.walks(prior.dimension)
    trace = compiled_nested.sample(
        target.over(prior.mean, prior.lower), prior.lower, settings.n_live, walks, settings.dlogz,
        rng=rng,
    )  # fmt: skip
    return NestedRun(prior.mean + trace.samples, np.exp(trace.log_weights), trace.log_likelihoods,
                     trace.log_evidence, trace.log_evidence_error, trace.calls)  # fmt: skip
