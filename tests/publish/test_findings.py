"""Sentences of notebooks, README and paper about signs and orders, on stored results."""

import numpy as np
import pandas as pd
import pytest

from sngr_utils import paths
from sngr_utils.metrics import summaries
from sngr_utils.publish.results import results_in

RESULTS = results_in(paths.REFERENCE)


def worlds(key):
    return np.array(RESULTS[key]["sample"], dtype=float)


def change(preset, p):
    """Relative change of the pose RMSE by refinement, world by world."""
    before = worlds(f"audit.{preset}.p{p}.pose_rmse")
    return worlds(f"audit.{preset}.p{p}.sngr_pose_rmse") / before - 1


def test_refinement_changes_little_and_under_c_at_the_most_noise_for_the_better():
    """Notebook 5, README, abstract."""
    before, after = (worlds(f"audit.C.p0.3.{name}pose_rmse") for name in ("", "sngr_"))
    less, more, p_value = summaries.sign_test(after - before)
    assert less > more
    assert p_value < 0.05 / 9  # of nine tests: three presets, three levels
    assert np.median(after - before) == pytest.approx(-0.005, abs=0.004)  # half a centimetre
    assert (change("C", "0.3") <= 0.05).all()


@pytest.mark.parametrize(("preset", "p"), [
    ("C", "0.1"), ("C", "0.2"), *((preset, p) for preset in "AB" for p in ("0.1", "0.2", "0.3")),
])  # fmt: skip
def test_elsewhere_no_direction_is_beyond_chance(preset, p):
    difference = worlds(f"audit.{preset}.p{p}.sngr_pose_rmse") - worlds(
        f"audit.{preset}.p{p}.pose_rmse"
    )
    assert summaries.sign_test(difference)[2] > 0.05
    if preset == "B":
        assert (np.abs(change(preset, p)) < 0.05).all()


def test_one_world_gets_worse_by_a_fifth():
    found = change("C", "0.2")
    assert np.sum(found > 0.05) == 1
    assert 0.15 < found.max() < 0.25


@pytest.mark.parametrize(("preset", "mostly"), [("A", True), ("B", True), ("C", False)])
def test_silent_on_clean_data_and_blind_at_small_p(preset, mostly):
    silent = worlds(f"audit.{preset}.p0.tau3.96.triggered") == 0
    recall = worlds(f"audit.{preset}.p0.1.tau3.96.recall")
    blind = recall[np.isfinite(recall)] == 0
    for share in (silent.mean(), blind.mean()):
        assert share > 0.5 if mostly else share == 0


def test_readings_differ_beyond_chance_at_one_level():
    for p in ("0", "0.1", "0.2", "0.3", "0.4"):
        difference = worlds(f"audit.B.p{p}.pose_rmse") - worlds(f"audit.C.p{p}.pose_rmse")
        less, more, p_value = summaries.sign_test(difference)
        assert (p_value < 0.05) == (p == "0.3"), p
        assert p != "0.3" or less > more


@pytest.mark.parametrize("p", ["0.4"])
def test_online_and_batch_are_equivalent_and_both_as_good_as_the_oracle(p):
    """By intervals, not by a large p-value: 2 % for the pair, 5 % from the oracle."""
    online, batch = worlds(f"online.p{p}.ratio"), worlds(f"online.em_exclusive.p{p}.ratio")
    pair = summaries.median_and_interval(pd.Series(batch / online))
    assert 0.98 < pair.low <= pair.high < 1.02
    for ratio in (online, batch, worlds(f"online.p{p}.graph")):
        alone = summaries.median_and_interval(pd.Series(ratio))
        assert 0.95 < alone.low <= alone.high < 1.05
