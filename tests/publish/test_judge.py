"""The claims table: complete, computed, and hooked into the paper and the README."""

import math
import re

import numpy as np
import pytest
from helpers import read_notebook
from scipy import stats

from sngr_utils import paths
from sngr_utils.publish import (
    claims,
    contradictions,
    files,
    judge,
    latex,
    notebooks,
    number_tests,
    printed,
    rules,
    verdict_tables,
)
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
    rows = list(made(entry, results, "C", CLASHES))
    (found,) = [row for row in rows if claim in (row.id, *(one.id for one in row.numbers))]
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


def test_each_row_has_a_verdict_and_each_number_one_row(results):
    rows = judge.evaluate(results)
    assert {row.verdict for row in rows} <= set(rules.VERDICTS)
    total = sum(sum(judge.counts(rows, kind).values()) for kind in ("number", "prose"))
    assert total == len(rows)
    assert len({row.id for row in rows}) == len(rows)
    numbers = [one.id for row in rows for one in row.numbers]
    assert len(set(numbers)) == len(numbers) == len(printed.leaves())
    assert judge.counts(rows, "number")["not comparable"] == 1  # the clock alone


LEVELS = ("0", "0.1", "0.2", "0.3", "0.4")


def nees_like_the_paper():
    """(30, 5) worlds whose NEES rises as the printed one does, by some 30 % around it."""
    rng = np.random.default_rng(8)
    printed_series = np.array([0.36, 148.52, 210.15, 458.26, 745.23])
    return printed_series * rng.lognormal(sigma=0.3, size=(N, 5))


def test_verdicts_follow_the_results(results):
    keys, worlds = [f"audit.C.p{p}.nees" for p in LEVELS], nees_like_the_paper()
    results |= {key: sample(worlds[:, i]) for i, key in enumerate(keys)}
    found = row(results, "nees")
    assert (found.verdict, len(found.numbers)) == ("reproduced", 5)
    assert found.share < 0.15
    results |= {key: sample(worlds[:, i] / 100) for i, key in enumerate(keys)}
    assert row(results, "nees").verdict == "trend reproduced"
    results |= {key: sample(worlds[:, 0]) for key in keys}
    assert row(results, "nees").verdict == "not reproduced"
    rng = np.random.default_rng(9)
    results |= {key: sample(10 ** rng.uniform(-2, 4, N)) for key in keys}
    assert row(results, "nees").verdict == "untestable"


def test_contradiction_overrides_agreement(results):
    results["audit.C.p0.4.tau3.96.recall"] = sample(np.full(N, 0.89))
    assert row(results, "recall.p0.4").verdict == "cannot hold"
    assert row(results, "recall.p0.4").why == "the row gives 23/26"
    assert row(results, "recall.p0.3").verdict == "follows"
    for p in ("0.2", "0.3", "0.4"):
        results[f"audit.C.p{p}.tau3.96.precision"] = sample(np.ones(N))
    assert row(results, "precision-one").verdict == "cannot hold"
    assert row(results, "precision-one").ours == "30 of 30 [0.88, 1.00]"


def test_seconds_are_judged_by_ratios(results):
    results["cost.window_over_isam2"] = value(600.0)
    first, other = (row(results, f"exhaustive-seconds.p{p}") for p in ("0.0", "0.2"))
    assert (first.verdict, first.printed) == ("reproduced", "336 (600)")
    width = math.log10(4 * 336.5 / 335.5 * 0.025 / 0.015)  # twice either way, and the rounding
    assert first.share == pytest.approx(width / 10, abs=1e-3)
    assert (other.verdict, other.why) == ("follows", "the seconds at p = 0")
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
    assert claims.key("{small}", "B", {"small": "0.00001"}) == "1e-05"
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
    ("rule", "given", "verdict", "why"),
    [
        ("clock", value(1.0), "not comparable", "the clock that other seconds are measured with"),
        ("hardware", value(3.0), "reproduced", "a ratio of wall clocks"),
        ("hardware", value(15.0), "trend reproduced", "a ratio of wall clocks"),
        ("hardware", value(90.0), "not reproduced", "a ratio of wall clocks"),
        ("deterministic", value(2.2364), "reproduced", "rounding"),
        ("deterministic", value(2.2366), "not reproduced", "rounding"),
        ("one_world", sample(2.2 + np.arange(30) / 100), "reproduced", "a further world"),
        ("one_world", sample(2.3 + np.arange(30) / 100), "not reproduced", "a further world"),
        ("one_world", sample(np.arange(30) / 10), "untestable",
         "97% of what could be would be accepted"),
        ("one_world", sample(np.r_[np.full(11, math.nan), np.full(19, 2.236)]), "untestable",
         "too few worlds define it"),
        ("mean_of_five", sample(2.2 + np.arange(30) / 400), "reproduced",
         "mean of five further worlds"),
        ("mean_of_five", sample(2.3 + np.arange(30) / 400), "not reproduced",
         "mean of five further worlds"),
    ],
)  # fmt: skip
def test_each_rule_gives_its_verdict_and_what_decides(rule, given, verdict, why):
    """Of the one number 2.236."""
    natural = "clocks" if rule == "hardware" else "distance"
    entry = number_entry(printed="bimodal/error_from_mode_map", ours="x", rule=rule, range=natural)
    (found,) = judge._numbers(entry, {"x": given}, "C", [])
    assert (found.verdict, found.why) == (verdict, why)
    if rule == "deterministic":  # of the lengths up to 3 m only those that round to ours would do
        assert found.share == pytest.approx(0.001 / 3.001)


def test_a_number_stands_beside_what_would_have_been_accepted_and_its_rank():
    entry = number_entry(printed="bimodal/error_from_mode_map", ours="x", range="distance")
    worlds = np.r_[np.full(10, 2.0), np.full(10, 2.236), np.full(10, 2.3)]
    (found,) = judge._numbers(entry, {"x": sample(worlds)}, "C", [])
    (one,) = found.numbers
    assert (one.printed, one.ours, one.n) == ("2.236", "2.236", "30")
    assert (one.accepted, one.rank) == ("2.000 to 2.300", "11-21 of 31")
    assert one.covered == pytest.approx(0.301 / 3.001)
    assert judge._rank(5.0, np.array([1.0, 2.0])) == "3 of 3"


def number_entry(**changes):
    given = {
        "id": "made", "where": "tab", "what": "it", "printed": "baseline/{p}/nees", "ours": "x.{p}",
        "rule": "one_world", "range": "nees", "notebook": "05_audit", "cell": "claim", **changes,
    }  # fmt: skip
    return claims.NumberEntry(**given)


def test_a_series_is_one_row_without_what_contradicts_or_follows():
    entry, worlds = number_entry(trend="rises"), nees_like_the_paper()
    results = {f"x.{p}": sample(worlds[:, i]) for i, p in enumerate(LEVELS)}
    clash = contradictions.Contradiction((("baseline", "0.3", "nees"),), "made", "cannot be")
    first, series = judge._numbers(entry, results, "C", [clash])
    assert (first.id, first.verdict, first.why) == ("made.p0.3", "cannot hold", "cannot be")
    assert (series.id, series.entry, series.kind) == ("made", "made", "number")
    assert (series.verdict, series.printed) == ("reproduced", "0.36, 148.52, 210.15, 745.23")
    shown = [one.id for one in series.numbers]
    assert shown == ["made.p0.0", "made.p0.1", "made.p0.2", "made.p0.4"]
    ranks = [int(one.rank.split(" ")[0].split("-")[0]) for one in series.numbers]
    assert all(3 < rank < 29 for rank in ranks)
    (whole,) = judge._numbers(entry, results, "C", [])
    assert len(whole.numbers) == 5


def test_a_trend_is_that_between_the_levels_at_which_a_number_is_printed():
    """Precision is a dash at p = 0 and 0.1: what ours does there is no part of the series."""
    series = {"printed": "baseline/{p}/precision", "range": "share"}
    results = {f"x.{p}": sample(np.full(N, 9.0)) for p in LEVELS}
    results["x.0.2"] = sample(np.linspace(0, 1, N) + 3)

    def has_trend(last=5, **trend):
        entry = number_entry(**series, **trend)
        (test,) = number_tests.tests(entry, results, "C", list(entry.leaves())[-last:])
        return judge._has_trend(test, results, "C")

    results["x.0.4"] = sample(np.linspace(0, 1, N) + 2)
    assert has_trend(trend="falls")
    assert not has_trend(trend="rises")
    assert not has_trend()
    results["x.0.3"] = sample(np.linspace(0, 1, N) + 3)
    assert has_trend(last=2, trend="falls")
    assert not has_trend(last=1, trend="falls")
    results["x.0.4"] = sample(np.linspace(0, 1, N) + 4)
    assert not has_trend(trend="falls")


def test_rows_are_named_after_all_that_tells_them_apart():
    entry = number_entry(printed="{table}/{p}/triggered", ours="x", rule="clock")
    rows = judge._numbers(entry, {"x": value(1.0)}, "C", [])
    ids = {row.id: row.where for row in rows}
    assert ids["made.tablebaseline.p0.4"] == ids["made.tablesngr.p0.0"] == "tab"


def test_a_mean_is_undefined_where_a_world_is():
    entry = number_entry(printed="bimodal/error_from_mode_map", ours="x", rule="mean_of_five")
    worlds = sample(np.r_[np.ones(29), math.nan])
    with pytest.raises(ValueError, match="a mean of five worlds needs a defined value"):
        list(judge._numbers(entry, {"x": worlds}, "C", []))


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
    assert (found.kind, found.printed, found.numbers, found.rule) == ("prose", "–", (), "share")
    assert (found.id, found.entry, found.where, found.what) == ("made", "made", "sec", "so")
    assert (found.notebook, found.cell, found.rule) == ("05_audit", "claim", "share")
    assert found.why == ""
    found = judged(prose(above=0.0), {"x": {"value": None, "n": 2, "sample": [None, None]}})
    assert (found.ours, found.n, found.verdict) == ("0 of 0", "0", "not reproduced")


def test_a_claim_that_something_rises_counts_worlds():
    results = {"x": sample([*np.full(9, 2.0), math.nan, 1.0]), "y": sample(np.ones(11))}
    entry = prose(rule="rises", minus="y", share=None)
    found = judged(entry, results)
    assert (found.ours, found.n, found.verdict) == ("up in 9, down in 0", "10", "reproduced")
    falls = judged(prose(rule="rises", ours="y", minus="x", share=None), results)
    assert (falls.verdict, falls.ours) == ("not reproduced", "up in 0, down in 9")
    nothing = {"x": sample([1.0, math.nan]), "y": sample([math.nan, 1.0])}
    assert (judged(entry, nothing).ours, judged(entry, nothing).n) == ("up in 0, down in 0", "0")


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
    worlds = nees_like_the_paper()
    results |= {f"audit.A.p{p}.nees": sample(worlds[:, i]) for i, p in enumerate(LEVELS)}
    assert claims.read().reading == "C"
    ours, other = ({row.id: row for row in judge.evaluate(results, p)} for p in (None, "A"))
    assert other["nees"].verdict == "reproduced"
    assert ours["nees"].verdict != "reproduced"
    for claim in ("nees", "rmse-std", "precision-one", "saddle"):
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


def test_tables_for_latex(verdicts):
    made = verdict_tables.result(verdicts)
    typeset = latex.latex([made])
    rows = verdicts.read
    n = judge.counts(rows, "number")["reproduced"]
    assert rf"res@claims.numbers.reproduced\endcsname{{{n}}}" in typeset["values.tex"]
    assert made["values"]["claims.printed"]["value"] == len(printed.leaves())
    assert typeset["tab_claims_prose.tex"].count(r"\\") == len(claims.read().prose) + 1
    assert len(made["tables"]["claims_controls"]["rows"]) == len(verdict_tables.CONTROLS)
    full, lines = verdict_tables.whole(rows), len(printed.leaves()) + len(claims.read().prose)
    assert full.startswith(r"\begin{longtable}")
    assert full.count("id & printed") == 2  # on the first page, and on those that follow
    assert full.count("claim-") == lines
    assert not re.search(r"(?<!\\)[_%#]", full)


def test_the_main_paper_shows_what_each_test_could_have_refused(verdicts):
    """The fewest of 30 worlds whose share has a lower exact limit of four fifths: 29."""
    shown = verdict_tables.headline(verdicts.rows).set_index("claim")
    assert list(shown["printed"]) == [
        next(row.printed for row in verdicts.read if row.id == name)
        for name in claims.read().headline
    ]
    assert shown.loc["the trajectory error grows with p", "power"] == "needs 29 of 30"
    assert stats.binomtest(29, 30).proportion_ci(0.95, "exact").low > 0.8
    assert stats.binomtest(28, 30).proportion_ci(0.95, "exact").low < 0.8
    nees = next(row for row in verdicts.read if row.id == "nees")
    assert shown.loc["NEES", "power"] == f"refuses {1 - nees.share:.0%}".replace("%", " %")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("headline: [inc", "headline: [inc", ""),
        ("headline: [inconsistent", "headline: [nothing", "'nothing' is the id of no claim"),
        ("rule: mean_of_five", "rule: mean_of_6", r"yaml, claim 'rmse': rule: Input should be"),
        ("reading: C", "reading: D", r"yaml: reading: Input should be"),
        ("rule: std_of_five", "rule: std_of_five, ratio: [a/b, c/d]", "'rmse-std': .'a', 'b'"),
        ('"baseline/{p}/nees"', '"base/{p}/nees"', "claim 'nees': 'base/{p}/nees' is not among"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_claim_is_a_sentence(monkeypatch, tmp_path, old, new, message):
    text = paths.CLAIMS.read_text(encoding="utf-8")
    assert old in text
    monkeypatch.setattr(paths, "CLAIMS", tmp_path / "claims.yaml")
    monkeypatch.setattr(claims, "read", claims.read.__wrapped__)  # which keeps nothing
    paths.CLAIMS.write_text(text.replace(old, new, 1), encoding="utf-8")
    if not message:
        claims.check()
        return
    with pytest.raises(notebooks.ProjectError, match=message):
        claims.check()


def test_readme_block_is_written_between_its_markers(verdicts, tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "README", tmp_path / "README.md")
    blocks = f"{verdict_tables.BEGIN}\nold\n{verdict_tables.END}"
    paths.README.write_text(f"before\n{blocks}\nafter\n")
    block = verdict_tables.readme_block(verdicts)
    for _ in range(2):  # writing it again changes nothing
        verdict_tables.update_readme(verdicts)
        text = paths.README.read_text()
        assert text == f"before\n{block}\nafter\n"
    assert "| preset C, our reading |" in block
    assert block.count("\n|") == 2 + len(verdict_tables.README_ROWS)
    paths.README.write_text("no markers")
    with pytest.raises(notebooks.ProjectError, match="lacks the lines"):
        verdict_tables.update_readme(verdicts)


def test_the_readme_has_the_verdicts_of_the_committed_reference(verdicts):
    assert verdict_tables.readme_block(verdicts) in paths.README.read_text(encoding="utf-8")


def test_the_committed_verdicts_are_those_of_the_reference(verdicts):
    committed = files.read_json(paths.VERDICTS)
    assert committed == {name: verdict_tables.record(rows) for name, rows in verdicts.rows.items()}
