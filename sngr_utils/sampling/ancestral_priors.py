"""Three priors for nested sampling of one target, and the run that compares them.

A nested sampler looks for the posterior inside a prior. The paper's is a Gaussian about the MAP,
N(MAP, c Sigma). Here is also the ancestral one of NSFG: a spanning tree of the factor graph, prior
on the first pose, odometry, a landmark's first range, is itself a density that can be drawn from,
root to leaves, wherever the other factors pull. Whatever the prior, the likelihood is the target
over the prior, so all runs have the same posterior and the same evidence.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sngr_utils.sampling import compiled_nested
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.ambiguous_window import LOG_TAU, Window, WindowFactors
from sngr_utils.sampling.targets.landmark import Landmark, LandmarkFactors, ring_density, ring_place
from sngr_utils.sampling.weighted_samples import WeightedSamples


@dataclass(frozen=True)
class Prior:
    """A density to look in.

    Attributes
    ----------
    dimension : d
    push : (d,) standard normals to a (d,) point that follows the density
    log_density : (N, d) points to (N,) log densities, [nats]
    lower : (d, d) L if it is a Gaussian N(mean, L L^T), and the unit matrix for the others
    factors : target to what the compiled sampler takes
    """

    dimension: int
    push: Callable[[np.ndarray], np.ndarray]
    log_density: Callable[[np.ndarray], np.ndarray]
    lower: np.ndarray
    factors: Callable[[Landmark | Window], LandmarkFactors | WindowFactors]

    def draw(self, n: int, *, rng: np.random.Generator) -> np.ndarray:
        """(n, d) draws"""
        return np.array([self.push(z) for z in rng.standard_normal((n, self.dimension))])


def gaussian(mean: np.ndarray, covariance: np.ndarray, scale: float) -> Prior:
    """N(mean, scale * covariance), the paper's prior.

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

    return Prior(
        d, lambda z: mean + lower @ z, log_density, lower, lambda target: target.over(mean, lower)
    )


def ring(target: Landmark) -> Prior:
    """The landmark's first range, a ring around the mean of the first position."""
    centre, distance, sigma = target.positions[0], float(target.ranges[0]), target.first_sigma

    def log_density(points):
        return np.array([ring_density(*offset, distance, sigma) for offset in points - centre])

    return Prior(
        2, lambda z: np.array(ring_place(centre, distance, sigma, z)), log_density, np.eye(2),
        lambda of: of.over_ring(),
    )  # fmt: skip


def tree(target: Window) -> Prior:
    """Root to leaves: the chain alone, a standard Gaussian of its noises; the map is known."""
    return gaussian(np.zeros(target.dimension), np.eye(target.dimension), 1.0)


def sample(
    target: Landmark | Window, prior: Prior, settings: SamplerSettings, *, rng: np.random.Generator
) -> WeightedSamples:
    """Nested sampling of a target inside a prior, compiled.

    The likelihood is the target over the prior: what the tree holds already is not counted
    again. `SamplerSettings.prior_scale` and `likelihood_factor` have no say here.

    Source: Huang, Papalia, Leonard, Nested sampling for non-Gaussian inference in SLAM factor
    graphs, RA-L 2022 (ancestral sampling of the prior).
    """
    run = compiled_nested.sample(
        prior.factors(target), prior.lower, settings.n_live, settings.walks(prior.dimension),
        settings.dlogz, rng=rng,
    )  # fmt: skip
    normals = np.linalg.solve(prior.lower, run.samples.T).T
    return replace(run, samples=np.array([prior.push(z) for z in normals]))
