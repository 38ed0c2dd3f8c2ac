"""Nested sampling, compiled: an independent check of dynesty, and the engine of bulk sweeps.

Points are z ~ N(0, I) in R^d, with xi = L z and L L^T = c Sigma_w (`prior_transform`). The
algorithm is Skilling's; new points come from random walks whose steps are differences of two
live points, as in differential evolution. The likelihood is that of `compiled.Factors`, or of any
other tuple of arrays that `evaluate` has been taught (`ambiguous_window`).
"""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.sampling.targets.compiled import Factors, energy_at, evaluate
from sngr_utils.sampling.weighted_samples import WeightedSamples

HOP = 0.05  # share of steps of a full difference of live points, which can change the mode
TARGET_ACCEPTANCE = 0.2


@compile_once
def walk(factors, limit, walks, scale, live_z, live_x, z, x, poses, points, rng):
    """Random walk of `walks` steps under N(0, I) restricted to energy < limit, in place.

    A step is scale * (a - b) with two live points a, b, now and then the whole difference: both
    are symmetric, so accepting with the ratio of prior densities leaves the prior invariant.

    Returns
    -------
    energy at the end (inf if no step was accepted), accepted steps, likelihood calls

    Source: ter Braak, Statistics and Computing 16 (2006) 239 (steps from differences).
    """
    d, n = len(z), len(live_z)
    new_z, new_x = np.empty(d), np.empty(d)
    norm = 0.0
    for i in range(d):
        norm += z[i] * z[i]
    at, accepted, calls = math.inf, 0, 0
    for _ in range(walks):
        a = int(n * rng.random())
        b = int((n - 1) * rng.random())
        b += b >= a
        factor = 1.0 if rng.random() < HOP else scale
        new_norm = 0.0
        for i in range(d):
            new_z[i] = z[i] + factor * (live_z[a, i] - live_z[b, i])
            new_norm += new_z[i] * new_z[i]
        if new_norm > norm and math.log(rng.random()) > 0.5 * (norm - new_norm):
            continue
        for i in range(d):
            new_x[i] = x[i] + factor * (live_x[a, i] - live_x[b, i])
        calls += 1
        there = evaluate(factors, new_x, poses, points, limit)
        if there < limit:
            for i in range(d):
                z[i], x[i] = new_z[i], new_x[i]
            norm, at = new_norm, there
            accepted += 1
    return at, accepted, calls


@compile_once
def _shrink(factors, cholesky, live_z, live_x, walks, dlogz, rng):
    """Replace the worst live point until the others can add no more than dlogz; in place.

    A walk moves z and x = L z side by side. Each walk adds differences of points whose own
    rounding errors came from such differences, so that x - L z would grow exponentially with
    the generations, and the prior and the likelihood would come to see different points. A new
    live point therefore has its x computed afresh.

    Returns
    -------
    (D, d) dead points and (D,) their energies, (n_live,) energies of the live points, calls
    """
    n_live, d = live_z.shape
    poses, points = factors.poses.copy(), factors.points.copy()
    live_e = np.empty(n_live)
    for n in range(n_live):
        live_e[n] = energy_at(factors, live_x[n])
    calls, scale, dead = n_live, 0.5, 0
    out_x, out_e = np.empty((16 * n_live, d)), np.empty(16 * n_live)
    log_z, z, x = -math.inf, np.empty(d), np.empty(d)
    first_shell = math.log(-math.expm1(-1 / n_live))
    while np.logaddexp(0.0, -np.min(live_e) - dead / n_live - log_z) > dlogz:
        worst = np.argmax(live_e)
        limit = live_e[worst]
        if dead == len(out_e):
            more_x, more_e = np.empty((2 * dead, d)), np.empty(2 * dead)
            for n in range(dead):
                more_e[n] = out_e[n]
                for i in range(d):
                    more_x[n, i] = out_x[n, i]
            out_x, out_e = more_x, more_e
        out_e[dead] = limit
        for i in range(d):
            out_x[dead, i] = live_x[worst, i]
        log_z = np.logaddexp(log_z, first_shell - dead / n_live - limit)
        dead += 1
        at = math.inf
        while at == math.inf:
            start = int((n_live - 1) * rng.random())
            start += start >= worst
            for i in range(d):
                z[i], x[i] = live_z[start, i], live_x[start, i]
            at, accepted, called = walk(
                factors, limit, walks, scale, live_z, live_x, z, x, poses, points, rng
            )
            calls += called
            scale *= math.exp((accepted / walks - TARGET_ACCEPTANCE) / d)
            scale = min(max(scale, 1e-4), 1.0)
        live_e[worst] = at
        for i in range(d):
            live_z[worst, i], live_x[worst, i] = z[i], 0.0
            for j in range(i + 1):
                live_x[worst, i] += cholesky[i, j] * z[j]
    return out_x[:dead], out_e[:dead], live_e, calls


def sample(
    factors: Factors,
    cholesky: np.ndarray,
    n_live: int,
    walks: int,
    dlogz: float,
    *,
    rng: np.random.Generator,
) -> WeightedSamples:
    """Nested sampling of the likelihood in `factors` under the prior N(0, L L^T) on xi.

    Parameters
    ----------
    factors : `compiled.Factors` or another tuple that `evaluate` knows
    cholesky : (d, d) lower-triangular L
    n_live, dlogz : as in `settings.SamplerSettings`
    walks : steps of each random walk

    Returns
    -------
    all points of the run as xi, by rising likelihood; the error of log Z is sqrt(H / n_live)

    Source: Skilling, Bayesian Analysis 1 (2006) 833.
    """
    live_z = rng.standard_normal((n_live, len(cholesky)))
    live_x = live_z @ cholesky.T
    dead_x, dead_e, live_e, calls = _shrink(factors, cholesky, live_z, live_x, walks, dlogz, rng)
    order, dead = np.argsort(-live_e), len(dead_e)
    samples, energies = np.concatenate([dead_x, live_x[order]]), np.append(dead_e, live_e[order])
    log_shell = np.full(dead + n_live, -dead / n_live - math.log(n_live))
    log_shell[:dead] = math.log(-math.expm1(-1 / n_live)) - np.arange(dead) / n_live
    log_likelihoods = -energies
    log_weights = log_likelihoods + log_shell
    log_evidence = np.logaddexp.reduce(log_weights)
    weights = np.exp(log_weights - log_evidence)
    information = weights @ log_likelihoods - log_evidence
    error = math.sqrt(max(information, 0.0) / n_live)
    return WeightedSamples(samples, weights, log_likelihoods, float(log_evidence), error, calls)
