"""The claims table: complete, computed, and hooked into the paper and the README."""

import math
import re

import numpy as np
import pytest
from helpers import read_notebook

from sngr_utils import paths
from sngr_utils.publish import (
    claims,
    contradictions,
    judge,
    latex,
    notebooks,
    printed,
    rules,
    verdict_tables,
)
from sngr_utils.publish.results import results_in
from sngr_utils.slam import conventions

VALUES = {  # handed on as single values; all other keys are samples
    "bimodal.map_x", "bimodal.map_y", "bimodal.loglik_saddle_as_printed", "bimodal.map_distance",
    "cost.isam2_seconds", "cost.window_over_isam2",
}  # fmt: skip
N = 30


def value(number):
    return {"value": number, "format": ".2f", "unit": "", "n": 1}


def sample(values):
    values = np.array(values, dtype=float)
    return {
        "value": float(np.nanmean(values)),
        "standard_error": float(np.nanstd(values) / math.sqrt(len(values))),
        "n": len(values),
        "sample": [None if math.isnan(v) else float(v) for v in values],
    }


@pytest.fixture
def results():
    """Made-up results for every key: log-normal worlds, so that verdicts of most kinds occur."""
    rng = np.random.default_rng(5)
    keys = {key for preset in conventions.PRESETS for key in claims.needed(preset)}
    return {
        key: value(2.0) if key in VALUES else sample(rng.lognormal(size=N)) for key in sorted(keys)
    }


CLASHES = contradictions.contradictions(printed.leaves())


def row(results, claim):
    """What `judge.evaluate` has for one claim, without judging all others."""
    (entry,) = [
        entry for entry in [*claims.read().numbers, *claims.read().prose]
        if claim == entry.id or claim.startswith(f"{entry.id}.")
    ]  # fmt: skip
    made = judge._numbers if entry in claims.read().numbers else judge._prose
    (found,) = [row for row in made(entry, results, "C", CLASHES) if row.id == claim]
    return found


def test_every_printed_number_is_judged_exactly_once():
    judged = [path for entry in claims.read().numbers for path in entry.leaves()]
    assert sorted(judged) == sorted(printed.leaves())
    assert len(judged) > 130


def test_claims_are_read_anew_as_they_are_kept():
    assert claims.read.__wrapped__() == claims.read()


def test_entries_are_sound():
    entries = [*claims.read().numbers, *claims.read().prose]
    names = [entry.id for entry in entries]
    assert len(set(names)) == len(names)
    relations = {clash.relation for clash in contradictions.contradictions(printed.leaves())}
    for entry in claims.read().prose:
        assert (entry.share is not None) == (entry.rule == "share"), entry.id
        assert entry.contradicted_by is None or entry.contradicted_by in relations, entry.id
        bounded = {entry.above, entry.at_least, entry.at_most} != {-math.inf, math.inf}
        assert bounded == (entry.rule != "rises"), entry.id
        for text in (entry.ours, entry.minus or ""):
            assert ("{p}" in text) == (bool(text) and entry.p != [""]), entry.id


def test_stated_trends_are_those_of_the_printed_numbers():
    for entry in claims.read().numbers:
        if entry.trend:
            series = [entry.compared(*leaf).value for leaf in entry.leaves().items()]
            known = [value for value in series if value is not None]
            assert (known[-1] > known[0]) == (entry.trend == "rises"), entry.id
            assert "{p}" in entry.ours, entry.id


def test_the_cell_that_decides_exists():
    for entry in [*claims.read().numbers, *claims.read().prose]:
        if (paths.NOTEBOOKS / f"{entry.notebook}.ipynb").exists():
            cells = read_notebook(entry.notebook).cells
            tagged = [cell for cell in cells if entry.cell in cell.metadata.get("tags", [])]
            assert len(tagged) == 1, (entry.notebook, entry.cell)
        else:
            assert entry.notebook == "05_audit"  # the only one that may be on its way


def test_each_row_has_a_verdict_of_the_five(results):
    rows = judge.evaluate(results)
    assert {row.verdict for row in rows} <= set(rules.VERDICTS)
    total = sum(sum(judge.counts(rows, kind).values()) for kind in ("number", "prose"))
    assert total == len(rows) == len(printed.leaves()) + len(claims.read().prose)
    assert len({row.id for row in rows}) == len(rows)
    assert judge.counts(rows, "number")["not comparable"] == 4  # the clock alone


def test_verdicts_follow_the_results(results):
    nees = "audit.C.p0.1.nees"
    results[nees] = sample(np.linspace(100, 200, N))  # printed: 148.52
    assert row(results, "nees.p0.1").verdict == "reproduced"
    results[nees] = sample(np.linspace(1, 2, N))
    results["audit.C.p0.nees"] = sample(np.linspace(0, 1, N))
    results["audit.C.p0.4.nees"] = sample(np.linspace(50, 60, N))
    assert row(results, "nees.p0.1").verdict == "trend reproduced"
    results["audit.C.p0.4.nees"] = results["audit.C.p0.nees"]
    assert row(results, "nees.p0.1").verdict == "not reproduced"
    assert row(results, "nees.p0.1").ours == "1.50 ± 0.05"


def test_contradiction_overrides_agreement(results):
    results["audit.C.p0.4.tau3.96.recall"] = sample(np.full(N, 0.89))
    assert row(results, "recall.p0.4").verdict == "cannot hold"
    assert row(results, "recall.p0.4").why == "the row gives 23/26"
    for p in ("0.2", "0.3", "0.4"):
        results[f"audit.C.p{p}.tau3.96.precision"] = sample(np.ones(N))
    assert row(results, "precision-one").verdict == "cannot hold"
    assert row(results, "precision-one").ours == "30 of 30 [0.88, 1.00]"


def test_seconds_are_judged_by_ratios(results):
    results["cost.window_over_isam2"] = value(600.0)
    assert row(results, "exhaustive-seconds.p0.2").verdict == "reproduced"
    assert row(results, "exhaustive-seconds.p0.2").printed == "336 (600)"
    results["audit.C.p0.1.saving"] = sample(np.r_[math.nan, np.ones(N - 1)])
    silent = row(results, "refine-seconds.p0.1")  # printed: no window refined, 0 s
    assert (silent.printed, silent.verdict, silent.n) == ("0", "reproduced", "29 of 30")
    assert row(results, "isam2-seconds.p0.0").verdict == "not comparable"


def test_prose_is_judged_world_by_world(results):
    key = "audit.C.p0.tau3.92.triggered"
    results[key] = sample(np.r_[np.zeros(28), 3, 4])
    assert row(results, "no-false-alarm").verdict == "trend reproduced"
    results[key] = sample(np.zeros(N))
    assert row(results, "no-false-alarm").verdict == "reproduced"
    before, after = np.linspace(1, 2, N), np.linspace(1, 2, N) * 1.04
    for p in ("0.2", "0.3"):
        results[f"audit.C.p{p}.pose_rmse"] = sample(before)
        results[f"audit.C.p{p}.sngr_pose_rmse"] = sample(after)
    assert row(results, "rmse-unchanged").verdict == "reproduced"
    results["audit.C.p0.3.sngr_pose_rmse"] = sample(after * 1.02)  # at each p, or it fails
    assert row(results, "rmse-unchanged").verdict == "not reproduced"
    results["audit.C.p0.1.tau3.96.recall"] = sample(np.r_[np.full(5, math.nan), np.zeros(25)])
    assert row(results, "blind-spot").ours == "25 of 25 [0.86, 1.00]"
    assert row(results, "saddle").verdict == "not reproduced"
    results["bimodal.map_y"] = value(1e-17)
    assert row(results, "saddle").verdict == "reproduced"


def test_keys_are_filled_with_numbers_in_their_shortest_form():
    names = {"p": "0.0", "tau": "4.00", "end": "last", "odd": "1.2.3"}
    assert claims.key("{preset}.{p}.{tau}.{end}.{odd}", "B", names) == "B.0.4.last.1.2.3"
    assert claims.key("plain", "B", {}) == "plain"


def test_needed_keys_are_those_of_all_claims_each_once():
    needed = claims.needed("A")
    assert len(set(needed)) == len(needed)
    assert needed[0] == "bimodal.map_x"
    for key in ("audit.A.p0.4.nees", "audit.A.p0.tau4.triggered", "audit.A.p0.1.tau3.96.recall"):
        assert key in needed
    assert not any("{" in key for key in needed)


def test_compared_is_the_number_its_magnitude_or_a_ratio():
    path = ("bimodal", "ns_best", "1")
    plain = number_entry(printed="bimodal/ns_best/1")
    assert plain.leaves() == {path: {}}
    assert plain.compared(path, {}).value == -2.232
    assert number_entry(magnitude=True).compared(path, {}).value == 2.232
    ends = ("cost/{p}/exhaustive", "cost/{p}/refine")
    path, names = ("cost", "0.0", "refine"), {"p": "0.0"}
    ratio = number_entry(printed="cost/{p}/refine", ratio=ends).compared(path, names)
    assert ratio.value == pytest.approx(336 / 44)
    halved = number_entry(printed="cost/{p}/refine", ratio=ends, per=2.0).compared(path, names)
    assert halved.value == pytest.approx(168 / 44)


@pytest.mark.parametrize(
    ("rule", "given", "text", "verdict", "why"),
    [
        ("clock", value(1.0), "0.02", "not comparable",
         "the clock that other seconds are measured with"),
        ("hardware", value(30.0), "20", "reproduced", "a ratio of wall clocks"),
        ("hardware", value(150.0), "20", "trend reproduced", "a ratio of wall clocks"),
        ("hardware", value(900.0), "20", "not reproduced", "a ratio of wall clocks"),
        ("deterministic", value(2.004), "2.00", "reproduced", "rounding"),
        ("deterministic", value(2.006), "2.00", "not reproduced", "rounding"),
        ("deterministic", value(None), "null", "reproduced", "rounding"),
        ("one_world", sample(np.arange(30.0) / 100), "0.3", "reproduced",
         "a further world: 0 to 0.29"),
        ("one_world", sample(np.r_[math.nan, np.arange(29.0)]), "40", "not reproduced",
         "a further world: undefined to 28"),
        ("mean_of_five", sample(np.arange(30.0)), "14.5", "reproduced",
         "mean of five further worlds"),
        ("mean_of_five", sample(np.arange(30.0)), "40", "not reproduced",
         "mean of five further worlds"),
        ("std_of_five", sample(np.arange(30.0)), "8.8", "reproduced",
         "std of five further worlds"),
        ("std_of_five", sample(np.arange(30.0)), "14.5", "not reproduced",
         "std of five further worlds"),
    ],
)  # fmt: skip
def test_each_rule_gives_its_verdict_and_what_decides(rule, given, text, verdict, why):
    found = judge._number_verdict(rule, {"x": given}, "x", printed.number(text))
    assert found == (verdict, why)


def test_ours_is_a_mean_with_its_error_to_the_digits_that_are_printed():
    shown = sample([1.0, 2.0, 6.0, math.nan])
    shown["standard_error"] = 1.52752
    assert judge._ours(shown, 3) == ("3.000 ± 1.528", "3 of 4", 3.0)
    assert judge._ours(shown, 0) == ("3.0 ± 1.5", "3 of 4", 3.0)  # a mean of counts is no count
    assert judge._ours(sample([2.0, 2.0]), 1) == ("2.0 ± 0.0", "2", 2.0)
    single = {"value": 5.25, "n": 7, "standard_error": None}
    assert judge._ours(single, 0) == ("5", "7", 5.25)
    assert judge._ours({"value": None, "n": 0}, 2) == ("–", "0", None)


def test_spread_is_that_of_the_sample_with_the_error_a_gaussian_has():
    """Of n - 1 degrees of freedom s has a standard error of s / sqrt(2 n - 2)."""
    given = sample([1.0, 3.0, 5.0, math.nan])
    found = judge._spread(given)
    assert (found["value"], found["standard_error"]) == pytest.approx((2.0, 1.0))
    assert found["sample"] == given["sample"]
    for few in ([1.0], [math.nan, 2.0], [math.nan]):
        found = judge._spread({"sample": [None if math.isnan(x) else x for x in few]})
        assert (found["value"], found["standard_error"]) == (None, None)
    two = judge._spread(sample([1.0, 3.0]))
    assert (two["value"], two["standard_error"]) == pytest.approx((math.sqrt(2), 1.0))


def number_entry(**changes):
    given = {
        "id": "made", "where": "tab", "what": "it", "printed": "baseline/{p}/nees", "ours": "x.{p}",
        "rule": "one_world", "notebook": "05_audit", "cell": "claim", **changes,
    }  # fmt: skip
    return claims.NumberEntry(**given)


def test_rows_of_a_series():
    """Printed: 0.36 148.52 210.15 458.26 745.23. Ours rises from 0.36, but not as far."""
    entry = number_entry(trend="rises")
    shares = {"0": 0.36, "0.1": 148.52, "0.2": 2.0, "0.3": 3.0, "0.4": 4.0}
    results = {f"x.{p}": sample(np.full(N, mean)) for p, mean in shares.items()}
    clash = contradictions.Contradiction((("baseline", "0.3", "nees"),), "made", "cannot be")
    rows = list(judge._numbers(entry, results, "C", [clash]))
    assert [row.id for row in rows] == [f"made.p{p}" for p in ("0.0", "0.1", "0.2", "0.3", "0.4")]
    assert [row.verdict for row in rows] == [
        "reproduced", "reproduced", "trend reproduced", "cannot hold", "trend reproduced"
    ]  # fmt: skip
    assert [row.why for row in rows[2:4]] == ["a further world: 2 to 2", "cannot be"]
    first = rows[0]
    assert (first.entry, first.kind, first.where, first.what) == ("made", "number", "tab", "it")
    assert (first.printed, first.ours, first.values, first.n) == (
        "0.36", "0.36 ± 0.00", (0.36, pytest.approx(0.36)), "30"
    )  # fmt: skip
    assert (first.rule, first.notebook, first.cell) == ("one_world", "05_audit", "claim")
    results["x.0.4"] = results["x.0"]  # no trend any more
    assert [row.verdict for row in judge._numbers(entry, results, "C", [])][2:] == [
        "not reproduced"
    ] * 3


def test_a_trend_is_that_between_the_levels_at_which_a_number_is_printed():
    """Precision is a dash at p = 0 and 0.1: what ours does there is no part of the series."""
    entry = number_entry(printed="baseline/{p}/precision", trend="falls")
    results = {f"x.{p}": sample(np.linspace(0, 1, N)) for p in ("0.3",)}
    results["x.0.2"] = sample(np.linspace(0, 1, N) + 3)
    results["x.0.4"] = sample(np.linspace(0, 1, N) + 2)
    results |= {f"x.{p}": sample(np.full(N, 9.0)) for p in ("0", "0.1")}
    assert judge._has_trend(entry, results, "C")
    assert not judge._has_trend(number_entry(trend="rises"), results, "C")
    results["x.0.4"] = sample(np.linspace(0, 1, N) + 4)
    assert not judge._has_trend(entry, results, "C")


def test_a_ratio_is_shown_beside_what_is_printed():
    entry = number_entry(
        printed="cost/{p}/refine", ratio=("cost/{p}/exhaustive", "cost/{p}/refine"), per=2.0
    )
    results = {f"x.{p}": sample(np.full(N, 3.8)) for p in ("0", "0.1", "0.2", "0.3")}
    first, second = list(judge._numbers(entry, results, "C", []))[:2]
    assert (first.printed, first.verdict) == ("44 (3.82)", "reproduced")  # 336 / 44 / 2
    assert first.values[0] == pytest.approx(336 / 88)
    assert (second.printed, second.values[0]) == ("0", None)
    assert first.ours == "3.8 ± 0.0"
    whole = number_entry(printed="cost/{p}/exhaustive", ours="x.0", per=1.0,
                         ratio=("cost/{p}/exhaustive", "cost/{p}/isam2"))  # fmt: skip
    assert next(judge._numbers(whole, results, "C", [])).printed == "336 (1.68e+04)"


def test_rows_are_named_after_all_that_tells_them_apart():
    entry = number_entry(printed="{table}/{p}/nees", ours="x")
    rows = judge._numbers(entry, {"x": sample(np.zeros(N))}, "C", [])
    assert {"made.tablebaseline.p0.4", "made.tablesngr.p0.0"} < {row.id for row in rows}


def test_a_printed_spread_is_compared_with_a_spread():
    entry = number_entry(printed="baseline/{p}/rmse_std", rule="std_of_five")
    worlds = sample(np.arange(30.0))
    results = {f"x.{p}": worlds for p in ("0", "0.1", "0.2", "0.3", "0.4")}
    first = next(judge._numbers(entry, results, "C", []))
    spread = math.sqrt(30 * 31 / 12)
    assert first.values == (0.06, pytest.approx(spread))
    assert first.ours == f"{spread:.2f} ± {spread / math.sqrt(58):.2f}"


def prose(**changes):
    """A claim in words about the samples "x" and, if it says so, "y"."""
    given = {
        "id": "made", "where": "sec", "says": "so", "ours": "x", "rule": "share", "share": 0.8,
        "notebook": "05_audit", "cell": "claim", **changes,
    }  # fmt: skip
    return claims.ProseEntry(**given)


def judged(entry, results, clashes=()):
    (found,) = judge._prose(entry, results, "C", list(clashes))
    return found


@pytest.mark.parametrize(
    ("bounds", "expected"),
    [
        ({"above": 1.0}, [False, False, True, True]),
        ({"at_least": 1.0}, [False, True, True, True]),
        ({"at_most": 1.0}, [True, True, False, False]),
        ({"at_least": 1.0, "at_most": 2.0}, [False, True, True, False]),
        ({"at_most": 1.0, "magnitude": True}, [False, True, False, False]),
    ],
)
def test_bounds_of_a_claim_are_open_above_and_closed_elsewhere(bounds, expected):
    results = {"x": sample([-2.0, 1.0, 2.0, 3.0])}
    assert judge.claim_holds(prose(**bounds), results, "C").tolist() == expected


def test_claims_about_differences_are_relative_where_they_say_so():
    results = {"x": sample([3.0, 1.0, 2.0]), "y": sample([2.0, 2.0, math.nan])}
    holds = [
        judge.claim_holds(prose(minus="y", relative=relative, at_most=0.5), results, "C")
        for relative in (False, True)
    ]
    assert [found.tolist() for found in holds] == [[False, True], [True, True]]


def test_a_claim_at_several_levels_holds_in_a_world_where_it_holds_at_all_that_are_defined():
    results = {
        "x0.1": sample([1.0, 1.0, math.nan, math.nan]),
        "x0.2": sample([1.0, -1.0, 1.0, math.nan]),
    }
    entry = prose(ours="x{p}", p=["0.1", "0.2"], above=0.0)
    assert judge.claim_holds(entry, results, "C").tolist() == [True, False, True]


def test_a_share_is_shown_with_its_interval_and_without_worlds_as_nothing():
    found = judged(prose(above=0.0), {"x": sample([1.0] * 29 + [-1.0])})
    assert (found.ours, found.n, found.verdict) == ("29 of 30 [0.83, 1.00]", "30", "reproduced")
    assert (found.kind, found.printed, found.values, found.rule) == (
        "prose",
        "–",
        (None,) * 2,
        "share",
    )
    assert (found.id, found.entry, found.where, found.what) == ("made", "made", "sec", "so")
    assert (found.notebook, found.cell, found.rule) == ("05_audit", "claim", "share")
    assert found.why == ""
    found = judged(prose(above=0.0), {"x": {"value": None, "n": 2, "sample": [None, None]}})
    assert (found.ours, found.n, found.verdict) == ("0 of 0", "0", "not reproduced")


def test_a_claim_that_something_rises_shows_the_mean_change_and_its_error():
    """Changes of 1, 2 and 3, one world undefined: 2 with a standard error of 1 / sqrt 3."""
    results = {"x": sample([2.0, 4.0, 6.0, math.nan]), "y": sample([1.0, 2.0, 3.0, 0.0])}
    entry = prose(rule="rises", minus="y", share=None)
    found = judged(entry, results)
    assert (found.ours, found.n) == ("2.00 ± 0.58", "3")
    assert found.verdict == "not reproduced"  # t = 3.46 with 2 degrees of freedom: 4.30 is asked
    results["x"] = sample([2.0, 3.01, 4.02, math.nan])
    assert judged(entry, results).verdict == "reproduced"
    falls = judged(prose(rule="rises", ours="y", minus="x", share=None), results)
    assert (falls.verdict, falls.ours) == ("not reproduced", "−1.01 ± 0.01")
    alone = {"x": sample([3.0, math.nan]), "y": sample([1.0, 1.0])}
    assert judged(entry, alone).ours == "2.00"
    nothing = {"x": sample([1.0, math.nan]), "y": sample([math.nan, 1.0])}
    assert (judged(entry, nothing).ours, judged(entry, nothing).n) == ("–", "0")


def test_a_claim_about_one_value_shows_it():
    entry = prose(rule="value", share=None, at_most=0.01, magnitude=True)
    found = judged(entry, {"x": value(-0.009876)})
    assert (found.ours, found.n, found.verdict) == ("−0.00988", "1", "reproduced")
    assert judged(entry, {"x": value(0.02)}).verdict == "not reproduced"
    assert judged(entry, {"x": value(12345.6)}).ours == "1.23e+04"
    assert judged(entry, {"x": value(None)}).verdict == "not reproduced"
    other = prose(rule="value", share=None, ours="{preset}.x", at_least=1.0)
    assert judged(other, {"A.x": value(0.0), "C.x": value(1.0)}).verdict == "reproduced"


def test_a_contradiction_is_named_where_a_claim_rests_on_it():
    clash = contradictions.Contradiction((), "broken", "it says both")
    results = {"x": sample([1.0] * 30)}
    entry = prose(above=0.0, contradicted_by="broken")
    found = judged(entry, results, [clash])
    assert (found.verdict, found.why) == ("cannot hold", "it says both")
    assert judged(entry, results).verdict == "reproduced"
    assert judged(prose(above=0.0), results, [clash]).verdict == "reproduced"


def test_the_reading_is_that_of_the_yaml_and_the_others_differ(results):
    results["audit.A.p0.1.nees"] = sample(np.full(N, 148.52))
    assert claims.read().reading == "C"
    ours, other = ({row.id: row for row in judge.evaluate(results, p)} for p in (None, "A"))
    assert other["nees.p0.1"].verdict == "reproduced"
    assert ours["nees.p0.1"].verdict != "reproduced"
    for claim in ("nees.p0.1", "rmse-std.p0.2", "precision-one", "saddle"):
        assert ours[claim] == row(results, claim)


def test_missing_results_are_counted_and_the_first_ones_named(results):
    keys = claims.needed("C")[4:14]
    rest = {key: entry for key, entry in results.items() if key not in keys}
    with pytest.raises(notebooks.ProjectError) as raised:
        judge.evaluate(rest)
    assert str(raised.value) == (
        f"paper/claims.yaml needs {keys[0]!r}, which no notebook hands on; nor are 9 more: "
        f"{', '.join(keys[1:8])} ..."
    )
    for missing, more in ((1, ""), (2, f"; nor are 1 more: {keys[1]} ...")):
        rest |= {key: results[key] for key in keys[missing:]}
        with pytest.raises(notebooks.ProjectError) as raised:
            judge.evaluate({key: rest[key] for key in rest if key not in keys[:missing]})
        assert str(raised.value).endswith(f"which no notebook hands on{more}")


def test_missing_results_are_named(results):
    del results["audit.C.p0.1.nees"]
    with pytest.raises(notebooks.ProjectError, match=r"'audit\.C\.p0\.1\.nees', which no note"):
        judge.evaluate(results)
    results["audit.C.p0.1.nees"] = sample(np.ones(19))
    with pytest.raises(notebooks.ProjectError, match=r"claim 'nees': 19 worlds"):
        judge.evaluate(results)
    results["audit.C.p0.1.nees"] = value(1.0)
    with pytest.raises(notebooks.ProjectError, match="must be a sample"):
        judge.evaluate(results)


def test_tables_for_latex(results):
    judged = verdict_tables.judged(results)
    made = verdict_tables.result(judged)
    files = latex.latex([made])
    rows = judged["C"]
    n = judge.counts(rows, "number")["reproduced"]
    assert rf"res@claims.numbers.reproduced\endcsname{{{n}}}" in files["values.tex"]
    assert made["values"]["claims.numbers.total"]["value"] == len(printed.leaves())
    tally = np.array([line[6:] for line in made["tables"]["claims_groups"]["rows"]], dtype=int)
    assert tally.sum() == len(printed.leaves())
    assert files["tab_claims_prose.tex"].count(r"\\") == len(claims.read().prose) + 1
    full = verdict_tables.chunks(rows)
    pages = math.ceil(len(rows) / verdict_tables.ROWS_PER_PAGE)
    assert full.count(r"\begin{table*}") == full.count(r"\bottomrule") == pages
    assert full.count("claim-") == len(rows)
    assert not re.search(r"(?<!\\)[_%#]", full)


def test_readme_block_is_written_between_its_markers(results, tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "README", tmp_path / "README.md")
    blocks = f"{verdict_tables.BEGIN}\nold\n{verdict_tables.END}"
    paths.README.write_text(f"before\n{blocks}\nafter\n")
    made = verdict_tables.judged(results)
    block = verdict_tables.readme_block(made)
    monkeypatch.setattr(verdict_tables, "judged", lambda given: made if given is results else None)
    for _ in range(2):  # writing it again changes nothing
        verdict_tables.update_readme(results)
        text = paths.README.read_text()
        assert text == f"before\n{block}\nafter\n"
    assert "| numbers, preset C (our reading) |" in block
    paths.README.write_text("no markers")
    with pytest.raises(notebooks.ProjectError, match="lacks the lines"):
        verdict_tables.update_readme(results)


def test_the_readme_has_the_verdicts_of_the_committed_reference():
    text = paths.README.read_text(encoding="utf-8")
    assert verdict_tables.BEGIN in text
    assert verdict_tables.END in text
    if not (paths.NOTEBOOKS / "05_audit.ipynb").exists():
        pytest.skip("no audit yet")
    judged = verdict_tables.judged(results_in(paths.REFERENCE))
    assert verdict_tables.readme_block(judged) in text
