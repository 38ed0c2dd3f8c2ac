import math

import pandas as pd
import pytest

from sngr_utils import bimodal, paths, trigger_sweep
from sngr_utils.__main__ import main
from sngr_utils.publish import (
    cells,
    execution,
    files,
    notebooks,
    report,
    verdict_tables,
    verify,
)
from sngr_utils.show import bimodal as show_bimodal
from sngr_utils.show import trigger_sweep as show_trigger_sweep


def entry(value, kind, size, error=None):
    made = {"value": value, "format": ".2f", "tolerance": {"kind": kind, "size": size}}
    return made if error is None else {**made, "standard_error": error}


@pytest.mark.parametrize(
    ("old", "new", "holds"),
    [
        (entry(3.0, "exact", 0), entry(3.0, "exact", 0), True),
        (entry(3.0, "exact", 0), entry(4.0, "exact", 0), False),
        (entry(1.0, "absolute", 0.05), entry(1.05, "absolute", 0.05), True),
        (entry(1.0, "absolute", 0.05), entry(1.06, "absolute", 9.0), False),
        (entry(1.0, "standard errors", 3, 0.1), entry(1.29, "standard errors", 3, 0.1), True),
        (entry(1.0, "standard errors", 3, 0.1), entry(1.31, "standard errors", 3, 9.0), False),
        (entry(None, "exact", 0), entry(None, "exact", 0), True),
        (entry(None, "exact", 0), entry(1.0, "exact", 0), False),
        (entry(1.0, "exact", 0), entry(None, "exact", 0), False),
        (entry(math.inf, "exact", 0), entry(math.inf, "exact", 0), True),
        # no error to count by: the printed digits decide
        (entry(1.0, "standard errors", 3, 0.0), entry(1.0, "standard errors", 3, 0.0), True),
        (entry(1.0, "standard errors", 3, 0.0), entry(1.004, "standard errors", 3, 0.0), True),
        (entry(1.0, "standard errors", 3, 0.0), entry(1.006, "standard errors", 3, 0.1), False),
        (entry(1.0, "standard errors", 3), entry(1.006, "standard errors", 3, 0.1), False),
        (entry(1.0, "standard errors", 3, math.nan), entry(1.006, "exact", 0), False),
    ],
)
def test_each_kind_of_tolerance_can_hold_and_can_fail(old, new, holds):
    (row,) = verify.compare_values({"k": old}, {"k": new})
    assert row.holds is holds
    assert ("BREACH" in verify.table([row])) is not holds


def test_a_key_on_one_side_only_is_a_breach():
    rows = verify.compare_values({"a": entry(1.0, "exact", 0)}, {"b": entry(1.0, "exact", 0)})
    assert [row.key for row in rows if not row.holds] == ["a", "b"]


def test_default_tolerances(tmp_path):
    to = report.Report("x", tmp_path)
    to.value("count", 3, ".0f")
    to.value("nats", 22.1, ".0f")
    to.value("rate", 0.25)
    to.value("mean", 0.25, error=0.1)
    to.value("own", 0.25, within=0.2)
    to.save()
    values = files.read_json(tmp_path / "x.json")["values"]
    kinds = {key: tuple(value["tolerance"].values()) for key, value in values.items()}
    assert kinds == {
        "count": ("exact", 0),
        "nats": ("absolute", 0.5),  # no whole number: its last bits are another processor's
        "rate": ("absolute", 0.005),
        "mean": ("standard errors", 3),
        "own": ("absolute", 0.2),
    }


@pytest.mark.parametrize("fmt", [".0f", ".1f", ".2f", "+.3f", "g"])
@pytest.mark.parametrize("value", [0.0, 1 / 3, -7e5, math.nan])
@pytest.mark.parametrize("error", [0.0, 1e-17, math.nan])
def test_an_error_of_zero_or_rounding_counts_for_nothing(tmp_path, value, error, fmt):
    to = report.Report("x", tmp_path)
    to.value("k", value, fmt, error=error)
    to.value("without", value, fmt)
    to.sample("s", [value] * 3, fmt)  # the mean of three thirds leaves an error of 1e-17
    to.save()
    written = files.entries(files.read_json(tmp_path / "x.json"))
    assert {entry["tolerance"]["kind"] for entry in written.values()} <= {"exact", "absolute"}
    assert written["k"]["tolerance"] == written["without"]["tolerance"]
    assert all(row.holds for row in verify.compare_values(written, written))


@pytest.mark.parametrize("name", notebooks.names())
def test_committed_reference_is_what_the_committed_notebook_gives(name):
    """Each notebook's own run, which is executed only where no test before has done so."""
    folder = execution.run_of(name, notebooks.parameters(name))
    assert [row for row in verify.compare_run(name, folder) if not row.holds] == []


def sampled(values, tmp_path, fmt=".2f"):
    to = report.Report("x", tmp_path)
    to.sample("k", values, fmt)
    to.save()
    return files.entries(files.read_json(tmp_path / "x.json"))


@pytest.mark.parametrize(
    ("old", "new", "holds"),
    [
        ([0.0, 1.0, 2.0], [0.1, 1.1, 2.1], True),
        ([0.0, 1.0, 2.0], [1.7, 2.7, 3.7], True),  # 3 standard errors are 1.73
        ([0.0, 1.0, 2.0], [1.8, 2.8, 3.8], False),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0, 1.0], False),  # another number of worlds
        ([0.1, 0.1, 0.1], [0.1, 0.1, 0.1 + 1e-15], True),
        ([math.nan, 1.0, 2.0], [1.5, 1.0, 2.0], True),
        ([math.nan, math.nan], [math.nan, math.nan], True),
        ([math.nan, math.nan], [math.nan, 1.0], False),
    ],
)
def test_samples_are_compared_by_mean_and_size(tmp_path, old, new, holds):
    (row,) = verify.compare_values(sampled(old, tmp_path), sampled(new, tmp_path))
    assert row.holds is holds


def test_counts_alike_in_all_worlds_must_stay_so(tmp_path):
    zeros, one = ([0.0] * 30, [0.0] * 29 + [1.0])
    rows = verify.compare_values(sampled(zeros, tmp_path, ".0f"), sampled(one, tmp_path, ".0f"))
    assert not rows[0].holds


def sweep_values(sweep, presets, tmp_path):
    to = report.Report("02_trigger_sweep", tmp_path)
    show_trigger_sweep.record(sweep, presets, to)
    to.table("baseline", show_trigger_sweep.baseline_table(presets))
    to.save()
    return verify.handed_on(files.read_json(tmp_path / "02_trigger_sweep.json"))


def test_reference_holds_for_the_sweep_and_a_perturbed_parameter_is_caught(
    paper_sweep, paper_presets, tmp_path
):
    """The proof that verify can fail: a range sigma of 0.11 instead of 0.10 m."""
    committed = {
        key: entry for key, entry in reference("02_trigger_sweep").items()
        if not key.startswith("tab_") or key.startswith("tab_baseline.")
    }  # fmt: skip
    same = verify.compare_values(committed, sweep_values(paper_sweep, paper_presets, tmp_path))
    assert all(row.holds for row in same)
    other = trigger_sweep.run(trigger_sweep.Config(range_sigma=0.11))
    presets = paper_presets | {"C": other}
    perturbed = verify.compare_values(committed, sweep_values(other, presets, tmp_path))
    breaches = [row.key for row in perturbed if not row.holds]
    assert sum(key.startswith("tab_") for key in breaches) > 5
    assert sum(not key.startswith("tab_") for key in breaches) > 2


def test_compare_and_adopt_on_folders(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(notebooks, "names", lambda: ["01_bimodal"])
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    monkeypatch.setattr(paths, "RESULTS", tmp_path / "verify/01_bimodal")
    monkeypatch.setattr(verdict_tables, "judged", lambda results: results)
    monkeypatch.setattr(verdict_tables, "update_readme", lambda results: seen.update(results))
    monkeypatch.setattr(verdict_tables, "write_record", lambda results: recorded.update(results))
    seen, recorded = {}, {}
    to = report.Report("01_bimodal", tmp_path / "verify/01_bimodal")
    show_bimodal.record(bimodal.run(bimodal.Config(n_repeats=2, n_live=20)), to)
    to.sample("worlds", [1.0, 2.0])
    to.table("hessian", show_bimodal.hessian_table(bimodal.Config()))
    to.value("clock", 3.0, timing=True)
    to.table("clocks", pd.DataFrame({"s": [cells.number(3.0)]}), timing=True)
    to.save()
    assert verify.compare(tmp_path / "verify") > 0  # no reference yet
    verify.adopt()
    assert {"worlds", "clock", "bimodal.map_x"} <= seen.keys() == recorded.keys()
    assert set(files.read_json(tmp_path / "reference/01_bimodal.timings.json")) == {"clock"}
    kept = files.read_json(tmp_path / "reference/01_bimodal.json")
    assert kept["tab_hessian.row1.column3"] == {"value": pytest.approx(0.01), "format": ".2f"}
    assert verify.compare(tmp_path / "verify") == 0
    assert "0 outside their tolerance" in capsys.readouterr().out


def reference(name):
    return files.read_json(paths.REFERENCE / f"{name}.json")


COMMITTED = sorted(path.stem for path in paths.REFERENCE.glob("*.json"))


@pytest.mark.parametrize("name", COMMITTED)
def test_the_committed_reference_reproduces_itself_and_nothing_else(name):
    """Each value alone, moved by a hair more than its tolerance or lost, is a breach."""
    committed = reference(name)
    rows = verify.compare_values(committed, reference(name))
    assert len(rows) == len(committed)
    assert [row.key for row in rows if not row.holds] == []
    for row in rows:
        entry = committed[row.key]
        unit = entry["standard_error"] if row.kind == "standard errors" else 1.0
        moved = 0.0 if row.reference is None else row.reference + 1.001 * row.allowed * unit + 1e-6
        for other in ({**entry, "value": moved}, {**entry, "value": None}):
            if other["value"] != row.reference:
                (found,) = verify.compare_values({"k": entry}, {"k": other})
                assert not found.holds, row.key


@pytest.mark.parametrize("name", COMMITTED)
def test_the_committed_tolerances_are_what_a_report_writes(name):
    for key, entry in reference(name).items():
        declared = entry.get("tolerance", {"kind": "absolute"})  # a table's cell has none
        if declared["kind"] != "absolute":  # which the notebook may have chosen itself
            assert declared == report.tolerance(entry), key


@pytest.mark.parametrize(
    ("damage", "breaches"),
    [
        (lambda entries: None, 0),
        (lambda entries: entries["s"].update(value=9.0), 1),
        (lambda entries: entries["v"].update(value=1.006), 1),
        (lambda entries: entries["v"].update(value=None), 1),
        (lambda entries: entries["tab_t.row1.column2"].update(value=8), 1),
        (lambda entries: entries["tab_t.row1.column3"].update(value=2.256), 1),
        (lambda entries: entries["tab_t.row1.column3"].update(value=2.2549), 0),
        (lambda entries: entries["tab_t.row1.column3.3"].update(value=2.49), 1),
        (lambda entries: entries.pop("tab_t.row1.column3.2"), 1),
        (lambda entries: entries["s"]["sample"].pop(), 1),
        (lambda entries: entries.pop("v"), 1),
        (lambda entries: entries.update(extra=entries["v"]), 1),
        (lambda entries: entries.update(renamed=entries.pop("v")), 2),
    ],
)  # fmt: skip
def test_an_altered_reference_is_noticed(tmp_path, monkeypatch, capsys, damage, breaches):
    monkeypatch.setattr(notebooks, "names", lambda: ["01_bimodal"])
    monkeypatch.setattr(paths, "BUILD", tmp_path)
    monkeypatch.setattr(paths, "REFERENCE", tmp_path)
    monkeypatch.setattr(paths, "VERIFIED", tmp_path / "verified.json")
    to = report.Report("01_bimodal", tmp_path / "verify/01_bimodal")
    to.value("v", 1.0)
    to.sample("s", [1.0, 2.0, 3.0])
    cell = cells.with_interval(2.25, 2.0, 2.5)
    to.table("t", pd.DataFrame({"p": ["0.1"], "n": [7], "mean": [cell]}))
    to.save()
    entries = verify.handed_on(files.read_json(tmp_path / "verify/01_bimodal/01_bimodal.json"))
    damage(entries)
    files.write_json(tmp_path / "01_bimodal.json", entries)
    assert main(["verify"]) == (breaches > 0)
    shown = capsys.readouterr().out
    assert shown.count("BREACH") == breaches
    assert f"{breaches} outside their tolerance" in shown
    assert paths.VERIFIED.exists() == (breaches == 0)  # only what held is written down


def test_there_is_a_reference_for_every_notebook():
    for name in notebooks.names():
        values = files.read_json(paths.REFERENCE / f"{name}.json")
        assert len(values) >= 5
        assert all({"value", "format"} <= value.keys() for value in values.values())
