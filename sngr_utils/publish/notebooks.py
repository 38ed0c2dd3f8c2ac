"""The committed notebooks, read as the JSON that they are.

A check of all parameters reads them all; nbformat would take a second to be imported for it.
"""

import ast
import json
from typing import Any

from sngr_utils import paths

OUTPUT_DIR = "output_dir"  # the one parameter that is the runner's, not the YAML's
TYPES = {"int", "float", "str", "bool", "list", "dict"}  # of which a parameter's type is made
LONGEST = ("08", "05", "04", "09", "03", "06")  # to execute, the longest first


class ProjectError(Exception):
    """Something the user can mend; its message says what and where."""


def names() -> list[str]:
    """Stems of all notebooks, each of which must have its YAML and the other way round."""
    notebooks = {path.stem for path in paths.NOTEBOOKS.glob("*.ipynb")}
    params = {path.stem for path in paths.PARAMS.glob("*.yaml")}
    for name in sorted(params - notebooks):
        raise ProjectError(f"notebooks/{name}.ipynb is missing, but params/{name}.yaml is there")
    for name in sorted(notebooks - params):
        raise ProjectError(f"params/{name}.yaml is missing, but notebooks/{name}.ipynb is there")
    return sorted(notebooks)


def length(name: str) -> int:
    """Rank of a notebook by the time it takes, 0 the longest; all short ones are alike.

    The long ones are started first: the short ones then fill what is left of two cores.
    """
    number = name.partition("_")[0]
    return LONGEST.index(number) if number in LONGEST else len(LONGEST)


def sources(name: str, code_only: bool = False) -> list[str]:
    """The text of a notebook's cells, in order.

    Raises
    ------
    ProjectError : no such notebook, or the file is none
    """
    return [text for kind, text, _ in _cells(name) if kind == "code" or not code_only]


def parameters(name: str) -> dict[str, Any]:
    """Parameter -> default, from the notebook's cell tagged ``parameters``; not the runner's.

    Raises
    ------
    ProjectError : no such cell, more than one, or one that holds other than literal values
    """
    found = [text for kind, text, tags in _cells(name) if kind == "code" and "parameters" in tags]
    if len(found) != 1:
        how_many = "no cell" if not found else "more than one cell"
        raise ProjectError(f"notebooks/{name}.ipynb has {how_many} tagged 'parameters'")
    declared = {}
    try:
        for line in ast.parse(found[0]).body:
            if isinstance(line, ast.AnnAssign):
                nodes = ast.walk(line.annotation)
                named = {node.id for node in nodes if isinstance(node, ast.Name)}
                if not named <= TYPES:
                    raise ValueError(f"{ast.unparse(line.annotation)} is no type")
                declared[line.target.id] = ast.literal_eval(line.value)
    except (SyntaxError, ValueError, TypeError, AttributeError) as error:
        raise ProjectError(
            f"notebooks/{name}.ipynb: the parameters cell must hold lines "
            f"'name: type = literal value': {error}"
        ) from error
    declared.pop(OUTPUT_DIR, None)
    return declared


def _cells(name: str) -> list[tuple[str, str, list[str]]]:
    """Kind, text and tags of each cell."""
    path = paths.NOTEBOOKS / f"{name}.ipynb"
    if not path.exists():
        raise ProjectError(f"notebooks/{name}.ipynb is missing")
    try:
        return [
            (cell["cell_type"], "".join(cell["source"]), cell["metadata"].get("tags", []))
            for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        ]
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise ProjectError(f"notebooks/{name}.ipynb is not a notebook: {error!r}") from error
