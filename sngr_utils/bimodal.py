"""Driver of notebook 01: a landmark seen from two anchors has two places to be."""

from dataclasses import dataclass
from typing import Annotated

import gtsam
import numpy as np
from dynesty.results import Results
from dynesty.utils import resample_run
from gtsam.symbol_shorthand import A, L
from pydantic import Field, model_validator

from sngr_utils.metrics import bimodality, standard_error
from sngr_utils.sampling import dynesty_nested, prior_transform, settings, weighted_samples
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.settings import Positive, Seed

ANCHOR_SIGMA = 1e-6  # m: the anchors are known
ANCHORS, LANDMARK = (A(0), A(1)), L(0)


class Config(settings.SamplerSettings):
    """Parameters of the bimodal experiment, in m; the defaults are the paper's values.

    The paper prints neither range_sigma nor landmark_prior_sigma. 0.2 m is what its
    log-likelihood at the saddle follows from, 10 m what its gain follows from.
    """

    anchor_distance: Positive = 4.0
    measured_range: Positive = 3.0
    range_sigma: Positive = 0.2
    landmark_prior_sigma: Positive = 10.0
    prior_scale: Positive = 50.0
    n_repeats: Annotated[int, Field(ge=2)] = 20
    seed: Seed = 0

    @model_validator(mode="after")
    def _circles_cross(self):
        if self.measured_range <= self.anchor_distance / 2:
            raise ValueError(
                f"measured_range is {self.measured_range}: it must exceed half of "
                f"anchor_distance ({self.anchor_distance}), or the two circles do not cross"
            )
        return self

    @property
    def anchors(self) -> np.ndarray:
        """(2, 2) anchor positions, [m]"""
        return np.array([[0.0, 0.0], [self.anchor_distance, 0.0]])

    @property
    def saddle(self) -> np.ndarray:
        """(2,) the point midway between the anchors, where the landmark is started, [m]"""
        return self.anchors.mean(axis=0)

    @property
    def modes(self) -> np.ndarray:
        """(2, 2) where the circles cross, y > 0 first, [m]"""
        height = np.sqrt(self.measured_range**2 - (self.anchor_distance / 2) ** 2)
        return self.saddle + np.array([[0.0, height], [0.0, -height]])


def build_graph(config: Config) -> gtsam.NonlinearFactorGraph:
    """Two known anchors, two ranges, and a weak prior on the landmark at the saddle."""
    graph = gtsam.NonlinearFactorGraph()
    range_noise = gtsam.noiseModel.Isotropic.Sigma(1, config.range_sigma)
    known = gtsam.noiseModel.Isotropic.Sigma(2, ANCHOR_SIGMA)
    weak = gtsam.noiseModel.Isotropic.Sigma(2, config.landmark_prior_sigma)
    for key, position in zip(ANCHORS, config.anchors, strict=True):
        graph.push_back(gtsam.PriorFactorPoint2(key, position, known))
        graph.push_back(gtsam.RangeFactor2(key, LANDMARK, config.measured_range, range_noise))
    graph.push_back(gtsam.PriorFactorPoint2(LANDMARK, config.saddle, weak))
    return graph


def run_isam2(config: Config, at: np.ndarray, updates: int = 10) -> gtsam.Values:
    """iSAM2 with the landmark started `at` a point, and extra updates to move if it can."""
    start = gtsam.Values()
    for key, position in zip(ANCHORS, config.anchors, strict=True):
        start.insert(key, position)
    start.insert(LANDMARK, at)
    params = gtsam.ISAM2Params()
    params.setRelinearizeThreshold(1e-6)
    params.relinearizeSkip = 1
    isam = gtsam.ISAM2(params)
    isam.update(build_graph(config), start)
    for _ in range(updates):
        isam.update()
    return isam.calculateEstimate()


def log_likelihood(config: Config, estimate: gtsam.Values) -> LocalLikelihood:
    """Local log-likelihood of the landmark (paper eq. "ll"), as a function of its offset."""
    factors = build_graph(config)
    return LocalLikelihood(factors, estimate, [LANDMARK], config.likelihood_factor)


def gauss_newton_hessian(config: Config, at: np.ndarray) -> np.ndarray:
    """(2, 2) J^T J of the landmark's factors: what iSAM2 sees. Ranges only see along the ray."""
    offset = at - config.anchors
    rays = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    ranges = rays.T @ rays / config.range_sigma**2
    return ranges + np.eye(2) / config.landmark_prior_sigma**2


def full_hessian(config: Config, at: np.ndarray) -> np.ndarray:
    """(2, 2) true second derivative of the negative log posterior at a point.

    Adds to `gauss_newton_hessian` the curvature of the circles,
    (rho - z) / (rho sigma^2) (I - n n^T), n the ray and rho the distance; negative inside a
    circle.
    """
    hessian = gauss_newton_hessian(config, at)
    for offset in at - config.anchors:
        distance = np.linalg.norm(offset)
        ray = offset / distance
        curvature = (distance - config.measured_range) / (distance * config.range_sigma**2)
        hessian += curvature * (np.eye(2) - np.outer(ray, ray))
    return hessian


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
    runs: list[weighted_samples.NestedRun]
    samples: np.ndarray
    weights: np.ndarray
    upper_masses: np.ndarray
    resampled_error: float

    @property
    def run(self) -> weighted_samples.NestedRun:
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
    estimate = run_isam2(config, config.saddle if at is None else at)
    likelihood = log_likelihood(config, estimate)
    covariance = gtsam.Marginals(build_graph(config), estimate).marginalCovariance(LANDMARK)
    transform = prior_transform.prior_transform(covariance, config.prior_scale)
    *streams, resample_rng = np.random.default_rng(config.seed).spawn(config.n_repeats + 1)
    runs = [dynesty_nested.run_nested(likelihood, transform, 2, config, rng=rng) for rng in streams]
    first, position = runs[0], estimate.atPoint2(LANDMARK)
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


def resampled_mass_error(
    run: weighted_samples.NestedRun, height: float, n: int = 50, *, rng: np.random.Generator
) -> float:
    """Standard error of `upper_mass` by resampling the strands of one run.

    Too small here. A random walk starts at a live point and stays in its mode, so once the
    modes are apart their live points multiply and die out by chance, as genes drift in a
    small population; the strands of the one run cannot show that.

    Source: Higson et al., Bayesian Analysis 13 (2018) 873; `dynesty.utils.resample_run`.
    """
    masses = [upper_mass(resample_run(run.results, rstate=rng), height) for _ in range(n)]
    return float(np.std(masses, ddof=1))


def repeated(result: Result) -> dict[str, tuple[list[float], str]]:
    """What a run reports, for each of the repeated runs: name -> ((n_repeats,) values, unit)."""
    bests = [result.map + run.best for run in result.runs]
    loglik = [float(run.log_likelihoods.max()) for run in result.runs]
    heights = [result.map[1] + run.samples[:, 1] for run in result.runs]
    return {
        "best_x": ([float(best[0]) for best in bests], "m"),
        "best_abs_y": ([abs(float(best[1])) for best in bests], "m"),
        "best_distance": ([result.mode_distance(best) for best in bests], "m"),
        "loglik_best": (loglik, "nats"),
        "gains": ([value - result.loglik_map for value in loglik], "nats"),
        "sigmas_y": ([float(np.sqrt(run.covariance[1, 1])) for run in result.runs], "m"),
        "bimodalities": (
            [bimodality.bimodality_coefficient(y, run.weights)
             for y, run in zip(heights, result.runs, strict=True)], "",
        ),
        "upper_masses": (list(map(float, result.upper_masses)), ""),
    }  # fmt: skip


def mode_width(result: Result) -> float:
    """Weighted standard deviation of y within the upper mode, [m]"""
    upper = result.samples[:, 1] > 0
    y, weights = result.samples[upper, 1], result.weights[upper]
    return float(np.sqrt(np.cov(y, aweights=weights)))
