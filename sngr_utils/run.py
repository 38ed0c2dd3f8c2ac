"""Run the notebooks headless: check parameters, execute what is stale, publish the results.

The Makefile calls this module; ``python -m sngr_utils.run --help`` lists its commands. A
notebook ``notebooks/NN_name.ipynb`` belongs with ``params/NN_name.yaml`` and the driver module
``sngr_utils.name``, whose `Config` knows the range of each parameter.
"""

import argparse
import ast
import difflib
import hashlib
import importlib
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import papermill
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from papermill.exceptions import PapermillExecutionError
from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from sngr_utils import paths, report

OUTPUT_DIR = "output_dir"  # the one parameter that is the runner's, not the YAML's
QUIET_KERNEL = ["--log-level=50"]  # no remarks about its transport or its end


class ProjectError(Exception):
    """Something the user can mend; its message says what and where."""


# --- parameters -----------------------------------------------------------------------------


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
    except (ValueError, nbformat.ValidationError) as error:
        raise ProjectError(f"notebooks/{name}.ipynb is not a notebook: {error}") from error


def declared_parameters(name: str) -> dict[str, tuple[str, Any]]:
    """Parameter -> (annotation, default) of the notebook's cell tagged ``parameters``."""
    for cell in read_notebook(name).cells:
        if "parameters" in cell.metadata.get("tags", []):
            return {
                statement.target.id: (
                    ast.unparse(statement.annotation),
                    ast.literal_eval(statement.value),
                )
                for statement in ast.parse(cell.source).body
                if isinstance(statement, ast.AnnAssign)
            }
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
    if not path.exists():
        raise ProjectError(f"{where} is missing")
    try:
        values = YAML(typ="safe", pure=True).load(path)
    except YAMLError as error:
        raise ProjectError(f"{where} is not valid YAML: {error}") from error
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


def _check_type(where: str, key: str, annotation: str, value: Any) -> None:
    allowed = {"int": int, "float": float, "str": str, "bool": bool, "list": list, "dict": dict}
    wanted = eval(annotation, {"__builtins__": {}}, allowed)  # the notebook's own annotation
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


# --- freshness ------------------------------------------------------------------------------


def provenance(name: str, params: dict[str, Any]) -> dict[str, str]:
    """Hashes of all that a notebook's results depend on."""
    sources = [cell.source for cell in read_notebook(name).cells]
    modules = [path.read_text(encoding="utf-8") for path in imported_modules(sources)]
    return {
        "notebook": _hash(sources),
        "params": _hash(params),
        "package": _hash(modules),
        "printed_values": _hash(paths.PRINTED_VALUES.read_text(encoding="utf-8")),
        "lock": _hash(paths.LOCK.read_text(encoding="utf-8")),
    }


def imported_modules(sources: list[str]) -> list[Path]:
    """Files of `sngr_utils` that the given code imports, directly or not, sorted."""
    found: set[Path] = set()
    queue = list(sources)
    while queue:
        for module in _imports(queue.pop()):
            path = paths.PACKAGE / f"{module}.py"
            if path.exists() and path not in found:
                found.add(path)
                queue.append(path.read_text(encoding="utf-8"))
    return sorted(found)


def _imports(source: str) -> Iterator[str]:
    """Names of the modules of `sngr_utils` that a piece of Python imports."""
    try:
        tree = ast.parse(source)
    except SyntaxError:  # a markdown cell
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "sngr_utils":
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sngr_utils."):
            yield node.module.split(".")[1]


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _file_hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def is_fresh(name: str, params: dict[str, Any]) -> bool:
    """Whether the published results are there, whole, and made from what is here now."""
    path = paths.RESULTS / f"{name}.json"
    if not path.exists():
        return False
    stamp = report.read_json(path).get("provenance", {})
    files = stamp.get("files", {})
    return stamp.get("inputs") == provenance(name, params) and all(
        (paths.ROOT / file).exists() and _file_hash(paths.ROOT / file) == digest
        for file, digest in files.items()
    )


# --- execution ------------------------------------------------------------------------------


def run_notebook(name: str) -> None:
    """Execute a notebook with its YAML unless its results are fresh; publish on success only.

    Raises
    ------
    ProjectError : bad parameters, or the notebook failed. What was published before stays.
    """
    params = read_params(name)
    if is_fresh(name, params):
        print(f"{name}: up to date")
        return
    inputs = provenance(name, params)  # before the run: an edit meanwhile makes it stale
    staging, started = paths.STAGING / name, time.perf_counter()
    print(f"{name}: running", flush=True)
    execute(name, params, staging)
    publish(name, staging, inputs)
    print(f"{name}: done in {time.perf_counter() - started:.0f} s", flush=True)


def run_quick(name: str) -> None:
    """Execute a notebook with its small parameters from ``params/quick``, into ``build/quick``."""
    params = read_params(name, paths.PARAMS / "quick")
    print(f"{name}: running with params/quick", flush=True)
    execute(name, params, paths.BUILD / "quick" / name)
    print(f"{name}: done, see build/quick/{name}", flush=True)


def execute(name: str, params: dict[str, Any], staging: Path) -> None:
    """papermill the notebook into an emptied folder, as ``<staging>/<name>.ipynb``."""
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    output = staging / f"{name}.ipynb"
    where = os.path.relpath(staging, paths.NOTEBOOKS)
    position = sorted(path.stem for path in paths.NOTEBOOKS.glob("*.ipynb")).index(name)
    bar = {"desc": name, "position": position, "leave": False, "disable": not sys.stderr.isatty()}
    try:
        papermill.execute_notebook(
            paths.NOTEBOOKS / f"{name}.ipynb",
            output,
            parameters={**params, OUTPUT_DIR: where},
            kernel_name="python3",
            language="python",
            cwd=paths.NOTEBOOKS,
            progress_bar=bar,
            autosave_cell_every=0,
            extra_arguments=QUIET_KERNEL,
        )
    except PapermillExecutionError as error:
        shown = os.path.relpath(output, paths.ROOT)
        raise ProjectError(
            f"{name} failed in cell {error.cell_index}: {error.ename}: {error.evalue}\n"
            f"  the failed notebook is {shown}; published results are untouched"
        ) from error


def publish(name: str, staging: Path, inputs: dict[str, str]) -> None:
    """Move a finished run's figures, results and notebook to their places, results last."""
    result_path = staging / f"{name}.json"
    if not result_path.exists():
        raise ProjectError(f"{name} ran but saved no results: it must call Report.save()")
    result = report.read_json(result_path)
    for folder in (paths.FIGURES, paths.RESULTS, paths.EXECUTED):
        folder.mkdir(parents=True, exist_ok=True)
    moved = {}
    for figure in result["figures"]:
        target = paths.FIGURES / figure
        os.replace(staging / figure, target)
        moved[target.relative_to(paths.ROOT).as_posix()] = _file_hash(target)
    for old in paths.FIGURES.glob(f"{name}_*"):
        if old.name not in result["figures"]:
            old.unlink()  # a figure the notebook no longer draws
    timings = staging / f"{name}.timings.json"
    if timings.exists():
        os.replace(timings, paths.RESULTS / timings.name)
    os.replace(staging / f"{name}.ipynb", paths.EXECUTED / f"{name}.ipynb")
    result["provenance"] = {"inputs": inputs, "files": moved}
    report.write_json(result_path, result)
    os.replace(result_path, paths.RESULTS / result_path.name)


def refresh_notebook(name: str) -> None:
    """Execute a committed notebook in place, with its own defaults, and tidy what is stored."""
    notebook = read_notebook(name)
    client = NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=None,
        record_timing=False,
        coalesce_streams=True,
        extra_arguments=QUIET_KERNEL,
        resources={"metadata": {"path": str(paths.NOTEBOOKS)}},
    )
    try:
        client.execute()
    except CellExecutionError as error:
        raise ProjectError(f"{name} failed: {error}\n  the notebook is untouched") from error
    tidy(notebook)
    path = paths.NOTEBOOKS / f"{name}.ipynb"
    partial = path.with_suffix(".partial")
    nbformat.write(notebook, partial)
    os.replace(partial, path)
    print(f"{name}: stored outputs refreshed", flush=True)


def tidy(notebook: nbformat.NotebookNode) -> None:
    """Remove what differs from machine to machine and says nothing to a reader."""
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number:02d}"


# --- the paper ------------------------------------------------------------------------------


def write_latex() -> None:
    """Write ``paper/generated`` from the results of all notebooks.

    Raises
    ------
    ProjectError : a notebook's results are missing or stale
    """
    results = []
    for name in notebook_names():
        if not is_fresh(name, read_params(name)):
            raise ProjectError(f"results of {name} are missing or stale: run 'make results'")
        results.append(report.read_json(paths.RESULTS / f"{name}.json"))
        timings = paths.RESULTS / f"{name}.timings.json"
        if timings.exists():
            results.append(report.read_json(timings))
    folder = paths.PAPER / "generated"
    folder.mkdir(exist_ok=True)
    files = report.latex(results)
    for old in folder.iterdir():
        if old.name not in files:
            old.unlink()
    for file, content in files.items():
        path = folder / file
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")


def check() -> None:
    """Check the parameters of all notebooks."""
    for name in notebook_names():
        read_params(name)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m sngr_utils.run", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("check", help="check all parameter files")
    commands.add_parser("latex", help="write paper/generated from fresh results")
    for command, help_text in (
        ("notebook", "run notebooks with their YAML unless their results are fresh"),
        ("quick", "run notebooks with params/quick, into build/quick"),
        ("refresh", "execute committed notebooks in place"),
    ):
        commands.add_parser(command, help=help_text).add_argument("names", nargs="+")
    args = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        if args.command == "check":
            check()
        elif args.command == "latex":
            write_latex()
        else:
            work = {"notebook": run_notebook, "quick": run_quick, "refresh": refresh_notebook}
            for name in args.names:
                work[args.command](name)
    except ProjectError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted: published results are untouched", file=sys.stderr)
        return 130
    return 0


def _interrupt(signum, frame):
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
