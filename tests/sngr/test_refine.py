import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy import stats

from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sngr import gate, noop_baseline, refine

FAST = SamplerSettings(n_live=30, dlogz=2.0)


def window(t, pose, accepted=True):
    return refine.RefinedWindow(t, 0.0, accepted, [pose] * 3, run=None)


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


def test_a_window_does_not_depend_on_the_others_or_on_their_order(noisy):
    def refined(which):
        windows = refine.refine_windows(
            noisy.solution, which, noisy.covariances, FAST, gate.Gate(),
            rng=np.random.default_rng(0),
        )  # fmt: skip
        return {w.t: w.run.mean for w in windows}

    alone, both, reversed_order = refined([12]), refined([12, 14]), refined([14, 12])
    assert np.array_equal(alone[12], both[12])
    assert np.array_equal(both[14], reversed_order[14])
    assert np.array_equal(both[12], reversed_order[12])


def test_refined_window_is_what_it_says(noisy):
    (result,) = refine.refine_windows(
        noisy.solution, [12], noisy.covariances, FAST, gate.Gate(),
        rng=np.random.default_rng(0),
    )  # fmt: skip
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


def test_bad_gate_names_the_parameter():
    with pytest.raises(ValueError, match="gate_tolerance"):
        gate.Gate(gate_tolerance=-1.0)
