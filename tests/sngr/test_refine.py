from functools import partial

import gtsam
import joblib
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy import stats

from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import ENGINES, SamplerSettings
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.slam.solution import poses_of
from sngr_utils.sngr import algorithm, gate, noop_baseline, refine, trigger

FAST = SamplerSettings(n_live=30, dlogz=2.0)


def window(t, pose, accepted=True):
    return refine.RefinedWindow(t, 0.0, accepted, [pose] * 3, run=None)


def test_settings_are_the_papers():
    """1e-3 nats; 500 samples of N(MAP, 0.5^2 I)."""
    assert gate.Gate().gate_tolerance == 1e-3
    assert noop_baseline.TriggerOnly().model_dump() == {"noop_samples": 500, "noop_sigma": 0.5}


def test_gate():
    """Equation "gate": down to the tolerance, inclusive."""
    assert gate.passes_gate(0.0, 1e-3)
    assert gate.passes_gate(-1e-3, 1e-3)
    assert not gate.passes_gate(-1.1e-3, 1e-3)
    assert not gate.passes_gate(float("nan"), 1e-3)


def test_updates_are_applied_together_and_later_windows_win(clean):
    estimate = clean.solution.estimate
    a, b, c = (gtsam.Pose2(k, k, 0.0) for k in (1, 2, 3))
    updated = refine.apply_updates(
        estimate, [window(6, b), window(5, a), window(20, c, accepted=False)]
    )
    for t, pose in ((5, a), (6, b), (7, b), (8, b)):
        assert updated.atPose2(X(t)).equals(pose, 0)
    for t in (4, 9, 20, 21, 22):
        assert updated.atPose2(X(t)).equals(estimate.atPose2(X(t)), 0)


def refined(base, which, sampler=FAST, engine="dynesty"):
    """The windows `which` of the baseline, refined."""
    fires = partial(trigger.regardless, which=which)
    return algorithm.run(
        base.world, PRESETS["B"], fires, refine.Paper(sampler, engine), gate.Gate(), base,
        rng=np.random.default_rng(0),
    ).windows  # fmt: skip


def test_a_window_does_not_depend_on_the_others(noisy):
    alone, both = refined(noisy, [12]), refined(noisy, [12, 14])
    assert [w.t for w in both] == [12, 14]
    assert np.array_equal(alone[0].run.mean, both[0].run.mean)


@pytest.mark.parametrize("engine", ENGINES)
def test_windows_in_parallel_are_those_in_sequence(noisy, engine):
    """Serial, threads, processes: bit by bit the same."""

    def sampled(**config):
        with joblib.parallel_config(**config):
            windows = refined(noisy, [5, 12], SamplerSettings(n_live=20, dlogz=20.0), engine)
        return [window.run.samples for window in windows]

    serial = sampled(n_jobs=1)
    for backend in ("threading", "loky"):
        others = sampled(backend=backend, n_jobs=2)
        assert all(np.array_equal(a, b) for a, b in zip(serial, others, strict=True))


def test_windows_on_a_dask_cluster_are_those_in_sequence(noisy):
    distributed = pytest.importorskip("distributed")

    def sampled():
        return [window.run.samples for window in refined(noisy, [5, 12], FAST, "nested")]

    serial = sampled()
    local = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.Client(processes=False, **local), joblib.parallel_config(backend="dask"):
        there = sampled()
    assert all(np.array_equal(a, b) for a, b in zip(serial, there, strict=True))


def test_refined_window_is_what_it_says(noisy):
    (result,) = refined(noisy, [12])
    likelihood = refine.window_likelihood(noisy.solution, 12, FAST.likelihood_factor)
    gain = likelihood(result.run.mean) - likelihood(np.zeros(9))
    assert result.delta_logp == pytest.approx(gain)
    assert result.accepted == gate.passes_gate(gain, 1e-3)
    for pose, same in zip(result.poses, likelihood.variables(result.run.mean), strict=True):
        assert pose.equals(same, 0)


def test_noop_weights_have_their_closed_form_mean(noisy):
    """Mean of 20 000 log weights at 5 standard errors. Failure probability 6e-7."""
    covariance = noisy.covariances[12]
    settings = noop_baseline.TriggerOnly(noop_samples=20_000)
    weights = noop_baseline.noop_log_weights(covariance, settings, rng=np.random.default_rng(0))
    expected = noop_baseline.noop_expected_log_weight(covariance, 0.5)
    assert abs(weights.mean() - expected) < 5 * weights.std() / np.sqrt(len(weights))
    assert noop_baseline.noop_expected_log_weight(0.25 * np.eye(9), 0.5) == pytest.approx(0)


def test_noop_weights_are_differences_of_normal_densities():
    """The same draws, by SciPy's densities; not at sigma 1/2, where s^2 is s / 2."""
    covariance = np.array([[0.5, 0.1, 0.0], [0.1, 0.3, 0.05], [0.0, 0.05, 0.2]])
    settings = noop_baseline.TriggerOnly(noop_samples=40, noop_sigma=0.3)
    got = noop_baseline.noop_log_weights(covariance, settings, rng=np.random.default_rng(7))
    draws = np.random.default_rng(7).normal(scale=0.3, size=(40, 3))
    target, proposal = stats.multivariate_normal(cov=covariance), stats.norm(scale=0.3)
    assert got == pytest.approx(target.logpdf(draws) - proposal.logpdf(draws).sum(axis=1))
    # minus the divergence of the one from the other, by quadrature of the same formula in 1-d
    x, step = np.linspace(-4, 4, 40_001, retstep=True)
    density = stats.norm.pdf(x, scale=0.3)
    gap = stats.norm.logpdf(x, scale=np.sqrt(0.5)) - np.log(density)
    assert noop_baseline.noop_expected_log_weight(np.array([[0.5]]), 0.3) == pytest.approx(
        np.sum(density * gap) * step
    )


def test_noop_weights_of_the_proposal_itself_are_zero():
    weights = noop_baseline.noop_log_weights(
        0.25 * np.eye(9), noop_baseline.TriggerOnly(), rng=np.random.default_rng(0)
    )
    assert np.allclose(weights, 0)


def test_bad_settings_name_the_parameter():
    with pytest.raises(ValueError, match="gate_tolerance"):
        gate.Gate(gate_tolerance=-1e-9)
    with pytest.raises(ValueError, match="noop_samples"):
        noop_baseline.TriggerOnly(noop_samples=1)
    assert gate.Gate(gate_tolerance=0.0).gate_tolerance == 0
    assert noop_baseline.TriggerOnly(noop_samples=2).noop_samples == 2


def test_algorithm_1_step_by_step(noisy):
    """The whole of it against its steps, from the world alone and from iSAM2's run at hand."""
    tau, conventions = np.sort(noisy.scores)[-3], PRESETS["B"]
    arguments = partial(trigger.triggers, tau=tau), refine.Paper(FAST, "nested"), gate.Gate()
    whole, at_hand = (
        algorithm.run(noisy.world, conventions, *arguments, base, rng=np.random.default_rng(3))
        for base in (None, noisy)
    )
    fired = np.flatnonzero(noisy.fired(tau))
    assert [w.t for w in whole.windows] == [w.t for w in at_hand.windows] == fired.tolist() != []
    streams = np.random.default_rng(3).spawn(len(noisy.scores))
    for t, window in zip(fired, whole.windows, strict=True):
        likelihood = refine.window_likelihood(noisy.solution, t, FAST.likelihood_factor)
        run = engines.sample_window(
            likelihood, noisy.covariances[t], FAST, "nested", rng=streams[t]
        )
        assert np.array_equal(window.run.samples, run.samples)
    updated = refine.apply_updates(noisy.solution.estimate, whole.windows)
    assert np.array_equal(whole.poses, poses_of(updated, noisy.world.n_poses))
    assert np.array_equal(whole.poses, at_hand.poses)
