"""A map from a log of which little is known, and what it says of itself."""

from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.experiments import kinds_of_worlds
from sngr_utils.metrics.alignment import aligned_rmse
from sngr_utils.robust import growing_map
from sngr_utils.world.dead_reckoning import dead_reckoning, relative_motion
from sngr_utils.world.log import NO_LABEL, Log
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate


def a_log(p, n_poses=40, seed=100):
    scenario = Scenario(n_poses=n_poses, n_landmarks=3)
    world = simulate(scenario, p, rng=np.random.default_rng(seed))
    return world, world.log([0.01, 0.01, 0.001])


@pytest.fixture(scope="module")
def right():
    """A log with right labels, its world, and its map."""
    world, log = a_log(0.0)
    return world, log, growing_map.estimate(log)


def rmse(poses, world):
    return aligned_rmse(poses[:, :2], world.poses[:, :2])


def test_a_map_of_right_labels_has_no_doubts_and_beats_dead_reckoning(right):
    world, log, grown = right
    assert grown.doubts == []
    assert grown.unexplained < 0.02
    assert rmse(grown.soft.poses, world) < 0.1  # the sigma of one range
    assert rmse(dead_reckoning(log.x0_mean, log.odometry), world) > 0.15


def test_stretched_ranges_are_found_out(right):
    world, log, grown = right
    stretched = replace(log, ranges=1.1 * log.ranges, scale=(1.0, np.inf))
    again = growing_map.estimate(stretched)
    sigma = np.sqrt(again.noise.estimate.calibration_covariance[0, 0])
    assert abs(again.soft.calibration[0] - 1.1) < 4 * sigma  # 1 in 15,000
    assert sigma < 0.03
    assert rmse(again.soft.poses, world) < 1.5 * rmse(grown.soft.poses, world)


@pytest.mark.parametrize("p", [0.3, None])
def test_wrong_labels_and_none_cost_little(right, p):
    world, log, grown = right
    labels = np.full(len(log.ranges), NO_LABEL) if p is None else a_log(p)[0].label_of
    again = growing_map.estimate(replace(log, label_of=labels))
    assert rmse(again.soft.poses, world) < 1.3 * rmse(grown.soft.poses, world)


def test_each_reason_to_doubt_is_said(right):
    _, log, grown = right
    soft, sound = grown.soft, growing_map._diagnosed(log, grown.soft)
    assert growing_map._doubts(log, soft, [0.0, -0.5], sound) == []
    assert "2 searches" in growing_map._doubts(log, soft, [0.0, -5.0], sound)[0]
    worse = replace(sound, held_out=0.2, held_out_p=1e-3)
    assert "20% of held-out" in growing_map._doubts(log, soft, [0.0, 0.0], worse)[0]
    lost = replace(soft, weights=soft.weights * [1, 0, 1, 1])
    assert "landmarks [1] have hardly" in growing_map._doubts(log, lost, [0.0, 0.0], sound)[0]


@pytest.mark.parametrize("run", [True, False])
def test_wrong_labels_in_a_run_of_poses_may_be_a_slip_that_nobody_asked_about(run):
    """All of six poses, against as many all over the way."""
    world, log = a_log(0.0)
    some = log.pose_of // 6 == 3 if run else np.arange(len(log.ranges)) % 7 == 0
    wrong = np.where(some, (world.source_of + 1) % 3, world.source_of)
    doubts = growing_map.estimate(replace(log, label_of=wrong)).doubts
    assert any("wrong labels" in doubt for doubt in doubts) == run


def test_a_straight_road_has_another_side():
    """Odometry that does not err leaves the mirror image exactly as likely."""
    world, _ = kinds_of_worlds.draw("straight", 0.0, 100)
    exact = replace(world, odometry=relative_motion(world.poses)).log([0.01, 0.01, 0.001])
    assert any("another estimate" in doubt for doubt in growing_map.estimate(exact).doubts)


@pytest.mark.parametrize("changed", [{"odometry": 0.0}, {"ranges": 1.4, "scale": (1.0, np.inf)}])
def test_odometry_that_is_zero_and_a_scale_far_off_are_doubted(changed):
    world = simulate(Scenario(), 0.3, rng=np.random.default_rng(103))
    log = world.log([0.01, 0.01, 0.001])
    found = {name: value * getattr(log, name) for name, value in changed.items() if name != "scale"}
    with np.errstate(all="ignore"):
        assert growing_map.estimate(replace(log, **{**changed, **found})).doubts


def test_a_landmark_seen_from_one_place_is_on_a_ring():
    """The robot stands: wherever the landmark is on the ring, it is as likely elsewhere."""
    n, noise = 25, np.random.default_rng(0).normal(0, 0.05, 25)
    log = Log(
        odometry=np.zeros((n - 1, 3)),
        odometry_covariances=np.diag([0.05, 0.05, 0.01]) ** 2,
        pose_of=np.arange(n),
        ranges=5 + noise,
        range_sigmas=0.1,
        label_of=np.zeros(n),
        n_landmarks=1,
        x0_mean=np.zeros(3),
        x0_sigmas=np.full(3, 0.01),
    )
    assert any("another estimate" in doubt for doubt in growing_map.estimate(log).doubts)


def test_a_log_without_ranges_is_refused():
    _, log = a_log(0.0)
    with pytest.raises(ValueError, match="nothing to estimate"):
        growing_map.estimate(log.keep(np.zeros(len(log.ranges), bool)))


def test_landmarks_are_counted_without_labels():
    _, log = a_log(0.0)
    number, scores = growing_map.count_landmarks(log, 4)
    assert number == 3
    assert scores[2] > max(scores[1], scores[3]) + 3
