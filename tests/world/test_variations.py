"""Bursts, slips and a drawn prior change what they name and nothing else."""

import numpy as np
import pytest

from sngr_utils.world import scenario, simulation, variations


@pytest.fixture(scope="module")
def noisy():
    return simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(1))


def test_a_drawn_prior_follows_its_sigmas_in_the_body_frame(noisy):
    sigmas = [0.1, 0.3, 0.05]
    rng = np.random.default_rng(0)
    means = np.array([variations.draw_x0(noisy, sigmas, rng=rng).x0_mean for _ in range(4000)])
    offset = means - noisy.poses[0]  # it heads along y: its own x is the world's y
    assert noisy.poses[0, 2] == pytest.approx(np.pi / 2)
    # five standard errors of a standard deviation, sigma / sqrt(2 n): fails once in 6e5 runs
    for column, sigma in ((offset[:, 1], 0.1), (offset[:, 0], 0.3), (offset[:, 2], 0.05)):
        assert column.std() == pytest.approx(sigma, abs=5 * sigma / np.sqrt(8000))


def test_a_burst_is_wrong_inside_and_true_outside(noisy):
    starts = set()
    for seed in range(60):
        hit = variations.burst(noisy, 1.0, 4, rng=np.random.default_rng(seed))
        wrong = np.unique(hit.pose_of[hit.label_of != hit.source_of])
        assert len(wrong) == 4
        assert wrong[-1] - wrong[0] == 3
        starts.add(wrong[0])
    assert len(starts) > 15  # of 27 places; 60 uniform draws miss that with chance below 1e-9
    none = variations.burst(noisy, 0.0, 4, rng=np.random.default_rng(0))
    assert np.array_equal(none.label_of, none.source_of)
    assert np.array_equal(none.ranges, noisy.ranges)


def test_a_slip_touches_only_its_steps(noisy):
    slid = variations.slip(noisy, 4, 0.7, rng=np.random.default_rng(3))
    changed = np.flatnonzero((slid.odometry != noisy.odometry).any(axis=1))
    assert len(changed) == 4
    assert changed[-1] - changed[0] == 3
    assert np.array_equal(slid.odometry[:, 2], noisy.odometry[:, 2])
    assert np.array_equal(slid.label_of, noisy.label_of)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda w, rng: variations.burst(w, 1.5, 4, rng=rng), "p is 1.5"),
        (lambda w, rng: variations.burst(w, 0.5, 0, rng=rng), "length is 0"),
        (lambda w, rng: variations.burst(w, 0.5, 31, rng=rng), "length is 31"),
        (lambda w, rng: variations.slip(w, 30, 0.1, rng=rng), "steps is 30"),
        (lambda w, rng: variations.slip(w, 3, -0.1, rng=rng), "sigma is -0.1"),
    ],
)
def test_values_out_of_range_are_named(noisy, call, name):
    with pytest.raises(ValueError, match=name):
        call(noisy, np.random.default_rng(0))


# --- clutter, reach, roads, noise that is misstated -------------------------------------------


def test_clutter_that_is_added_leaves_the_rest_as_it_was(noisy):
    """The count is binomial: 200 worlds give the share to 0.01, six standard errors of it."""
    shares = []
    for seed in range(200):
        more = variations.clutter_added(noisy, 0.2, 10.0, rng=np.random.default_rng(seed))
        sound = more.keep(more.source_of >= 0)
        assert np.array_equal(sound.ranges, noisy.ranges)
        assert np.array_equal(sound.label_of, noisy.label_of)
        assert (np.diff(more.pose_of) >= 0).all()
        shares.append(np.mean(more.source_of < 0))
    assert np.mean(shares) == pytest.approx(0.2, abs=0.01)


def test_clutter_that_replaces_keeps_number_and_labels(noisy):
    hit = variations.clutter_replaced(noisy, 0.3, 100.0, rng=np.random.default_rng(0))
    clutter = hit.source_of < 0
    assert np.array_equal(hit.label_of, noisy.label_of)
    assert np.array_equal(hit.ranges[~clutter], noisy.ranges[~clutter])
    assert 20 < clutter.sum() < 90  # of 180; outside of it once in 1e7
    assert hit.ranges[clutter].max() > 50


def test_ranges_too_long_are_longer_by_less_than_the_most(noisy):
    hit = variations.too_long(noisy, 0.5, 3.0, rng=np.random.default_rng(0))
    extra, clutter = hit.ranges - noisy.ranges, hit.source_of < 0
    assert (extra[~clutter] == 0).all()
    assert 0 < extra[clutter].min() < extra[clutter].max() < 3


def test_a_sensor_sees_no_farther_than_it_reaches(noisy):
    seen = variations.within_reach(noisy, 4.0)
    far = np.linalg.norm(seen.poses[seen.pose_of, :2] - seen.landmarks[seen.source_of], axis=1)
    assert far.max() < 4
    assert 0 < len(seen.ranges) < len(noisy.ranges)


def test_a_jump_misses_one_motion(noisy):
    jumped = variations.jump(noisy, 5.0, 0.5, rng=np.random.default_rng(0))
    missed = jumped.odometry - noisy.odometry
    (at,) = np.flatnonzero(missed.any(axis=1))
    assert np.linalg.norm(missed[at, :2]) == pytest.approx(5)
    assert abs(missed[at, 2]) == pytest.approx(0.5)


def test_misstated_noise_changes_only_what_is_told(noisy):
    told = variations.misstated(noisy, 1.25, 2.0)
    assert told.ranges is noisy.ranges
    assert told.scenario.range_sigma == pytest.approx(0.125)
    assert told.scenario.odometry_sigmas == pytest.approx([0.1, 0.1, 0.02])


@pytest.mark.parametrize("bend", [0.0, np.pi / 2])
def test_a_road_is_driven_once_in_each_direction(bend):
    drawn = variations.on_a_road(scenario.Scenario(), bend, 0.0, rng=np.random.default_rng(0))
    assert drawn.n_poses == 30
    assert drawn.poses[:15, :2] == pytest.approx(drawn.poses[:14:-1, :2])
    turns = np.abs(np.exp(1j * drawn.poses[:15, 2]) + np.exp(1j * drawn.poses[:14:-1, 2]))
    assert turns == pytest.approx(np.zeros(15), abs=1e-12)
    straight = np.linalg.matrix_rank(drawn.poses[:, :2] - drawn.poses[0, :2], tol=1e-9) == 1
    assert straight == (bend == 0)
    steps = np.linalg.norm(np.diff(drawn.poses[:15, :2], axis=0), axis=1)
    assert steps == pytest.approx(2 * np.pi * 5 / 30)
