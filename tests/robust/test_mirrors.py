"""The other sides of a road: where there are second places, and when they count as others."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sngr_utils.experiments import every_world, kinds_of_worlds
from sngr_utils.experiments.online_variants import run_unwarned
from sngr_utils.online.estimator import Settings
from sngr_utils.robust import em, mirrors
from sngr_utils.slam import conventions
from sngr_utils.world import dead_reckoning, scenario, simulation, variations

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
    world, _ = kinds_of_worlds.draw("straight", 0.0, 100)
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
    world, sound = kinds_of_worlds.draw("straight", 0.0, 506)
    rng = np.random.default_rng([506, kinds_of_worlds.STREAM, 1])
    log = world.log(C.x0_sigmas)
    found = run_unwarned(log, C, Settings(), rng=rng)
    assert found.diagnosis.rival < 1
    assert found.diagnosis.doubtful
    missed = every_world.slipped(world, sound)
    at_truth = every_world.informed_em(log, missed, C, (world.poses, world.landmarks))
    assert abs(found.cost - at_truth.cost) < 1


def over_sides(found):
    return mirrors.over_sides(found.poses, mirrors.turned(found), len(found.landmarks))


def test_the_mean_over_sides_is_the_estimate_where_there_is_one_side(best):
    found = over_sides(best)
    assert np.array_equal(found.poses, best.poses)
    assert not found.spread.any()
    assert not found.open.any()


def test_the_mean_over_sides_weighs_each_choice_by_the_root_of_its_odds():
    """Of three choices, by hand: weights 1, 1/2 and 1/4; a heading is averaged across pi."""
    poses = np.zeros((1, 3))
    by = [[0.7, 0.0, 0.0], [0.0, 1.4, 2 * np.pi + 0.7]]
    others = [
        mirrors.Turned(2 * np.log(2.0**n), poses + step, None, np.arange(3) == n)
        for n, step in enumerate(by, 1)
    ]
    found = mirrors.over_sides(poses, others, 3)
    assert np.allclose(found.poses, [[0.2, 0.2, 0.1]])
    assert np.allclose(found.spread, [[0.14 - 0.04, -0.04], [-0.04, 0.28 - 0.04]])
    assert found.open.tolist() == [False, True, True]


def test_a_choice_counts_once_and_as_the_one_that_it_ends_at():
    """Landmark 0 takes landmark 1 along, and landmark 2 falls back: 7 starts, 1 choice."""
    world, _ = kinds_of_worlds.draw("straight", 0.0, 100)
    chain, _ = fit(world, world.log(C.x0_sigmas)).minimum
    here, asked = world.landmarks, np.arange(6) < 3

    def settled(landmarks):
        gone = np.linalg.norm(landmarks - here, axis=1) > 0.1
        there = here + np.where(gone[0], [0.0, 9.0], 0.0) * (np.arange(6) < 2)[:, None]
        return 3.0 + gone[0], world.poses, there

    (other,) = mirrors.choices(chain, world.poses, here, asked, settled)
    assert other.cost == 1.0
    assert other.sides.tolist() == [True, True, False, False, False, False]


def test_of_two_minima_with_the_same_sides_the_better_counts():
    world, _ = kinds_of_worlds.draw("straight", 0.0, 100)
    chain, _ = fit(world, world.log(C.x0_sigmas)).minimum
    here, tried = world.landmarks, []

    def settled(landmarks):
        there = landmarks.copy()
        there[:2] += [0.0, 9.0] if (landmarks != here).any() else 0.0
        tried.append(there)
        cost = {1: 5.0, 2: 7.0}.get(len(tried), 6.0)
        return cost, world.poses, np.vstack([there[:2], here[2:]])

    (other,) = mirrors.choices(chain, world.poses, here, np.arange(6) < 2, settled)
    assert other.cost == 1.0


@pytest.fixture(scope="module")
def truths_rank():
    """Share of the other choices of sides that are likelier than the true one, world by world."""

    def rank(bend, seed):
        rng = np.random.default_rng(seed)
        world = variations.on_a_road(scenario.Scenario(), bend, 0.0, rng=rng)
        found = fit(world, world.log(C.x0_sigmas))
        costs = np.array([one.cost for one in mirrors.turned(found)])
        return np.mean(costs < 0) if len(costs) else 0.0

    return rank


def test_on_a_straight_road_the_true_sides_rank_in_the_middle_on_average(truths_rank):
    """Ranks of 40 worlds, were they uniform, have a mean within .18 of one half but for 1e-4."""
    ranks = np.array([truths_rank(0.0, seed) for seed in range(500, 540)])
    assert abs(ranks.mean() - 0.5) < 0.18
    bent = np.array([truths_rank(0.3, seed) for seed in range(500, 520)])
    assert bent.max() == 0.0


def test_no_landmark_on_a_straight_road_is_called_known():
    """Of development world 104 a side is likelier by more than the 99 to 1 that once sufficed."""
    (row,) = every_world.rows("straight", "C", 0.3, 104)
    assert row["known"] == 0.0
    assert row["filtered"] < 1.15


def test_what_is_read_out_on_a_straight_road_is_the_mean_over_sides():
    """Of development world 137 the likeliest choice errs by twice the oracle's error."""
    (row,) = every_world.rows("straight", "C", 0.0, 137)
    assert row["at_mode"] > 1.8
    assert row["final"] < 0.9 * row["at_mode"]
