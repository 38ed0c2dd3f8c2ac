"""Sentences of notebooks, README and paper about signs and orders, on stored results."""

import re

import numpy as np
import pandas as pd
import pytest
import yaml
from stored_results import RESULTS, value, worlds

from sngr_utils import full_sngr, paths
from sngr_utils.experiments import studies
from sngr_utils.metrics import summaries
from sngr_utils.publish import rules


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


def test_in_sixty_other_worlds_it_helps_more_often_than_it_harms():
    """Sampled by the fast path. About two in three of those that change, by millimetres.

    A fair coin gives as many with a probability of .015.
    """
    change = []
    for seed in (*range(9500, 9530), *range(9600, 9630)):
        refined = full_sngr.run_level(full_sngr.Config(seed=seed, engine="fast"), 0.3)
        change.append(refined.pose_rmse - refined.baseline.pose_rmse)
    less, more, _ = summaries.sign_test(np.array(change))
    assert 0.6 < less / (less + more) < 0.75
    assert -0.005 < np.median(change) < 0  # m


def test_in_most_worlds_refinement_moves_the_error_by_less_than_a_twentieth():
    """At both levels where the paper says so; README and abstract. Under A and B in nearly all."""
    for preset in "ABC":
        moved = np.abs([change(preset, p) for p in ("0.2", "0.3")]).max(axis=0)
        low, _ = rules.share_interval(moved <= 0.05)
        assert low > (0.5 if preset == "C" else 0.8)


@pytest.mark.parametrize(("preset", "p"), [
    ("C", "0.1"), ("C", "0.2"), *((preset, p) for preset in "AB" for p in ("0.1", "0.2", "0.3")),
])  # fmt: skip
def test_elsewhere_no_direction_is_beyond_chance(preset, p):
    difference = worlds(f"audit.{preset}.p{p}.sngr_pose_rmse") - worlds(
        f"audit.{preset}.p{p}.pose_rmse"
    )
    assert summaries.sign_test(difference)[2] > 0.05
    middle = summaries.median_and_interval(pd.Series(difference))
    assert -0.01 < middle.low <= middle.high < 0.01  # m
    if preset == "B":
        assert (np.abs(change(preset, p)) < 0.05).all()


def test_one_world_gets_worse_by_a_fifth():
    found = change("C", "0.2")
    assert np.sum(found > 0.05) == 1
    assert 0.15 < found.max() < 0.25


@pytest.mark.parametrize(("preset", "mostly"), [("A", True), ("B", True), ("C", False)])
def test_silent_on_clean_data_and_blind_at_small_p(preset, mostly):
    """None of these is blind under C; of 55 others, of seeds from 9500 on, two were."""
    silent = worlds(f"audit.{preset}.p0.tau3.96.triggered") == 0
    recall = worlds(f"audit.{preset}.p0.1.tau3.96.recall")
    blind = recall[np.isfinite(recall)] == 0
    for share in (silent.mean(), blind.mean()):
        assert share > 0.5 if mostly else share == 0


@pytest.mark.parametrize("p", ["0.4"])
def test_online_and_batch_are_equivalent_and_both_as_good_as_the_oracle(p):
    """By intervals, not by a large p-value: 2 % for the pair, 5 % from the oracle."""
    online, batch = worlds(f"online.p{p}.ratio"), worlds(f"online.em_exclusive.p{p}.ratio")
    pair = summaries.median_and_interval(pd.Series(batch / online))
    assert 0.98 < pair.low <= pair.high < 1.02
    for ratio in (online, batch, worlds(f"online.p{p}.graph")):
        alone = summaries.median_and_interval(pd.Series(ratio))
        assert 0.95 < alone.low <= alone.high < 1.05


# --- the paper's introduction, and the front of the README ----------------------------------------


def column(table, number):
    """A column of a table, by row; rows that hold no number there are left out."""
    keys = [key for key in RESULTS if re.fullmatch(rf"tab_{table}\.row\d+\.column{number}", key)]
    return {int(re.search(r"row(\d+)", key)[1]): value(key) for key in keys}


def test_the_wheels_alone_are_better_than_least_squares_over_wrong_labels():
    assert value("robust.least_squares.grid.p0.4") > 3 * value("robust.dead_reckoning.none.p0.4")


@pytest.mark.parametrize("preset", "ABC")
def test_the_nees_grows_by_orders_of_magnitude(preset):
    least, most = (np.median(worlds(f"audit.{preset}.p{p}.nees")) for p in ("0", "0.4"))
    assert most > 100 * least


def test_an_alarm_adds_little_to_the_base_rate_under_our_reading():
    """Rows are presets A to C, each with five levels of p, of which the first is clean."""
    added = column("audit_detection", 6)
    assert min(added[row] for row in range(12, 16)) > 0
    assert max(added[row] for row in range(12, 16)) < 0.07


def test_pooled_over_worlds_the_score_says_little_about_wrong_labels():
    """Rows are presets A to C, each with five levels of p, of which the first is clean."""
    pooled = column("audit_auc", 3)
    assert len(pooled) == 15
    dirty = [auc for row, auc in pooled.items() if (row - min(pooled)) % 5]
    assert 1 / 3 < min(dirty) <= max(dirty) < 2 / 3


def test_gains_are_what_the_solver_left():
    """Presets A to C at four levels of p each; of them 0.2 and 0.3."""
    largest = list(column("audit_gains", 7).values())
    a, b, c = (largest[i + 2 : i + 4] for i in (0, 4, 8))
    assert min(a + c) > 1
    assert 0.01 < min(b) <= max(b) < 0.1


def test_asking_where_a_range_came_from_comes_before_forgetting_it():
    methods = "isam2", "huber", "fastslam", "switchable", "max_mixture_all", "em_exclusive"
    ratios = [np.mean(worlds(f"online.{name}.p0.4.ratio")) for name in methods]
    assert ratios == sorted(ratios, reverse=True)
    for p in ("0", "0.2", "0.4", "0.5"):
        assert np.mean(worlds(f"online.p{p}.ratio")) == pytest.approx(1, abs=0.01)
    assert value("online.batch.largest_mean") < 1.01


def test_in_the_first_figure_two_stay_at_one_and_all_others_lie_above():
    """And SNGR's error is that of iSAM2 within a twentieth."""
    others = {
        match[1]
        for key in RESULTS
        if (match := re.fullmatch(r"online\.(\w+)\.p0\.4\.ratio", key)) and "sample" in RESULTS[key]
    } - {"em_exclusive", "p0"}
    assert len(others) > 10
    for p in ("0.1", "0.2", "0.3", "0.4", "0.5"):
        ours = (
            np.mean(worlds(f"online.p{p}.ratio")),
            np.mean(worlds(f"online.em_exclusive.p{p}.ratio")),
        )
        assert np.abs(np.array(ours) - 1).max() < 0.01
        for name in others:
            if f"online.{name}.p{p}.ratio" in RESULTS:
                assert np.mean(worlds(f"online.{name}.p{p}.ratio")) > max(1.005, *ours), (name, p)
    sngr, isam2 = (np.mean(worlds(f"online.{name}.p0.4.ratio")) for name in ("sngr", "isam2"))
    assert abs(sngr / isam2 - 1) < 0.05


def test_at_the_lower_threshold_a_is_silent_in_few_clean_worlds():
    """Rows of `audit_silent` are 3.9, 3.92, 3.96 and 4.0; the third column has A."""
    assert value("tab_audit_silent.row2.column1") == 3.92
    assert (
        0 < value("tab_audit_silent.row2.column2") < 0.2 * value("tab_audit_silent.row2.column2.2")
    )


def test_most_of_the_precision_is_the_base_rate_under_every_preset():
    """In the middle world where it fires, at every share of wrong labels; the first is clean."""
    added, precision = column("audit_detection", 6), column("audit_detection", 4)
    dirty = [row for row in added if (row - 1) % 5]
    assert len(dirty) == 12
    assert max(added[row] / precision[row] for row in dirty) < 0.5


def test_the_fastest_engine_is_a_hundred_times_as_fast():
    assert value("engine.fast.ratio") > 100


def test_one_gaussian_fails_on_first_poses_and_cheap_means_find_both_places():
    wrong = [value(f"multimodal.landmark.{n}.wrong") for n in (2, 3, 4, 5, 8)]
    assert wrong == sorted(wrong, reverse=True)
    runs = value("multimodal.landmark.ancestral.runs")
    for name in ("ancestral", "starts"):
        assert value(f"multimodal.landmark.{name}.within") == runs
    assert value("multimodal.landmark.c50.within") <= runs / 2


# --- what captions say in numbers that no run has handed on ---------------------------------------


def captions():
    """(chapter, worlds, text) of each caption that counts worlds by a number of its own."""
    both = (paths.PAPER / name for name in ("sngr.tex", "supplement.tex"))
    text = " ".join(" ".join(path.read_text(encoding="utf-8") for path in both).split())
    for said, chapter in re.findall(r"\\caption\{((?:(?!\\caption).)*?)\\source\{(\w+)\}", text):
        for worlds_said in re.findall(
            r"(\d+) (?:clean )?worlds|worlds of every kind, (\d+)", said.lower()
        ):
            yield chapter, int("".join(worlds_said)), said


def test_captions_count_the_worlds_that_were_run():
    asked = list(captions())
    assert len(asked) > 25
    for chapter, n, said in asked:
        if "Worlds of every kind" in said:
            groups = studies.committed("every_world").groupby(["kind", "preset", "p"])
            assert set(groups.size()) == {n}
            continue
        params = yaml.safe_load((paths.PARAMS / f"{chapter}.yaml").read_text(encoding="utf-8"))
        assert n in {value for key, value in params.items() if key.startswith("n_")}, said


def test_the_paper_says_in_words_how_many_worlds_windows_were_studied_in():
    params = yaml.safe_load((paths.PARAMS / "05_audit.yaml").read_text(encoding="utf-8"))
    assert (params["n_windows"], params["p_windows"], params["n_corrected"]) == (8, 0.2, 20)
    assert value("gaussian.conditional.windows") % (8 * 3) == 0  # of three presets
