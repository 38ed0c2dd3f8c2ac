"""Read the parameters of a headless run and check them before any work.

A notebook ``notebooks/NN_name.ipynb`` belongs with ``params/NN_name.yaml`` and the driver module
``sngr_utils.name``. Its parameters cell says which keys there are and of which type, the driver's
`Config` knows the range of each.
"""

import ast
import difflib
import importlib
import os
from pathlib import Path
from typing import Any

import nbformat
from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from sngr_utils import paths

OUTPUT_DIR = "output_dir"  # the one parameter that is the runner's, not the YAML's


class ProjectError(Exception):
    """Something the user can mend; its message says what and where."""


def notebook_names() -> list[str]:
    """Stems of all notebooks, each of which must have its YAML and the other way round."""
    notebooks = {path.stem for path in paths.NOTEBOOKS.glob("*.ipynb")}
    params = {path.stem for path in paths.PARAMS.glob("*.yaml")}
    for name in sorted(params - notebooks):
        raise ProjectError(f"notebooks/{name}.ipynb is missing, but params/{name}.yaml is there")
    for name in sorted(notebooks - params):
        raise ProjectError(f"params/{name}.yaml is missing, but notebooks/{name}.ipynb is there")
    return sorted(notebooks)


def read_notebook(name: str) -> nbformat.NotebookNode:
    """The committed notebook, or a ProjectError that says what is wrong with it."""
    path = paths.NOTEBOOKS / f"{name}.ipynb"
    if not path.exists():
        raise ProjectError(f"notebooks/{name}.ipynb is missing")
    try:
        return nbformat.read(path, as_version=4)
    except (ValueError, AttributeError, nbformat.ValidationError) as error:
        raise ProjectError(f"notebooks/{name}.ipynb is not a notebook: {error}") from error


def declared_parameters(name: str) -> dict[str, tuple[str, Any]]:
    """Parameter -> (annotation, default) of the notebook's cell tagged ``parameters``."""
    for cell in read_notebook(name).cells:
        if "parameters" in cell.metadata.get("tags", []):
            try:
                return {
                    statement.target.id: (
                        ast.unparse(statement.annotation),
                        ast.literal_eval(statement.value),
                    )
                    for statement in ast.parse(cell.source).body
                    if isinstance(statement, ast.AnnAssign)
                }
            except (SyntaxError, ValueError, TypeError) as error:
                raise ProjectError(
                    f"notebooks/{name}.ipynb: the parameters cell must hold lines "
                    f"'name: type = literal value': {error}"
                ) from error
    raise ProjectError(f"notebooks/{name}.ipynb has no cell tagged 'parameters'")


def read_params(name: str, folder: Path | None = None) -> dict[str, Any]:
    """The checked parameters of ``<folder>/<name>.yaml``, folder being ``params/`` if not given.

    Raises
    ------
    ProjectError : unreadable YAML; a key the notebook does not declare, or the other way round;
        a value of the wrong type or out of range. Names the file and the key.
    """
    path = (folder or paths.PARAMS) / f"{name}.yaml"
    where = os.path.relpath(path, paths.ROOT)
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise ProjectError(f"{where} must hold 'key: value' lines")
    declared = declared_parameters(name)
    declared.pop(OUTPUT_DIR, None)
    for key in values:
        if key not in declared:
            near = difflib.get_close_matches(str(key), declared, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ProjectError(
                f"{where}: unknown key {key!r}: notebooks/{name}.ipynb does not declare it{hint}"
            )
    for key, (annotation, _) in declared.items():
        if key not in values:
            raise ProjectError(f"{where}: key {key!r} is missing ({annotation})")
        _check_type(where, key, annotation, values[key])
    _check_range(where, name, values)
    return values


def read_yaml(path: Path) -> Any:
    """What a YAML file holds, or a ProjectError that says in one line what is wrong with it."""
    where = os.path.relpath(path, paths.ROOT)
    if not path.exists():
        raise ProjectError(f"{where} is missing")
    try:
        return YAML(typ="safe", pure=True).load(path)
    except (YAMLError, OSError, ValueError, RecursionError) as error:
        raise ProjectError(f"{where} is not valid YAML: {' '.join(str(error).split())}") from error


def _check_type(where: str, key: str, annotation: str, value: Any) -> None:
    allowed = {"int": int, "float": float, "str": str, "bool": bool, "list": list, "dict": dict}
    try:
        wanted = eval(annotation, {"__builtins__": {}}, allowed)  # the notebook's own annotation
    except (NameError, TypeError) as error:
        raise ProjectError(f"{where}: {key} is declared as {annotation!r}: {error}") from error
    try:
        TypeAdapter(wanted).validate_python(value, strict=True)
    except ValidationError as error:
        reason = error.errors()[0]["msg"]
        raise ProjectError(f"{where}: {key} is {value!r}: {reason} ({annotation})") from error


def _check_range(where: str, name: str, values: dict[str, Any]) -> None:
    try:
        driver_of(name).Config(**values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        shown = f"{key} is {first['input']!r}: " if key else ""
        raise ProjectError(f"{where}: {shown}{first['msg']}") from error


def driver_of(name: str) -> Any:
    """The driver module of a notebook: ``sngr_utils.bimodal`` for "01_bimodal"."""
    stem = name.split("_", 1)[-1]
    if not (paths.PACKAGE / f"{stem}.py").exists():
        raise ProjectError(f"notebooks/{name}.ipynb has no driver: sngr_utils/{stem}.py is missing")
    return importlib.import_module(f"sngr_utils.{stem}")
