"""Factor graphs, what elimination makes of them, and Bayes trees, drawn.

A variable is a name and a place: ``x3`` is a pose, ``l1`` a landmark. A factor is the names of its
variables.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from sngr_utils.show import style

SMALLEST_NAMED = 8  # pt: a smaller variable shows no name
Places = Mapping[str, Sequence[float]]


def symbol(name: str) -> str:
    """A variable's name as a formula: "x12" as x with a subscript."""
    return rf"${name[0]}_{{{name[1:]}}}$"


def draw_factor_graph(
    ax: Axes,
    places: Places,
    factors: Sequence[tuple[str, ...]],
    marked: Collection[int] = (),
    size: float = 15,
) -> None:
    """Variables as circles, factors as black squares on the lines to their variables.

    Parameters
    ----------
    places : name -> (2,) where the variable is drawn
    factors : variables of each; one with a single variable hangs on a short line
    marked : numbers of the factors that are drawn in the colour of a wrong label
    size : diameter of a variable, [pt]; below `SMALLEST_NAMED` it shows no name
    """
    for number, factor in enumerate(factors):
        colour = style.TRIGGERED if number in marked else style.TRUTH
        _draw_factor(ax, places, factor, colour, size, 1.6 if number in marked else 0.7)
    for name, place in places.items():
        colour = style.LANDMARK if name.startswith("l") else style.ESTIMATE
        _draw_variable(ax, name, place, colour, size)
    _frame(ax)


def draw_elimination(
    ax: Axes, places: Places, factors: Sequence[tuple[str, ...]], order: Sequence[str]
) -> None:
    """The graph after the variables of `order` are eliminated, one by one.

    They are grey, with an arrow from each variable that they depend on. Factors that
    elimination has made are drawn in a colour of their own.
    """
    left = [(set(factor), style.TRUTH, 0.7) for factor in factors]
    for name in order:
        separator = set().union(*(factor for factor, *_ in left if name in factor)) - {name}
        left = [drawn for drawn in left if name not in drawn[0]]
        if separator:
            left.append((separator, style.SAMPLES, 1.4))
        for parent in sorted(separator):
            arrow = {"arrowstyle": "->", "color": style.PRINTED, "lw": 0.8}
            arrow |= {"shrinkA": 7, "shrinkB": 7}
            ax.annotate("", places[name], places[parent], arrowprops=arrow)
    for factor, colour, width in left:
        _draw_factor(ax, places, sorted(factor), colour, 13, width)
    for name, place in places.items():
        known = style.LANDMARK if name.startswith("l") else style.ESTIMATE
        _draw_variable(ax, name, place, style.PRINTED if name in order else known, 13)
    _frame(ax)


def draw_bayes_tree(
    ax: Axes,
    cliques: Sequence[tuple[Collection[str], Collection[str], int | None]],
    marked: Collection[int] = (),
) -> None:
    """Cliques as boxes, the root on top: "variables : what they depend on".

    Parameters
    ----------
    cliques : variables, separator, and number of the parent (None of a root), parents first
    marked : numbers of the cliques that are drawn filled
    """
    at = _tree_places([parent for _, _, parent in cliques])
    for number, (variables, separator, parent) in enumerate(cliques):
        if parent is not None:
            ax.plot(*np.transpose([at[parent], at[number]]), color=style.PRINTED, lw=0.8, zorder=1)
        text = ", ".join(map(symbol, sorted(variables)))
        if separator:
            text += " : " + ", ".join(map(symbol, sorted(separator)))
        face = style.LANDMARK if number in marked else "white"
        box = {"boxstyle": "round", "fc": face, "ec": style.TRUTH, "lw": 0.7}
        ax.text(*at[number], text, ha="center", va="center", fontsize=9, bbox=box)
    x, y = np.transpose(at)
    ax.set(xlim=(x.min() - 0.7, x.max() + 0.7), ylim=(y.min() - 0.5, y.max() + 0.5))
    ax.axis("off")


def _tree_places(parents: Sequence[int | None]) -> np.ndarray:
    """(N, 2) where each node is drawn: leaves side by side, parents midway above."""
    at = np.zeros((len(parents), 2))
    leaves = iter(range(len(parents)))

    def put(node: int | None, depth: int) -> float:
        below = [put(n, depth + 1) for n, parent in enumerate(parents) if parent == node]
        x = float(np.mean(below)) if below else float(next(leaves))
        if node is not None:
            at[node] = x, -depth
        return x

    put(None, -1)
    return at


def _draw_factor(
    ax: Axes, places: Places, factor: Sequence[str], colour: str, size: float, width: float
) -> None:
    ends = np.array([places[name] for name in factor], dtype=float)
    middle = ends.mean(axis=0) if len(ends) > 1 else ends[0] - _stub(places)
    for end in ends:
        ax.plot(*np.transpose([middle, end]), color=colour, lw=width, zorder=1)
    ax.plot(*middle, "s", color=colour, ms=0.35 * size, zorder=2, clip_on=False)


def _stub(places: Places) -> np.ndarray:
    """(2,) the line of a factor with one variable, as part of the drawing's width."""
    x = [place[0] for place in places.values()]
    return np.array([0.0, 0.09 * (max(x) - min(x))])


def _draw_variable(ax: Axes, name: str, place: Sequence[float], colour: str, size: float) -> None:
    look = {"mfc": "white", "mec": colour, "mew": 0.09 * size}
    ax.plot(*place, "o", ms=size, zorder=3, clip_on=False, **look)
    if size >= SMALLEST_NAMED:
        ax.text(*place, symbol(name), ha="center", va="center", fontsize=0.65 * size, zorder=4)


def _frame(ax: Axes) -> None:
    ax.set_aspect("equal")
    ax.margins(0.08)
    ax.axis("off")
