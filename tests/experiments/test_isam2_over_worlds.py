import math

import joblib
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from sngr_utils.experiments import isam2_over_worlds
from sngr_utils.metrics import precision_recall, rmse_and_nees, summaries
from sngr_utils.slam import conventions, marginals
from sngr_utils.sngr import baseline, trigger
from sngr_utils.world import dead_reckoning, scenario

SMALL = scenario.Scenario(n_poses=8)
TABLES = ("runs", "detections", "scores")
PRESETS = {name: conventions.PRESETS[name] for name in ("B", "C")}


def small(seeds=(3, 1, 2), jobs=1):
    return isam2_over_worlds.run_sweep(SMALL, PRESETS, [0.0, 0.3], seeds, [3.5, 3.9], jobs)


@pytest.fixture(scope="module")
def serial():
    return small()


def test_sweep_hangs_on_neither_workers_nor_backend_nor_order(serial, forked):
    with joblib.parallel_config(backend="threading", n_jobs=2):
        threaded = small(jobs=None)
    reordered = small(seeds=(1, 2, 3))
    for name in TABLES:
        table = getattr(serial, name)
        for other in (small(jobs=2), threaded):
            pd.testing.assert_frame_equal(getattr(other, name), table, check_exact=True)
        keys = [c for c in ("preset", "p", "seed", "tau", "window") if c in table]
        pair = [frame.sort_values(keys, ignore_index=True) for frame in (
            table, getattr(reordered, name)
        )]  # fmt: skip
        pd.testing.assert_frame_equal(*pair, check_exact=True)


def test_sweep_rows_are_those_of_single_runs(serial):
    assert [len(getattr(serial, name)) for name in TABLES] == [12, 24, 72]
    run = baseline.run_baseline(SMALL, PRESETS["C"], 0.3, 1)
    chosen = {"preset": "C", "p": 0.3, "seed": 1}
    runs, detections, scores = (
        getattr(serial, name)[(getattr(serial, name)[list(chosen)] == chosen).all(axis=1)]
        for name in TABLES
    )
    row = runs.iloc[0]
    assert (row.pose_rmse, row.landmark_rmse, row.nees) == (
        run.pose_rmse, run.landmark_rmse, run.nees
    )  # fmt: skip
    assert (row.failed, row.base_rate) == (run.failed.sum(), run.base_rate)
    blind = dead_reckoning.dead_reckoning(run.world.x0_mean, run.world.odometry)
    assert row.odometry_rmse == rmse_and_nees.rmse(blind[:, :2], run.world.poses[:, :2])
    assert scores.score.tolist() == run.scores.tolist()
    assert scores.failed.tolist() == run.failed.tolist()
    assert scores.eligible.tolist() == [False, False, True, True, True, True]
    for row in detections.itertuples():
        found = precision_recall.detection(trigger.triggers(run.scores, row.tau), run.failed)
        counts = (found.true_positives, found.false_positives, found.false_negatives)
        assert (row.tp, row.fp, row.fn) == counts
        assert (row.triggered, row.tp + row.fp + row.fn + row.tn) == (found.triggered, 6)
        fires = trigger.triggers(run.scores, row.tau)
        may_fire = precision_recall.detection(fires[2:], run.failed[2:])
        assert np.array_equal(
            [row.precision, row.recall, row.mcc],
            [found.precision, found.recall, may_fire.matthews],
            equal_nan=True,
        )


def test_scores_hold_both_units(serial):
    table = serial.scores
    assert np.allclose(table.log_lambda_max - table.log_lambda_min, table.score)
    assert ((table.score_cm - table.score > 3.5) & (table.score_cm - table.score < 4.01)).all()


@pytest.mark.parametrize(
    ("name", "changed"),
    [("seeds", {"seeds": [1, 1]}), ("p_levels", {"p_levels": []}), ("taus", {"taus": [4, 4.0]}),
     ("presets", {"presets": {}})],
)  # fmt: skip
def test_repeated_or_missing_entries_are_refused(name, changed):
    given = {"presets": PRESETS, "p_levels": [0.1], "seeds": [0], "taus": [4.0]} | changed
    with pytest.raises(ValueError, match=f"{name} is"):
        isam2_over_worlds.run_sweep(SMALL, **given)


def test_summary_closed_form_and_missing_values():
    frame = pd.DataFrame({
        "preset": ["b"] * 4 + ["a"] + ["c"] * 2,
        "p": [0.1] * 7,
        "x": [1.0, 2.0, 6.0, np.nan, 5.0, np.nan, np.nan],
    })
    table = summaries.summary(frame, "x")
    assert table.preset.tolist() == ["b", "a", "c"]
    assert table.n.tolist() == [3, 1, 0]
    assert table.missing.tolist() == [1, 0, 2]
    first = table.iloc[0]
    assert (first["mean"], first.se) == pytest.approx((3, np.sqrt(7 / 3)))
    ends = stats.ttest_1samp([1.0, 2.0, 6.0], 0).confidence_interval(0.95)
    assert (first.low, first.high) == pytest.approx((ends.low, ends.high))
    assert table["mean"][1] == 5
    assert np.isnan(table["mean"][2])
    assert table.loc[1:, ["se", "low", "high"]].isna().all(axis=None)


def test_coverage_that_the_docstring_of_summary_states():
    """2000 means of log-normal values, t against BCa on the first 400 of five values.

    Standard errors of the t shares are below 0.8 %; 4 points are five of them, so the failure
    probability is below 1e-6 each. BCa is 11 points short with a standard error of 2.
    """
    rng, s = np.random.default_rng(5), 0.75
    truth = np.exp(s**2 / 2)
    assert np.sqrt(np.exp(s**2) - 1) == pytest.approx(0.87, abs=0.005)
    for n, share in ((30, 0.90), (5, 0.86)):
        values = np.exp(s * rng.normal(size=(2000, n)))
        frame = pd.DataFrame({"world": np.repeat(np.arange(2000), n), "x": values.ravel()})
        table = summaries.summary(frame, "x", by=["world"])
        covers = (table.low <= truth) & (truth <= table.high)
        assert covers.mean() == pytest.approx(share, abs=0.04)
    ends = stats.bootstrap(
        (values[:400],), np.mean, axis=1, method="BCa", n_resamples=999, rng=rng
    ).confidence_interval
    bca = (ends.low <= truth) & (truth <= ends.high)
    assert bca.mean() < covers[:400].mean() - 0.02


def test_a_median_has_an_interval_from_six_values_on_and_few_large_ones_do_not_move_it():
    """The least and the largest of six cover the median in 1 - 2 / 2^6 = 97 %."""
    row = summaries.median_and_interval(pd.Series([3.0, 1, 2, 4, 1e9, 5, np.nan]))
    assert row.tolist() == [3.5, 1, 1e9, 6, 1]
    assert np.isnan(summaries.median_and_interval(pd.Series([1.0, 2, 3, 4, 5])).low)
    assert np.isnan(summaries.median_and_interval(pd.Series([np.nan]))["median"])


def test_the_interval_of_a_median_covers_as_often_as_it_says():
    """At least 95 %: of 1000 samples of a skewed law fewer than 930 with a probability of 0.3 %."""
    worlds = np.random.default_rng(1).lognormal(sigma=2, size=(1000, 30))
    rows = [summaries.median_and_interval(pd.Series(x)) for x in worlds]
    assert sum(row.low <= 1 <= row.high for row in rows) >= 930


def test_a_sign_test_leaves_out_what_is_equal_or_undefined():
    found = summaries.sign_test(np.array([-1.0, -2.0, -1e-9, 0.0, 1e9, math.nan]))
    assert found == (2, 1, pytest.approx(1.0))
    assert summaries.sign_test(np.zeros(4)) == (0, 0, 1.0)
    assert summaries.sign_test(-np.ones(10))[2] == pytest.approx(2 / 2**10)


@pytest.fixture(scope="module")
def variants():
    return isam2_over_worlds.nees_variants(
        scenario.Scenario(), {"C": conventions.PRESETS["C"]}, range(100, 130), 1
    )


def test_nees_of_a_true_mean_is_that_of_the_baseline(variants):
    for frame in ("world", "body"):
        convention = conventions.preset_conventions("C", {"nees_frame": frame})
        run = baseline.run_baseline(scenario.Scenario(), convention, 0.0, 100)
        chosen = variants[(variants.x0_mean == "truth") & (variants.frame == frame)]
        assert chosen.nees.iloc[0] == run.nees


def test_nees_is_the_same_in_any_frame_that_errors_and_covariances_share(noisy):
    errors = noisy.solution.poses[:, :2] - noisy.world.poses[:, :2]
    cos, sin = np.cos(noisy.solution.poses[:, 2]), np.sin(noisy.solution.poses[:, 2])
    turned = np.column_stack([
        cos * errors[:, 0] + sin * errors[:, 1],
        cos * errors[:, 1] - sin * errors[:, 0],
    ])
    body = rmse_and_nees.nees(turned, marginals.position_covariances(noisy.solution, "body"))
    assert body == pytest.approx(noisy.nees)


def test_nees_is_two_only_with_a_drawn_mean_and_a_common_frame(variants):
    """30 worlds. A t variable of 29 degrees leaves 5 standard errors with probability 3e-5."""
    table = summaries.summary(variants, "nees", ["x0_mean", "frame"]).set_index([
        "x0_mean",
        "frame",
    ])
    drawn = table.loc[("drawn", "world")]
    assert abs(drawn["mean"] - 2) < 5 * drawn.se
    for other in (("truth", "world"), ("truth", "body"), ("drawn", "body")):
        assert not table.loc[other].low < 2 < table.loc[other].high
