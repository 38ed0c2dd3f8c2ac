"""What the sampler's own numbers say: ESS, evidence, mean log weights, bimodality coefficient."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import stats

from sngr_utils.experiments import window_posteriors
from sngr_utils.experiments.window_posteriors import PRIOR_SCALE, Settled, spread_ratio
from sngr_utils.metrics import bimodality, effective_sample_size
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sngr import closure, noop_baseline, windows
from sngr_utils.sngr.baseline import Baseline


def gaussian_factors(precision: np.ndarray) -> compiled.Factors:
    """An exact Gaussian likelihood, exp(-1/2 xi^T A xi), for the compiled samplers.

    Parameters
    ----------
    precision : (d, d) A, d a multiple of three
    """
    d = len(precision)
    return compiled.Factors(
        poses=np.zeros((d // 3, 5)),
        points=np.zeros((0, 2)),
        counts=np.array([d // 3, 0, 0, 0, 0, 0, 0]),
        of=np.zeros((0, 2), dtype=np.uint64),
        measured=np.zeros((0, 8)),
        quadratic=np.array(precision, dtype=float, order="C"),
        linear=np.zeros(0),
        factor=1.0,
    )


def ess_shares(
    base: Baseline,
    which: Sequence[int],
    settings: SamplerSettings,
    scales: Sequence[float] = (1.0, 50.0),
    *,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Flaw 6: ESS shares of windows, and of exact Gaussians with the same two covariances.

    Returns
    -------
    one row per window, prior scale and kind ("window", "Gaussian"): ess_share, log_evidence
    """
    rows = []
    for t in which:
        own = window_posteriors.window_factors(base.solution, t, settings.likelihood_factor)
        keys = windows.window_keys(t)
        conditional = closure.conditional_covariance(
            base.solution.graph, base.solution.estimate, keys
        )
        twin = gaussian_factors(settings.likelihood_factor * np.linalg.inv(conditional))
        for scale in scales:
            chosen = settings.model_copy(update={"prior_scale": scale})
            for kind, factors in (("window", own), ("Gaussian", twin)):
                run = engines.sample_factors(
                    factors, base.covariances[t], chosen, "nested", rng=rng
                )
                rows.append({
                    "window": int(t), "scale": scale, "kind": kind,
                    "ess_share": run.ess_share, "log_evidence": run.log_evidence,
                })  # fmt: skip
    return pd.DataFrame(rows)


def evidence_check(
    settled: Sequence[Settled], walks: int, *, rng: np.random.Generator
) -> pd.DataFrame:
    """Nested sampling of the corrected target against importance sampling, window by window.

    Windows whose importance weights may not be trusted are left out.

    Returns
    -------
    one row per window: difference (nested less importance, [nats]), error (of both together),
    in_errors (their ratio), sd_ratio (nested over importance, geometric mean)
    """
    rows, settings = [], SamplerSettings(n_live=100, min_walks=walks, prior_scale=PRIOR_SCALE)
    for one in settled:
        if one.run is None:
            continue
        factors = one.target.corrected(PRIOR_SCALE)
        run = engines.sample_factors(factors, one.target.covariance, settings, "nested", rng=rng)
        error = np.hypot(run.log_evidence_error, one.run.log_evidence_error)
        difference = run.log_evidence - one.run.log_evidence
        rows.append({
            "window": one.window, "dimension": len(one.cholesky), "difference": difference,
            "error": error, "in_errors": difference / error,
            "sd_ratio": spread_ratio(run.covariance, one.run.covariance),
        })  # fmt: skip
    return pd.DataFrame(rows)


def noop_readings(
    base: Baseline, tau: float, settings: noop_baseline.TriggerOnly, *, rng: np.random.Generator
) -> pd.DataFrame:
    """Flaw 12: what the mean log weight of the no-op sampler may have meant, [nats].

    s is `noop_sigma`. "normalised" has the two densities' determinants, "ratio" only their
    exponents, "target" only the marginal's exponent; "log mean" is log of the mean weight over
    the samples rather than the mean of its log. Heading untouched, or poses one at a time, are
    readings of "N(MAP, s^2 I)"; so are a variance (s^2 = 0.5) or a factor on the exponent.

    Returns
    -------
    one row per triggered window, a column per reading
    """
    rows, streams = [], rng.spawn(len(base.covariances))
    s = settings.noop_sigma
    for t in np.flatnonzero(base.fired(tau)):
        joint = base.covariances[t]
        blocks = [joint[i : i + 3, i : i + 3] for i in (0, 3, 6)]
        planes = [joint[i : i + 2, i : i + 2] for i in (0, 3, 6)]
        plane = np.ix_(*2 * [[0, 1, 3, 4, 6, 7]])
        weights = noop_baseline.noop_log_weights(joint, settings, rng=streams[t])
        expected = noop_baseline.noop_expected_log_weight
        target = -0.5 * s**2 * np.trace(np.linalg.inv(joint))
        flat = -0.5 * s**2 * np.trace(np.linalg.inv(joint[plane]))
        rows.append({
            "window": int(t),
            "normalised, 9 x 9": expected(joint, s),
            "ratio, 9 x 9": target + 0.5 * len(joint),
            "target, 9 x 9": target,
            "normalised, s² = 0.5": expected(joint, s**0.5),
            "normalised, positions of the window": expected(joint[plane], s),
            "target, positions of the window": flat,
            "normalised, poses one by one, summed": sum(expected(b, s) for b in blocks),
            "normalised, mean pose": float(np.mean([expected(b, s) for b in blocks])),
            "normalised, positions one by one, summed": sum(expected(b, s) for b in planes),
            "normalised, mean position": float(np.mean([expected(b, s) for b in planes])),
            "normalised, diagonal only": expected(np.diag(np.diag(joint)), s),
            "log mean weight": float(np.logaddexp.reduce(weights) - np.log(len(weights))),
            "self-normalised, mean log": float(weights.mean() - np.logaddexp.reduce(weights)),
            "largest weight": float(weights.max()),
        })
    return pd.DataFrame(rows)


def bimodality_readings(y: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Flaw 12: the bimodality coefficient of one nested sampling run, by reading.

    Parameters
    ----------
    y : (N,) samples, [m]
    weights : (N,) posterior weights
    """
    coefficient, equal, n = bimodality.bimodality_coefficient, np.ones(len(y)), len(y)
    unbiased = stats.skew(y, bias=False), stats.kurtosis(y, bias=False)
    skewness, kurtosis = _moments(y, weights)
    plain_skewness, plain_kurtosis = _moments(y, equal)
    effective = effective_sample_size.effective_sample_size(weights)
    heavy = weights > 1e-3 * weights.max()
    return {
        "weighted": coefficient(y, weights),
        "unweighted": coefficient(y, equal),
        "unweighted, SAS small-sample": _small_sample(*unbiased, n),
        "weighted, small-sample with the effective n":
            _small_sample(skewness, kurtosis - 3, effective),
        "unweighted, weights above a thousandth": coefficient(y[heavy], equal[heavy]),
        "unweighted, excess kurtosis not put back": (plain_skewness**2 + 1) / (plain_kurtosis - 3),
        "weighted, 1/kurtosis only": 1 / kurtosis,
    }  # fmt: skip


def _moments(y: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Weighted skewness and kurtosis."""
    weights = weights / weights.sum()
    centred = y - weights @ y
    second = weights @ centred**2
    return float(weights @ centred**3 / second**1.5), float(weights @ centred**4 / second**2)


def _small_sample(skewness: float, excess: float, n: float) -> float:
    """SAS's form, (g^2 + 1) / (k + 3 (n-1)^2 / ((n-2)(n-3))), k the excess kurtosis."""
    return float((skewness**2 + 1) / (excess + 3 * (n - 1) ** 2 / ((n - 2) * (n - 3))))
