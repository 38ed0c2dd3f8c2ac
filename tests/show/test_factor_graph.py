"""A drawn factor graph has what the graph has: a circle a variable, a square a factor."""

import matplotlib.pyplot as plt
import pytest
from matplotlib.colors import to_hex

from sngr_utils.show import factor_graph, style

PLACES = {"x0": (0, 0), "x1": (1, 0), "l1": (0.5, 1)}
FACTORS = [("x0",), ("x0", "x1"), ("x0", "l1"), ("x1", "l1")]

pytestmark = pytest.mark.usefixtures("house_style")


def squares(ax):
    """Colour of each factor's square -> how many there are."""
    found = [to_hex(line.get_color()).upper() for line in ax.lines if line.get_marker() == "s"]
    return {colour: found.count(colour) for colour in found}


def names(ax):
    return [text.get_text() for text in ax.texts if text.get_text()]


def test_a_square_for_each_factor_and_the_marked_one_in_its_own_colour():
    _, ax = plt.subplots()
    factor_graph.draw_factor_graph(ax, PLACES, FACTORS, marked=[2])
    assert squares(ax) == {style.TRUTH: 3, style.TRIGGERED: 1}
    assert names(ax) == ["$x_{0}$", "$x_{1}$", "$l_{1}$"]


def test_small_variables_show_no_name():
    _, ax = plt.subplots()
    factor_graph.draw_factor_graph(ax, PLACES, FACTORS, size=4)
    assert names(ax) == []


def test_elimination_leaves_one_factor_on_the_neighbours():
    _, ax = plt.subplots()
    factor_graph.draw_elimination(ax, PLACES, FACTORS, ["x0"])
    assert squares(ax) == {style.TRUTH: 1, style.SAMPLES: 1}
    assert len(ax.texts) - len(names(ax)) == 2  # arrows from both neighbours
    _, ax = plt.subplots()
    factor_graph.draw_elimination(ax, PLACES, FACTORS, list(PLACES))
    assert squares(ax) == {}


def test_a_tree_has_its_root_on_top_and_parents_midway():
    cliques = [({"x2"}, set(), None), ({"x1"}, {"x2"}, 0), ({"x3"}, {"x2"}, 0), ({"x0"}, {"x1"}, 1)]
    _, ax = plt.subplots()
    factor_graph.draw_bayes_tree(ax, cliques, marked=[1])
    at = {text.get_text(): text.get_position() for text in ax.texts}
    root, left, right = at["$x_{2}$"], at["$x_{1}$ : $x_{2}$"], at["$x_{3}$ : $x_{2}$"]
    assert root[0] == pytest.approx((left[0] + right[0]) / 2)
    assert root[1] > left[1] == right[1] > at["$x_{0}$ : $x_{1}$"][1]
