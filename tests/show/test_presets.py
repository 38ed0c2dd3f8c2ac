"""The tables of presets: what they set, and printed numbers beside them."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from sngr_utils.settings import PRESET_NAMES, READING
from sngr_utils.show import presets, style
from sngr_utils.slam import conventions


def test_every_convention_of_every_preset_is_explained():
    table = presets.explained()
    assert list(table.columns[1:]) == [f"preset {name}" for name in PRESET_NAMES]
    assert list(presets.FIELDS) == list(conventions.Conventions.model_fields)
    assert len(table) == len(presets.FIELDS) + 1
    assert list(table["preset A"][:2]) == ["0.2, 0.2, 0.001", "10"]
    assert list(table.iloc[-1, 1:]) == list(conventions.WHY.values())
    assert conventions.OpenConventions().preset == READING
    assert "our reading" in table[f"preset {READING}"].iloc[-1]


def test_printed_numbers_stand_beside_those_of_each_preset():
    ours = {"A": {0.0: {"n": 3, "x": 1.0}, 0.1: {"n": 4, "x": 2.0}}, "B": {0.0: {}, 0.1: {"n": 5}}}
    printed = {0.1: {"x": -0.5}}
    table = presets.beside_printed({"x": ("x [m]", ".1f"), "n": ("n", "d")}, printed, ours)
    assert table.map(str).to_numpy().tolist() == [
        ["x [m]", "0", "–", "1.0", "–"],
        ["", "0.1", "−0.5", "2.0", "–"],
        ["n", "0", "–", "3", "–"],
        ["", "0.1", "–", "4", "5"],
    ]
    heads = [("", ""), ("", "p"), ("", "printed"), ("preset", "A"), ("preset", "B")]
    assert list(table.columns) == heads
    without = presets.beside_printed({"x": ("x", ".1f")}, None, ours, "seed")
    assert list(without.columns) == [("", ""), ("", "seed"), *heads[3:]]


def test_a_quantity_of_a_table_is_drawn_as_the_table_has_it():
    ours = {"A": {0.0: {"n": 3}, 0.1: {"n": 4}}, "B": {0.0: {}, 0.1: {"n": 5}}}
    table = presets.beside_printed({"x": ("x", ".1f"), "n": ("n", "d")}, {0.1: {"n": 7}}, ours)
    ax = Figure().subplots()
    presets.draw_beside_printed(ax, table, "n")
    drawn = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert list(drawn) == ["printed", "preset A", "preset B"]
    assert drawn["preset A"] == [[0.0, 3.0], [0.1, 4.0]]
    assert drawn["printed"][1] == [0.1, 7.0]
    assert np.isnan(drawn["preset B"][0][1])
    assert (ax.get_xlabel(), ax.get_ylabel()) == (style.WRONG_LABEL, "n")


def test_a_panel_is_handed_on_and_not_shown():
    drawn = []
    fig = presets.panel(conventions.OpenConventions(), lambda *args: drawn.append(args), 1)
    assert drawn == [(fig.axes[0], 1)]
    assert fig.get_suptitle() == "preset C"
    assert not plt.fignum_exists(fig.number)


def test_a_figure_names_its_preset_and_says_if_it_was_changed():
    for replaced, title in (({}, "preset B"), ({"relinearize_skip": 3}, "preset B, changed")):
        fig = Figure()
        presets.entitle(fig, conventions.OpenConventions(preset="B", conventions=replaced))
        assert fig.get_suptitle() == title
