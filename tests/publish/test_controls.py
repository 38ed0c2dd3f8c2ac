"""What the rules say of numbers that nobody measured, on the committed reference."""

import numpy as np
import pytest

from sngr_utils import paths
from sngr_utils.publish import claims, controls, judge, printed, rules
from sngr_utils.publish.number_tests import NumberTest
from sngr_utils.publish.results import results_in


@pytest.fixture(scope="module")
def tests():
    return list(controls.all_tests(results_in(paths.REFERENCE), claims.read().reading))


def test_random_numbers_pass_at_most_15_percent_of_the_testable_rows(tests):
    """By construction of the share, row by row; drawn anew here, 40 times a row."""
    rng, passed = np.random.default_rng(99), []
    for test in controls.testable(tests):
        drawn = test.rounded(test.cloud.natural.draw((40, len(test.was)), rng=rng))
        passed.append(test.accepts(drawn).mean())
    assert len(passed) > 10
    assert np.mean(passed) <= rules.MAX_SHARE


def test_a_fresh_world_passes_at_least_90_percent_of_the_rows(tests):
    """One of our worlds in the paper's place, testable or not; no long run is needed for it."""
    found = controls.shares([test for test in tests if not test.powerless], NumberTest.fresh)
    assert len(found) > 15
    assert found.mean() >= 0.9


def test_the_rmse_lies_at_the_edge_of_what_five_of_our_worlds_allow(monkeypatch):
    """Its verdict under C holds with a hundred times the draws; under A it hangs on the draw."""
    results, found = results_in(paths.REFERENCE), {}
    for preset, splits, seeds in (("C", 100_000, 3), ("A", 1000, 20)):
        (rmse,) = (t for t in controls.all_tests(results, preset) if t.entry.id == "rmse")
        monkeypatch.setattr("sngr_utils.publish.prediction.SPLITS", splits)
        rngs = map(np.random.default_rng, range(seeds))
        found[preset] = [rmse.cloud.accepts(rmse.values[None], rng=rng)[0] for rng in rngs]
    assert not any(found["C"])
    assert 0 < np.mean(found["A"]) < 1


def test_the_order_of_a_series_matters(tests):
    found = controls.shares(controls.testable(tests), NumberTest.shuffled)
    assert len(found) >= 5
    assert found.mean() < 0.5


def test_a_trigger_that_never_fires_is_asked_where_it_would_print_something(tests):
    asked = [test.entry.id for test in tests if np.isfinite(controls.never_firing(test))]
    assert set(asked) == {
        "tau-clean", "tau-noisy", "precision", "triggered", "seed-tp", "seed-fp",
        "sngr-triggered", "sngr-precision",
    }  # fmt: skip


@pytest.mark.parametrize("preset", "ABC")
def test_a_trigger_that_never_fires_passes_more_of_its_rows_than_the_papers(preset):
    rows = controls.testable(controls.all_tests(results_in(paths.REFERENCE), preset))
    of_triggers = [test for test in rows if test.entry.silent is not None]
    silent, as_printed = (
        controls.shares(of_triggers, passed).sum()
        for passed in (controls.never_firing, controls.as_printed)
    )
    assert silent > as_printed


def test_untestable_rows_are_those_that_most_of_their_range_would_pass(tests):
    results = results_in(paths.REFERENCE)
    for test in tests:
        verdict, _, share = judge._tested(test, results, claims.read().reading)
        dull = share is None or share > rules.MAX_SHARE
        assert (verdict == rules.UNTESTABLE) == dull, test.entry.id


def test_numbers_that_are_counted_once_do_follow():
    """As the paper prints them; where they do not, the row is one that cannot hold."""
    numbers = {path: one.value for path, one in printed.leaves().items()}
    for p in ("0.0", "0.1", "0.2", "0.3"):
        assert numbers["cost", p, "triggered"] == numbers["sngr", p, "triggered"]
        assert numbers["cost", p, "exhaustive"] == numbers["cost", "0.0", "exhaustive"]
        nees = (numbers[table, p, "nees"] for table in ("sngr", "baseline"))
        assert next(nees) == pytest.approx(next(nees), rel=0.01)
    assert numbers["cost", "seconds_per_window", "1"] == numbers["cost", "0.0", "exhaustive"] / 28
    for seed in ("0", "1", "2", "4"):
        row = {
            name: numbers["per_seed_p0.3", seed, name] for name in ("triggered", "tp", "fp", "fn")
        }
        assert row["triggered"] == row["tp"] + row["fp"]
        recall = row["tp"] / (row["tp"] + row["fn"])
        assert numbers["per_seed_p0.3", seed, "recall"] == pytest.approx(recall, abs=0.005)
    for name in ("triggered", "precision", "recall"):
        assert numbers["per_seed_p0.3", "0", name] == numbers["baseline", "0.3", name]
    assert numbers["bimodal", "delta_logp"] == pytest.approx(
        numbers["bimodal", "loglik_ns"] - numbers["bimodal", "loglik_map"]
    )
