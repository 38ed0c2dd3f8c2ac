import dataclasses
from functools import partial
from types import SimpleNamespace

import gtsam
import joblib
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy import stats

from sngr_utils.experiments import (
    isam2_over_worlds,
    sampler_numbers,
    sngr_over_worlds,
    window_posteriors,
)
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.numerics import derivatives
from sngr_utils.sampling import (
    compiled_nested,
    importance,
    laplace,
    settings,
    weighted_samples,
)
from sngr_utils.sampling.targets import compiled, place
from sngr_utils.slam import conventions, levenberg_marquardt, marginals
from sngr_utils.slam.factors import range_factor
from sngr_utils.slam.solution import Solution, poses_of
from sngr_utils.sngr import (
    algorithm,
    baseline,
    closure,
    corrected,
    noop_baseline,
    refine,
    refined_world,
    trigger,
    window_posterior,
    windows,
)
from sngr_utils.sngr.gate import NoiseGate
from sngr_utils.world import scenario

# Noise a hundredth of the paper's: every window is Gaussian to about a thousandth.
QUIET = scenario.Scenario(
    n_poses=8, n_landmarks=4, odometry_sigma_xy=5e-4, odometry_sigma_theta=1e-4, range_sigma=1e-3
)
TIGHT = conventions.Conventions(x0_sigmas=[1e-3, 1e-3, 5e-4], landmark_prior_sigma=5e-3)


@pytest.fixture(scope="module")
def quiet():
    base = baseline.run_baseline(QUIET, TIGHT, 0.0, 0)
    return base, levenberg_marquardt.converge(base.solution)


def linearised_pieces(solution):
    """Every factor as Gauss-Newton and GTSAM have it: without the curvature of the residuals."""
    pieces = []
    for i in range(solution.graph.size()):
        alone, ordering = gtsam.NonlinearFactorGraph(), gtsam.Ordering()
        alone.push_back(solution.graph.at(i))
        keys = sorted(solution.graph.at(i).keys())
        for key in keys:
            ordering.push_back(key)
        hessian, vector = alone.linearize(solution.estimate).hessian(ordering)
        pieces.append(window_posterior.Piece(keys, hessian, -vector))
    return pieces


def test_batch_settles_the_estimate_and_leaves_the_input_alone(noisy):
    before = noisy.solution.graph.error(noisy.solution.estimate)
    linearised = noisy.solution.isam.calculateEstimate()
    batch = levenberg_marquardt.converge(noisy.solution)
    more = levenberg_marquardt.converge(noisy.solution, "updates", 3)
    assert noisy.solution.graph.error(noisy.solution.estimate) == before
    assert noisy.solution.isam.calculateEstimate().equals(linearised, 0)
    assert batch.graph.error(batch.estimate) <= before
    assert np.isfinite(more.poses).all()
    pieces = linearised_pieces(batch)
    keys = list(batch.estimate.keys())
    matrix, slope = window_posterior.eliminated(pieces, keys)
    assert 0.5 * slope @ np.linalg.solve(matrix, slope) < 1e-4  # nats left to gain
    with pytest.raises(ValueError, match="how is"):
        levenberg_marquardt.converge(noisy.solution, "soon")


def test_elimination_gives_gtsams_marginals(noisy):
    pieces = linearised_pieces(noisy.solution)
    for t in (0, 5, 27):
        precision, _ = window_posterior.eliminated(pieces, windows.window_keys(t))
        assert np.allclose(np.linalg.inv(precision), noisy.covariances[t], rtol=1e-6, atol=1e-10)


def test_second_order_is_exact_on_priors_and_close_on_ranges():
    """A range's Hessian: rays n n^T and the circle's curvature (rho - z) / (rho sigma^2)."""
    values, factors = gtsam.Values(), gtsam.NonlinearFactorGraph()
    values.insert(X(0), gtsam.Pose2())
    values.insert(gtsam.symbol("l", 0), np.array([3.0, 4.0]))
    factors.push_back(range_factor(0, 0, 2.0, 0.1))
    solution = Solution(gtsam.ISAM2(), factors, values, 1, 1)
    (piece,) = window_posterior.expand(solution)
    ray = np.array([0.6, 0.8])
    own = 100 * (np.outer(ray, ray) + 3 / 5 * (np.eye(2) - np.outer(ray, ray)))
    assert np.allclose(piece.quadratic[3:, 3:], own, rtol=1e-7)
    assert np.allclose(piece.linear[3:], 100 * 3 * ray, rtol=1e-8)


def test_ends_have_fewer_neighbours(noisy):
    solution = levenberg_marquardt.converge(noisy.solution)
    pieces = window_posterior.expand(solution)
    sizes = [window_posterior.marginal_target(solution, t, pieces).factors for t in (0, 5, 27)]
    assert [int(f.counts[0]) for f in sizes] == [4, 5, 4]
    assert sizes[1].dimension == len(sizes[1].quadratic) <= 27


@pytest.mark.parametrize("separators", ["conditional", "marginal"])
def test_the_corrected_posterior_of_a_quiet_world_is_the_linear_one(quiet, separators):
    """Sampled covariance against the closed form: all variances to 20 %, at an ESS of about 1200
    a five sigma test of each. Failure probability below 1e-4."""
    base, solution = quiet
    t, keys = 3, windows.window_keys(3)
    aim = window_posterior.target(solution, t, base.covariances[t], separators)
    run = corrected.sample_target(aim, 4.0, rng=np.random.default_rng(0))
    if separators == "conditional":
        exact = closure.conditional_covariance(solution.graph, solution.estimate, keys)
    else:
        exact = windows.covariances(solution)[t]
    lower = np.linalg.inv(np.linalg.cholesky(exact))
    whitened = lower @ run.covariance[:9, :9] @ lower.T
    assert np.allclose(np.diag(whitened), 1, atol=0.2)
    d, determinant = len(aim.covariance), np.linalg.slogdet(4.0 * aim.covariance)[1]
    integral = run.log_evidence + 0.5 * (d * np.log(2 * np.pi) + determinant)
    full = exact if separators == "conditional" else aim.covariance
    at_mode = compiled.log_likelihood(aim.factors, np.zeros(d))
    closed = at_mode + 0.5 * (d * np.log(2 * np.pi) + np.linalg.slogdet(full)[1])
    assert integral == pytest.approx(closed, abs=0.2)


def test_the_quadratic_divides_the_prior_out(noisy):
    """Prior times corrected likelihood is the target times a constant, at any point."""
    aim = window_posterior.target(noisy.solution, 12, noisy.covariances[12], "conditional")
    points = np.random.default_rng(0).multivariate_normal(np.zeros(9), aim.covariance, 50)
    prior = -0.5 * np.sum(points * np.linalg.solve(3.0 * aim.covariance, points.T).T, axis=1)
    together = prior + compiled.log_likelihoods(aim.corrected(3.0), points)
    assert np.allclose(together, compiled.log_likelihoods(aim.factors, points), rtol=1e-10)


def test_false_refusals_are_as_many_as_the_gate_says():
    """Noise alone loses chi^2_d / 2n against the exact mode of a Gaussian posterior.

    20 000 Gaussian means at 5 standard errors. Failure probability 6e-7 each."""
    rng = np.random.default_rng(0)
    gate = NoiseGate(gate_tolerance=0.0, gate_sigmas=1.0)
    for d, n in ((9, 40.0), (27, 200.0)):
        losses = 0.5 * rng.chisquare(d, 20_000) / n
        refused = np.mean(losses > gate.slack(d, n))
        expected = stats.chi2.sf(2 * n * gate.slack(d, n), d)
        assert abs(refused - expected) < 5 * np.sqrt(expected * (1 - expected) / 20_000)
    assert stats.chi2.sf(2 * 500 * NoiseGate().slack(9, 500), 9) < 0.01


@pytest.mark.parametrize(("d", "n", "sigmas"), [(9, 500.0, 3.0), (27, 80.0, 0.0), (2, 1.0, 1.5)])
def test_the_gate_forgives_the_mean_loss_and_some_of_its_deviations(d, n, sigmas):
    """The loss of a mean of n samples is chi-square with d degrees of freedom over 2 n."""
    gate = NoiseGate(gate_tolerance=0.01, gate_sigmas=sigmas)
    law = stats.chi2(d, scale=1 / (2 * n))
    assert gate.slack(d, n) == pytest.approx(0.01 + law.mean() + sigmas * law.std())


def test_defaults_and_how_seldom_the_exact_mode_is_refused():
    """Of a Gaussian posterior, by noise alone: once in a hundred windows, or less."""
    assert (corrected.PROPOSAL_SCALE, corrected.LAPLACE_DRAWS) == (4.0, 2000)
    assert NoiseGate().model_dump() == {"gate_tolerance": 1e-3, "gate_sigmas": 3.0}
    with pytest.raises(ValueError, match="gate_sigmas"):
        NoiseGate(gate_sigmas=-1e-9)
    bare = NoiseGate(gate_tolerance=0.0)
    refused = [stats.chi2.sf(2 * 500 * bare.slack(d, 500), d) for d in (9, 27)]
    assert refused == pytest.approx([0.0098, 0.0059], abs=5e-5)


def test_laplace_is_exact_for_a_gaussian():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(9, 9))
    precision, cholesky = root @ root.T + np.eye(9), np.diag(rng.uniform(0.5, 2, 9))
    factors = sampler_numbers.gaussian_factors(precision)
    found = laplace.laplace_approximation(factors, cholesky, rng.normal(size=9))
    covariance = np.linalg.inv(precision + np.diag(np.diag(cholesky) ** -2.0))
    assert np.allclose(found.covariance, covariance, rtol=1e-6, atol=1e-9)
    log_z = 0.5 * np.linalg.slogdet(covariance)[1] - np.log(np.diag(cholesky)).sum()
    assert found.log_evidence == pytest.approx(log_z, abs=1e-6)
    run = laplace.sample(factors, cholesky, 5000, rng=rng)  # five errors: 6e-7
    assert abs(run.log_evidence - log_z) < 5 * run.log_evidence_error
    other = importance.sample(factors, cholesky, settings.FastSettings(), rng=rng)
    assert abs(other.log_evidence - log_z) < 5 * other.log_evidence_error


def test_derivatives_are_exact_for_polynomials_of_fourth_degree():
    """In steps that are neither unit nor orthogonal, at a point that is not the origin."""
    rng = np.random.default_rng(3)
    a, b, c, at = rng.normal(size=(4, 3))
    steps = rng.normal(size=(3, 3))

    def function(x):
        return (x @ a) ** 4 + (x @ b) ** 3 * (x @ c) + (x @ c) ** 2 + x @ a + 7

    x, y, z = at @ a, at @ b, at @ c
    slope = 4 * x**3 * a + 3 * y**2 * z * b + y**3 * c + 2 * z * c + a
    cross = 3 * y**2 * (np.outer(b, c) + np.outer(c, b))
    hessian = 12 * x**2 * np.outer(a, a) + 6 * y * z * np.outer(b, b) + cross + 2 * np.outer(c, c)
    value, first, second = derivatives.derivatives(function, at, steps)
    assert value == pytest.approx(function(at))
    assert first == pytest.approx(steps.T @ slope, rel=1e-9)
    assert second == pytest.approx(-steps.T @ hessian @ steps, rel=1e-8)


def bent():
    """A target that is no Gaussian, its prior, and its log evidence by a grid."""
    anchors, centre = np.array([[0.0, 0.0], [4.0, 0.5]]), np.array([2.0, 2.3])
    one = place.Evidence(anchors, np.full(2, 3.0), np.full(2, 0.3), np.zeros(2), 9.0, centre, 1.0)
    cholesky = np.array([[0.8, 0.0], [0.3, 0.5]])
    axis = np.arange(-4, 4, 0.02)
    xi = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    prior = stats.multivariate_normal(cov=cholesky @ cholesky.T).logpdf(xi)
    density = compiled.log_likelihoods(one.factors, xi) + prior
    log_z = np.logaddexp.reduce(density) + np.log(0.02**2)
    mean = np.exp(density - np.logaddexp.reduce(density)) @ xi
    return one.factors, cholesky, log_z, mean


def test_importance_sampling_about_laplaces_gaussian_corrects_it():
    """Evidence and mean of a bent target within five errors, each 6e-7; the errors scatter so.

    Of 40 runs the standard deviation lies within 5 of its own errors, 1 / sqrt(78), of what the
    runs say of themselves.
    """
    factors, cholesky, log_z, mean = bent()
    runs = [laplace.sample(factors, cholesky, 400, rng=np.random.default_rng(i)) for i in range(40)]
    errors = np.array([run.log_evidence - log_z for run in runs])
    stated = np.array([run.log_evidence_error for run in runs])
    assert abs(errors.mean()) < 5 * stated.mean() / np.sqrt(40) + stated.mean() ** 2
    assert errors.std(ddof=1) == pytest.approx(stated.mean(), rel=5 / np.sqrt(78))
    together = np.mean([run.mean for run in runs], axis=0)
    spread = np.std([run.mean for run in runs], axis=0, ddof=1) / np.sqrt(40)
    assert (np.abs(together - mean) < 5 * spread).all()
    for run in runs:
        assert run.weights.sum() == pytest.approx(1)
        assert run.calls == len(run.samples) == 400
        assert run.log_likelihoods == pytest.approx(compiled.log_likelihoods(factors, run.samples))


def test_weights_with_a_heavy_tail_or_few_effective_draws_are_not_trusted(monkeypatch):
    factors, cholesky, *_ = bent()

    def sampled(k_hat, least):
        monkeypatch.setattr(laplace, "pareto_k_hat", lambda weights: k_hat)
        monkeypatch.setattr(laplace, "MIN_ESS_SHARE", least)
        return laplace.sample(factors, cholesky, 200, rng=np.random.default_rng(0))

    assert laplace.MIN_ESS_SHARE == 0.1
    share = sampled(0.7, 0.1).ess_share
    assert sampled(0.7, share) is not None
    assert sampled(0.7, share + 1e-9) is None
    assert sampled(0.71, 0.1) is None
    assert sampled(np.nan, 0.1) is None


@pytest.mark.parametrize("bend", [-0.5, -0.99, 24.0])
def test_laplace_needs_a_peak_not_a_sharp_one(bend):
    """Likelihoods that flatten the unit prior or sharpen it: precision 1 + bend on every axis."""
    factors = sampler_numbers.gaussian_factors(bend * np.eye(3))
    found = laplace.laplace_approximation(factors, np.eye(3), np.full(3, 0.7))
    assert found.covariance == pytest.approx(np.eye(3) / (1 + bend), abs=1e-6 / (1 + bend))
    assert found.mode == pytest.approx(np.zeros(3), abs=1e-6)
    assert found.log_evidence == pytest.approx(-1.5 * np.log(1 + bend), abs=1e-6)


def test_no_laplace_at_a_saddle():
    factors = sampler_numbers.gaussian_factors(-4 * np.eye(9))
    assert laplace.laplace_approximation(factors, np.eye(9), np.zeros(9)) is None
    assert laplace.sample(factors, np.eye(9), 100, rng=np.random.default_rng(0)) is None


def test_a_target_with_a_saddle_at_the_estimate_is_sampled_about_all_its_modes():
    """Two anchors that both measure 3 m: two places, and iSAM2's estimate between them.

    The reference is a grid of 0.01 m; the evidence lies within five of its own errors (6e-7), and
    either place has half the mass, within five errors of a share at the effective sample size.
    """
    anchors, centre = np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([2.0, 0.0])
    two = place.Evidence(anchors, np.full(2, 3.0), np.full(2, 0.04), np.zeros(2), 9.0, centre, 1.0)
    aim = SimpleNamespace(
        factors=two.factors, covariance=np.eye(2), corrected=lambda scale: two.factors
    )
    assert laplace.sample(two.factors, np.eye(2), 100, rng=np.random.default_rng(0)) is None
    run = corrected.sample_target(aim, 4.0, rng=np.random.default_rng(0))
    axis = np.arange(-6, 6, 0.01)
    xi = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    prior = -0.5 * np.sum(xi**2, axis=1) / 4 - np.log(2 * np.pi * 4)
    density = compiled.log_likelihoods(two.factors, xi) + prior
    log_z = np.logaddexp.reduce(density) + np.log(0.01**2)
    assert 0 < run.log_evidence_error < 0.05
    assert abs(run.log_evidence - log_z) < 5 * run.log_evidence_error
    assert run.weights.sum() == pytest.approx(1)
    effective = run.ess_share * len(run.samples)
    upper = run.weights[run.samples[:, 1] > 0].sum()
    assert abs(upper - 0.5) < 5 * 0.5 / np.sqrt(effective)
    assert np.average(np.abs(run.samples[:, 1]), weights=run.weights) == pytest.approx(
        np.average(np.abs(xi[:, 1]), weights=np.exp(density - density.max())), abs=0.02
    )
    assert len(run.samples) == pytest.approx(20_000, abs=8)  # shared out among the modes
    assert run.calls > len(run.samples)
    likelihoods = compiled.log_likelihoods(two.factors, run.samples[:50])
    assert run.log_likelihoods[:50] == pytest.approx(likelihoods)


def test_objections_to_the_weights_are_noted(monkeypatch):
    diagnostics = importance.Diagnostics(n_modes=8, converged=0.5, k_hat=0.1, ess=1000)
    draw = importance.sample(
        sampler_numbers.gaussian_factors(np.eye(3)), np.eye(3), settings.FastSettings(),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    monkeypatch.setattr(
        importance, "sample", lambda *_, rng: dataclasses.replace(draw, diagnostics=diagnostics)
    )
    factors = sampler_numbers.gaussian_factors(-4 * np.eye(3))  # no peak at the estimate
    aim = SimpleNamespace(covariance=np.eye(3), corrected=lambda scale: factors)
    run = corrected.sample_target(aim, 1.0, rng=None)
    assert run.note == "modes, starts"
    assert run.calls == draw.calls


@pytest.mark.parametrize(("offset", "accepted"), [(-1e-6, True), (1e-6, False)])
def test_the_gate_is_asked_about_the_mean_with_its_effective_samples(noisy, offset, accepted):
    """Two samples of unequal weight; the gate forgives as much as the mean loses, or a bit less."""
    t, solution = 12, noisy.solution
    aim = window_posterior.target(solution, t, noisy.covariances[t], "conditional")
    samples = np.vstack([np.full(9, 0.2), np.full(9, -0.1)])
    run = weighted_samples.WeightedSamples(
        samples, np.array([0.75, 0.25]), np.zeros(2), 0.0, 0.0, 2
    )
    mean = np.full(9, 0.125)
    nothing, there = compiled.log_likelihoods(aim.factors, np.vstack([np.zeros(9), mean]))
    assert there < nothing
    effective = 1 / (0.75**2 + 0.25**2)
    forgiven = nothing - there - offset - (4.5 + 3 * np.sqrt(4.5)) / effective
    gate = NoiseGate(gate_tolerance=forgiven)
    found = refine.judge(solution, t, aim.log_density, run, gate)
    assert (found.t, found.accepted) == (t, accepted)
    assert found.delta_logp == pytest.approx(there - nothing)
    assert found.run is run
    for i, pose in enumerate(found.poses):
        moved = solution.estimate.atPose2(X(t + i)).retract(mean[:3])
        assert pose.equals(moved, 1e-12)


def test_a_windows_result_does_not_depend_on_the_others(quiet):
    base, _ = quiet
    alone, both = (
        algorithm.run(
            base.world, TIGHT, partial(trigger.regardless, which=which),
            corrected.Corrected("marginal"), NoiseGate(), base, rng=np.random.default_rng(0),
        ).windows
        for which in ([4], [4, 3])
    )  # fmt: skip
    assert [window.t for window in both] == [3, 4]
    assert np.array_equal(alone[0].run.samples, both[1].run.samples)
    assert len(both[1].poses) == 3
    assert both[1].run.samples.shape[1] > 9  # with the separators


def test_nothing_is_left_to_gain_after_batch(noisy):
    settled = levenberg_marquardt.converge(noisy.solution)
    assert all(-1e-6 <= window_posteriors.attainable_gain(settled, t) < 5e-3 for t in (0, 9, 20))


def test_corrected_run_moves_only_accepted_windows(noisy):
    run = algorithm.run(
        noisy.world, conventions.PRESETS["B"], partial(trigger.regardless, which=[12, 13]),
        corrected.Corrected("conditional"), NoiseGate(), noisy, rng=np.random.default_rng(0),
    )  # fmt: skip
    assert [window.t for window in run.windows] == [12, 13]
    settled = levenberg_marquardt.converge(noisy.solution)
    assert np.array_equal(run.solution.poses, settled.poses)
    updated = refine.apply_updates(settled.estimate, run.windows)
    assert np.array_equal(run.poses, poses_of(updated, 30))
    assert [w.accepted for w in run.windows] == [True, True]
    assert not np.array_equal(run.poses[12:16], settled.poses[12:16])


def test_a_refined_world_is_judged_before_and_after_with_the_settled_covariances(noisy):
    conventions_b = conventions.PRESETS["B"]
    found = refined_world.refine_world(
        noisy, conventions_b, partial(trigger.regardless, which=[12, 13]),
        corrected.Corrected("conditional"), NoiseGate(), rng=np.random.default_rng(0),
    )  # fmt: skip
    settled, truth = levenberg_marquardt.converge(noisy.solution), noisy.world.poses[:, :2]
    updated = refine.apply_updates(settled.estimate, found.windows)
    before, after = settled.poses[:, :2], poses_of(updated, 30)[:, :2]
    assert found.solution_rmse == rmse_and_nees.rmse(before, truth)
    assert found.pose_rmse == rmse_and_nees.rmse(after, truth) != found.solution_rmse
    covariances = marginals.position_covariances(settled, conventions_b.nees_frame)
    assert found.nees == rmse_and_nees.nees(after - truth, covariances)


@pytest.mark.parametrize("settles", [True, False])
def test_without_windows_the_estimate_stays_as_the_sampling_has_it(noisy, settles):
    """Settled for the corrected algorithm, iSAM2's own for the paper's."""
    sampling = (
        corrected.Corrected("marginal")
        if settles
        else refine.Paper(settings.SamplerSettings(), "nested")
    )
    none = partial(trigger.triggers, tau=np.inf)
    found = refined_world.refine_world(
        noisy, conventions.PRESETS["B"], none, sampling, NoiseGate(), rng=np.random.default_rng(0)
    )
    base = levenberg_marquardt.converge(noisy.solution) if settles else noisy.solution
    assert found.windows == []
    assert np.array_equal(found.solution.poses, base.poses)
    expected = rmse_and_nees.rmse(base.poses[:, :2], noisy.world.poses[:, :2])
    assert found.pose_rmse == found.solution_rmse == pytest.approx(expected)


def test_widths_follow_the_gaussian_prediction(quiet):
    """A run of nine coordinates at an ESS of some 500: 10 % is at least three errors."""
    base, _ = quiet
    table = window_posteriors.widths(
        base, [3], settings.SamplerSettings(min_walks=50), rng=np.random.default_rng(0)
    )
    assert np.allclose(table["over_conditional"], table["predicted_conditional"], rtol=0.1)


def test_readings_of_the_no_op_weights_and_of_the_coefficient(noisy):
    table = sampler_numbers.noop_readings(
        noisy, 3.0, noop_baseline.TriggerOnly(), rng=np.random.default_rng(0)
    )
    assert len(table) == noisy.fired(3.0).sum() > 0
    assert (table["largest"] > table["log mean"]).all()
    two = np.array([[0.0, -1.0], [0.0, 1.0], [0.0, 0.0]])
    weights, zeros = np.array([0.5, 0.5, 0.0]), np.zeros(3)
    run = weighted_samples.WeightedSamples(two, weights, zeros, 0.0, 0.0, 3)
    (readings,) = sampler_numbers.bimodality_readings([run]).to_dict("records")
    assert readings["weighted"] == pytest.approx(1.0)
    assert readings["unweighted"] == pytest.approx(2 / 3)


def test_long_walks_have_no_bias():
    """Evidence of a Gaussian whose prior is no multiple of the identity, so that z and x round
    differently: 12 runs of 400 walks at 5 standard errors of their mean, the sampler's own 0.29
    for one run. Failure probability 6e-7. Rounding once took 0.6 nats from it, 7 errors."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(9, 9))
    covariance = root @ root.T + np.eye(9)
    factors = sampler_numbers.gaussian_factors(15 * np.linalg.inv(covariance))
    cholesky, exact = np.linalg.cholesky(covariance), -0.5 * 9 * np.log(16)
    runs = [
        compiled_nested.sample(factors, cholesky, 100, 400, 0.5, rng=np.random.default_rng(i))
        for i in range(12)
    ]
    mean_error = runs[0].log_evidence_error / np.sqrt(12)
    assert abs(np.mean([run.log_evidence for run in runs]) - exact) < 5 * mean_error


def test_batch_ends_where_gtsams_default_damping_does_not():
    """World 8 under preset A at p = 0.3: lambda underflows with GTSAM's defaults."""
    base = baseline.run_baseline(scenario.Scenario(), conventions.PRESETS["A"], 0.3, 8)
    settled = levenberg_marquardt.converge(base.solution)
    assert settled.graph.error(settled.estimate) < base.solution.graph.error(base.solution.estimate)


def test_sweep_is_the_same_serial_and_parallel():
    refinement = sngr_over_worlds.Refinement({(0.2, 1): ("paper", "conditional")}, tau=3.0)

    def table(jobs):
        return isam2_over_worlds.run_sweep(
            scenario.Scenario(n_poses=8), {"C": conventions.PRESETS["C"]}, [0.2], [0, 1], [3.0],
            jobs, refinement,
        ).refined  # fmt: skip

    serial = table(1)
    with joblib.parallel_config(backend="threading"):
        parallel = table(2)
    assert serial.equals(parallel)
    assert list(serial["variant"]) == ["paper", "conditional"]
    assert (serial["seed"] == 1).all()
    assert (serial["triggered"] > 0).all()
    with pytest.raises(ValueError, match="bold"):
        sngr_over_worlds.Refinement({(0.2, 1): ("bold",)})
