"""Read the parameters of a headless run and check them before any work.

A notebook ``notebooks/NN_name.ipynb`` belongs with ``params/NN_name.yaml`` and the helper module
``sngr_utils.name``, whose `Config` knows the type and range of each parameter.
"""

import difflib
import importlib
import os
import reprlib
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from sngr_utils import paths
from sngr_utils.publish import notebooks
from sngr_utils.publish.notebooks import ProjectError

LARGEST = 1_000_000  # bytes, and entries, that a YAML file may have


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
    declared = notebooks.parameters(name).keys()
    for key in values:
        if key not in declared:
            near = difflib.get_close_matches(str(key), declared, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ProjectError(
                f"{where}: unknown key {key!r}: notebooks/{name}.ipynb does not declare it{hint}"
            )
    for key in sorted(declared - values.keys()):
        raise ProjectError(f"{where}: key {key!r} is missing: notebooks/{name}.ipynb declares it")
    _check_values(where, name, values)
    return values


def read_yaml(path: Path) -> Any:
    """What a YAML file holds, or a ProjectError that says in one line what is wrong with it."""
    where = os.path.relpath(path, paths.ROOT)
    if not path.exists():
        raise ProjectError(f"{where} is missing")
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"it has more than {LARGEST} bytes")
        tree = YAML(typ="safe", pure=True).load(path)
        _count(tree, 0)
    except (YAMLError, OSError, ValueError, RecursionError) as error:
        raise ProjectError(f"{where} is not valid YAML: {' '.join(str(error).split())}") from error
    return tree


def _count(tree: Any, so_far: int) -> int:
    """Number of nodes, each alias as often as it stands; few lines of aliases can be billions."""
    so_far += 1
    if so_far > LARGEST:
        raise ValueError(f"its aliases stand for more than {LARGEST} entries")
    if isinstance(tree, int) and tree.bit_length() > 1000:  # Python writes none of 4300 digits
        raise ValueError("it has an integer of more than 300 digits")
    if isinstance(tree, dict | list | set | tuple):
        for part in [*tree, *tree.values()] if isinstance(tree, dict) else tree:
            so_far = _count(part, so_far)
    return so_far


def _check_values(where: str, name: str, values: dict[str, Any]) -> None:
    try:
        config_of(name)(**values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        shown = f"{key} is {reprlib.repr(first['input'])}: " if key else ""
        raise ProjectError(f"{where}: {shown}{first['msg']}") from error


def config_of(name: str) -> Any:
    """The `Config` of a notebook's helper: that of ``sngr_utils.bimodal`` for "01_bimodal".

    Raises
    ------
    ProjectError : no such helper, or its fields are not the parameters that the notebook declares
    """
    stem = name.split("_", 1)[-1]
    if not (paths.PACKAGE / f"{stem}.py").exists():
        raise ProjectError(f"notebooks/{name}.ipynb has no helper: sngr_utils/{stem}.py is missing")
    config = importlib.import_module(f"sngr_utils.{stem}").Config
    declared = notebooks.parameters(name).keys()
    for key in sorted(config.model_fields.keys() ^ declared):
        raise ProjectError(
            f"parameter {key!r}: notebooks/{name}.ipynb and sngr_utils/{stem}.py must both have it"
        )
    return config
