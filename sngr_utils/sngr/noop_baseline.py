"""The trigger-only baseline: a no-op importance sampler in the place of nested sampling."""

from typing import Annotated

import numpy as np
from pydantic import Field

from sngr_utils.settings import Checked, Positive


class TriggerOnly(Checked):
    """The no-op importance sampler of the trigger-only baseline; the paper's values."""

    noop_samples: Annotated[int, Field(ge=2)] = 500
    noop_sigma: Positive = 0.5  # in every coordinate, [m, m, rad]


def noop_log_weights(
    covariance: np.ndarray, settings: TriggerOnly, *, rng: np.random.Generator
) -> np.ndarray:
    """(N,) log importance weights of draws from N(MAP, s^2 I) under the iSAM2 marginal.

    log N(x; MAP, Sigma_w) - log N(x; MAP, s^2 I), both normalised, [nats]. Their expectation
    is `noop_expected_log_weight`.

    Parameters
    ----------
    covariance : (d, d) joint marginal Sigma_w
    """
    d, sigma = len(covariance), settings.noop_sigma
    draws = rng.normal(scale=sigma, size=(settings.noop_samples, d))
    quadratic = np.sum(draws * np.linalg.solve(covariance, draws.T).T, axis=1)
    log_determinant = np.linalg.slogdet(covariance)[1]
    proposal = np.sum(draws**2, axis=1) / sigma**2 + 2 * d * np.log(sigma)
    return -0.5 * (quadratic + log_determinant - proposal)


def noop_expected_log_weight(covariance: np.ndarray, sigma: float) -> float:
    """Closed form of the mean of `noop_log_weights`: minus KL(N(0, s^2 I) || N(0, Sigma_w))."""
    d = len(covariance)
    trace = sigma**2 * np.trace(np.linalg.inv(covariance))
    log_ratio = np.linalg.slogdet(covariance)[1] - 2 * d * np.log(sigma)
    return float(-0.5 * (trace - d + log_ratio))
