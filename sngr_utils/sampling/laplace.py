"""Laplace's approximation with the full Hessian: what a window would be if it were one Gaussian."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from sngr_utils.numerics.derivatives import STEP, derivatives
from sngr_utils.numerics.student_t import log_fall, log_height, student_t
from sngr_utils.sampling.importance_diagnostics import MAX_K_HAT
from sngr_utils.sampling.pareto_k_hat import pareto_k_hat
from sngr_utils.sampling.targets.compiled import Factors, log_likelihoods
from sngr_utils.sampling.weighted_samples import WeightedSamples

MIN_ESS_SHARE = 0.1  # of the draws, below which they are not trusted


@dataclass(frozen=True)
class Laplace:
    """A Gaussian at a mode of exp(log-likelihood) N(0, L L^T).

    Attributes
    ----------
    mode : (d,) xi
    covariance : (d, d) inverse of the full Hessian of the log posterior
    log_evidence : of the Gaussian, [nats]
    """

    mode: np.ndarray
    covariance: np.ndarray
    log_evidence: float


def laplace_approximation(
    factors: Factors, cholesky: np.ndarray, start: np.ndarray
) -> Laplace | None:
    """Newton's method from `start`, then the Gaussian of the full Hessian; None if it fails.

    Gauss-Newton leaves out residual times curvature of the range circles. With wrong
    associations residuals are metres, and that is no small term. The differences are taken in
    units of the last Gaussian found, first of the prior, so that all directions are resolved alike.

    Parameters
    ----------
    cholesky : (d, d) lower-triangular L of the prior
    start : (d,) xi near a mode

    Source: Tierney & Kadane, JASA 81 (1986) 82.
    """
    at, spread = np.array(start, dtype=float), cholesky
    precision = np.linalg.inv(cholesky @ cholesky.T)

    def log_posterior(xi):
        return log_likelihoods(factors, xi) - 0.5 * np.sum(xi @ precision * xi, axis=1)

    for _ in range(30):
        value, slope, hessian = derivatives(log_posterior, at, STEP * spread)
        eigenvalues, vectors = np.linalg.eigh(hessian / STEP**2)
        if not eigenvalues[0] > 0:
            return None
        step = vectors @ (vectors.T @ slope / STEP / eigenvalues)
        at = at + spread @ step
        spread = spread @ (vectors / np.sqrt(eigenvalues))
        rise = slope @ step / STEP
        if rise < 1e-8 and np.allclose(eigenvalues, 1, atol=1e-3):
            log_ratio = np.linalg.slogdet(spread)[1] - np.log(np.diag(cholesky)).sum()
            return Laplace(at, spread @ spread.T, float(value + 0.5 * rise + log_ratio))
    return None


def sample(
    factors: Factors, cholesky: np.ndarray, draws: int, *, rng: np.random.Generator
) -> WeightedSamples | None:
    """`sample_about` the Laplace Gaussian at the estimate; None if there is no such Gaussian."""
    found = laplace_approximation(factors, cholesky, np.zeros(len(cholesky)))
    return None if found is None else sample_about(found, factors, cholesky, draws, rng=rng)


def sample_about(
    found: Laplace, factors: Factors, cholesky: np.ndarray, draws: int, *, rng: np.random.Generator
) -> WeightedSamples | None:
    """Importance sampling from a Student t about a Laplace Gaussian; None if the weights' own
    diagnostics object to them.

    It knows one mode. The limits are those of `importance`, which looks for more, but whose
    Gauss-Newton proposal is too narrow in many dimensions with wrong associations.

    Parameters
    ----------
    cholesky : (d, d) lower-triangular L of the prior
    """
    d, spread = len(cholesky), np.linalg.cholesky(found.covariance)
    noise = student_t(draws, d, rng=rng)
    xi = found.mode + noise @ spread.T
    log_likelihood = log_likelihoods(factors, xi)
    z = solve_triangular(cholesky, xi.T, lower=True)
    log_ratio = np.log(np.diag(spread)).sum() - np.log(np.diag(cholesky)).sum()
    log_t = log_height(d) + log_fall(np.sum(noise**2, axis=1), d)
    log_prior = -0.5 * np.sum(z**2, axis=0) - 0.5 * d * np.log(2 * np.pi)
    log_weights = log_likelihood + log_prior - log_t + log_ratio
    log_evidence = np.logaddexp.reduce(log_weights) - np.log(draws)
    weights = np.exp(log_weights - log_evidence) / draws
    run = WeightedSamples(
        xi, weights, log_likelihood, float(log_evidence),
        float(np.sqrt(draws * np.var(weights))), draws,
    )  # fmt: skip
    trusted = pareto_k_hat(weights) <= MAX_K_HAT and run.ess_share >= MIN_ESS_SHARE
    return run if trusted else None
