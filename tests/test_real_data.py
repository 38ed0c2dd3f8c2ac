"""Notebook 10: its algorithms from scratch, short looks at a set, and what its studies say."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from helpers import cells_from_scratch

from sngr_utils import real_data
from sngr_utils.experiments import real_data as real_experiments
from sngr_utils.experiments import real_online, real_peers, real_stretch
from sngr_utils.metrics import alignment
from sngr_utils.publish import report
from sngr_utils.show import real_data as show
from sngr_utils.world import simulation
from sngr_utils.world.dead_reckoning import relative_motion
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.truth import Truth

pytestmark = pytest.mark.usefixtures("house_style")

BATCH, ONLINE = real_data.study("plaza"), real_data.study("plaza_online")
OURS = BATCH[BATCH["method"] == "growing_map"]
LABELLED = OURS[OURS["kind"] == "labels"]


@pytest.fixture(scope="module")
def lesson():
    """What the cells that are tagged "from-scratch" define."""
    return cells_from_scratch("10_real_data")


@pytest.fixture(scope="module")
def small():
    """A small world with four landmarks and right labels, and its log."""
    scenario = Scenario(n_poses=30, n_landmarks=4)
    world = simulation.simulate(scenario, 0.0, rng=np.random.default_rng(100))
    return world, world.log([0.01, 0.01, 0.001])


def test_alignment_from_scratch_is_the_librarys_and_takes_out_a_rigid_motion(lesson):
    rng = np.random.default_rng(100)
    truth, angle = rng.normal(size=(40, 2)), 2.0
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    path = truth @ turn.T + [5.0, -3.0]
    assert lesson["aligned_rmse"](path, truth) < 1e-12
    mirrored = path * [1, -1]
    assert lesson["aligned_rmse"](mirrored, truth) > 0.5
    noisy = path + 0.1 * rng.normal(size=path.shape)
    errors = alignment.aligned_errors(noisy, truth)
    np.testing.assert_allclose(lesson["align"](noisy, truth) - truth, errors, atol=1e-12)


def test_radios_without_names_are_found_from_scratch(lesson, small):
    world, log = small
    known = replace(log, odometry=relative_motion(world.poses))
    rng = np.random.default_rng(100)
    maps = real_stretch.maps_without_labels(known, 30, 20, lesson["find_radios"], rng=rng)
    radios, chances, height = maps[0]
    apart = np.linalg.norm(radios[:, None] - world.landmarks, axis=2)
    assert apart.min(axis=0).max() < 0.15  # of sigma .1 m
    named = apart.argmin(axis=1)[chances.argmax(axis=1)]
    assert np.mean(named == world.source_of) > 0.9
    assert height == max(other for *_, other in maps)


@pytest.fixture(scope="module")
def maps(lesson):
    """What the lesson's EM makes of the first n poses of a drive, from its own starts."""
    logs = {name: real_data.calibrated(name) for name in real_data.OTHER}
    find, config = lesson["find_radios"], real_data.Config()

    def of(name, n):
        rng = np.random.default_rng([config.seed, n])
        return real_stretch.maps_without_labels(logs[name], n, config.n_starts, find, rng=rng)

    return of


def test_five_starts_of_forty_end_in_the_likeliest_map(maps):
    heights = np.array([height for *_, height in maps("Plaza1", 240)])
    assert (np.sum(heights > heights[0] - 1), len(heights)) == (5, 40)


def test_its_radios_stand_where_they_were_surveyed(maps):
    radios, surveyed = maps("Plaza1", 240)[0][0], real_data.recording("Plaza1").truth.landmarks
    apart = np.linalg.norm(radios[:, None] - surveyed, axis=2)
    assert sorted(apart.argmin(axis=1)) == [0, 1, 2, 3]
    assert apart.min(axis=1).max() < 2  # m, of a field of seventy


@pytest.mark.parametrize("name", real_data.OTHER)
def test_after_80_poses_the_likeliest_map_has_a_rival_as_good_and_after_160_none(maps, name):
    assert real_stretch.runner_up(maps(name, 80)) < 0.1
    assert real_stretch.runner_up(maps(name, 160)) > 100


def test_a_map_with_its_radios_in_another_order_is_no_rival():
    rng = np.random.default_rng(100)
    radios, other = rng.normal(size=(2, 4, 2)) * 50
    chances = np.empty((0, 4))
    same = [(radios, chances, 0.0), (radios[::-1] + 0.5, chances, -1.0)]
    assert real_stretch.runner_up(same) == np.inf
    assert real_stretch.runner_up([*same, (other, chances, -7.0)]) == 7.0


def test_a_straight_way_has_mirror_images_and_a_bend_takes_them_away(small):
    _, log = small
    gaps = real_stretch.mirror_gaps(log, [3, 30]).pivot(index="radio", columns="poses")["gap"]
    assert (gaps[3] < 5).any()
    assert (gaps[30] > 20).all()


def test_the_least_cost_is_at_the_scale_of_the_ranges(small):
    _, log = small
    scales = np.array([1.0, 1.05, 1.1])
    costs = real_stretch.costs_of_scales(replace(log, ranges=1.05 * log.ranges), scales, 0.0)
    assert costs.argmin() == 1
    assert costs.max() - costs.min() > 2


def test_calibration_takes_scale_and_offset_out(small):
    _, log = small
    found = {"scale": 1.07, "offset": 0.2, "range_sigma": 0.107}
    again = real_online.calibrated(replace(log, ranges=1.07 * log.ranges + 0.2), found)
    np.testing.assert_allclose(again.ranges, log.ranges)
    np.testing.assert_allclose(again.range_sigmas, 0.1)
    stated = np.sqrt(log.odometry_covariances[0, 2, 2])
    estimated = np.sqrt(np.median(again.odometry_covariances[:, 2, 2]))
    assert 0.2 * stated < estimated < 5 * stated


@pytest.mark.parametrize("method", ["gnc_tls", "gnc_tls_superlinear", "isam", "isam2", "em"])
def test_peers_do_well_with_right_labels(small, method):
    world, log = small
    start = world.poses, world.landmarks
    poses = real_peers.peers()[method](log, start)
    errors = alignment.aligned_errors(poses[:, :2], world.poses[:, :2])
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 0.1  # the sigma of one range


# --- parameters, tables, figures ------------------------------------------------------------


@pytest.mark.parametrize(
    "bad",
    [{"n_poses": 3}, {"prefixes": [80]}, {"prefixes": [120, 80]}, {"p": 1.5}, {"n_starts": 1},
     {"scale_low": 1.2}],
)  # fmt: skip
def test_parameters_that_cannot_be_are_refused_by_name(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        real_data.Config(**bad)


def test_tables_and_figures(small, tmp_path):
    world, log = small
    found, seconds = real_stretch.drive(log, rng=np.random.default_rng(0))
    places = world.poses[:, :2], world.landmarks
    stretch = real_stretch.Stretch(log, *places, world.source_of, found, seconds)
    driven = ONLINE[(ONLINE["kind"] == "labels") & (ONLINE["method"] == "online")]
    peers = real_data.study("plaza_peers")
    assert len(show.time_table(seconds)) == 3
    assert show.stretch_table(stretch, {"final": 0.1}).iloc[0, 0] == "aligned RMSE, final [m]"
    assert len(show.measures_table(LABELLED, driven)) >= 12
    assert show.provoked_table(OURS, ONLINE).iloc[-1, 3] == "yes"
    assert len(show.goats_table(real_data.study("goats"))) == 2
    assert len(show.online_table(driven.query("p == 0.4"))) == 2
    table = show.peers_table(peers)
    assert table.iloc[0, 0] == "least squares"
    assert list(table)[-1] == "a pose [ms]"
    scales = [real_data.found_in(name) for name in real_data.OTHER]
    assert len(show.scale_table(scales, dict.fromkeys(real_data.OTHER, 1.07))) == 2
    fig, axes = plt.subplots(1, 6, figsize=(12, 2.5))
    show.draw_paths(axes[0], places[0], {"a": places[0]})
    show.draw_scale(axes[1], np.ones(3), np.ones(3), scales[0], 1.07)
    show.draw_map(axes[2], *places, *places)
    show.draw_mirrors(axes[3], "a", real_stretch.mirror_gaps(log, [3, 30]))
    show.draw_levels(axes[4:], BATCH, peers, driven)
    show.draw_gaps(axes[3], pd.DataFrame({"set": ["a"], "poses": [80], "gap": [1.0]}))
    to = report.Report("x", tmp_path)
    to.figure(fig, "all")
    assert (tmp_path / "x_all.pdf").exists()


def test_an_oracle_while_driving_is_least_squares_up_to_a_pose(small):
    world, log = small
    truth = Truth(poses=world.poses, landmarks=world.landmarks, source_of=world.source_of)
    asked, poses = real_online.filtered_oracle(log, truth, 7)
    assert asked.tolist() == [7, 14, 21, 28]
    start = world.poses[:22], world.landmarks
    alone = real_experiments.least_squares(log.first(22), *start).poses[-1]
    np.testing.assert_allclose(poses[2], alone, atol=1e-4)


def test_a_row_of_the_online_study_has_the_oracle_beside(small, monkeypatch):
    """Right labels on a small world: both know as much while driving, and err by a few sigmas."""
    world, log = small
    truth = Truth(poses=world.poses, landmarks=world.landmarks, source_of=world.source_of)
    radios = {"scale": 1.0, "offset": 0.0, "range_sigma": 0.1}
    monkeypatch.setattr(real_online.plaza, "read", lambda _: None)
    monkeypatch.setattr(real_experiments, "changed", lambda *_, rng: (log, truth))
    monkeypatch.setattr(real_online, "found_in", lambda _: radios)
    (row,) = real_online.run("Plaza1", "labels", real_online.ORACLE_AT, 100, "online")
    assert 0.05 < row["filtered_oracle"] < 0.5
    assert row["filtered_beside"] < 1.5 * row["filtered_oracle"]
    assert row["final"] < 1.5 * row["oracle"]
    assert row["right"] == 1.0
    assert 0 < row["step_ms"] <= row["step_ms_95"]
    (row,) = real_online.run("Plaza1", "labels", 0.0, 100, "online")
    assert np.isnan([row["filtered_oracle"], row["filtered_beside"]]).all()


def test_the_gain_of_a_step_over_a_drive_is_that_of_its_median():
    seconds = np.linspace(0.001, 0.003, 1001)
    seconds[::50] = 1.0  # looks at all data
    found = real_online.times_of(seconds)
    assert found["step_ms"] == pytest.approx(2.0, abs=0.1)
    assert found["step_ms_gain"] == pytest.approx(0.9 * 2.0, abs=0.1)


def test_what_is_handed_online_leaves_scale_and_offset_open(small):
    _, log = small
    found = {"scale": 1.07, "offset": 0.2, "range_sigma": 0.107}
    told = real_online.handed(replace(log, scale=(1.0, 0.1), offset=(0.0, 1.0)), found)
    assert (told.scale, told.offset) == ((1.07, 0.1), (0.2, 1.0))
    np.testing.assert_array_equal(told.ranges, log.ranges)
