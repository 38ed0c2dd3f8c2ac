import warnings
from collections import Counter
from copy import deepcopy
from dataclasses import replace
from functools import cache

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sngr_utils.experiments import estimators, every_world, kinds_of_worlds, online_variants
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.online import (
    belief,
    data_association,
    estimator,
    localisation,
    slips,
    window,
)
from sngr_utils.online.landmarks import _locate, drop_landmarks
from sngr_utils.robust import diagnosis, losses, mutual_exclusion
from sngr_utils.robust.association import Shares
from sngr_utils.sampling.targets import place
from sngr_utils.show import association_pictures
from sngr_utils.slam import conventions
from sngr_utils.world import dead_reckoning, scenario, simulation, variations

C = conventions.PRESETS["C"]
WHOLE = estimator.Settings()
SHORT = scenario.Scenario(n_poses=12)


def make(p, seed=100):
    return simulation.simulate(scenario.Scenario(), p, rng=np.random.default_rng(seed))


def run(drawn, settings=WHOLE, watch=None):
    log = drawn.log(C.x0_sigmas)
    return estimator.run(log, C, settings, watch, rng=np.random.default_rng(0))


def rmse(found, drawn):
    return rmse_and_nees.rmse(found.poses[:, :2], drawn.poses[:, :2])


@pytest.fixture(scope="module")
def noisy():
    drawn = make(0.4)
    return drawn, run(drawn)


# --- causal, repeatable, data-driven --------------------------------------------------------


class EnoughError(Exception):
    """A run is stopped from outside: the rest of it would say no more."""


def test_what_comes_later_changes_nothing_of_what_was_said(noisy):
    """To the last bit, all poses and landmarks of every step, not only the newest pose."""
    drawn, _ = noisy
    middle, stories = 15, []
    later = drawn.pose_of > middle
    spoilt = replace(
        drawn,
        ranges=np.where(later, drawn.ranges[::-1], drawn.ranges),
        label_of=np.where(later, drawn.label_of[::-1], drawn.label_of),
        odometry=np.vstack([drawn.odometry[:middle], drawn.odometry[middle:] + 0.3]),
    )

    def watch(b):
        stories[-1].append((b.poses, b.landmarks, b.assignment.used))
        if len(stories[-1]) == middle + 3:
            raise EnoughError

    for given in (drawn, spoilt):
        stories.append([])
        with pytest.raises(EnoughError):
            run(given, watch=watch)
    for ours, theirs in zip(*(story[:middle] for story in stories), strict=True):
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(ours, theirs, strict=True))
    assert not np.array_equal(stories[0][-1][0], stories[1][-1][0])


def test_the_same_run_twice_is_the_same_run(noisy):
    drawn, first = noisy
    again = run(drawn)
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.used, again.used)
    assert first.counts == again.counts


# --- right answers --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [100, 101, 102])
def test_on_clean_data_it_is_the_batch_estimate_of_the_same_graph(seed):
    """All labels kept, no window sampled, and the optimum but for where the weak priors sit."""
    drawn = make(0.0, seed)
    found = run(drawn)
    poses, landmarks = losses.estimate(drawn, C, "least_squares", "grid")
    assert np.array_equal(found.used, drawn.label_of)
    assert np.abs(found.poses[:, :2] - poses[:, :2]).max() < 0.01
    assert np.abs(found.landmarks - landmarks).max() < 0.01
    assert found.counts["position samples"] == found.counts["slips"] == 0
    assert found.p < 0.03


@pytest.mark.parametrize("seed", [100, 101, 102])
def test_wrong_labels_are_found_out(seed):
    """Four of ten labels are wrong; nearly all ranges end where they came from."""
    drawn = make(0.4, seed)
    found = run(drawn)
    assert np.mean(found.used == drawn.source_of) > 0.9
    assert found.p == pytest.approx(np.mean(drawn.label_of != drawn.source_of), abs=0.06)
    oracle, _ = losses.estimate(drawn, C, "oracle", "grid")
    assert rmse(found, drawn) < 1.35 * rmse_and_nees.rmse(oracle[:, :2], drawn.poses[:, :2])
    covariances = found.position_covariances
    assert np.linalg.eigvalsh(covariances).min() > 0
    assert estimators.expected_nees(drawn, C, found.poses, covariances) < 6


def test_variants_change_what_their_name_says():
    settings = online_variants.variants(nets=False)
    assert settings["no second look"] == estimator.Settings(sweep=False, restart=False, soft=False)
    assert online_variants.variants(nets=True)[online_variants.NAME] == WHOLE


def test_drop_only_swaps_nothing():
    drawn = make(0.3)
    found = run(drawn, estimator.Settings(swap=False))
    kept = found.used != data_association.DROPPED
    assert np.array_equal(found.used[kept], drawn.label_of[kept])
    assert found.counts["swapped"] == 0 < found.counts["dropped"]


def test_without_nested_sampling_none_is_run():
    found = run(make(0.3), estimator.Settings(nested=False))
    assert found.counts["landmark samples"] == found.counts["position samples"] == 0
    assert found.counts["landmark questions"] > 0


@pytest.mark.parametrize(("sound", "referee", "asked"), [(False, True, 1), (True, True, 0),
                                                         (False, False, 0)])  # fmt: skip
def test_the_referee_is_asked_where_a_landmark_would_start_on_weights_that_are_not_sound(
    monkeypatch, sound, referee, asked
):
    """Many starts say that it may; the referee's answer counts, and it is another one here."""
    positions = simulation.circle_poses(12, 5.0)[:, :2].copy()  # as compiled: contiguous
    ranges = np.linalg.norm(positions - [1.0, 2.0], axis=1)
    evidence = place.Evidence(
        positions, ranges, np.full(12, 0.01), np.full(12, 0.1), 10.0, np.zeros(2), 8.0
    )
    here, _ = localisation.many_starts(evidence, rng=np.random.default_rng(0))
    monkeypatch.setattr(localisation, "many_starts", lambda evidence, rng: (here, sound))
    scattered = replace(here, samples=here.samples + np.linspace(-3, 3, len(here.samples))[:, None])
    monkeypatch.setattr(localisation, "sample", lambda evidence, rng: scattered)
    drawn = belief.Belief(make(0.0).first(1).log(C.x0_sigmas))
    found = _locate(drawn, evidence, referee, np.random.default_rng(0))
    assert drawn.counts["landmark samples"] == asked
    assert (found is None) == bool(asked)


def test_p_can_be_held():
    assert run(make(0.2).first(10), estimator.Settings(p=0.1)).p == 0.1


def test_a_slip_is_noticed_and_survived():
    """Two metres in one step, of which the odometry says nothing: better than the oracle then."""
    drawn = make(0.2, 103)
    odometry = drawn.odometry.copy()
    odometry[17, :2] += [2.0, 0.5]
    slipped = replace(drawn, odometry=odometry)
    found = run(slipped)
    assert found.counts["slips"] >= 1
    assert found.counts["position questions"] >= 1
    oracle, _ = losses.estimate(slipped, C, "oracle", "grid")
    assert rmse(found, drawn) < 0.5 * rmse_and_nees.rmse(oracle[:, :2], drawn.poses[:, :2])


# --- parts ----------------------------------------------------------------------------------


@cache
def followed(upto):
    """The belief after some poses of clean data, for `believed` to copy."""
    kept = []
    run(make(0.0).first(upto + 1), watch=kept.append)
    return kept[-1]


def believed(upto=12):
    """A belief after some poses, to be changed."""
    return deepcopy(followed(upto))


def test_innovations_leave_out_the_range_itself():
    """Against an estimate made without it, linearised at the same place."""
    state = believed()
    data, used = state.log, state.assignment.used
    found = state.innovations()
    for m in (5, 31, 70):
        without = used.copy()
        without[m] = data_association.DROPPED
        state.assignment = data_association.Assignment(without, state.assignment.weights)
        fewer = data_association.innovations(
            data, state.poses, state.landmarks, without, state.covariance()
        )
        k = used[m]
        assert found.variances[m, k] == pytest.approx(fewer.variances[m, k], rel=1e-6)
    state.assignment = data_association.Assignment(used, state.assignment.weights)


def test_a_lonely_range_goes_to_the_landmark_that_explains_it():
    state = believed()
    data = state.log
    found = state.innovations()
    m = 30
    other = (data.label_of[m] + 1) % 6
    label_of = data.label_of.copy()
    label_of[m] = other
    relabelled, shares = replace(state.log, label_of=label_of), Shares(0.1, 0.0)
    for exclusive in (False, True):
        assignment = data_association.decide(
            relabelled, found, state.assignment.used, shares, exclusive, True
        )
        assert assignment.used[m] == data.label_of[m]
        assert assignment.weights[m].sum() == pytest.approx(1)
    kept = data_association.decide(relabelled, found, state.assignment.used, shares, True, False)
    assert kept.used[m] == data_association.DROPPED


def test_a_vague_prediction_credits_nothing():
    state = believed()
    found = state.innovations()
    vague = replace(found, variances=found.variances + 1.0)
    assignment = data_association.decide(
        state.log, vague, state.assignment.used, Shares(0.1, 0.0), True, True
    )
    assert (assignment.used == data_association.DROPPED).all()


def test_a_landmark_in_the_wrong_place_is_taken_out():
    state = believed()
    used = np.where(state.assignment.used == 2, data_association.DROPPED, state.assignment.used)
    state.use(used)
    drop_landmarks(state)
    assert np.isnan(state.landmarks[2]).all()
    assert np.isfinite(state.landmarks[[0, 1, 3, 4, 5]]).all()
    assert state.counts["landmark restarts"] == 1


def test_a_step_that_the_estimate_contradicts_is_widened():
    state = believed()
    slips.doubt_steps(state)
    assert not state.slipped.any()
    state.log = state.log._with(odometry=state.log.odometry + [[0.5, 0, 0]] * 12)
    slips.doubt_steps(state)
    assert state.slipped.any()
    wide = state.log.odometry_covariances[np.argmax(state.slipped)]
    assert np.diag(wide) == pytest.approx([state.longest**2, state.longest**2, 0.01**2])
    state.trust(np.flatnonzero(state.slipped))
    assert not state.slipped.any()
    assert np.array_equal(state.log.odometry_covariances, state.told)


def test_the_past_says_of_the_window_what_all_poses_said():
    """Twenty poses, the first eight summed up: the same minimum and the same covariances."""
    state = believed(upto=19)
    whole, poses, landmarks = state.covariance(), state.poses, state.landmarks
    state._leave(8)
    state.solve()
    assert len(state.poses) == 12
    assert np.abs(state.poses - poses[8:]).max() < 1e-5
    assert np.abs(state.landmarks - landmarks).max() < 1e-5
    blocks = state.covariance()
    assert blocks.poses == pytest.approx(whole.poses[8:], rel=1e-2, abs=1e-7)
    assert blocks.landmarks == pytest.approx(whole.landmarks, rel=1e-2, abs=1e-6)
    log, told, all_poses, used = state.whole()
    assert log.n_poses == 20
    assert len(told) == 19
    assert len(used) == len(log.ranges) == 120
    assert np.abs(all_poses - poses).max() < 1e-5


def test_without_a_landmark_the_past_is_its_marginal():
    state = believed(upto=19)
    state._leave(8)
    past = window.without(state.past, 2)
    kept = np.delete(np.arange(15), [7, 8])
    expected = np.linalg.inv(np.linalg.inv(state.past.information + 1e-6 * np.eye(15))[
        np.ix_(kept, kept)])  # fmt: skip
    assert past.information[np.ix_(kept, kept)] == pytest.approx(expected, rel=1e-3, abs=1e-2)
    assert not past.information[[7, 8]].any()


def test_two_ranges_that_fit_one_landmark_only_do_not_underflow():
    logs = np.full((6, 7), -2000.0)
    logs[:, 0], logs[:, -1] = 0.0, -np.inf
    found = mutual_exclusion.exclusive_posterior(logs)
    assert np.isfinite(found).all()
    assert found.sum(axis=1) == pytest.approx(np.ones(6))


# --- many worlds ----------------------------------------------------------------------------


def test_study_has_every_variant_in_any_order():
    settings = {online_variants.NAME: WHOLE, "hard": estimator.Settings(soft=False)}
    frame = online_variants.run_variants(SHORT, C, settings, [0.2], [100, 101], 1)
    assert list(frame["method"]) == [online_variants.NAME, "hard"] * 2
    alone = online_variants.run_variants(SHORT, C, settings, [0.2], [101], 1)
    kept = [name for name in frame if name != "seconds"]
    ours = frame[frame["seed"] == 101].reset_index(drop=True)[kept]
    assert ours.equals(alone[kept])


def test_slips_are_the_same_for_all():
    frame = online_variants.run_slips(SHORT, C, 0.3, 4, 0.7, [100], 1)
    sound = simulation.simulate(SHORT, 0.3, rng=np.random.default_rng(100))
    drawn = variations.slip(sound, 4, 0.7, rng=np.random.default_rng([100, online_variants.SLIPS]))
    oracle, _ = losses.estimate(drawn, C, "oracle", "grid")
    row = frame[frame["method"] == "oracle"].iloc[0]
    assert row.pose_rmse == rmse_and_nees.rmse(oracle[:, :2], drawn.poses[:, :2])


def test_film_stops_where_it_is_told():
    frames = online_variants.film(make(0.3).first(15), C, [3, 12], 100)
    assert [len(frame.poses) for frame in frames] == [4, 13]
    assert all(np.isnan(frames[0].landmarks[k]).all() for k in frames[0].clouds)
    played = association_pictures.film(frames).pictures
    assert next(text for text, _ in played).startswith("pose 3: ")
    plt.close("all")
    with pytest.raises(ValueError, match="at is"):
        online_variants.film(make(0.3), C, [0], 100)


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="p"):
        estimator.Settings(p=1.5)
    with pytest.raises(ValueError, match="nested"):
        estimator.Settings(nested="grid")
    assert isinstance(run(make(0.0).first(3)).counts, Counter)


def test_fifteen_landmarks_and_a_scan_with_one_measured_twice_are_ordinary():
    short = scenario.Scenario(n_landmarks=15, n_poses=8)
    drawn = simulation.simulate(short, 0.2, rng=np.random.default_rng(100))
    twice = drawn.keep(np.sort(np.append(np.arange(len(drawn.ranges)), [20, 75])))
    found = run(twice)
    assert len(found.used) == len(drawn.ranges) + 2
    assert rmse(found, drawn) < 0.3


@pytest.mark.parametrize("exclusive", [True, False])
@pytest.mark.parametrize("n", [2, 4])
def test_ranges_of_each_landmark_in_every_scan_need_the_option_that_allows_them(exclusive, n):
    """With it the map is found; without it the warning names it, and the result doubts itself."""
    drawn = make(0.0).first(12)
    often = drawn.keep(np.repeat(np.arange(len(drawn.ranges)), n))
    log = often.log(C.x0_sigmas)
    settings = estimator.Settings(exclusive=exclusive)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = estimator.run(log, C, settings, rng=np.random.default_rng(0))
    named = [one.filename for one in caught if "set exclusive=False" in str(one.message)]
    assert named == exclusive * [__file__]
    assert found.diagnosis.doubtful == exclusive
    if not exclusive:
        assert np.mean(found.used == often.source_of) > 0.95


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_an_offset_that_no_data_hold_is_left_open(n):
    log = replace(make(0.0).log(C.x0_sigmas), offset=(0.0, np.inf)).first(n)
    found = estimator.run(log, C, WHOLE, rng=np.random.default_rng(0))
    assert np.isfinite(found.poses).all()
    assert found.calibration[1] == 0 or np.isfinite(found.landmarks).all()
    assert found.diagnosis.doubtful or n == 5


def test_two_steps_that_moved_and_turned_are_both_found():
    """At first neighbouring steps are believed to have slipped, and not to have turned."""
    rng = np.random.default_rng(400)
    drawn = simulation.simulate(scenario.Scenario(n_poses=60), 0.2, rng=rng)
    odometry = drawn.odometry.copy()
    odometry[[17, 39]] += [1.2, -1.6, 0.3]
    log = replace(drawn, odometry=odometry).log(C.x0_sigmas)
    found = estimator.run(log, C, WHOLE, rng=np.random.default_rng(0))
    slipped = np.isin(np.arange(59), [17, 39])
    at_truth = every_world.informed_em(log, slipped, C, (drawn.poses, drawn.landmarks))
    assert found.cost < at_truth.cost + 1
    assert found.counts["slips"] == 2


def test_a_landmark_that_half_of_the_way_is_behind_a_wall_is_where_it_was():
    """A wall makes the ranges of one landmark .7 m long, half of the way: as from the truth."""
    rng = np.random.default_rng(334)
    drawn = simulation.simulate(scenario.Scenario(n_poses=40), 0.0, rng=rng)
    behind = (drawn.source_of == 0) & (drawn.pose_of > 12) & (drawn.pose_of < 30)
    log = replace(drawn, ranges=drawn.ranges + 0.7 * behind).log(C.x0_sigmas)
    found = estimator.run(log, C, WHOLE, rng=np.random.default_rng(0))
    none = np.zeros(39, dtype=bool)
    at_truth = every_world.informed_em(log, none, C, (drawn.poses, drawn.landmarks))
    assert found.cost < at_truth.cost + 1


# --- any log --------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_clutter_is_found_out_and_its_share_estimated(share):
    """Added ranges that come from nothing: the labels of some scans stand there twice."""
    drawn = variations.clutter_added(make(0.2), share, 10.0, rng=np.random.default_rng(0))
    found = run(drawn)
    assert np.mean(found.used == drawn.source_of) > 0.9
    assert found.clutter == pytest.approx(np.mean(drawn.source_of < 0), abs=0.08)
    best, _ = every_world.oracle(drawn, make(0.2), C, from_grid=True)
    assert rmse(found, drawn) < 1.35 * rmse(best, drawn)


def test_all_lengths_times_ten_give_the_same_times_ten():
    """To rounding: nothing in the estimator, EM included, is an absolute length."""
    log = make(0.3).log(C.x0_sigmas)
    unit = np.array([10.0, 10.0, 1.0])
    large = log._with(
        odometry=log.odometry * unit, ranges=10 * log.ranges, range_sigmas=10 * log.range_sigmas,
        odometry_covariances=log.odometry_covariances * np.outer(unit, unit),
        x0_mean=log.x0_mean * unit, x0_sigmas=log.x0_sigmas * unit,
    )  # fmt: skip
    small, big = (
        estimator.run(each, C, WHOLE, rng=np.random.default_rng(0)) for each in (log, large)
    )
    assert np.array_equal(small.used, big.used)
    assert big.filtered[:, :2] / 10 == pytest.approx(small.filtered[:, :2], abs=1e-5)
    assert big.poses[:, :2] / 10 == pytest.approx(small.poses[:, :2], abs=1e-5)
    assert big.landmarks / 10 == pytest.approx(small.landmarks, abs=1e-5)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_poses_are_dead_reckoning_and_doubted(n):
    with pytest.warns(diagnosis.DoubtWarning):
        found = run(make(0.2).first(n))
    assert found.poses.shape == (n, 3)
    assert found.in_doubt.all()
    assert found.diagnosis.doubtful


def test_no_ranges_are_dead_reckoning_and_doubted():
    drawn = make(0.2)
    with pytest.warns(diagnosis.DoubtWarning):
        found = run(drawn.keep(np.zeros(len(drawn.ranges), dtype=bool)))
    expected = dead_reckoning.dead_reckoning(drawn.x0_mean, drawn.odometry)
    assert found.poses == pytest.approx(expected, abs=1e-9)
    assert found.in_doubt.all()


def test_half_of_the_labels_and_a_landmark_without_ranges():
    drawn = make(0.2)
    log = drawn.log(C.x0_sigmas)
    blank = np.random.default_rng(0).random(len(log.ranges)) < 0.4
    some = log._with(label_of=np.where(blank, -1, log.label_of))
    found = estimator.run(some, C, WHOLE, rng=np.random.default_rng(0))
    assert np.mean(found.used == drawn.source_of) > 0.9
    unseen = log.keep(drawn.source_of != 2)
    found = estimator.run(unseen, C, WHOLE, rng=np.random.default_rng(0))
    assert rmse(found, drawn) < 0.3


def test_standing_still_leaves_the_landmarks_in_doubt():
    rng = np.random.default_rng(0)
    poses = np.tile([5.0, 0.0, 1.5], (10, 1))
    drawn = simulation.measure(
        poses, make(0.0).landmarks, scenario.Scenario(), 0.0, rng=rng, association_rng=rng
    )
    found = run(drawn)
    assert found.in_doubt.all()
    assert rmse(found, drawn) < 0.4


def test_a_step_is_refused_by_field_and_row():
    log = make(0.2).log(C.x0_sigmas)
    online = estimator.Online(log.first(1), C, WHOLE, rng=np.random.default_rng(0))
    bad = log.measurements(1)
    with pytest.raises(ValueError, match=r"ranges\[2\]"):
        online.step(replace(bad, ranges=np.where(np.arange(6) == 2, -1.0, bad.ranges)))


@pytest.mark.parametrize("scale", [(1.0, 0.0), (1.0, 0.1), (2.0, 0.0)])
def test_a_log_is_what_its_measurements_are_one_by_one(scale):
    """A whole log is checked once, measurements as they come: to the last bit the same."""
    log = replace(make(0.3).log(C.x0_sigmas).first(7), scale=scale)
    fed = [estimator.Online(log.first(1), C, WHOLE, rng=np.random.default_rng(0)) for _ in "12"]
    for t in range(1, 7):
        fed[0].step(log.measurements(t))
        fed[1].take(estimator.of_pose(log, t))
    for name in ("ranges", "range_sigmas", "label_of", "times", "row_of", "odometry", "scale"):
        assert np.array_equal(*(getattr(each.belief.log, name) for each in fed)), name
    assert np.array_equal(fed[0].belief.poses, fed[1].belief.poses)


def torn():
    """A slip before any landmark is known, which no scan contradicts."""
    drawn = make(0.3, 118)
    return variations.jump(drawn, 5.0, 0.0, rng=np.random.default_rng([118, 90])), drawn


def test_an_estimate_that_is_lost_says_so():
    """Its map is torn, and it may not doubt the odometry."""
    slipped, drawn = torn()
    with pytest.warns(diagnosis.DoubtWarning, match="fit nothing"):
        found = run(slipped, estimator.Settings(doubt_odometry=False))
    assert found.diagnosis.reasons
    assert not run(drawn).diagnosis.doubtful


def test_a_slip_before_the_map_is_found_at_the_end():
    slipped, drawn = torn()
    found = run(slipped)
    assert found.counts["slips"] == 1
    best, _ = every_world.oracle(slipped, drawn, C, from_grid=False)
    assert rmse(found, drawn) < 1.2 * rmse(best, drawn)
    assert not found.diagnosis.doubtful


@pytest.mark.parametrize(("metres", "radians"), [(5.0, 0.0), (0.0, 0.5)])
def test_a_large_slip_is_found_at_the_next_scans(metres, radians):
    """Where one scan leaves a position open, the next one settles it; heading has two to do so."""
    drawn = make(0.3, 108)
    slipped = variations.jump(drawn, metres, radians, rng=np.random.default_rng([108, 90]))
    found = run(slipped)
    best, newest = every_world.oracle(slipped, drawn, C, from_grid=False)
    assert rmse(found, drawn) < 1.2 * rmse(best, drawn)
    truth = drawn.poses[:, :2]
    assert rmse_and_nees.rmse(found.filtered[:, :2], truth) < 1.5 * rmse_and_nees.rmse(
        newest, truth
    )


def test_a_slip_that_was_believed_is_taken_back_where_there_was_none():
    """A reach of 4 m, seed 115: for five poses the newest one was as far off as ten metres."""
    world, _ = kinds_of_worlds.draw("reach 4 m", 0.3, 115)
    found = run(world)
    truth = world.poses[:, :2]
    assert found.counts["slips"] == 0
    assert np.linalg.norm(found.filtered[:, :2] - truth, axis=1)[20:26].max() < 1.0
