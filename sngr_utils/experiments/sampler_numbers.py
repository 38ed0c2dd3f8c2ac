"""What the sampler's own numbers say: ESS, evidence, mean log weights, bimodality coefficient."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from sngr_utils.experiments import window_posteriors
from sngr_utils.experiments.window_posteriors import PRIOR_SCALE, Settled
from sngr_utils.metrics import bimodality
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.weighted_samples import WeightedSamples
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
    one row per window: difference (nested less importance, [nats]), in_errors (in errors of both
    together)
    """
    rows, settings = [], SamplerSettings(n_live=100, min_walks=walks, prior_scale=PRIOR_SCALE)
    for one in settled:
        if one.run is None:
            continue
        factors = one.target.corrected(PRIOR_SCALE)
        run = engines.sample_factors(factors, one.target.covariance, settings, "nested", rng=rng)
        error = np.hypot(run.log_evidence_error, one.run.log_evidence_error)
        difference = run.log_evidence - one.run.log_evidence
        rows.append({"difference": difference, "in_errors": difference / error})
    return pd.DataFrame(rows)


def noop_readings(
    base: Baseline, tau: float, settings: noop_baseline.TriggerOnly, *, rng: np.random.Generator
) -> pd.DataFrame:
    """Flaw 12: what the mean log weight of the no-op sampler may have meant, [nats].

    Of the whole window, of its positions only, or pose by pose; or the log of the mean weight, or
    the largest one, as its authors' code has it.

    Returns
    -------
    one row per triggered window, a column per reading
    """
    rows, streams, s = [], rng.spawn(len(base.covariances)), settings.noop_sigma
    expected = noop_baseline.noop_expected_log_weight
    for t in np.flatnonzero(base.fired(tau)):
        joint = base.covariances[t]
        positions = np.ix_(*2 * [[0, 1, 3, 4, 6, 7]])
        weights = noop_baseline.noop_log_weights(joint, settings, rng=streams[t])
        rows.append({
            "window": int(t),
            "mean log, the window": expected(joint, s),
            "mean log, its positions": expected(joint[positions], s),
            "mean log, a pose of it":
                float(np.mean([expected(joint[i : i + 3, i : i + 3], s) for i in (0, 3, 6)])),
            "log mean": float(np.logaddexp.reduce(weights) - np.log(len(weights))),
            "largest": float(weights.max()),
        })  # fmt: skip
    return pd.DataFrame(rows)


def bimodality_readings(runs: Sequence[WeightedSamples]) -> pd.DataFrame:
    """Flaw 12: the bimodality coefficient of y by reading, one row per run of two anchors."""
    coefficient = bimodality.bimodality_coefficient
    return pd.DataFrame([
        {"weighted": coefficient(run.samples[:, 1], run.weights),
         "unweighted": coefficient(run.samples[:, 1], np.ones(len(run.samples)))}
        for run in runs
    ])  # fmt: skip
