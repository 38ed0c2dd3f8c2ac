from dataclasses import replace
from functools import partial

import joblib
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from sngr_utils.experiments import estimators
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.robust import fastslam, losses
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.slam import conventions, isam2
from sngr_utils.sngr import algorithm, gate, refine, trigger
from sngr_utils.world import dead_reckoning, scenario, simulation, variations

C = conventions.PRESETS["C"]
FEW = fastslam.Settings(n_particles=50)


def make(p, seed=100):
    return simulation.simulate(scenario.Scenario(), p, rng=np.random.default_rng(seed))


def estimate(the_world, method, start="grid"):
    return estimators.estimate(the_world, C, method, start, FEW, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def runs():
    return estimators.compare(scenario.Scenario(), C, [0.2], range(100, 104), jobs=1)


@pytest.mark.parametrize("method", estimators.METHODS)
def test_every_method_answers_in_the_same_form_and_knows_nothing_of_the_truth(method):
    drawn = make(0.3)
    blind = replace(
        drawn,
        poses=np.full_like(drawn.poses, np.nan),
        landmarks=np.full_like(drawn.landmarks, np.nan),
        source_of=drawn.source_of if method == "oracle" else np.full(len(drawn.ranges), -1),
    )
    found, again = estimate(drawn, method), estimate(blind, method)
    assert found.poses.shape == (30, 3)
    assert found.landmarks.shape == (6, 2)
    assert np.isfinite(found.landmarks).all() == (method != "dead_reckoning")
    assert np.array_equal(found.poses, again.poses)
    assert (np.linalg.eigvalsh(found.position_covariances) > 0).all()


@pytest.mark.parametrize("method", [m for m in estimators.METHODS if m != "dead_reckoning"])
def test_a_landmark_seen_from_two_poses_only_is_left_out_by_every_method(method):
    drawn = make(0.0)
    kept = (drawn.label_of != 5) | (drawn.pose_of < 2)
    parts = ("pose_of", "label_of", "source_of", "ranges")
    found = estimate(replace(drawn, **{name: getattr(drawn, name)[kept] for name in parts}), method)
    assert np.isfinite(found.poses).all()
    assert np.isnan(found.landmarks[5]).all()
    assert np.isfinite(found.landmarks[:5]).all()
    assert (np.linalg.eigvalsh(found.position_covariances) > 0).all()


def test_dead_reckoning_is_what_odometry_says():
    drawn = make(0.3)
    found = estimate(drawn, "dead_reckoning")
    blind = dead_reckoning.dead_reckoning(drawn.x0_mean, drawn.odometry)
    assert np.allclose(found.poses, blind)
    rigid = dead_reckoning.rigid_covariances(blind, C.x0_sigmas)
    assert np.allclose(found.position_covariances[0], rigid[0])
    steps = np.trace(found.position_covariances - rigid, axis1=1, axis2=2) / 2
    covariance = np.diag(drawn.scenario.odometry_sigmas**2)
    expected = dead_reckoning.dead_reckoning_variances(blind, covariance)
    assert np.allclose(steps, expected, rtol=1e-6)


def test_methods_are_those_of_their_modules():
    drawn = make(0.3)
    poses, landmarks = losses.estimate(drawn, C, "cauchy", "first_poses")
    found = estimate(drawn, "cauchy", "first_poses")
    assert np.array_equal(found.poses, poses)
    assert np.array_equal(found.landmarks, landmarks)
    assert np.array_equal(estimate(drawn, "isam2").poses, isam2.run_isam2(drawn, C).poses)


def test_sngr_is_that_of_the_other_notebooks():
    """Another sampler, and window covariances of another computation: as good as six runs agree.

    Student's t with five degrees of freedom exceeds 5 by chance in one case of 250.
    """
    drawn = make(0.2, 104)
    found = estimators.estimate(drawn, C, "sngr", "grid", rng=np.random.default_rng([104, 1]))
    rmse = rmse_and_nees.rmse(found.poses[:, :2], drawn.poses[:, :2])
    solution = isam2.run_isam2(drawn, C)
    sampling = refine.Paper(SamplerSettings(min_walks=engines.ENOUGH_WALKS), "nested")
    fires = partial(trigger.triggers, tau=estimators.TAU)
    others = []
    for stream in np.random.default_rng(104).spawn(6):
        poses = algorithm.run(drawn, C, fires, sampling, gate.Gate(), rng=stream).poses
        others.append(rmse_and_nees.rmse(poses[:, :2], drawn.poses[:, :2]))
    error = np.std(others, ddof=1) * np.sqrt(1 + 1 / 6)
    assert abs(rmse - np.mean(others)) < 5 * error < 1e-2
    plain = rmse_and_nees.rmse(solution.poses[:, :2], drawn.poses[:, :2])
    assert abs(rmse - plain) > 1e-3  # it did something


@pytest.mark.parametrize("method", ["least_squares", "cauchy", "em"])
def test_the_nees_expected_over_the_prior_is_that_of_drawn_priors(method):
    """Repeated runs with 24 drawn means: same average within 5 standard errors and 2 %.

    Started from the first poses, which move with the prior; cells of a grid would not. The
    second order in the heading, of sigma 0.05 rad, is the 2 %. False alarms: below 1e-4 by
    Student's law.
    """
    drawn = make(0.1)
    base = estimate(drawn, method, "first_poses")
    expected = estimators.expected_nees(drawn, C, base.poses, base.position_covariances)
    values, rng = [], np.random.default_rng(3)
    for _ in range(24):
        moved = estimate(variations.draw_x0(drawn, C.x0_sigmas, rng=rng), method, "first_poses")
        errors = moved.poses[:, :2] - drawn.poses[:, :2]
        values.append(rmse_and_nees.nees(errors, moved.position_covariances))
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    assert abs(np.mean(values) - expected) < 5 * error + 0.02 * expected


def test_compare_is_one_estimate_per_row_in_any_order_of_work(runs):
    assert len(runs) == 4 * len(estimators.METHODS)
    assert runs.groupby("method").start.first()["fastslam"] == "none"
    drawn = make(0.2, 103)
    row = runs.query("method == 'switchable' and seed == 103").iloc[0]
    found = estimate(drawn, "switchable")
    assert row.pose_rmse == rmse_and_nees.rmse(found.poses[:, :2], drawn.poses[:, :2])
    assert row.landmark_rmse == rmse_and_nees.rmse(found.landmarks, drawn.landmarks)
    with joblib.parallel_config(backend="threading", n_jobs=2):
        again = estimators.compare(scenario.Scenario(), C, [0.2], [103, 102])
    order = ["seed", "method"]
    ours, theirs = (
        frame[frame.seed.isin([102, 103])].drop(columns="seconds").sort_values(order)
        for frame in (runs, again)
    )
    pd.testing.assert_frame_equal(
        ours.reset_index(drop=True), theirs.reset_index(drop=True), check_exact=True
    )


def test_whoever_doubts_beats_odometry_and_who_believes_does_not(runs):
    """One range in five is wrong. Four fixed worlds, so nothing here is random."""
    means = runs.groupby("method").pose_rmse.mean()
    believers = {"dead_reckoning", "isam2", "sngr", "least_squares"}
    for method in estimators.METHODS:
        if method in believers:
            assert means[method] >= means["dead_reckoning"]
        else:
            assert means[method] < means["dead_reckoning"]


def test_ratios_and_paired_differences(runs):
    relative = estimators.relative_to_oracle(runs)
    oracle = relative.query("method == 'oracle'")
    assert (oracle["ratio"] == 1).all()
    row = relative.query("method == 'huber' and seed == 101").iloc[0]
    best = oracle.set_index("seed").loc[101]
    assert (row.ratio, row.oracle_rmse) == (row.pose_rmse / best.pose_rmse, best.pose_rmse)
    assert row.landmark_ratio == row.landmark_rmse / best.landmark_rmse
    table = estimators.paired(runs, "isam2", "em")
    rmse = runs.set_index("seed").groupby("method")["pose_rmse"]
    difference = rmse.get_group("isam2") - rmse.get_group("em")
    assert table["median"].iloc[0] == pytest.approx(difference.median())
    assert table["p_value"].iloc[0] == pytest.approx(2 / 2**4)  # all four of one sign
    with pytest.raises(ValueError, match="lack the oracle"):
        estimators.relative_to_oracle(runs[runs["method"] != "oracle"])


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="method is 'tukey'"):
        estimate(make(0.0), "tukey")
    with pytest.raises(ValueError, match="start is 'truth'"):
        estimate(make(0.0), "huber", "truth")
    with pytest.raises(ValueError, match="method is 'tukey'"):
        estimators.compare(scenario.Scenario(), C, [0.0], [100], ["tukey"])
    with pytest.raises(ValueError, match="start is 'truth'"):
        estimators.compare(scenario.Scenario(), C, [0.0], [100], ["huber"], ["truth"])


def two_methods(n=12, gap=0.3):
    rng = np.random.default_rng(6)
    hard = rng.normal(size=n)
    values = {"a": hard + gap + 0.1 * rng.normal(size=n), "b": hard}
    return pd.DataFrame([
        {"method": name, "start": "none", "p": 0.2, "seed": seed, "pose_rmse": x}
        for name, xs in values.items()
        for seed, x in enumerate(xs)
    ])


def test_paired_difference_is_a_median_with_a_sign_test():
    runs = two_methods()
    a, b = (runs.pose_rmse[runs.method == name].to_numpy() for name in "ab")
    row = estimators.paired(runs, "a", "b").iloc[0]
    ranked = np.sort(a - b)
    assert row["median"] == pytest.approx(np.median(a - b))
    assert (row.low, row.high) == (ranked[2], ranked[-3])  # of 12: covers 96 %, in any table
    assert (row.less, row.more) == (np.sum(a < b), np.sum(a > b))
    assert row.p_value == pytest.approx(stats.binomtest(int(row.less), 12).pvalue)
    other = estimators.paired(runs, "b", "a").iloc[0]
    assert (other["median"], other.low) == pytest.approx((-row["median"], -row.high))


def test_paired_difference_uses_common_seeds_and_known_values():
    runs = two_methods()
    runs = runs[~((runs.method == "b") & (runs.seed >= 10))]
    runs.loc[(runs.method == "a") & (runs.seed == 0), "pose_rmse"] = np.nan
    shuffled = runs.sample(frac=1, random_state=np.random.default_rng(0))
    row = estimators.paired(shuffled, "a", "b").iloc[0]
    assert (row.n, row.missing) == (9, 1)
    same = estimators.paired(runs, "b", "b").iloc[0]
    assert (same["median"], same.p_value) == (0, 1)
    with pytest.raises(ValueError, match="in common"):
        estimators.paired(runs, "a", "d")
    apart = runs[(runs.method == "a") | (runs.seed < 0)]
    with pytest.raises(ValueError, match="in common"):
        estimators.paired(pd.concat([apart, apart.assign(method="c", p=0.9)]), "a", "c")


def test_a_start_is_the_same_whatever_was_started_before():
    """The oracle's labels were once left to the start that came after it."""
    both, alone = (
        estimators.compare(scenario.Scenario(), C, [0.4], [101], ["huber", "oracle"], starts)
        for starts in (["first_poses", "grid"], ["grid"])
    )
    again = both[both["start"] == "grid"].reset_index(drop=True)
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), alone.drop(columns="seconds"))
