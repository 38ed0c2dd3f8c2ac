"""Which cell of which notebook hands on a value, a table or a figure: read off the cells' code."""

import ast
import json
import re
from dataclasses import dataclass

from sngr_utils import paths
from sngr_utils.publish.files import read_json

KINDS = {
    "table": "table", "supplement": "table", "figure": "figure",
    "value": "value", "sample": "value",
}  # fmt: skip
HELD = {"fig", "ax", "axes", "paper", "rng"}  # names that carry no result from cell to cell


@dataclass(frozen=True)
class Cell:
    """A code cell of a committed notebook.

    Attributes
    ----------
    number : as "In [7]" shows it: its place among the code cells, from 1
    line : where its source begins in the file
    """

    notebook: str
    number: int
    line: int
    source: str
    tags: tuple[str, ...]


def code_cells(notebook: str) -> list[Cell]:
    """The code cells of a committed notebook, in order, without the solutions of exercises."""
    text = (paths.NOTEBOOKS / f"{notebook}.ipynb").read_text(encoding="utf-8")
    every = json.loads(text)["cells"]
    # as Jupyter writes it: the source of a cell, whatever its outputs hold, is three blanks deep
    lines = [i for i, line in enumerate(text.split("\n"), 2) if line.startswith('   "source":')]
    lines = lines if len(lines) == len(every) else [1] * len(every)
    code = [(cell, line) for cell, line in zip(every, lines, strict=True)
            if cell["cell_type"] == "code"]  # fmt: skip
    cells = [
        Cell(notebook, i, line, "".join(c["source"]), tuple(c["metadata"].get("tags", [])))
        for i, (c, line) in enumerate(code, start=1)
    ]
    return [cell for cell in cells if "solution" not in cell.tags]


def handed_on(notebook: str) -> dict[tuple[str, str], Cell]:
    """("table", "figure" or "value", name) -> its cell, as far as a cell says the name itself.

    A table named in a loop, by an f-string, is sought among those of the reference. A figure of
    wall clocks has the name that its file has, ending in ``_timing``.
    """
    found, formed = {}, []
    for cell, call in _calls(notebook):
        kind = KINDS.get(call.func.attr)
        for arg in call.args if kind else ():
            if isinstance(arg, ast.Constant) and isinstance(arg.value, str):
                timed = kind == "figure" and any(word.arg == "timing" for word in call.keywords)
                found.setdefault((kind, arg.value + "_timing" * timed), cell)
            elif isinstance(arg, ast.JoinedStr) and kind == "table":
                formed += [(name, cell) for name in _tables_like(notebook, arg)]
    for name, cell in formed:
        found.setdefault(("table", name), cell)
    return found


def _tables_like(notebook: str, name: ast.JoinedStr) -> list[str]:
    """The tables of the reference that an f-string can be the name of."""
    path = paths.REFERENCE / f"{notebook}.json"
    keys = read_json(path) if path.exists() else {}
    parts = [re.escape(part.value) if isinstance(part, ast.Constant) else r"\w+"
             for part in name.values]  # fmt: skip
    known = dict.fromkeys(re.findall(r"^tab_(\w+)\.row1\.", "\n".join(keys), re.MULTILINE))
    return [each for each in known if re.fullmatch("".join(parts), each)]


def recording(notebook: str) -> list[Cell]:
    """The cells that hand on values by a call of a helper's ``record``."""
    return list(
        dict.fromkeys(c for c, call in _calls(notebook) if call.func.attr.startswith("record"))
    )


def _calls(notebook: str) -> list[tuple[Cell, ast.Call]]:
    """Every call of an attribute, ``something.name(...)``, with its cell."""
    return [
        (cell, node)
        for cell in code_cells(notebook)
        for node in ast.walk(ast.parse(cell.source))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]


def made_in(cell: Cell) -> list[Cell]:
    """The earlier cells that make what a cell uses, directly or not; the parameters apart."""
    wanted, found = _names(cell)[0], []
    for other in reversed(code_cells(cell.notebook)):
        loaded, stored = _names(other)
        if other.number < cell.number and stored & wanted and "parameters" not in other.tags:
            found.append(other)
            wanted |= loaded
    return found[::-1]


def _names(cell: Cell) -> tuple[set[str], set[str]]:
    """Names that a cell reads, and those it sets for other cells."""
    loaded, stored, local = set(), set(), set()
    for node in ast.walk(ast.parse(cell.source)):
        if isinstance(node, ast.comprehension):
            local |= {name.id for name in ast.walk(node.target) if isinstance(name, ast.Name)}
        if isinstance(node, ast.Name):
            (loaded if isinstance(node.ctx, ast.Load) else stored).add(node.id)
    return loaded - local, stored - local - HELD
