"""What a window's posterior is: too narrow, too wide, converged, Gaussian? One table each.

All functions take a `baseline.Baseline`, i.e. one world under one preset, and return one row per
window (or window and setting), so that many worlds are rows of one table.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils.sampling import engines, importance, laplace
from sngr_utils.sampling.importance import modes_of_factors
from sngr_utils.sampling.settings import FastSettings, SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.weighted_samples import WeightedSamples
from sngr_utils.slam import levenberg_marquardt
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import closure, window_posterior, windows
from sngr_utils.sngr.baseline import Baseline

PRIOR_SCALE = 4.0  # of the prior about a settled window, which is divided out again
MORE = (0, 1, 5, 10, 50)  # updates of iSAM2 after the last one
DRAWS = 20_000
# name -> factor on GTSAM's error(), is the prior divided out?
READINGS = {"paper": (0.5, False), "untempered": (1.0, False), "corrected": (1.0, True)}


def spread_ratio(covariance: np.ndarray, reference: np.ndarray) -> float:
    """Geometric mean over the coordinates of the ratio of standard deviations."""
    return float(np.exp(0.5 * np.mean(np.log(np.diag(covariance) / np.diag(reference)))))


def window_factors(solution: Solution, t: int, factor: float) -> compiled.Factors:
    """The compiled likelihood of window w(t), everything else held."""
    keys = windows.window_keys(t)
    return compiled.flatten(
        closure.touching_factors(solution.graph, keys), solution.estimate, keys, factor
    )


def widths(
    base: Baseline, which: Sequence[int], settings: SamplerSettings, *, rng: np.random.Generator
) -> pd.DataFrame:
    """Flaws 1 and 2: how wide the sampled posterior of a window is, against what it might be.

    Returns
    -------
    one row per window and reading of `READINGS`: over_conditional, over_marginal (sampled
    standard deviation over the linearised one, geometric mean of the nine coordinates),
    predicted_conditional (the same for a Gaussian window: precision factor * Lambda +
    Sigma_w^-1 / c, the last term absent if divided out)
    """
    solution, rows = base.solution, []
    for t in which:
        marginal, keys = base.covariances[t], windows.window_keys(t)
        conditional = closure.conditional_covariance(solution.graph, solution.estimate, keys)
        prior = np.linalg.inv(settings.prior_scale * marginal)
        for name, (factor, divided) in READINGS.items():
            factors = window_factors(solution, t, factor)
            if divided:
                factors = factors._replace(quadratic=-prior)
            run = engines.sample_factors(factors, marginal, settings, "nested", rng=rng)
            precision = factor * np.linalg.inv(conditional) + (0 if divided else prior)
            predicted = np.linalg.inv(precision)
            rows.append({
                "window": int(t),
                "reading": name,
                "over_conditional": spread_ratio(run.covariance, conditional),
                "over_marginal": spread_ratio(run.covariance, marginal),
                "predicted_conditional": spread_ratio(predicted, conditional),
            })
    return pd.DataFrame(rows)


def marginal_over_conditional(base: Baseline) -> pd.DataFrame:
    """Flaw 3: standard deviations of the marginal over the conditional, by window.

    Returns
    -------
    one row per window: geometric_mean (of the nine coordinates), largest_direction (the root of
    the largest generalised eigenvalue: the extreme over all directions)
    """
    solution, rows = base.solution, []
    for t, marginal in enumerate(base.covariances):
        keys = windows.window_keys(t)
        conditional = closure.conditional_covariance(solution.graph, solution.estimate, keys)
        lower = np.linalg.inv(np.linalg.cholesky(conditional))
        extremes = np.linalg.eigvalsh(lower @ marginal @ lower.T)
        rows.append({
            "window": t,
            "geometric_mean": spread_ratio(marginal, conditional),
            "largest_direction": float(np.sqrt(extremes[-1])),
        })
    return pd.DataFrame(rows)


def attainable_gain(solution: Solution, t: int, factor: float = 1.0) -> float:
    """Maximum of a window's log-likelihood, all else held, less its value at the estimate, [nats].

    By Levenberg-Marquardt from the estimate: the nearest maximum. Right to about 1e-4.
    """
    factors, keys = window_factors(solution, t, factor), windows.window_keys(t)
    covariance = closure.conditional_covariance(solution.graph, solution.estimate, keys)
    cholesky = np.linalg.cholesky(covariance)
    flat = factors._replace(quadratic=-np.linalg.inv(covariance))  # takes the search's prior back
    rotated = cholesky.T @ flat.quadratic @ cholesky
    modes = modes_of_factors(flat, cholesky, rotated, np.zeros((1, 9)), factors.n_residuals)[0]
    if not len(modes):
        return float("nan")
    reached = compiled.log_likelihood(factors, cholesky @ modes[0])
    return float(reached - compiled.log_likelihood(factors, np.zeros(9)))


def gains(base: Baseline) -> pd.DataFrame:
    """Flaw 4: what windows could gain at the iSAM2 estimate, after more updates, after batch.

    With the paper's factor 1/2 on the sum of GTSAM's error().

    Returns
    -------
    one row per window and base: base (number of extra updates as text, or "batch"), gain
    [nats], fires (at tau 3.9 in the usual estimate), error (of the whole graph, [nats])
    """
    settled = {str(n): levenberg_marquardt.converge(base.solution, "updates", n) for n in MORE}
    settled["batch"] = levenberg_marquardt.converge(base.solution)
    fires, rows = base.fired(3.9), []
    for name, solution in settled.items():
        error = solution.graph.error(solution.estimate)
        rows += [
            {"base": name, "window": t, "fires": bool(fires[t]), "error": error,
             "gain": attainable_gain(solution, t, 0.5)}
            for t in range(len(base.covariances))
        ]  # fmt: skip
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class Settled:
    """The corrected target of a window of the settled estimate, sampled once for all checks.

    Attributes
    ----------
    window : t
    target : of `window_posterior.target`
    cholesky : (d, d) root of the prior N(0, scale * covariance) that is divided out
    gaussian : Laplace's; None where there is none
    run : draws about it; None where their weights may not be trusted
    """

    window: int
    target: window_posterior.Target
    cholesky: np.ndarray
    gaussian: laplace.Laplace | None
    run: WeightedSamples | None


def settled_targets(
    solution: Solution, pieces: list[window_posterior.Piece], covariances: np.ndarray,
    which: Sequence[int], separators: str, *, rng: np.random.Generator,
) -> list[Settled]:  # fmt: skip
    """The targets of some windows and their samples, from a Student t about the Laplace Gaussian.

    Parameters
    ----------
    pieces : of `window_posterior.expand`, the same for both treatments of separators
    covariances : (N, 9, 9) Sigma_w
    separators : "conditional" or "marginal", see `corrected.Corrected`
    """
    found = []
    for t in which:
        aim = window_posterior.target(solution, t, covariances[t], separators, pieces)
        cholesky = np.linalg.cholesky(PRIOR_SCALE * aim.covariance)
        factors = aim.corrected(PRIOR_SCALE)
        one = laplace.laplace_approximation(factors, cholesky, np.zeros(len(cholesky)))
        run = one and laplace.sample_about(one, factors, cholesky, DRAWS, rng=rng)
        found.append(Settled(int(t), aim, cholesky, one, run))
    return found


def gaussianity(settled: Sequence[Settled], *, rng: np.random.Generator) -> pd.DataFrame:
    """Flaw 5: Laplace evidence of a window's posterior against importance sampling.

    Starts drawn from the prior that is divided out look for modes.

    Returns
    -------
    one row per window: difference (importance less Laplace), error (its standard
    error), modes (found by many starts); difference and error NaN where there is no Laplace
    Gaussian or its weights may not be trusted
    """
    rows = []
    for one in settled:
        run, sound = one.run, one.run is not None
        many = importance.sample(
            one.target.corrected(PRIOR_SCALE), one.cholesky, FastSettings(), rng=rng
        )
        rows.append({
            "window": one.window,
            "difference": run.log_evidence - one.gaussian.log_evidence if sound else np.nan,
            "error": run.log_evidence_error if sound else np.nan,
            "modes": many.diagnostics.n_modes,
        })
    return pd.DataFrame(rows)
