"""Which cell of which notebook hands on a value, a table or a figure: read off the cells' code."""

import ast
import json
import re
import symtable
from dataclasses import dataclass, replace

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
    at : which of its lines hands something on, from 0
    """

    notebook: str
    number: int
    line: int
    source: str
    tags: tuple[str, ...]
    at: int = 0


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


def recording(notebook: str, key: str) -> list[Cell]:
    """The cells with the calls of a helper's ``record`` whose strings come nearest to a key."""
    calls = [(c, call.func) for c, call in _calls(notebook) if call.func.attr.startswith("record")]
    near = [_nearness(notebook, func.value.id, func.attr, key) for _, func in calls]
    return [cell for (cell, _), n in zip(calls, near, strict=True) if n == max(near)]


def _nearness(notebook: str, module: str, function: str, key: str) -> int:
    """How many letters of a key the strings spell that a function, or what it calls, forms."""
    imports = "\n".join(cell.source for cell in code_cells(notebook) if "import" in cell.source)
    (path,) = (
        paths.ROOT / node.module.replace(".", "/") / f"{name.name}.py"
        for node in ast.walk(ast.parse(imports))
        if isinstance(node, ast.ImportFrom)
        for name in node.names
        if module == (name.asname or name.name)
    )
    body = ast.parse(path.read_text(encoding="utf-8")).body
    known = {node.name: node for node in body if isinstance(node, ast.FunctionDef)}
    spelt, wanted = 0, {function}
    while wanted:
        nodes = list(ast.walk(known.pop(wanted.pop())))
        for parts in (_parts(node) for node in nodes):
            if re.fullmatch(".+".join(map(re.escape, parts)), key):
                spelt = max(spelt, len("".join(parts)))
        wanted |= {node.id for node in nodes if isinstance(node, ast.Name)} & known.keys()
    return spelt


def _parts(node: ast.AST) -> list[str]:
    """What a string says before, between and after the values that stand in it."""
    if isinstance(node, ast.JoinedStr):
        told = [part.value if isinstance(part, ast.Constant) else "\0" for part in node.values]
        return "".join(told).split("\0")
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []


def _calls(notebook: str) -> list[tuple[Cell, ast.Call]]:
    """Every call of an attribute, ``something.name(...)``, with its cell."""
    return [
        (replace(cell, at=node.lineno - 1), node)
        for cell in code_cells(notebook)
        for node in ast.walk(ast.parse(cell.source))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]


def made_in(cell: Cell) -> list[Cell]:
    """The earlier cells that make what a cell hands on, directly or not; the parameters apart."""
    needed, found = _names(_behind(cell))[0], []
    for other in reversed(code_cells(cell.notebook)):
        needs, makes = _names(other.source)
        if other.number < cell.number and makes & needed and "parameters" not in other.tags:
            found.append(other)
            needed |= needs
    return found[::-1]


def _behind(cell: Cell) -> str:
    """Of a cell, the statement that hands on, and those that make its names; for a figure all."""
    if ".figure(" in cell.source.split("\n")[cell.at]:
        return cell.source
    body = [node for node in ast.parse(cell.source).body if node.lineno <= cell.at + 1]
    behind = ast.unparse(body.pop())
    for node in reversed(body):
        if _names(ast.unparse(node))[1] & _names(behind)[0]:
            behind = f"{ast.unparse(node)}\n{behind}"
    return behind


def _names(source: str) -> tuple[set[str], set[str]]:
    """Names that a piece of code needs from what runs before it, and those it makes for others."""
    needs, makes = set(), set()
    for node in ast.parse(source).body:
        table = symtable.symtable(ast.unparse(node), "cell", "exec")
        read, inner = {s.get_name() for s in table.get_symbols() if s.is_referenced()}, [table]
        while inner:
            children = inner.pop().get_children()
            inner += children
            read |= {s.get_name() for each in children for s in each.get_symbols() if s.is_global()}
        read |= {each.target.id for each in ast.walk(node) if isinstance(each, ast.AugAssign)
                 and isinstance(each.target, ast.Name)}  # fmt: skip
        if isinstance(node, ast.For):
            makes |= {name.id for name in ast.walk(node.target) if isinstance(name, ast.Name)}
        needs |= read - makes
        makes |= {s.get_name() for s in table.get_symbols() if s.is_assigned()}
    return needs, makes - HELD
