"""Weighted samples of a posterior, with its evidence: what every sampler returns."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from dynesty.results import Results

from sngr_utils.metrics.effective_sample_size import effective_sample_size
from sngr_utils.sampling.importance_diagnostics import Diagnostics


@dataclass(frozen=True)
class WeightedSamples:
    """N weighted samples of a d-dimensional posterior and its evidence, whatever drew them.

    Attributes
    ----------
    samples : (N, d)
    weights : (N,) summing to 1
    log_likelihoods : (N,) of the likelihood, or of a target that holds its prior, [nats]
    log_evidence, log_evidence_error : log Z and the sampler's own standard error, [nats]
    calls : likelihood calls
    results : dynesty's full record, if dynesty drew them
    diagnostics : of the weights, if they are importance weights from many starts
    note : what the sampler has to say about itself, e.g. why it handed over to another
    """

    samples: np.ndarray
    weights: np.ndarray
    log_likelihoods: np.ndarray
    log_evidence: float
    log_evidence_error: float
    calls: int
    results: Results | None = None
    diagnostics: Diagnostics | None = None
    note: str = ""

    @cached_property
    def mean(self) -> np.ndarray:
        """(d,) weighted mean of the samples"""
        return self.weights @ self.samples

    @cached_property
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
