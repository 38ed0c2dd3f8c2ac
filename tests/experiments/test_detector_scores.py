import numpy as np
import pandas as pd
import pytest

from sngr_utils.detection import scores
from sngr_utils.experiments import detector_scores, detector_summary
from sngr_utils.metrics import precision_recall
from sngr_utils.slam import conventions
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
    ranked = detector_summary.ranking(rows, ["disagreement"], "contaminated", rng=rng)
    decided = detector_summary.decisions(rows, {"disagreement": 0.1}, "contaminated", rng=rng)
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
