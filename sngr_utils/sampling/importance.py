"""The fast path: find the modes from many starts, then importance sampling from a mixture.

Nearly every window is close to one Gaussian, and then this takes a millisecond. It knows when
it cannot be trusted: see `Diagnostics`. Just over 300 lines: search, draws and weights share
their compiled loops.
"""

import math
from dataclasses import replace

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import factorise, solve_lower, solve_upper
from sngr_utils.numerics.student_t import log_fall, log_height, student_t
from sngr_utils.sampling.importance_diagnostics import MAX_MODES, MIN_ESS, Diagnostics
from sngr_utils.sampling.pareto_k_hat import pareto_k_hat
from sngr_utils.sampling.settings import FastSettings
from sngr_utils.sampling.targets.compiled import Factors, energy, residuals
from sngr_utils.sampling.weighted_samples import WeightedSamples

SAME_MODE = 1.0  # modes nearer than this in their own standard deviations are one
MORE = 20


class NoModeError(ValueError):
    """No optimisation converged to a mode; `calls` of the likelihood were made."""

    def __init__(self, why: str = "", calls: int = 0):
        super().__init__(why)
        self.calls = calls


@compile_once
def _objective(factors, cholesky, z, x, poses, points):
    """1/2 |z|^2 + energy(L z); leaves xi = L z in x."""
    norm = 0.0
    for i in range(len(z)):
        total = 0.0
        for j in range(i + 1):
            total += cholesky[i, j] * z[j]
        x[i] = total
        norm += z[i] * z[i]
    return 0.5 * norm + energy(factors, x, poses, points, math.inf)


@compile_once
def _gauss_newton(factors, cholesky, rotated, z, x, work, slope, hessian):
    """Gradient and lower half of the Gauss-Newton Hessian of the objective at z, xi = x.

    The Jacobian of the residuals is by forward differences: its error moves the proposal, not
    the result.
    """
    poses, points, base, moved, jacobian = work
    d, n, step = len(z), len(base), 1e-6
    residuals(factors, x, poses, points, base)
    for j in range(d):
        kept = x[j]
        x[j] = kept + step
        residuals(factors, x, poses, points, moved)
        x[j] = kept
        for r in range(n):
            jacobian[j, r] = (moved[r] - base[r]) / step
    for j in range(d):  # columns of J to columns of J L
        for r in range(n):
            total = 0.0
            for i in range(j, d):
                total += jacobian[i, r] * cholesky[i, j]
            jacobian[j, r] = total
    for i in range(d):
        slope[i] = z[i]
        for r in range(n):
            slope[i] += factors.factor * jacobian[i, r] * base[r]
        for j in range(i + 1):
            total = 0.0
            for r in range(n):
                total += jacobian[i, r] * jacobian[j, r]
            hessian[i, j] = factors.factor * total
        hessian[i, i] += 1.0
    for i in range(len(rotated)):
        for j in range(d):
            slope[i] += rotated[i, j] * z[j]
            if j <= i:
                hessian[i, j] += rotated[i, j]
    for i in range(len(factors.linear)):
        for j in range(i + 1):
            slope[j] += cholesky[i, j] * factors.linear[i]


@compile_once
def _distance(lower, z, mode, work):
    """|L^T (z - mode)|^2: squared distance in the mode's own standard deviations."""
    total = 0.0
    for j in range(len(z)):
        work[j] = z[j] - mode[j]
    for j in range(len(z)):
        along = 0.0
        for i in range(j, len(z)):
            along += lower[i, j] * work[i]
        total += along * along
    return total


@compile_once
def modes_of_factors(factors, cholesky, rotated, starts, n_residuals):
    """Levenberg-Marquardt from every start; the distinct modes it ends in.

    A start that comes within `SAME_MODE` of a known mode is taken to end there.

    Returns
    -------
    (m, d) modes in z, (m, d, d) Cholesky factors of their Hessians, (m,) log of their Laplace
    masses, number of starts that converged, likelihood evaluations

    Source: Levenberg-Marquardt as in Madsen, Nielsen & Tingleff, 2004, section 3.2.
    """
    n, d = starts.shape
    poses, points = factors.poses.copy(), factors.points.copy()
    base, moved = np.empty(n_residuals), np.empty(n_residuals)
    jacobian, x, z, trial = np.empty((d, n_residuals)), np.empty(d), np.empty(d), np.empty(d)
    work = (poses, points, base, moved, jacobian)
    slope, hessian, damped = np.empty(d), np.zeros((d, d)), np.empty((d, d))
    modes, lowers, masses = (
        np.empty((MAX_MODES, d)),
        np.empty((MAX_MODES, d, d)),
        np.empty(MAX_MODES),
    )
    found, converged, calls = 0, 0, 0
    for s in range(n):
        for i in range(d):
            z[i] = starts[s, i]
        value, damping, ended = _objective(factors, cholesky, z, x, poses, points), 1e-3, False
        for _ in range(60):
            for m in range(found):
                ended = ended or _distance(lowers[m], z, modes[m], trial) < SAME_MODE**2
            if ended:
                break
            _gauss_newton(factors, cholesky, rotated, z, x, work, slope, hessian)
            calls += d + 2
            gain = math.inf
            while damping < 1e12:
                for i in range(d):
                    trial[i] = slope[i]
                    for j in range(i + 1):
                        damped[i, j] = hessian[i, j]
                    damped[i, i] += damping * max(hessian[i, i], 1e-3)
                if factorise(damped) < 0:
                    solve_lower(damped, trial)
                    gain = 0.0
                    for i in range(d):
                        gain += trial[i] * trial[i]
                    solve_upper(damped, trial)
                    for i in range(d):
                        trial[i] = z[i] - trial[i]
                    there = _objective(factors, cholesky, trial, x, poses, points)
                    calls += 1
                    if there <= value:
                        break
                    if gain < 1e-10:
                        there = value
                        for i in range(d):
                            trial[i] = z[i]
                        break
                damping = max(4 * damping, 1e-3)
            if damping >= 1e12:
                break
            value, damping = there, 0.1 * damping
            for i in range(d):
                z[i] = trial[i]
            if gain < 1e-4:  # a hundredth of a standard deviation
                if factorise(hessian) < 0 and found < MAX_MODES:
                    masses[found] = -value
                    for i in range(d):
                        modes[found, i] = z[i]
                        for j in range(d):
                            lowers[found, i, j] = hessian[i, j]
                        masses[found] -= math.log(hessian[i, i])
                    found += 1
                    ended = True
                break
            _objective(factors, cholesky, z, x, poses, points)
        converged += ended
    return modes[:found], lowers[:found], masses[:found], converged, calls


@compile_once
def _weigh(factors, cholesky, modes, lowers, spreads, component, noise):
    """Place the draws, and weigh each against the whole mixture.

    Parameters
    ----------
    spreads : (m, d, d) upper-triangular square roots of the modes' covariances
    component : (N,) which mode each draw belongs to, ascending
    noise : (N, d) standard Student t draws

    Returns
    -------
    (N, d) xi, (N,) log-likelihoods, (N,) log (prior / proposal)
    """
    n, d = noise.shape
    poses, points = factors.poses.copy(), factors.points.copy()
    samples, values, ratios = np.empty((n, d)), np.empty(n), np.empty(n)
    x, z, work, log_norm = np.empty(d), np.empty(d), np.empty(d), np.empty(len(modes))
    constant = log_height(d) + 0.5 * d * math.log(2 * math.pi)  # of the prior's density
    for m in range(len(modes)):
        log_norm[m] = constant + math.log(np.sum(component == m) / n)
        for i in range(d):
            log_norm[m] += math.log(lowers[m, i, i])
    for k in range(n):
        own, norm, near = component[k], 0.0, 0.0
        for i in range(d):
            total = modes[own, i]
            for j in range(i, d):
                total += spreads[own, i, j] * noise[k, j]
            z[i] = total
            norm += total * total
            near += noise[k, i] * noise[k, i]
        proposal = math.exp(log_norm[own] + log_fall(near, d))
        for m in range(len(modes)):
            if m != own:
                far = _distance(lowers[m], z, modes[m], work)
                proposal += math.exp(log_norm[m] + log_fall(far, d))
        for i in range(d):
            total = 0.0
            for j in range(i + 1):
                total += cholesky[i, j] * z[j]
            x[i] = total
            samples[k, i] = total
        values[k] = -energy(factors, x, poses, points, math.inf)
        ratios[k] = -0.5 * norm - math.log(proposal)
    return samples, values, ratios


def sample(
    factors: Factors,
    cholesky: np.ndarray,
    settings: FastSettings,
    starts: np.ndarray | None = None,
    *,
    rng: np.random.Generator,
) -> WeightedSamples:
    """Importance sampling of the likelihood in `factors` under the prior N(0, L L^T) on xi.

    The proposal is a mixture of Student t distributions, one at each mode, in proportion to
    their Laplace masses; every draw is weighed against the whole mixture.

    Parameters
    ----------
    cholesky : (d, d) lower-triangular L
    starts : (n, d) xi to optimise from; None for zero, and draws from the prior

    Returns
    -------
    xi with their diagnostics; the calls include those of the optimisation

    Raises
    ------
    NoModeError : no start converged

    Source: Owen & Zhou, JASA 95 (2000) 135 (deterministic mixtures).
    """
    d = len(cholesky)
    if starts is None:
        begin = rng.standard_normal((settings.n_starts, d))
        begin[0] = 0
    else:
        begin = np.linalg.solve(cholesky, starts.T).T.copy()
    has_more = len(factors.quadratic) > 0
    rotated = cholesky.T @ factors.quadratic @ cholesky if has_more else np.zeros((0, d))
    modes, lowers, masses, converged, evaluations = modes_of_factors(
        factors, cholesky, rotated, begin, factors.n_residuals
    )
    if len(modes) == 0:
        raise NoModeError(f"none of {len(begin)} starts converged to a mode", evaluations)
    mixture = (modes, lowers, np.linalg.inv(lowers).transpose(0, 2, 1).copy())
    shares = np.maximum(np.exp(masses - masses.max()), 0.02)
    share = converged / len(begin)
    for n_draws in (settings.n_draws, MORE * settings.n_draws):
        draw = _draw(factors, cholesky, mixture, shares / shares.sum(), n_draws, share, rng)
        evaluations += len(draw.samples)
        if draw.diagnostics.ess >= MIN_ESS:
            break
    return replace(draw, calls=evaluations)


def _draw(
    factors: Factors,
    cholesky: np.ndarray,
    mixture: tuple[np.ndarray, np.ndarray, np.ndarray],
    shares: np.ndarray,
    n_draws: int,
    converged: float,
    rng: np.random.Generator,
) -> WeightedSamples:
    """Importance samples from a mixture, its components drawn from in fixed shares."""
    component = np.repeat(np.arange(len(shares)), np.maximum(1, (n_draws * shares).astype(int)))
    n, d = len(component), len(cholesky)
    x, log_likelihoods, ratios = _weigh(
        factors, cholesky, *mixture, component, student_t(n, d, rng=rng)
    )
    log_weights = log_likelihoods + ratios
    top = log_weights.max()
    weights = np.exp(log_weights - top)
    mean, total = weights.mean(), weights.sum()
    ess = total**2 / np.sum(weights**2)
    return WeightedSamples(
        samples=x,
        weights=np.exp(log_weights - top - math.log(total)),
        log_likelihoods=log_likelihoods,
        log_evidence=float(top + math.log(mean)),
        log_evidence_error=float(math.sqrt(weights.var() / n) / mean),
        calls=n,
        diagnostics=Diagnostics(len(shares), converged, pareto_k_hat(weights), float(ess)),
    )
