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
