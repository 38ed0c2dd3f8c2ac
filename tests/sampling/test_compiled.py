import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from scipy.special import ndtri

from sngr_utils.numerics.normal import normal_quantile
from sngr_utils.sampling import importance
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.sngr import closure


def random_graph(rng):
    """Four poses, two of them moving, three landmarks, one of them moving, every factor type."""
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel
    for t in range(4):
        values.insert(X(t), gtsam.Pose2(*rng.normal(size=2), rng.uniform(-np.pi, np.pi)))
        sigmas = noise.Diagonal.Sigmas(rng.uniform(0.01, 1, 3))
        pose = gtsam.Pose2(*rng.normal(size=2), rng.uniform(-np.pi, np.pi))
        graph.push_back(gtsam.PriorFactorPose2(X(t), pose, sigmas))
        if t:
            motion = gtsam.Pose2(*rng.normal(size=2), rng.uniform(-np.pi, np.pi))
            graph.push_back(gtsam.BetweenFactorPose2(X(t - 1), X(t), motion, sigmas))
    for k in range(3):
        values.insert(L(k), rng.normal(size=2))
        sigma = noise.Isotropic.Sigma(2, rng.uniform(0.01, 1))
        graph.push_back(gtsam.PriorFactorPoint2(L(k), rng.normal(size=2), sigma))
        if k:
            sigma = noise.Isotropic.Sigma(1, rng.uniform(0.01, 1))
            graph.push_back(gtsam.RangeFactor2(L(k - 1), L(k), rng.uniform(0.1, 4), sigma))
        for t in range(4):
            sigma = noise.Isotropic.Sigma(1, rng.uniform(0.01, 1))
            graph.push_back(gtsam.RangeFactor2D(X(t), L(k), rng.uniform(0.1, 4), sigma))
    return graph, values


@pytest.mark.parametrize("seed", range(8))
def test_errors_are_those_of_gtsam(seed):
    """To 1e-12 relative, poses across +-pi, large residuals; scalar and batched alike."""
    rng = np.random.default_rng(seed)
    graph, values = random_graph(rng)
    keys = [X(1), X(2), L(1)]
    touching = closure.touching_factors(graph, keys)
    likelihood = LocalLikelihood(touching, values, keys, 0.7)
    factors = compiled.flatten(touching, values, keys, 0.7)
    assert factors.dimension == likelihood.dimension == 8
    xis = rng.normal(size=(300, 8)) * rng.choice([1e-3, 0.1, 3.0], size=(300, 1))
    expected = np.array([likelihood(xi) for xi in xis])
    batched = compiled.log_likelihoods(factors, xis)
    assert np.allclose(batched, expected, rtol=1e-12, atol=0)
    assert np.array_equal(batched, [compiled.log_likelihood(factors, xi) for xi in xis])


@pytest.mark.parametrize("seed", range(3))
def test_residuals_are_the_whitened_errors_of_gtsam(seed):
    rng = np.random.default_rng(seed)
    graph, values = random_graph(rng)
    keys = [X(1), X(2), L(1)]
    factors = compiled.flatten(graph, values, keys, 1.0)
    likelihood = LocalLikelihood(graph, values, keys, 1.0)
    xi, out = rng.normal(size=8), np.empty(factors.n_residuals)
    compiled.residuals(factors, xi, factors.poses.copy(), factors.points.copy(), out)
    moved = gtsam.Values(values)
    for key, value in zip(keys, likelihood.variables(xi), strict=True):
        moved.update(key, value)
    theirs = [graph.at(i).whitenedError(moved) for i in range(graph.size())]
    kinds = [type(graph.at(i)) for i in range(graph.size())]
    order = [
        gtsam.BetweenFactorPose2, gtsam.PriorFactorPose2, gtsam.PriorFactorPoint2,
        gtsam.RangeFactor2, gtsam.RangeFactor2D,
    ]  # fmt: skip
    expected = [e for kind in order for k, e in zip(kinds, theirs, strict=True) if k is kind]
    assert np.allclose(out, np.concatenate(expected), rtol=1e-11, atol=1e-11)


def test_a_sum_that_passes_the_limit_stays_above_it():
    """The early end changes no decision."""
    rng = np.random.default_rng(0)
    graph, values = random_graph(rng)
    factors = compiled.flatten(graph, values, [X(1), X(2), L(1)], 0.5)
    poses, points = factors.poses.copy(), factors.points.copy()
    for xi in rng.normal(size=(200, 8)):
        whole = compiled.energy(factors, xi, poses, points, np.inf)
        for limit in (0.3 * whole, 0.999 * whole, 1.001 * whole):
            assert (compiled.energy(factors, xi, poses, points, limit) < limit) == (whole < limit)


def test_the_quadratic_is_added():
    rng = np.random.default_rng(1)
    graph, values = random_graph(rng)
    factors = compiled.flatten(graph, values, [X(1), L(1)], 0.5)
    matrix = rng.normal(size=(5, 5))
    more = factors._replace(quadratic=matrix @ matrix.T)
    for xi in rng.normal(size=(20, 5)):
        extra = compiled.log_likelihood(factors, xi) - compiled.log_likelihood(more, xi)
        assert extra == pytest.approx(0.5 * xi @ more.quadratic @ xi)


def test_the_linear_term_is_added_and_moves_the_mode_as_it_should():
    """With factors that are quadratic in the point, the mode is where the gradients cancel."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(L(0), np.zeros(2))
    sigmas, slope = np.array([0.5, 2.0]), np.array([3.0, -1.0])
    noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
    graph.push_back(gtsam.PriorFactorPoint2(L(0), np.array([0.1, 0.2]), noise))
    factors = compiled.flatten(graph, values, [L(0)], 1.0)
    tilted = factors._replace(linear=slope)
    for xi in np.random.default_rng(0).normal(size=(20, 2)):
        extra = compiled.log_likelihood(factors, xi) - compiled.log_likelihood(tilted, xi)
        assert extra == pytest.approx(slope @ xi)
    covariance = np.array([[1.0, 0.3], [0.3, 0.5]])
    cholesky, nothing = np.linalg.cholesky(covariance), np.zeros((0, 2))
    starts, n = np.ones((3, 2)), tilted.n_residuals
    modes = importance.modes_of_factors(tilted, cholesky, nothing, starts, n)[0]
    precision = np.diag(sigmas**-2) + np.linalg.inv(covariance)
    mode = np.linalg.solve(precision, np.array([0.1, 0.2]) / sigmas**2 - slope)
    assert np.allclose(modes @ cholesky.T, [mode], atol=1e-4)


def test_what_has_no_compiled_form_is_refused():
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose2())
    values.insert(L(0), np.zeros(2))
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel
    bearing = gtsam.BearingFactor2D(X(0), L(0), gtsam.Rot2(0.1), noise.Isotropic.Sigma(1, 0.1))
    graph.push_back(bearing)
    with pytest.raises(ValueError, match="BearingFactor2D"):
        compiled.flatten(graph, values, [X(0)], 1.0)
    huber = noise.Robust.Create(
        noise.mEstimator.Huber.Create(1.345), noise.Isotropic.Sigma(1, 0.1)
    )  # fmt: skip
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(gtsam.RangeFactor2D(X(0), L(0), 1.0, huber))
    with pytest.raises(ValueError, match="Robust"):
        compiled.flatten(graph, values, [X(0)], 1.0)
    with pytest.raises(ValueError, match="poses before points"):
        compiled.flatten(gtsam.NonlinearFactorGraph(), values, [L(0), X(0)], 1.0)


def test_quantile_is_that_of_scipy():
    u = np.concatenate([
        np.random.default_rng(0).random(2000), 10.0 ** -np.arange(1, 300, 7),
        1 - 10.0 ** -np.arange(1, 15),
    ])  # fmt: skip
    ours = np.array([normal_quantile(x) for x in u])
    assert np.allclose(ours, ndtri(u), rtol=1e-13, atol=1e-15)
