import numpy as np
import pandas as pd
import pytest

from sngr_utils.detection import leverage, scores
from sngr_utils.experiments import detector_scores
from sngr_utils.metrics import cluster_bootstrap, precision_recall
from sngr_utils.slam import conventions, isam2, selected_inverse
from sngr_utils.sngr import failure, trigger
from sngr_utils.world import scenario

PAPER, C = scenario.Scenario(n_poses=12), conventions.PRESETS["C"]
CASES = [detector_scores.Case("paper", 0.2), detector_scores.Case("paper", 0.6, 4)]


@pytest.fixture(scope="module")
def rows():
    found = detector_scores.run(CASES, PAPER, C, [100, 101], jobs=1)
    return detector_scores.with_either(found, found)


def test_results_do_not_depend_on_the_number_of_processes(rows, forked):
    again = detector_scores.run(CASES, PAPER, C, [100, 101], jobs=2)
    pd.testing.assert_frame_equal(again, rows.drop(columns="either"))
    assert again.index.equals(pd.RangeIndex(len(rows)))


def test_either_counts_a_condition_number_by_the_clean_ones():
    shown = pd.DataFrame({"condition": [1.0, 5.0, 9.0], "chi_square": [0.0, 3.0, 0.5]})
    clean = pd.DataFrame({"condition": [2.0, 4.0, 6.0, 8.0]})
    among_clean = np.array([5, 3, 1]) / 5  # p-values: one more than the clean ones above, of five
    smallest = np.minimum(among_clean, 10.0 ** -shown["chi_square"])
    found = detector_scores.with_either(shown, clean)["either"]
    assert np.allclose(found, -np.log10(np.minimum(2 * smallest, 1)))


def test_null_rates_are_those_of_each_clean_world():
    alpha, named = 0.3, ["scenario", "preset", "seed", "estimate", "fired"]
    found = detector_scores.null_rates(["paper"], PAPER, [100, 101], alpha, jobs=1)
    assert list(found) == named
    assert set(found["estimate"]) == {"iSAM2", "settled"}
    at_c = found.query("preset == 'C' and estimate == 'iSAM2'").set_index("seed")["fired"]
    for seed in (100, 101):
        drawn = detector_scores.Case("paper", 0.0).draw(PAPER, seed)
        solution = isam2.run_isam2(drawn, C)
        covariance = selected_inverse.covariance(solution, drawn, C)
        test = leverage.chi_square(drawn, solution.poses, solution.landmarks, covariance)
        above = test.surprise[trigger.FIRST_ELIGIBLE :] > -np.log10(alpha)
        assert at_c[seed] == above.mean()
    assert found["fired"].nunique() > 1


def test_truth_is_what_the_world_says(rows):
    for case in CASES:
        the_world = case.draw(PAPER, 101)
        here = rows.query("case == @case.name and seed == 101")
        assert list(here["window"]) == list(range(trigger.FIRST_ELIGIBLE, 10))
        for t, wrong, failed, error in here[
            ["window", "contaminated", "failed", "error"]
        ].itertuples(index=False):
            mine = (the_world.pose_of >= t) & (the_world.pose_of < t + 3)
            assert wrong == (the_world.label_of[mine] != the_world.source_of[mine]).any()
            assert failed == (error > failure.FAILURE_ERROR)


def test_a_burst_leaves_the_rest_of_the_world_alone():
    clean, hit = (detector_scores.Case("paper", p, 4).draw(PAPER, 100) for p in (0.0, 1.0))
    assert np.array_equal(clean.ranges, hit.ranges)
    assert not detector_scores.wrong_labels(clean).any()
    assert (
        4 <= (detector_scores.wrong_labels(hit) > 0).sum() <= 6
    )  # windows that meet its four poses


def test_scenarios_change_what_they_name():
    for name, changed in detector_scores.SCENARIOS.items():
        drawn = detector_scores.Case(name, 0.0).draw(scenario.Scenario(), 100).scenario
        assert drawn == scenario.Scenario(**changed)


def test_thresholds_by_law_or_by_calibration(rows):
    found = detector_scores.thresholds(rows, 0.05)
    assert set(found) == set(scores.SCORES)
    for name in ("chi_square", "chi_square_robust", "either"):
        assert found[name] == pytest.approx(-np.log10(0.05))
    for name in detector_scores.CALIBRATED:
        assert (rows[name] > found[name]).mean() <= 0.05


def test_summaries_agree_with_the_plain_measures(rows):
    rng = np.random.default_rng(0)
    ranked = detector_scores.ranking(rows, ["disagreement"], "contaminated", rng=rng)
    decided = detector_scores.decisions(rows, {"disagreement": 0.1}, "contaminated", rng=rng)
    for case in rows["case"].unique():
        group = rows[rows["case"] == case]
        true, score = group["contaminated"].to_numpy(), group["disagreement"].to_numpy()
        row = ranked[ranked["case"] == case].iloc[0]
        found = precision_recall.detection(score > 0.1, true)
        expected = (
            precision_recall.roc_auc(score, true),
            precision_recall.average_precision(score, true),
        )
        assert (row["auc"], row["precision"]) == pytest.approx(expected, nan_ok=True)
        row = decided[decided["case"] == case].iloc[0]
        assert (row["precision"], row["recall"], row["mcc"], row["base_rate"]) == pytest.approx(
            (found.precision, found.recall, found.matthews, found.base_rate), nan_ok=True
        )
        assert row["silent"] == 1 - group.assign(f=score > 0.1).groupby("seed")["f"].any().mean()


GIVEN = pd.DataFrame({
    "scenario": "paper", "case": np.repeat(["p = 0.2", "burst"], 24),
    "seed": np.tile(np.repeat(np.arange(6), 4), 2),
    "failed": np.tile([True, False, False, True, False, False], 8),
    "score": np.random.default_rng(0).normal(size=48), "other": np.arange(48.0),
})  # fmt: skip
GIVEN.loc[GIVEN["seed"] == 5, "score"] = -9.0  # nothing fires there


def columns(name, interval):
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}


def test_ranking_has_a_row_for_each_group_and_score_with_intervals_over_worlds():
    """What stands in a row is what the measures give for its windows, draw by draw."""
    ranked = detector_scores.ranking(
        GIVEN, ["score", "other"], "failed", rng=np.random.default_rng(3)
    )
    assert list(zip(ranked["case"], ranked["detector"], strict=True)) == [
        ("p = 0.2", "score"), ("p = 0.2", "other"), ("burst", "score"), ("burst", "other"),
    ]  # fmt: skip
    rng = np.random.default_rng(3)
    for i, (case, name) in enumerate(zip(ranked["case"], ranked["detector"], strict=True)):
        group = GIVEN[GIVEN["case"] == case]
        score, true, worlds = (group[k].to_numpy() for k in (name, "failed", "seed"))
        within, _ = cluster_bootstrap.within_auc(score, true, worlds, rng=rng)
        expected = {
            "scenario": "paper", "case": case, "detector": name, "truth": "failed",
            **columns("auc", cluster_bootstrap.roc_auc(score, true, worlds, rng=rng)),
            **columns(
                "precision", cluster_bootstrap.average_precision(score, true, worlds, rng=rng)
            ),
            **columns("within", within),
            "base_rate": 1 / 3, "worlds": 6,
        }  # fmt: skip
        found = ranked.iloc[i].to_dict()
        assert found == pytest.approx(expected)
        assert found["auc_low"] < found["auc"] < found["auc_high"]
        assert found["within_low"] < found["within"] < found["within_high"]


def test_decisions_have_every_rate_with_its_interval():
    decided = detector_scores.decisions(
        GIVEN, {"score": 0.5, "other": 100.0}, "failed", rng=np.random.default_rng(4)
    )
    assert list(decided["detector"]) == ["score", "other"] * 2
    rng = np.random.default_rng(4)
    for i, row in decided.iterrows():
        group = GIVEN[GIVEN["case"] == row["case"]]
        true, worlds = group["failed"].to_numpy(), group["seed"].to_numpy()
        fired = group[row["detector"]].to_numpy() > (0.5, 100.0)[i % 2]
        shares = {
            "fired": (fired, np.ones(24, bool)), "precision": (true, fired),
            "recall": (fired, true), "false_alarms": (fired, ~true),
        }  # fmt: skip
        expected = {
            "scenario": "paper", "case": ("p = 0.2", "burst")[i // 2],
            "detector": ("score", "other")[i % 2], "truth": "failed",
        }  # fmt: skip
        for name, (marked, among) in shares.items():
            expected |= columns(name, cluster_bootstrap.share(marked, among, worlds, rng=rng))
        expected |= columns("mcc", cluster_bootstrap.matthews(fired, true, worlds, rng=rng))
        silent = 1.0 if i % 2 else np.mean([not fired[worlds == w].any() for w in range(6)])
        expected |= {"base_rate": 1 / 3, "worlds": 6, "silent": silent}
        assert row.to_dict() == pytest.approx(expected, nan_ok=True)
    assert (decided["silent"][::2] > 0).all()


def test_firing_is_above_the_threshold_not_at_it():
    decided = detector_scores.decisions(
        GIVEN, {"other": 46.0}, "failed", rng=np.random.default_rng(0)
    )
    assert decided["fired"].tolist() == [0, 1 / 24]


def test_the_robust_chi_square_keeps_its_level_where_isam2_does_not():
    """100 clean poses: the landmarks start from nearly straight lines, and some runs end wrong.

    The windows of one world hang together, so the rate over four worlds scatters: it stays below
    0.2 by far. One of the runs that failed folds its map over instead, at the expense of the
    odometry, so that its ranges fit all the same: only the disagreement sees that.
    """
    found = detector_scores.run(
        [detector_scores.Case("100 poses", 0.0)], scenario.Scenario(), C, range(109, 113), 1
    )
    fired = found.assign(
        plain=found["chi_square"] > 1.301, robust=found["chi_square_robust"] > 1.301,
        apart=found["disagreement"] > failure.FAILURE_ERROR,
    )  # fmt: skip
    rates = fired.groupby("seed")[["plain", "robust", "failed", "apart"]].mean()
    assert rates["robust"].mean() < 0.2
    assert rates["plain"].max() > 0.9
    folded = rates[(rates["failed"] > 0.9) & (rates["plain"] < 0.3)]
    assert len(folded) >= 1
    assert (folded["apart"] > 0.9).all()
