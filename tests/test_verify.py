import math

import pytest

from sngr_utils import (
    bimodal,
    parameters,
    paths,
    report,
    trigger_sweep,
    verdict_tables,
    verify,
)


def entry(value, kind, size, error=None):
    made = {"value": value, "tolerance": {"kind": kind, "size": size}}
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
    to.value("rate", 0.25)
    to.value("mean", 0.25, error=0.1)
    to.value("own", 0.25, within=0.2)
    to.save()
    values = report.read_json(tmp_path / "x.json")["values"]
    kinds = {key: tuple(value["tolerance"].values()) for key, value in values.items()}
    assert kinds == {
        "count": ("exact", 0),
        "rate": ("absolute", 0.005),
        "mean": ("standard errors", 3),
        "own": ("absolute", 0.2),
    }


def sampled(values, tmp_path, fmt=".2f"):
    to = report.Report("x", tmp_path)
    to.sample("k", values, fmt)
    to.save()
    return report.entries(report.read_json(tmp_path / "x.json"))


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


def sweep_values(sweep, tmp_path):
    to = report.Report("02_trigger_sweep", tmp_path)
    trigger_sweep.record(sweep, to)
    to.save()
    return report.read_json(tmp_path / "02_trigger_sweep.json")["values"]


def test_reference_holds_for_the_sweep_and_a_perturbed_parameter_is_caught(paper_sweep, tmp_path):
    """The proof that verify can fail: a range sigma of 0.11 instead of 0.10 m."""
    reference = report.read_json(paths.REFERENCE / "02_trigger_sweep.json")
    same = verify.compare_values(reference, sweep_values(paper_sweep, tmp_path))
    assert all(row.holds for row in same)
    other = trigger_sweep.run(trigger_sweep.Config(range_sigma=0.11))
    perturbed = verify.compare_values(reference, sweep_values(other, tmp_path))
    assert sum(not row.holds for row in perturbed) > 5


def test_compare_and_adopt_on_folders(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(verify, "notebook_names", lambda: ["01_bimodal"])
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    monkeypatch.setattr(paths, "RESULTS", tmp_path / "verify/01_bimodal")
    monkeypatch.setattr(verdict_tables, "update_readme", lambda results: seen.update(results))
    seen = {}
    to = report.Report("01_bimodal", tmp_path / "verify/01_bimodal")
    bimodal.record(bimodal.run(bimodal.Config(n_repeats=2, n_live=20)), to)
    to.sample("worlds", [1.0, 2.0])
    to.value("clock", 3.0, timing=True)
    to.save()
    assert verify.compare(tmp_path / "verify") > 0  # no reference yet
    verify.adopt()
    assert {"worlds", "clock", "bimodal.sigma_y"} <= seen.keys()
    assert set(report.read_json(tmp_path / "reference/01_bimodal.timings.json")) == {"clock"}
    assert verify.compare(tmp_path / "verify") == 0
    assert "0 outside their tolerance" in capsys.readouterr().out


def test_there_is_a_reference_for_every_notebook():
    for name in parameters.notebook_names():
        values = report.read_json(paths.REFERENCE / f"{name}.json")
        assert len(values) >= 5
        assert all("tolerance" in value for value in values.values())
