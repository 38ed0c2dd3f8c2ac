"""The other sides of a road: where there are second places, and when they count as others."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sngr_utils.experiments import every_world
from sngr_utils.experiments.online_variants import run_unwarned
from sngr_utils.online.estimator import Settings
from sngr_utils.robust import em, mirrors
from sngr_utils.slam import conventions
from sngr_utils.world import dead_reckoning, scenario, simulation

C = conventions.PRESETS["C"]


def fit(world, log, start=None):
    start = start or (world.poses, world.landmarks)
    loose = C.model_copy(update={"landmark_prior_sigma": 100.0})
    return em.fit(log, loose, start, exclusive=True, clutter=True, widest=1.0)


@pytest.fixture(scope="module")
def best():
    world = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))
    return fit(world, world.log(C.x0_sigmas))


@pytest.fixture(scope="module")
def road():
    """A straight road, and its log with odometry that does not err."""
    world, _ = every_world.draw("straight", 0.0, 100)
    exact = dead_reckoning.relative_motion(world.poses)
    return world, replace(world, odometry=exact).log(C.x0_sigmas)


def test_a_circle_has_no_second_place(best):
    assert mirrors.turned(best) == []
    assert mirrors.rivals(best, None) == []


def test_on_a_straight_road_all_choices_of_sides_are_alike(road):
    """But for what the noise of the ranges bends: of 64 the one that is all mirrored costs 0."""
    world, log = road
    found = fit(world, log)
    choices = mirrors.turned(found)
    assert len(choices) == 2**world.n_landmarks - 1
    mirrored = found.landmarks * [1, -1]
    (other,) = [one for one in choices if np.abs(one.landmarks - mirrored).max() < 0.1]
    assert other.cost == pytest.approx(0.0, abs=0.05)
    again = mirrors.rivals(found, lambda *start: fit(world, log, start))
    assert 1 <= len(again) <= 2 * mirrors.BEST
    assert all(mirrors.elsewhere(found, one).any() for one in again)


def test_estimates_differ_by_what_their_covariance_says_or_in_a_landmark(best):
    sure = np.ones(6, dtype=bool)
    other = partial(replace, best)
    metre = np.array([1.0, 0.0, 0.0])
    assert not mirrors.differ(best, other(poses=best.poses + 0.001 * metre), sure)
    assert mirrors.differ(best, other(poses=best.poses + metre), sure)
    elsewhere, absent = best.landmarks.copy(), best.landmarks.copy()
    elsewhere[3] += 0.6
    absent[3] = np.nan
    for places in (elsewhere, absent):
        assert mirrors.differ(best, other(landmarks=places), sure)
        assert not mirrors.differ(best, other(landmarks=places), np.arange(6) != 3)


def test_a_path_that_moves_by_more_than_its_shape_is_known_is_another(best):
    """A turn about the first pose is within what its prior allows, and not of the rest."""
    by = np.column_stack([-best.poses[:, 1], best.poses[:, 0], np.zeros(len(best.poses))])
    by = 0.03 * (by - by[0])
    assert best.moved(2 * by) == pytest.approx(2 * best.moved(by))
    moved = by[:, :2]
    squared = np.einsum("ti,tij,tj->t", moved, np.linalg.inv(best.position_covariances), moved)
    assert squared.mean() < 2
    assert best.moved(by) > 1
    assert mirrors.differ(best, replace(best, poses=best.poses + by), np.zeros(6, dtype=bool))


def test_a_road_whose_mirror_image_is_as_likely_is_doubted():
    """The path is lost, and was found without a doubt: only all sides together show another."""
    world, sound = every_world.draw("straight", 0.0, 506)
    rng = np.random.default_rng([506, every_world.STREAM, 1])
    found = run_unwarned(world.log(C.x0_sigmas), C, Settings(), rng=rng)
    assert found.diagnosis.rival < 1
    assert found.diagnosis.doubtful
    at_truth = every_world.by_em(world, sound, C, (world.poses, world.landmarks))
    assert abs(found.cost - at_truth.cost) < 1


def test_the_mean_over_sides_is_the_estimate_where_there_is_one_side(best):
    poses, covariances = mirrors.mean_over_sides(best)
    assert np.array_equal(poses, best.poses)
    assert np.array_equal(covariances, best.position_covariances)


def test_the_mean_over_sides_weighs_each_choice_by_its_likelihood(road, monkeypatch):
    """Of three choices, by hand: weights 1, 1/2 and 1/4; a heading is averaged across pi."""
    world, log = road
    found = fit(world, log)
    by = [[0.7, 0.0, 0.0], [0.0, 1.4, 2 * np.pi + 0.7]]
    choices = [
        mirrors.Turned(np.log(2.0**n), found.poses + step, found.landmarks)
        for n, step in enumerate(by, 1)
    ]
    monkeypatch.setattr(mirrors, "turned", lambda found: choices)
    poses, covariances = mirrors.mean_over_sides(found)
    assert np.allclose(poses - found.poses, [0.2, 0.2, 0.1])
    spread = np.array([[0.14 - 0.04, -0.04], [-0.04, 0.28 - 0.04]])
    assert np.allclose(covariances - found.position_covariances, spread)


def test_what_is_read_out_on_a_straight_road_is_the_mean_over_sides():
    """Of development world 137 the likeliest choice errs by twice the oracle's error."""
    (row,) = every_world.rows("straight", "C", 0.0, 137)
    assert row["at_mode"] > 1.8
    assert row["final"] < 0.9 * row["at_mode"]
