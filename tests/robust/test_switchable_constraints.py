import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, S, X
from scipy import optimize

from sngr_utils.robust import losses, switchable_constraints
from sngr_utils.slam import conventions, landmark_starts, marginals
from sngr_utils.slam.factors import sure_factors
from sngr_utils.slam.solution import Solution, values_of
from sngr_utils.world import dead_reckoning, scenario, simulation

C = conventions.PRESETS["C"]


def drawn(p=0.3, seed=100):
    the_world = simulation.simulate(scenario.Scenario(), p, rng=np.random.default_rng(seed))
    blind = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
    return the_world, (
        blind,
        landmark_starts.start_landmarks(the_world.log(C.x0_sigmas), blind, "grid"),
    )


@pytest.fixture(scope="module")
def solved():
    the_world, start = drawn()
    return the_world, start, *switchable_constraints.solve(the_world.log(C.x0_sigmas), C, start)


def residuals(the_world, found):
    offsets = found.landmarks[the_world.label_of] - found.poses[the_world.pose_of, :2]
    return (np.linalg.norm(offsets, axis=1) - the_world.ranges) / the_world.scenario.range_sigma


@pytest.mark.parametrize("sigma", [1.0, 0.25])
def test_eliminating_the_switch_leaves_geman_mcclure(sigma):
    """min over s of (s r)^2 / 2 + (s - 1)^2 / (2 sigma^2) is GTSAM's loss with c = 1 / sigma."""
    loss = gtsam.noiseModel.mEstimator.GemanMcClure.Create(1 / sigma)
    for r in (0.1, 1.0, 3.0, 20.0):
        cost = lambda s, r=r: 0.5 * (s * r) ** 2 + 0.5 * ((s - 1) / sigma) ** 2  # noqa: E731
        best = optimize.minimize_scalar(cost, bounds=(0, 1), method="bounded")
        assert best.fun == pytest.approx(loss.loss(r), rel=1e-6)
        assert best.x == pytest.approx(1 / (1 + (sigma * r) ** 2), abs=1e-4)


@pytest.mark.parametrize("p", [0.0, 0.3])
def test_with_the_authors_sigma_it_is_the_geman_mcclure_estimate(p):
    the_world, start = drawn(p)
    log = the_world.log(C.x0_sigmas)
    ours, _ = switchable_constraints.solve(log, C, start, switch_sigma=1.0)
    loss = losses.solve(log, C, "geman_mcclure", start)
    assert np.array_equal(ours.poses, loss.poses)
    assert np.array_equal(ours.landmarks, loss.landmarks)


def test_switches_have_their_closed_form_and_tell_wrong_from_right(solved):
    the_world, _, found, switches = solved
    whitened = residuals(the_world, found)
    expected = 1 / (1 + (switchable_constraints.SWITCH_SIGMA * whitened) ** 2)
    assert np.allclose(switches, expected, rtol=0, atol=1e-9)
    right = the_world.label_of == the_world.source_of
    assert np.median(switches[right]) > 0.9
    assert np.median(switches[~right]) < 0.1


def test_poses_landmarks_and_switches_are_together_at_the_minimum_of_gtsams_graph(solved):
    """With a switch as a variable, in a factor of its own: no descent from where we end; and
    the marginals of the poses, over the switches, are ours."""
    the_world, start, found, switches = solved
    factors, values = sure_factors(the_world, C, start[1]), values_of(found.poses, found.landmarks)
    noise = gtsam.noiseModel.Isotropic.Sigma(1, the_world.scenario.range_sigma)
    prior = gtsam.noiseModel.Isotropic.Sigma(1, switchable_constraints.SWITCH_SIGMA)
    for m, switch in enumerate(switches):
        t, k = int(the_world.pose_of[m]), int(the_world.label_of[m])
        inner = gtsam.RangeFactor2D(X(t), L(k), the_world.ranges[m], noise)
        keys, plain = [X(t), L(k), S(m)], gtsam.noiseModel.Unit.Create(1)
        factors.push_back(gtsam.CustomFactor(plain, keys, switched(inner)))
        factors.push_back(gtsam.PriorFactorDouble(S(m), 1.0, prior))
        values.insert(S(m), switch)
    gradient = factors.linearize(values).gradientAtZero()
    scale = np.sqrt(np.diagonal(factors.linearize(values).hessian()[0])).max()
    assert np.abs(gradient.vector()).max() < 1e-3 * scale
    expected = marginals.position_covariances(Solution(None, factors, values, 30, 6), "world")
    assert np.allclose(found.position_covariances, expected, rtol=1e-3)


def switched(inner):
    """Whitened residual of a range times its switch, with the derivatives GTSAM asks for."""

    def error(this, values, jacobians):
        switch, residual = values.atDouble(this.keys()[2]), inner.whitenedError(values)
        if jacobians is not None:
            by_both, _ = inner.linearize(values).jacobian()
            jacobians[0] = np.asfortranarray(switch * by_both[:, :3])
            jacobians[1] = np.asfortranarray(switch * by_both[:, 3:])
            jacobians[2] = np.array([residual])
        return switch * residual

    return error


def test_its_constant_is_as_efficient_as_the_others():
    """Against a location estimate of 4000 Gaussian samples of 50: 0.95 within 5 errors of 0.6 %.

    Variances of the mean and of the M-estimate from the same samples; the ratio of two strongly
    correlated variances has a relative error near sqrt(4 (1 - 0.95) / 4000) = 0.7 %.
    """
    sample = np.random.default_rng(5).standard_normal((4000, 50))
    place = sample.mean(axis=1)
    for _ in range(50):
        weights = (
            1 + (switchable_constraints.SWITCH_SIGMA * (sample - place[:, None])) ** 2
        ) ** -2.0
        place = (weights * sample).sum(axis=1) / weights.sum(axis=1)
    efficiency = sample.mean(axis=1).var() / place.var()
    assert efficiency == pytest.approx(0.95, abs=0.035)


def test_bad_sigma_is_named():
    the_world, start = drawn()
    with pytest.raises(ValueError, match="switch_sigma is 0"):
        switchable_constraints.solve(the_world.log(C.x0_sigmas), C, start, switch_sigma=0)
