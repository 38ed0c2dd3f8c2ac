"""Three engines for the same window posterior, behind one call.

dynesty is the reference; the others are tested against it, and against GTSAM's factors.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from sngr_utils.sampling import compiled_nested, importance
from sngr_utils.sampling.dynesty_nested import run_nested
from sngr_utils.sampling.prior_transform import prior_transform
from sngr_utils.sampling.settings import EngineChoice, FastSettings, SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.sampling.weighted_samples import WeightedSamples

ENOUGH_WALKS = 50  # steps at which the evidence has no bias that we can measure
AUDIT_SHARE = 0.02  # of the windows, drawn at random, that nested sampling checks
AUDIT_ERRORS = 4.0  # standard errors between two evidences that end the trust in the fast path


def sample_window(
    likelihood: LocalLikelihood,
    covariance: np.ndarray,
    settings: SamplerSettings,
    engine: str = "dynesty",
    *,
    rng: np.random.Generator,
) -> WeightedSamples:
    """Sample the posterior of a few variables under N(MAP, c Sigma), see `prior_transform`.

    Parameters
    ----------
    likelihood : of the d numbers that move
    covariance : (d, d) Sigma
    engine : see `EngineChoice`

    Raises
    ------
    ValueError : unknown engine, or a factor that has no compiled form
    numpy.linalg.LinAlgError : covariance not positive definite
    """
    EngineChoice(engine=engine)
    if engine == "dynesty":
        transform = prior_transform(covariance, settings.prior_scale)
        return run_nested(likelihood, transform, likelihood.dimension, settings, rng=rng)
    return sample_factors(flattened(likelihood), covariance, settings, engine, rng=rng)


def flattened(likelihood: LocalLikelihood) -> compiled.Factors:
    """A likelihood of GTSAM's factors as the arrays that the compiled engines read."""
    return compiled.flatten(
        likelihood.factors, likelihood.estimate, likelihood.keys, likelihood.factor
    )


def sample_factors(
    factors: compiled.Factors,
    covariance: np.ndarray,
    settings: SamplerSettings,
    engine: str,
    *,
    rng: np.random.Generator,
) -> WeightedSamples:
    """`sample_window` from flattened factors, for the two compiled engines."""
    cholesky = np.linalg.cholesky(settings.prior_scale * covariance)
    if engine == "fast":
        return _fast(factors, cholesky, settings, rng)
    walks = settings.walks(len(cholesky))
    return compiled_nested.sample(
        factors, cholesky, settings.n_live, walks, settings.dlogz, rng=rng
    )


def _fast(
    factors: compiled.Factors,
    cholesky: np.ndarray,
    settings: SamplerSettings,
    rng: np.random.Generator,
) -> WeightedSamples:
    """The fast path where it may be trusted, else the compiled nested sampler; calls of both."""
    checked, walks = None, max(ENOUGH_WALKS, settings.walks(len(cholesky)))
    nested = partial(
        compiled_nested.sample, factors, cholesky, settings.n_live, walks, settings.dlogz, rng=rng
    )
    try:
        draw = importance.sample(factors, cholesky, FastSettings(), rng=rng)
        calls, objections = draw.calls, draw.diagnostics.objections
    except importance.NoModeError as error:
        calls, objections = error.calls, ["starts"]
    if not objections and rng.random() < AUDIT_SHARE:
        checked = nested()
        spread = np.hypot(draw.log_evidence_error, checked.log_evidence_error)
        if abs(draw.log_evidence - checked.log_evidence) > AUDIT_ERRORS * spread:
            objections = ["audit"]
    if objections:
        note = "nested sampling: the fast path objects to its " + ", ".join(objections)
        found = nested() if checked is None else checked
        return replace(found, calls=calls + found.calls, note=note)
    if checked is None:
        return draw
    return replace(draw, calls=calls + checked.calls, note="audited")
