"""Nested sampling of one window: likelihood, prior transform, the dynesty run, its summary.

A point is a tangent vector xi in R^d about the MAP: the window's variables are
``MAP.retract(xi)``, three numbers per pose [m, m, rad] in its body frame. Headings near +-pi
therefore need no special care.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import gtsam
import numpy as np
from dynesty import NestedSampler
from dynesty.internal_samplers import RWalkSampler
from dynesty.results import Results
from pydantic import Field
from scipy.special import ndtri

from sngr_utils.metrics.effective_sample_size import effective_sample_size
from sngr_utils.settings import Checked, Positive


class SamplerSettings(Checked):
    """Settings of a nested sampling run; the defaults are the paper's.

    n_live : live points
    min_walks : steps of each random walk, raised to the dimension where that is larger
    dlogz : stop when the live points can add no more than this to log Z, [nats]
    prior_scale : c in the prior N(MAP, c Sigma_w)
    likelihood_factor : factor on GTSAM's error(). error() is already r^2 / (2 sigma^2), so 1
        gives the likelihood and the paper's 1/2 its square root
    """

    n_live: Annotated[int, Field(ge=20)] = 100
    min_walks: Annotated[int, Field(ge=1)] = 9
    dlogz: Positive = 0.5
    prior_scale: Positive = 1.0
    likelihood_factor: Positive = 0.5

    def walks(self, dimension: int) -> int:
        """Steps of each random walk in that many dimensions: max(d, min_walks)."""
        return max(dimension, self.min_walks)


class LocalLikelihood:
    """Log-likelihood of a few variables, all others held at the MAP (paper eq. "ll").

    Parameters
    ----------
    factors : the factors that touch `keys`
    estimate : MAP values of all variables
    keys : variables that move, poses or points
    factor : factor on GTSAM's error(), see `SamplerSettings`
    """

    def __init__(
        self,
        factors: gtsam.NonlinearFactorGraph,
        estimate: gtsam.Values,
        keys: list[int],
        factor: float,
    ) -> None:
        self.keys = keys
        self.factors = factors
        self.estimate = estimate
        self.factor = factor
        self._moved = gtsam.Values(estimate)
        self._map = [_variable(estimate, key) for key in keys]
        sizes = [3 if isinstance(v, gtsam.Pose2) else 2 for v in self._map]
        self._slices = [slice(e - n, e) for e, n in zip(np.cumsum(sizes), sizes, strict=True)]
        self.dimension = int(sum(sizes))

    def variables(self, xi: np.ndarray) -> list[gtsam.Pose2 | np.ndarray]:
        """MAP.retract(xi): the moved variables, in the order of `keys`."""
        return [
            value.retract(xi[part]) if isinstance(value, gtsam.Pose2) else value + xi[part]
            for value, part in zip(self._map, self._slices, strict=True)
        ]

    def __call__(self, xi: np.ndarray) -> float:
        """-factor * sum of error() at a (d,) tangent vector, [nats]."""
        for key, value in zip(self.keys, self.variables(xi), strict=True):
            self._moved.update(key, value)
        return -self.factor * self.factors.error(self._moved)


def _variable(values: gtsam.Values, key: int) -> gtsam.Pose2 | np.ndarray:
    is_pose = gtsam.Symbol(key).chr() == ord("x")
    return values.atPose2(key) if is_pose else values.atPoint2(key)


def prior_transform(covariance: np.ndarray, scale: float) -> Callable[[np.ndarray], np.ndarray]:
    """Map from the unit cube to N(0, scale * covariance): Cholesky factor and probit.

    Parameters
    ----------
    covariance : (d, d) positive definite
    scale : c in the paper

    Raises
    ------
    numpy.linalg.LinAlgError : covariance not positive definite
    """
    cholesky = np.linalg.cholesky(scale * covariance)
    return lambda unit: cholesky @ ndtri(unit)


@dataclass(frozen=True)
class NestedRun:
    """Weighted samples of a d-dimensional posterior and their evidence, whatever drew them.

    Attributes
    ----------
    samples : (N, d)
    weights : (N,) summing to 1
    log_likelihoods : (N,) [nats]
    log_evidence, log_evidence_error : log Z and the sampler's own standard error, [nats]
    calls : likelihood calls
    results : dynesty's full record, if dynesty drew them
    note : what the sampler has to say about itself, e.g. why it handed over to another
    """

    samples: np.ndarray
    weights: np.ndarray
    log_likelihoods: np.ndarray
    log_evidence: float
    log_evidence_error: float
    calls: int
    results: Results | None = None
    note: str = ""

    @property
    def mean(self) -> np.ndarray:
        """(d,) weighted mean of the samples"""
        return self.weights @ self.samples

    @property
    def covariance(self) -> np.ndarray:
        """(d, d) weighted covariance of the samples"""
        centred = self.samples - self.mean
        return (self.weights[:, None] * centred).T @ centred

    @property
    def ess_share(self) -> float:
        """Kish's effective sample size as a share of the number of samples."""
        return effective_sample_size(self.weights) / len(self.weights)

    @property
    def best(self) -> np.ndarray:
        """(d,) the sample of highest likelihood"""
        return self.samples[np.argmax(self.log_likelihoods)]


class CanonicalWalk(RWalkSampler):
    """dynesty's random walk, the same on every processor.

    A walk proposes points uniformly in an ellipsoid that dynesty describes by its principal
    axes. Their signs are arbitrary, and linear algebra libraries choose them differently on
    different processors, which would change every proposal. Only the matrix A A^T matters to
    the law of the proposals, so this walk describes it by its Cholesky factor, which is unique.
    """

    def prepare_sampler(self, axes=None, **arguments):
        canonical = [np.linalg.cholesky(a @ a.T) for a in axes]
        return super().prepare_sampler(axes=canonical, **arguments)


def run_nested(
    log_likelihood: Callable[[np.ndarray], float],
    transform: Callable[[np.ndarray], np.ndarray],
    dimension: int,
    settings: SamplerSettings,
    walk: RWalkSampler | None = None,
    *,
    rng: np.random.Generator,
) -> NestedRun:
    """Static nested sampling by dynesty with random walks (paper, section "Refinement").

    Parameters
    ----------
    walk : another sampler of new points than `CanonicalWalk`

    Source: Speagle, MNRAS 493 (2020) 3132; Skilling, Bayesian Analysis 1 (2006) 833.
    """
    sampler = NestedSampler(
        log_likelihood,
        transform,
        dimension,
        nlive=settings.n_live,
        sample=walk or CanonicalWalk(walks=settings.walks(dimension)),
        rstate=rng,
    )
    sampler.run_nested(dlogz=settings.dlogz, print_progress=False)
    results = sampler.results
    return NestedRun(
        samples=results.samples,
        weights=results.importance_weights(),
        log_likelihoods=results.logl,
        log_evidence=float(results.logz[-1]),
        log_evidence_error=float(results.logzerr[-1]),
        calls=int(np.sum(results.ncall)),
        results=results,
    )
