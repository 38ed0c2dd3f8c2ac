"""Nested sampling by dynesty, the definition that the compiled engines are tested against."""

from collections.abc import Callable

import numpy as np
from dynesty import NestedSampler
from dynesty.internal_samplers import RWalkSampler

from sngr_utils.sampling.dynesty_logsumexp import quick_logsumexp
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.weighted_samples import WeightedSamples


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
    *,
    rng: np.random.Generator,
) -> WeightedSamples:
    """Static nested sampling by dynesty with random walks (paper, section "Refinement").

    Source: Speagle, MNRAS 493 (2020) 3132; Skilling, Bayesian Analysis 1 (2006) 833.
    """
    sampler = NestedSampler(
        log_likelihood,
        transform,
        dimension,
        nlive=settings.n_live,
        sample=CanonicalWalk(walks=settings.walks(dimension)),
        rstate=rng,
    )
    with quick_logsumexp():
        sampler.run_nested(dlogz=settings.dlogz, print_progress=False)
    results = sampler.results
    return WeightedSamples(
        samples=results.samples,
        weights=results.importance_weights(),
        log_likelihoods=results.logl,
        log_evidence=float(results.logz[-1]),
        log_evidence_error=float(results.logzerr[-1]),
        calls=int(np.sum(results.ncall)),
        results=results,
    )
