"""The posterior over landmarks against enumeration, EM against the oracle, Louis' information."""

import itertools

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy import special

from sngr_utils import association, graph, metrics, robust, world

C = graph.PRESETS["C"]


def enumerated(log_weights):
    """Marginals over all matchings, one by one; the last column may be taken more than once."""
    n, columns = log_weights.shape
    total = np.zeros((n, columns))
    for choice in itertools.product(range(columns), repeat=n):
        taken = [j for j in choice if j < columns - 1]
        if len(set(taken)) == len(taken):
            weight = np.exp(log_weights[np.arange(n), list(choice)].sum())
            total[np.arange(n), list(choice)] += weight
    return total / total.sum(axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("n", "k", "none"), [(1, 3, True), (4, 4, False), (3, 5, True), (5, 3, True)]
)
def test_exclusive_posterior_is_the_sum_over_all_matchings(n, k, none):
    log_weights = 3 * np.random.default_rng(n).normal(size=(n, k + 1))
    if not none:
        log_weights[:, -1] = -np.inf
    found = association.exclusive_posterior(log_weights)
    assert np.allclose(found, enumerated(log_weights), atol=1e-12)
    if n > k:  # somebody must be left over
        assert (1 - found[:, :-1].sum(axis=0) > -1e-12).all()


def test_without_rivals_exclusion_changes_nothing():
    log_weights = np.random.default_rng(0).normal(size=(1, 7))
    alone = association.exclusive_posterior(log_weights)
    assert np.allclose(alone, association.posterior(log_weights))


def test_exclusion_settles_what_two_ranges_leave_open():
    """The second range can only be landmark 0, so the first, torn between two, is landmark 1."""
    log_weights = np.log(np.array([[0.5, 0.5, 1e-300], [1.0, 1e-300, 1e-300]]))
    assert association.posterior(log_weights)[0, 0] == pytest.approx(0.5)
    assert association.exclusive_posterior(log_weights)[0, 1] == pytest.approx(1.0)


def test_too_many_ranges_and_too_many_landmarks_are_refused():
    crowded = np.zeros((3, 3))
    crowded[:, -1] = -np.inf
    with pytest.raises(ValueError, match="no matching"):
        association.exclusive_posterior(crowded)
    with pytest.raises(ValueError, match="n_landmarks is 15"):
        association.exclusive_posterior(np.zeros((1, 16)))
    clean = world.simulate(world.Scenario(), 0.0, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="start is 'truth'"):
        association.estimate(clean, C, "truth", False)


def test_prior_sums_to_one():
    prior = np.exp(association.log_prior(np.array([2, 0]), 4, 0.3))
    assert np.allclose(prior.sum(axis=1), 1)
    assert prior[0, 2] == pytest.approx(0.7)


@pytest.mark.parametrize("exclusive", [False, True])
def test_on_clean_data_em_is_the_oracle(exclusive):
    clean = world.simulate(world.Scenario(), 0.0, rng=np.random.default_rng(101))
    found = association.estimate(clean, C, "grid", exclusive)
    poses, landmarks = robust.estimate(clean, C, "oracle", "grid")
    # the posterior of a right label is below one by less than 1e-2 where circles cross
    assert np.abs(found.poses - poses).max() < 2e-3
    assert np.abs(found.landmarks - landmarks).max() < 5e-3
    assert found.p < 0.01
    marginals = gtsam.Marginals(*_oracle_graph(clean, poses, landmarks))
    for t in (0, 15, 29):
        rotation = gtsam.Rot2(poses[t, 2]).matrix()
        expected = rotation @ marginals.marginalCovariance(X(t))[:2, :2] @ rotation.T
        assert np.allclose(found.position_covariances[t], expected, rtol=0.05)


def _oracle_graph(clean, poses, landmarks):
    factors = robust.sure_factors(clean, C, landmarks)
    factors.push_back(robust.range_factors(clean, landmarks, "least_squares"))
    return factors, robust.values_of(poses, landmarks)


def test_with_wrong_labels_em_stays_near_the_oracle_and_finds_p():
    """Least squares is worse by more than twice on all of these; EM by less than a quarter."""
    for seed in (110, 111, 112):
        wrong = world.simulate(world.Scenario(), 0.3, rng=np.random.default_rng(seed))
        truth = wrong.poses[:, :2]
        ratio = {}
        oracle = metrics.rmse(robust.estimate(wrong, C, "oracle", "grid")[0][:, :2], truth)
        found = association.estimate(wrong, C, "grid", True)
        ratio["em"] = metrics.rmse(found.poses[:, :2], truth) / oracle
        plain = robust.estimate(wrong, C, "least_squares", "grid")[0]
        ratio["plain"] = metrics.rmse(plain[:, :2], truth) / oracle
        assert ratio["em"] < 1.25 < 2 < ratio["plain"]
        drawn_wrong = (wrong.label_of != wrong.source_of).mean()
        # the share drawn is known but for the labels nobody can tell; 180 ranges
        assert found.p == pytest.approx(drawn_wrong, abs=0.05)


def test_what_the_associations_withhold_is_the_curvature_of_the_mixture():
    """Far landmarks, so that a distance is linear: Louis' information is minus the Hessian of the
    log mixture, here of one range that either of two landmarks may have sent."""
    sigma, poses = 0.1, np.array([[0.0, 0.0, 0.3]])
    landmarks = np.array([[1e5, 0.0], [1e5 * np.cos(1.0), 1e5 * np.sin(1.0)]])
    range_ = 1e5 + 0.1
    drawn = world.World(
        poses, landmarks, np.empty((0, 3)), np.zeros(1, int), np.zeros(1, int), np.zeros(1, int),
        np.array([range_]), world.Scenario(range_sigma=sigma), poses[0],
    )  # fmt: skip
    weights = association.responsibilities(drawn, poses, landmarks, 0.4, 1.0, False)
    missing = association._missing_information(drawn, poses, landmarks, np.arange(2), weights)
    unit = landmarks / 1e5

    def log_mixture(x, y):
        """Of the pose shifted by (x, y) in its own frame."""
        cos, sin = np.cos(0.3), np.sin(0.3)
        shift = np.array([cos * x - sin * y, sin * x + cos * y])
        residual = (range_ - (1e5 - unit @ shift)) / sigma
        return special.logsumexp(np.log([0.6, 0.4]) - 0.5 * residual**2)

    rotation = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    jacobian = -unit @ rotation
    complete = (
        sum(w * np.outer(j, j) for w, j in zip(weights[0], jacobian, strict=False)) / sigma**2
    )
    h = 1e-3
    hessian = np.empty((2, 2))
    for i, j in itertools.product(range(2), repeat=2):
        a, b = h * np.eye(2)[i], h * np.eye(2)[j]
        hessian[i, j] = (
            log_mixture(*(a + b)) - log_mixture(*(a - b))
            - log_mixture(*(b - a)) + log_mixture(*(-a - b))
        ) / (4 * h**2)  # fmt: skip
    assert np.allclose(complete - missing[:2, :2], -hessian, rtol=1e-3, atol=0.05)
    assert np.abs(missing[:2, :2]).max() > 10
