from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import S
from scipy import optimize

from sngr_utils.robust import graduated_non_convexity, losses, switchable_constraints
from sngr_utils.slam import conventions, landmark_starts, marginals
from sngr_utils.slam.factors import sure_factors
from sngr_utils.slam.solution import values_of
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
    return the_world, start, switchable_constraints.solve(the_world, C, start)


def residuals(the_world, solution):
    offsets = solution.landmarks[the_world.label_of] - solution.poses[the_world.pose_of, :2]
    return (np.linalg.norm(offsets, axis=1) - the_world.ranges) / the_world.scenario.range_sigma


def switches(solution, n):
    return np.array([solution.estimate.atDouble(S(m)) for m in range(n)])


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
    ours = switchable_constraints.solve(the_world, C, start, switch_sigma=1.0)
    loss = losses.solve(the_world, C, "geman_mcclure", start)
    assert np.abs(ours.poses - loss.poses)[:, :2].max() < 1e-3
    assert np.abs(ours.landmarks - loss.landmarks).max() < 1e-3


def test_switches_have_their_closed_form_and_tell_wrong_from_right(solved):
    the_world, _, solution = solved
    found = switches(solution, len(the_world.ranges))
    expected = 1 / (1 + (switchable_constraints.SWITCH_SIGMA * residuals(the_world, solution)) ** 2)
    assert np.abs(found - expected).max() < 1e-3
    right = the_world.label_of == the_world.source_of
    assert np.median(found[right]) > 0.9
    assert np.median(found[~right]) < 0.1


def test_marginals_are_over_the_switches(solved):
    """Integrating a switch out leaves the range with the weight s^3, in closed form."""
    the_world, start, solution = solved
    factors = sure_factors(the_world, C, start[1])
    n_sure = factors.size()
    factors.push_back(losses.range_factors(the_world, start[1], "least_squares"))
    cubes = switches(solution, len(the_world.ranges)) ** 3
    weighted = graduated_non_convexity.reweighted(factors, np.append(np.ones(n_sure), cubes))
    expected = marginals.position_covariances(replace(solution, graph=weighted), "world")
    assert np.allclose(marginals.position_covariances(solution, "world"), expected, rtol=1e-3)


def test_jacobians_are_those_of_finite_differences():
    the_world, (poses, landmarks) = drawn()
    here = np.flatnonzero(the_world.pose_of == 4)
    factor = switchable_constraints.switched_ranges(the_world, 4, here)
    values = values_of(poses, landmarks)
    for m in here:
        values.insert(S(m), 0.7)
    ordering, keys = gtsam.Ordering(), factor.keys()
    for key in keys:
        ordering.push_back(key)
    factors = gtsam.NonlinearFactorGraph()
    factors.push_back(factor)
    ours, _ = factors.linearize(values).jacobian(ordering)
    columns, h = [], 1e-6
    for key in keys:
        for i in range(_dim(key)):
            ends = []
            for sign in (1, -1):
                step = gtsam.VectorValues()
                step.insert(key, sign * h * np.eye(_dim(key))[i])
                ends.append(factor.whitenedError(values.retract(step)))
            columns.append((ends[0] - ends[1]) / (2 * h))
    assert np.allclose(ours, np.array(columns).T, atol=1e-4)


def _dim(key):
    return {"x": 3, "l": 2, "s": 1}[chr(gtsam.Symbol(key).chr())]


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
        switchable_constraints.solve(the_world, C, start, switch_sigma=0)
