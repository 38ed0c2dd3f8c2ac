from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.metrics import rmse_and_nees
from sngr_utils.robust import fastslam, particles
from sngr_utils.slam import conventions, landmark_starts
from sngr_utils.world import dead_reckoning, scenario, simulation, variations

C = conventions.PRESETS["C"]
SETUP = particles.Setup(np.array([0.05, 0.05, 0.01]), 0.1, 5.0, 8.0, 8, 50.0)


def make(p, seed=100):
    return simulation.simulate(scenario.Scenario(), p, rng=np.random.default_rng(seed))


def run(the_world, seed=0, **settings):
    return fastslam.run(
        the_world, C, fastslam.Settings(**settings), rng=np.random.default_rng([seed, 1])
    )


@pytest.fixture(scope="module")
def runs():
    return {
        p: [(make(p, seed), run(make(p, seed), seed)) for seed in range(100, 104)]
        for p in (0.0, 0.4)
    }


def test_better_than_odometry_with_and_without_wrong_labels(runs):
    """Means over four fixed worlds."""
    for pairs in runs.values():
        ours, blind = [], []
        for the_world, found in pairs:
            truth = the_world.poses[:, :2]
            ours.append(rmse_and_nees.rmse(found.poses[:, :2], truth))
            odometry = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
            blind.append(rmse_and_nees.rmse(odometry[:, :2], truth))
        assert np.mean(ours) < np.mean(blind)


def test_finds_the_landmarks_and_the_share_of_wrong_labels(runs):
    for p, pairs in runs.items():
        for the_world, found in pairs:
            assert rmse_and_nees.rmse(found.mean_landmarks, the_world.landmarks) < 0.6
            assert abs(found.weights @ found.wrong - p) < 0.15


def test_knows_nothing_of_the_truth_and_repeats_itself():
    drawn = make(0.3)
    blind = replace(
        drawn,
        poses=np.full_like(drawn.poses, np.nan),
        landmarks=np.full_like(drawn.landmarks, np.nan),
        source_of=np.full(len(drawn.ranges), -1),
    )
    assert np.array_equal(run(drawn).paths, run(blind).paths)


def test_moving_the_prior_moves_everything_rigidly():
    """Same random numbers, x0 elsewhere: the distances between all places stay."""
    drawn = make(0.2)
    moved = variations.draw_x0(drawn, [3.0, 3.0, 1.0], rng=np.random.default_rng(0))
    places = []
    for the_world in (drawn, moved):
        found = run(the_world)
        places.append(np.vstack([found.poses[:, :2], found.mean_landmarks]))
    gaps = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in places]
    assert np.allclose(*gaps, atol=1e-6)
    assert np.abs(places[0] - places[1]).max() > 0.5


def test_rigid_covariances_are_those_of_a_drawn_prior():
    """J Sigma J^T with J by finite differences of dead reckoning from a moved first pose."""
    drawn, sigmas, h = make(0.0), np.array([0.1, 0.2, 0.05]), 1e-6
    poses = dead_reckoning.dead_reckoning(drawn.x0_mean, drawn.odometry)
    columns = []
    for i in range(3):
        first = dead_reckoning.dead_reckoning(drawn.x0_mean, h * np.eye(3)[i][None])[-1]
        columns.append((dead_reckoning.dead_reckoning(first, drawn.odometry) - poses)[:, :2] / h)
    by_x0 = np.array(columns).transpose(1, 2, 0) * sigmas
    expected = by_x0 @ by_x0.transpose(0, 2, 1)
    assert np.allclose(dead_reckoning.rigid_covariances(poses, list(sigmas)), expected, atol=1e-5)


def test_systematic_resampling_draws_the_expected_number_but_for_rounding():
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(50, 0.3))
    for uniform in (0.0, 0.5, 0.999):
        counts = np.bincount(particles.systematic(weights, uniform), minlength=50)
        assert (np.abs(counts - 50 * weights) < 1 + 1e-9).all()
        assert counts.sum() == 50


def test_crossings_lie_on_both_circles():
    positions, distances = np.array([[0.0, 0.0], [4.0, 0.0]]), np.array([3.0, 3.0])
    found = landmark_starts.crossings(positions, distances)
    assert np.allclose(np.sort(found[:, 1]), [-np.sqrt(5), np.sqrt(5)])
    assert np.allclose(found[:, 0], 2)


@pytest.mark.parametrize(
    ("centre", "distances", "place"),
    [(10.0, (1.0, 2.0), 4.85), (1.0, (5.0, 1.0), 12.5), (0.0, (1.0, 2.0), 0.0)],
    ids=["apart", "nested", "concentric"],
)
def test_circles_that_do_not_meet_have_one_place_of_equal_power(centre, distances, place):
    positions = np.array([[0.0, 0.0], [centre, 0.0]])
    found = landmark_starts.crossings(positions, np.array(distances))
    assert np.allclose(found, [place, 0])
    powers = np.linalg.norm(found[0] - positions, axis=1) ** 2 - np.square(distances)
    assert centre == 0 or powers[0] == pytest.approx(powers[1])


def one_landmark(mean, covariance):
    """A particle at the origin that knows one landmark of two."""
    state = particles.empty(1, 1, 2, 1)
    state.means[0, 0, 0], state.covariances[0, 0, 0], state.shares[0, 0, 0] = mean, covariance, 1
    return state


def test_update_is_the_extended_kalman_filter():
    state = one_landmark([3.0, 4.0], [0.5, 0.1, 0.3])
    particles.update(SETUP, state, 0, 0, 0.0, 0.0, 5.4)
    before, u = np.array([[0.5, 0.1], [0.1, 0.3]]), np.array([0.6, 0.8])
    information = np.linalg.inv(before) + np.outer(u, u) / 0.1**2
    after = np.linalg.inv(information)
    assert np.allclose(state.means[0, 0, 0], [3, 4] + after @ u * 0.4 / 0.1**2)
    assert np.allclose(state.covariances[0, 0, 0], [after[0, 0], after[0, 1], after[1, 1]])


def test_a_range_is_credited_by_its_posterior():
    """Label 1 is unknown yet and uniform; landmark 0 is as likely in 4000 draws as Bayes says.

    5 standard errors: a false alarm in 6e-7 of runs.
    """
    state, started = one_landmark([3.0, 4.0], [1e-9, 0, 1e-9]), np.array([True, False])
    likelihood = np.exp(-0.5 * 2.5**2) / (np.sqrt(2 * np.pi) * 0.1)
    chances = 0.5 * likelihood, 0.5 / 8.0
    rng, hits, n = np.random.default_rng(1), 0, 4000
    for _ in range(n):
        state.counts[:], state.log_weights[:] = 0, 0
        state.means[0, 0, 0] = 3.0, 4.0
        particles.credit(SETUP, state, started, 0, 0, 1, 5.25, rng)
        hits += state.counts[0, 1]
    expected = chances[0] / sum(chances)
    assert state.log_weights[0] == pytest.approx(np.log(sum(chances)), abs=1e-6)
    assert abs(hits / n - expected) < 5 * np.sqrt(expected * (1 - expected) / n)


def test_a_landmark_starts_at_its_place_and_its_mirror_image_with_equal_shares():
    """Poses on a line cannot tell the two apart; two ranges of twelve are wrong."""
    positions = np.column_stack([np.linspace(0, 5, 12), np.zeros(12)])
    distances = np.linalg.norm(positions - [2.0, 2.5], axis=1)
    distances[[3, 8]] += 2.0
    state = particles.empty(1, 12, 1, 2)
    state.paths[0, :, :2] = positions
    particles.start(SETUP, state, 0, 0, np.arange(12), distances)
    found = state.means[0, 0][np.argsort(state.means[0, 0, :, 1])]
    assert np.allclose(found, [[2.0, -2.5], [2.0, 2.5]], atol=0.02)
    assert np.allclose(state.shares[0, 0], 0.5, atol=0.02)


@pytest.mark.parametrize(
    ("name", "value"),
    [("n_particles", 1), ("start_after", 2), ("n_hypotheses", 0), ("resample_below", 1.5)],
)
def test_bad_settings_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        fastslam.Settings(**{name: value})
