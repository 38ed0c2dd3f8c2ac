"""What notebook 01 runs: a landmark seen from two anchors has two places to be.

A helper's `Config` is read to check parameters before anything runs. So what is slow to load is
imported by the functions that need it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sngr_utils.metrics import bimodality, standard_error
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.settings import Positive, Seed
from sngr_utils.world.two_anchors import TwoAnchors

if TYPE_CHECKING:
    from dynesty.results import Results

    from sngr_utils.sampling.weighted_samples import WeightedSamples


class Config(TwoAnchors, SamplerSettings):
    """Parameters of the bimodal experiment; the defaults are the paper's values."""

    prior_scale: Positive = 50.0
    n_repeats: Annotated[int, Field(ge=2)] = 20
    seed: Seed = 0

    @model_validator(mode="after")
    def _places_are_likely(self) -> Self:
        gain = -float(self.profile(np.zeros(1), self.likelihood_factor)[0])
        if gain < 0.01:
            raise ValueError(
                f"range_sigma is {self.range_sigma}: the two places are likelier than the point "
                f"between them by {gain:.2g} nats: it must be 0.01 or more"
            )
        if self.modes[0, 1] > 10 * self.landmark_prior_sigma:
            raise ValueError(
                f"landmark_prior_sigma is {self.landmark_prior_sigma}: the two places lie more "
                f"than ten of it away, at {self.modes[0, 1]:.3g} m"
            )
        return self


@dataclass(frozen=True)
class Result:
    """Lengths in m, log quantities in nats.

    Attributes
    ----------
    config : the parameters
    map, best : (2,) the iSAM2 estimate, and the nested sample of highest likelihood
    loglik_map, loglik_best : local log-likelihoods there
    covariance : (2, 2) marginal covariance at the iSAM2 estimate
    samples, weights : (N, 2) positions and (N,) posterior weights
    runs : n_repeats nested sampling runs that differ in their random stream only; the first is
        `run`
    upper_masses : (n_repeats,) posterior mass at y > 0 in each of them
    resampled_error : what resampling `run` alone says the error of its mass is
    """

    config: Config
    map: np.ndarray
    best: np.ndarray
    loglik_map: float
    loglik_best: float
    covariance: np.ndarray
    runs: list[WeightedSamples]
    samples: np.ndarray
    weights: np.ndarray
    upper_masses: np.ndarray
    resampled_error: float

    @property
    def run(self) -> WeightedSamples:
        """The first of the repeated runs, which the figures show."""
        return self.runs[0]

    @property
    def upper_mass(self) -> float:
        """Posterior mass of the upper mode in `run`."""
        return float(self.upper_masses[0])

    @property
    def upper_mass_error(self) -> float:
        """Standard error of the mass of one run: the spread of the repeated runs."""
        return standard_error.standard_deviation(self.upper_masses)

    @property
    def delta_logp(self) -> float:
        return self.loglik_best - self.loglik_map

    @property
    def sigma_y(self) -> float:
        """Weighted standard deviation of y, [m]"""
        return float(np.sqrt(self.run.covariance[1, 1]))

    @property
    def bimodality(self) -> float:
        return bimodality.bimodality_coefficient(self.samples[:, 1], self.weights)

    def mode_distance(self, point: np.ndarray) -> float:
        """Distance to the nearer mode, [m]"""
        return float(np.linalg.norm(self.config.modes - point, axis=1).min())


def run(config: Config, at: np.ndarray | None = None) -> Result:
    """iSAM2 from the saddle (or `at` (2,)), then repeated nested sampling under N(MAP, c Sigma)."""
    import gtsam

    from sngr_utils.sampling.dynesty_nested import run_nested
    from sngr_utils.sampling.prior_transform import prior_transform
    from sngr_utils.sampling.targets import two_anchors

    estimate = two_anchors.run_isam2(config, config.saddle if at is None else at)
    likelihood = two_anchors.log_likelihood(config, estimate, config.likelihood_factor)
    marginals = gtsam.Marginals(two_anchors.build_graph(config), estimate)
    covariance = marginals.marginalCovariance(two_anchors.LANDMARK)
    transform = prior_transform(covariance, config.prior_scale)
    *streams, resample_rng = np.random.default_rng(config.seed).spawn(config.n_repeats + 1)
    runs = [run_nested(likelihood, transform, 2, config, rng=rng) for rng in streams]
    first, position = runs[0], estimate.atPoint2(two_anchors.LANDMARK)
    height = float(position[1])
    return Result(
        config=config,
        map=position,
        best=position + first.best,
        loglik_map=likelihood(np.zeros(2)),
        loglik_best=likelihood(first.best),
        covariance=covariance,
        runs=runs,
        samples=position + first.samples,
        weights=first.weights,
        upper_masses=np.array([upper_mass(run.results, height) for run in runs]),
        resampled_error=resampled_mass_error(first, height, rng=resample_rng),
    )


def upper_mass(results: Results, height: float) -> float:
    """Posterior mass above the anchors' line; samples are offsets from a point at `height` [m]."""
    return float(results.importance_weights() @ (results.samples[:, 1] + height > 0))


def resampled_mass_error(run: WeightedSamples, height: float, *, rng: np.random.Generator) -> float:
    """Standard error of `upper_mass` by resampling the strands of one run 50 times.

    Too small here. A random walk starts at a live point and stays in its mode, so once the
    modes are apart their live points multiply and die out by chance, as genes drift in a
    small population; the strands of the one run cannot show that.

    Source: Higson et al., Bayesian Analysis 13 (2018) 873; `dynesty.utils.resample_run`.
    """
    from dynesty.utils import resample_run

    masses = [upper_mass(resample_run(run.results, rstate=rng), height) for _ in range(50)]
    return float(np.std(masses, ddof=1))


def mode_width(result: Result) -> float:
    """Weighted standard deviation of y within the upper mode, [m]"""
    upper = result.samples[:, 1] > 0
    y, weights = result.samples[upper, 1], result.weights[upper]
    return float(np.sqrt(np.cov(y, aweights=weights)))
