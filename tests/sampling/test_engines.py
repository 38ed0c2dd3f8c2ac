"""Every engine against a closed form, dynesty's law, and GTSAM's likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from gtsam.symbol_shorthand import L
from scipy import stats

from sngr_utils import full_sngr
from sngr_utils.sampling import (
    compiled_nested,
    engines,
    importance,
    pareto_k_hat,
)
from sngr_utils.sampling.settings import FastSettings, SamplerSettings
from sngr_utils.sampling.targets import compiled, two_anchors
from sngr_utils.sngr import refine
from sngr_utils.world.two_anchors import TwoAnchors

LONG = SamplerSettings(min_walks=50)
COMPILED = ["nested", "fast"]


def linear_window(rng):
    """A pose prior alone, tight enough to be linear: exact evidence and posterior known.

    Returns factors, covariance of the sampler's prior, log Z, posterior mean and covariance.
    """
    import gtsam
    from gtsam.symbol_shorthand import X

    sigmas = np.array([1e-4, 2e-4, 1e-5])
    shift = rng.normal(size=3) * sigmas
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    values.insert(X(0), gtsam.Pose2(1.0, 2.0, 3.0))
    at = gtsam.Pose2(1.0, 2.0, 3.0).retract(shift)
    graph.push_back(gtsam.PriorFactorPose2(X(0), at, gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    mixing = rng.normal(size=(3, 3)) * sigmas[:, None] * 1.5
    covariance = mixing @ mixing.T + np.diag(sigmas**2)
    factors = compiled.flatten(graph, values, [X(0)], 1.0)
    law = stats.multivariate_normal(np.zeros(3), covariance + np.diag(sigmas**2))
    log_z = law.logpdf(shift) + 0.5 * np.sum(np.log(2 * np.pi * sigmas**2))
    posterior = np.linalg.inv(np.linalg.inv(covariance) + np.diag(sigmas**-2.0))
    return factors, covariance, log_z, posterior @ (shift / sigmas**2), posterior


@pytest.mark.parametrize("engine", COMPILED)
def test_evidence_and_moments_have_their_closed_form(engine):
    """Two-sided at 4.5 standard errors: false alarms in about 1e-5 of correct engines."""
    factors, covariance, log_z, mean, posterior = linear_window(np.random.default_rng(1))
    runs = 60
    streams = np.random.default_rng(2).spawn(runs)
    done = [
        engines.sample_factors(factors, covariance, LONG, engine, rng=stream) for stream in streams
    ]
    errors = np.array([run.log_evidence for run in done]) - log_z
    assert abs(errors.mean()) < 4.5 * errors.std(ddof=1) / np.sqrt(runs) + 0.02
    effective = sum(run.ess_share * len(run.samples) for run in done)
    error = np.mean([run.mean for run in done], axis=0) - mean
    assert np.all(np.abs(error) < 4.5 * np.sqrt(np.diag(posterior) / effective) * 1.5)
    pooled = np.mean([run.covariance for run in done], axis=0)
    ratio = np.exp(np.mean(np.log(np.diag(pooled) / np.diag(posterior))))
    assert 0.93 < ratio < 1.07


def test_compiled_engines_agree_with_each_other_on_a_window(noisy):
    """Mean evidence of 40 runs against 100,000 importance samples, at 4.5 standard errors."""
    likelihood = refine.window_likelihood(noisy.solution, 12, 0.5)
    factors = engines.flattened(likelihood)
    cholesky = np.linalg.cholesky(noisy.covariances[12])
    many = FastSettings(n_draws=100_000)
    truth = importance.sample(factors, cholesky, many, rng=np.random.default_rng(0))
    assert truth.log_evidence_error < 0.003
    runs = 40
    for engine in COMPILED:
        values = np.array([
            engines.sample_factors(
                factors, noisy.covariances[12], LONG, engine, rng=stream
            ).log_evidence
            for stream in np.random.default_rng(3).spawn(runs)
        ])
        error = values.std(ddof=1) / np.sqrt(runs)
        assert abs(values.mean() - truth.log_evidence) < 4.5 * error + 0.05
        if engine == "fast":
            assert np.sqrt(np.mean((values - truth.log_evidence) ** 2)) < 0.03


def two_modes():
    """The bimodal experiment under its wide prior: modes (2, +-sqrt 5), masses one half."""
    scene = TwoAnchors()
    estimate = two_anchors.run_isam2(scene, scene.saddle)
    likelihood = two_anchors.log_likelihood(scene, estimate, 1.0)
    return compiled.flatten(likelihood.factors, estimate, [L(0)], 1.0), 50 * np.eye(2)


def upper_mass(run, at=0.0):
    return float(run.weights[run.samples[:, 1] > at].sum())


def test_k_hat_is_blind_to_a_mode_it_never_saw_and_many_starts_are_not():
    """One start: half the mass is missing, and k-hat is mostly content. 32: 40 of 40 right.

    It objects only when a draw of the heavy tail happens to land near the other mode. A start
    falls in either basin with about equal chance; 32 miss one in 2 in 2^32 runs.
    """
    factors, covariance = two_modes()
    cholesky = np.linalg.cholesky(covariance)
    missed = found = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        off = factors.points.copy()
        off[0, 1] += 0.5  # start off the saddle
        single = FastSettings(n_starts=1)
        one = importance.sample(factors._replace(points=off), cholesky, single, rng=rng)
        mass = one.weights[one.samples[:, 1] > -0.5].sum()
        missed += (min(mass, 1 - mass) < 0.01) and one.diagnostics.k_hat < 0.7
        run = engines.sample_factors(factors, covariance, LONG, "fast", rng=rng)
        found += abs(upper_mass(run) - 0.5) < 0.05
    assert missed >= 30
    assert found == 40


def test_a_ring_is_handed_over_to_nested_sampling():
    """One range: a ring, which no mixture of few modes covers."""
    factors, covariance = two_modes()
    ring = factors._replace(of=factors.of[-1:], measured=factors.measured[-1:],
                            counts=np.array([0, 1, 0, 0, 0, 1, 0]))  # fmt: skip
    run = engines.sample_factors(ring, covariance, LONG, "fast", rng=np.random.default_rng(0))
    assert run.note.startswith("nested sampling: the fast path objects")
    direct = engines.sample_factors(ring, covariance, LONG, "nested", rng=np.random.default_rng(1))
    spread = np.hypot(run.log_evidence_error, direct.log_evidence_error)
    assert abs(run.log_evidence - direct.log_evidence) < 4.5 * spread + 0.1


def test_an_audit_that_disagrees_takes_over(monkeypatch):
    """A fast path whose evidence is wrong by ten nats, audited always."""
    factors, covariance, log_z, _, _ = linear_window(np.random.default_rng(1))
    honest = importance.sample

    def wrong(*arguments, **named):
        draw = honest(*arguments, **named)
        return replace(draw, log_evidence=draw.log_evidence + 10)

    monkeypatch.setattr(importance, "sample", wrong)
    monkeypatch.setattr(engines, "AUDIT_SHARE", 1.0)
    run = engines.sample_factors(factors, covariance, LONG, "fast", rng=np.random.default_rng(0))
    assert "audit" in run.note
    assert abs(run.log_evidence - log_z) < 4.5 * run.log_evidence_error + 0.1


@pytest.mark.parametrize("path", ["audited", "objected", "without a mode"])
def test_calls_of_a_look_that_failed_are_counted(monkeypatch, path):
    """Those of the fast path and of one nested run, whichever of the two is taken."""
    factors, covariance, *_ = linear_window(np.random.default_rng(1))
    honest, nested, made = importance.sample, compiled_nested.sample, []

    def fast(*arguments, **named):
        if path == "without a mode":
            made.append(7)
            raise importance.NoModeError("none", 7)
        draw = honest(*arguments, **named)
        made.append(draw.calls)
        return replace(draw, log_evidence=draw.log_evidence + 10 * (path == "objected"))

    def slow(*arguments, **named):
        run = nested(*arguments, **named)
        made.append(run.calls)
        return run

    monkeypatch.setattr(importance, "sample", fast)
    monkeypatch.setattr(compiled_nested, "sample", slow)
    monkeypatch.setattr(engines, "AUDIT_SHARE", 1.0)
    run = engines.sample_factors(factors, covariance, LONG, "fast", rng=np.random.default_rng(0))
    assert len(made) == 2
    assert run.calls == sum(made)


def test_pareto_shape_of_known_tails():
    """Mean of 40 fits; the shrinkage towards one half is that of the source."""
    rng = np.random.default_rng(0)
    for shape in (0.2, 0.5, 1.0):
        fits = [
            pareto_k_hat.pareto_k_hat(stats.genpareto.rvs(shape, size=5000, random_state=rng))
            for _ in range(40)
        ]
        size = int(3 * np.sqrt(5000))
        expected = (size * shape + 5) / (size + 10)
        assert abs(np.mean(fits) - expected) < 4.5 * np.std(fits) / np.sqrt(40) + 0.03
    assert pareto_k_hat.pareto_k_hat(np.ones(1000)) == -np.inf


def test_engine_is_checked_before_any_work(noisy):
    likelihood = refine.window_likelihood(noisy.solution, 5, 0.5)
    with pytest.raises(ValueError, match="engine"):
        engines.sample_window(
            likelihood, noisy.covariances[5], LONG, "slow", rng=np.random.default_rng(0)
        )


def test_settings_of_the_fast_path_are_checked():
    for name, value in {"n_starts": 0, "n_draws": 5}.items():
        with pytest.raises(ValueError, match=name):
            FastSettings(**{name: value})


def test_nested_samples_are_sorted_and_weights_sum_to_one():
    factors, covariance, *_ = linear_window(np.random.default_rng(1))
    run = compiled_nested.sample(
        factors, np.linalg.cholesky(covariance), 50, 30, 0.5, rng=np.random.default_rng(0)
    )
    assert np.all(np.diff(run.log_likelihoods) >= 0)
    assert run.weights.sum() == pytest.approx(1)
    assert np.allclose(compiled.log_likelihoods(factors, run.samples), run.log_likelihoods)


@pytest.mark.parametrize("engine", COMPILED)
def test_the_full_pipeline_takes_every_engine(engine):
    """Gains of settled windows agree with the reference engine's to the noise of a mean."""
    config = full_sngr.Config(
        p_levels=[0.0], p_diagnosed=0.0, p_noop=0.0, n_live=50, min_walks=50, engine=engine
    )  # fmt: skip
    level = full_sngr.run_level(config, 0.0)
    assert len(level.windows) > 0
    assert np.all(level.gains < 0.01)
    assert np.all(level.gains > -0.2)  # d / 2n for n = 50 is 0.09
    with pytest.raises(ValueError, match="engine"):
        full_sngr.Config(engine="quick")
