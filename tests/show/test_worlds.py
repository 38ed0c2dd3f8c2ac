import math

import pandas as pd
from helpers import handed_on

from sngr_utils.publish import report
from sngr_utils.show import style, worlds

ROWS = pd.DataFrame({
    "kind": ["circle", "circle", "slip"], "preset": ["C", "C", "A"], "p": [0.3, 0.3, 0.0],
    "final": [1.0, 1.2, 2.0], "filtered": [1.0, 1.1, 3.0], "known": [1.0, 1.0, 0.5],
    "landmark_ratio": [1.0, 1.0, 2.0], "nees": [2.0, 2.0, 9.0], "oracle_nees": [2.0, 2.0, 2.0],
    "doubtful": [0, 1, 1], "cauchy": [1.1, 1.3, 9.0], "gnc_tls": [1.0, 1.2, 9.0],
    "em_exclusive": [1.0, 1.1, 8.0], "at_truth": [1.0, 1.0, 1.1],
    "filtered_likelier": [1.0, 1.2, 2.5], "behind": [0.0, 2.0, 2.0],
    "filtered_right": [math.nan, math.nan, 1.5],
})  # fmt: skip


def test_a_row_for_each_kind_says_how_many_are_lost_and_doubted():
    table = worlds.table(ROWS)
    assert list(table["worlds"]) == ["circle, p = 0.3", "slip, p = 0, preset A"]
    assert [str(cell) for cell in table["lost"]] == ["0 of 2", "1 of 1"]
    assert [str(cell) for cell in table["doubted: lost, others"]] == ["0, 1", "1, 0"]
    assert str(table["final, median"][0]) == "1.10"
    assert [str(cell) for cell in table["mean, none likelier"]] == ["1.10", "2.50"]
    assert [str(cell) for cell in table["worst, from the truth"]] == ["1.00", "1.10"]
    assert [str(cell) for cell in table["Cauchy, median"]] == ["1.20", "9.00"]
    skewed = pd.concat([ROWS[:2], ROWS[:1].assign(cauchy=9.0)])
    assert str(worlds.table(skewed)["Cauchy, median"][0]) == "1.30"


def test_a_circle_for_each_world_and_its_numbers(tmp_path):
    _fig, ax = style.figure()
    worlds.draw(ax, ROWS)
    assert [label.get_text() for label in ax.get_yticklabels()] == list(worlds.cases(ROWS))
    circles = [line for line in ax.lines if line.get_marker() == "o"]
    assert sum(len(line.get_xdata()) for line in circles) == len(ROWS)
    to = report.Report("08_association_aware", tmp_path)
    sides = {"kind": ["circle", "straight", "straight", "slip 1 m"],
             "sides_likelier": [0.9, 0.4, 0.5, math.nan],
             "sides_gain": [9.0, 2.0, -1.0, math.nan]}  # fmt: skip
    slip = ROWS[2:].assign(final=1.0, nees=2.0, doubtful=0)
    known = pd.concat([ROWS.assign(filtered_right=math.nan), slip], ignore_index=True)
    worlds.record(known.assign(**sides), to)
    found = {key: entry["value"] for key, entry in handed_on(to).items()}
    assert found == {
        "worlds.n": 4, "worlds.lost": 1, "worlds.lost_doubted": 1, "worlds.others_doubted": 1,
        "worlds.lost_by_search": 1, "worlds.overconfident": 1, "worlds.overconfident_doubted": 1,
        "worlds.straight.likelier_sides": 0.45, "worlds.straight.gain": 2.0,
        "worlds.slip_1_m.filtered": 3.0, "worlds.slip_1_m.filtered_right": 1.5,
    }  # fmt: skip


def test_a_row_for_each_constant_has_the_worst_of_its_worlds():
    rows = pd.DataFrame({
        "constant": ["", "a.B", "a.B", "a.B"], "factor": [1.0, 0.5, 0.5, 2.0],
        "kind": ["circle"] * 4, "final": [1.0, 1.1, 1.4, 0.9],
    })  # fmt: skip
    table = worlds.sensitivity_table(rows)
    assert list(table["constant"]) == ["none changed", "a.B"]
    assert [str(cell) for cell in table["half, circle"]] == ["1.00", "1.40"]
    assert [str(cell) for cell in table["twice, circle"]] == ["1.00", "0.90"]
