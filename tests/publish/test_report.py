import json
import math
import re

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from sngr_utils.metrics import standard_error
from sngr_utils.publish import cells, files, latex, report


@pytest.mark.parametrize(
    ("value", "fmt", "shown"),
    [(1.005, ".1f", "1.0"), (-12.5, ".2f", "−12.50"), (-0.001, ".2f", "0.00"), (None, ".2f", "–"),
     (math.nan, ".2f", "–"), (4, "d", "4"), (2.4, "+.0f", "+2"), (-2.4, "+.0f", "−2"),
     (0.3, "g", "0.3")],
)  # fmt: skip
def test_text(value, fmt, shown):
    assert cells.text(value, fmt) == shown


def test_spread_of_few_values():
    assert str(cells.mean_std([1.0, 3.0])) == "2.00 ± 1.41"
    assert str(cells.mean_error([1.0, 3.0], "+.1f")) == "+2.0 ± 1.0"
    assert standard_error.standard_error([1.0, 3.0]) == pytest.approx(1.0)
    assert math.isnan(standard_error.standard_error([1.0]))


@pytest.mark.parametrize(
    ("entry", "tex"),
    [
        ({"value": -12.5, "format": ".2f", "unit": "nats"}, "$-$12.50~nats"),
        ({"value": 1.2, "format": ".1f", "unit": "m", "standard_error": 0.26}, r"1.2 $\pm$ 0.3~m"),
        ({"value": 1.2, "format": ".1f", "unit": "", "standard_error": None}, "1.2"),
        ({"value": None, "format": ".1f", "unit": "m", "standard_error": None}, "--"),
    ],
)
def test_latex_value(entry, tex):
    assert latex.latex_value(entry) == tex


def test_from_a_report_to_latex(tmp_path):
    to = report.Report("05_x", tmp_path / "out")
    to.value("a.b", 1.25, ".1f", "m", error=0.5, n=4)
    to.value("t", 3.0, timing=True)
    heads = pd.MultiIndex.from_tuples([("", "p"), ("RMSE", "printed"), ("RMSE", "ours")])
    shown = to.table(
        "x", pd.DataFrame([["0.1", cells.with_error(-1.26, 2, ".1f"), 3]], columns=heads)
    )
    assert "−1.3 ± 2.0" in shown.data
    fig, _ = plt.subplots()
    to.figure(fig, "f")
    to.save()
    result = files.read_json(tmp_path / "out/05_x.json")
    assert result["figures"] == ["05_x_f.pdf"]
    assert "t" not in result["values"]  # wall clocks live in a file of their own
    timings = files.read_json(tmp_path / "out/05_x.timings.json")
    written = latex.latex([result], [timings])
    assert r"\csname res@a.b\endcsname{1.2 $\pm$ 0.5~m}" in written["values.tex"]
    assert r"\csname res@t\endcsname{3.00}" in written["timings.tex"]
    table = written["tab_x.tex"]
    assert r"\multicolumn{2}{c}{RMSE}" in table
    assert r"0.1 & $-$1.3 $\pm$ 2.0 & 3" in table
    assert cells.entries(result["tables"]) == {
        "tab_x.row1.column2": {"value": -1.26, "format": ".1f"},
        "tab_x.row1.column2.2": {"value": 2, "format": ".1f"},
        "tab_x.row1.column3": {"value": 3, "format": "d"},
    }
    for key in ("values", "tables"):
        clash = {"notebook": "06", "values": {}, "tables": {}}
        clash[key] = result[key]
        with pytest.raises(ValueError, match="already taken"):
            latex.latex([result, clash])


def test_figures_are_the_same_bytes_each_time(tmp_path):
    for name in "ab":
        fig, ax = plt.subplots()
        ax.plot([1, 2])
        report.Report("n", tmp_path / name).figure(fig, "f")
        plt.close(fig)
    first, second = ((tmp_path / name / "n_f.pdf").read_bytes() for name in "ab")
    assert first == second
    assert b"CreationDate" not in first  # two within a second would be alike anyway


def test_printed_values_hold_the_slips_as_printed():
    printed = report.printed_values()
    seed3 = printed["per_seed_p0.3"][3]
    assert (seed3["triggered"], seed3["tp"], seed3["fp"]) == (10, 10, 2)
    assert printed["tau_sensitivity"][3.92]["noisy_p0.3"] == 21


def test_a_sample_keeps_its_worlds_and_prints_its_mean(tmp_path):
    to = report.Report("05_x", tmp_path)
    to.sample("s", [1.0, 3.0, math.nan], unit="m")
    to.save()
    path = tmp_path / "05_x.json"
    result = files.read_json(path)
    assert result["samples"]["s"]["sample"] == [1.0, 3.0, None]
    assert "[ 1.0, 3.0, null ]" in path.read_text()  # on one line
    assert result["samples"]["s"]["n"] == 3
    assert r"\csname res@s\endcsname{2.00 $\pm$ 1.00~m}" in latex.latex([result])["values.tex"]
    result["values"]["s"] = result["samples"]["s"]
    with pytest.raises(ValueError, match="already taken"):
        latex.latex([result])
    del result["values"]["s"], result["samples"]  # a result from before there were samples
    assert files.entries(result) == {}
    assert latex.latex([result])["values.tex"] == "\n"


def test_a_table_for_the_supplement_is_handed_on_and_only_named(tmp_path):
    paper = report.Report("07_peers", tmp_path)
    shown = paper.supplement("long", pd.DataFrame({"a": range(30), "b": range(30)}))
    paper.save()
    assert "30 rows of 2 columns" in shown.data
    assert "TABLE=long" in shown.data
    assert len(json.loads((tmp_path / "07_peers.json").read_text())["tables"]["long"]["rows"]) == 30


def test_a_marked_cell_is_bold_and_all_else_as_without_marks():
    frame = pd.DataFrame({"a < b": ["x & y", "<z>"], "n": [cells.number(1.0), cells.number(2.0)]})
    shown = cells.show(frame, lambda row, column: column == "n" and row["a < b"] == "<z>").data
    assert "<strong>2.00</strong>" in shown
    assert shown.replace("<strong>", "").replace("</strong>", "") == cells.show(frame).data


def test_marks_by_column_and_by_the_first_cell_of_a_row_or_its_number():
    heads = pd.MultiIndex.from_tuples([("", "p"), ("a < b", "n"), ("a < b", "m")])
    frame = pd.DataFrame([["x", 1, 2.5], ["y", 3, 4.5]], columns=heads)

    def marked(*asked):
        shown = cells.show(frame, cells.at(*asked)).data
        assert shown.replace("<strong>", "").replace("</strong>", "") == cells.show(frame).data
        return re.findall("<strong>(.*?)</strong>", shown)

    assert marked(("a < b", "n")) == ["1", "3"]
    assert marked(("a < b", "m"), "y") == ["4.5"]
    assert marked(None, 0) == ["1", "2.5"]
    assert marked(None, "z") == []
