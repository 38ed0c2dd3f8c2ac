"""Run the notebooks headless: check parameters, execute what is stale, publish the results.

The Makefile calls this module; ``python -m sngr_utils.publish.run --help`` lists its commands.
"""

import argparse
import fcntl
import hashlib
import json
import logging
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nbformat
import papermill
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError
from papermill.exceptions import PapermillExecutionError

from sngr_utils import paths
from sngr_utils.publish import claims, latex, report, verdict_tables
from sngr_utils.publish.dependencies import imported_files
from sngr_utils.publish.parameters import (
    OUTPUT_DIR,
    ProjectError,
    notebook_names,
    read_notebook,
    read_params,
)

UNTOUCHED = "published results are untouched"
# what reading a file that somebody spoiled may raise
MALFORMED = (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError)
QUIET_KERNEL = ["--log-level=50"]  # no remarks about its transport or its end


def provenance(name: str, params: dict[str, Any]) -> dict[str, str]:
    """Hashes of all that a notebook's results depend on."""
    cells = read_notebook(name).cells
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    modules = [path.read_text(encoding="utf-8") for path in imported_files(name, code)]
    return {
        "notebook": _hash([cell.source for cell in cells]),
        "params": _hash(params),
        "package": _hash(modules),
        "printed_values": _hash(paths.PRINTED_VALUES.read_text(encoding="utf-8")),
        "lock": _hash(paths.LOCK.read_text(encoding="utf-8")),
    }


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _file_hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _relative(path: Path) -> str:
    return path.relative_to(paths.ROOT).as_posix()


def is_fresh(name: str, params: dict[str, Any]) -> bool:
    """Whether the published results are there, whole, and made from what is here now."""
    inputs = provenance(name, params)
    try:
        result = report.read_json(paths.RESULTS / f"{name}.json")
        stamp = result.pop("provenance")
        published = [paths.FIGURES / figure for figure in result["figures"]]
        published.append(paths.EXECUTED / f"{name}.ipynb")
        return (
            stamp["inputs"] == inputs
            and stamp["content"] == _hash(result)
            and stamp["files"].keys() >= {_relative(path) for path in published}
            and all(_is_whole(paths.ROOT / file, was) for file, was in stamp["files"].items())
        )
    except MALFORMED:
        return False  # missing, damaged, or of an older make


def _is_whole(path: Path, digest: str) -> bool:
    """Whether a published file is as it was; without a hash, whether it can be read as its kind.

    Raises
    ------
    any of MALFORMED, where it cannot even be looked at
    """
    if digest:
        return _file_hash(path) == digest
    if path.suffix in (".pdf", ".png"):
        return path.read_bytes().startswith((b"%PDF", b"\x89PNG"))
    content = report.read_json(path)
    if path.suffix == ".ipynb":
        return bool(content["cells"])
    return bool(latex.latex([], [content]))


def run_notebook(name: str) -> None:
    """Execute a notebook with its YAML unless its results are fresh; publish on success only.

    Raises
    ------
    ProjectError : bad parameters, or the notebook failed. What was published before stays.
    """
    with _alone(name):
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


@contextmanager
def _alone(name: str) -> Iterator[None]:
    """Wait until no other process runs this notebook."""
    paths.BUILD.mkdir(exist_ok=True)
    with open(paths.BUILD / f".{name}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def run_quick(name: str) -> None:
    """Execute a notebook with its small parameters from ``params/quick``, into ``build/quick``."""
    params = read_params(name, paths.PARAMS / "quick")
    print(f"{name}: running with params/quick", flush=True)
    execute(name, params, paths.BUILD / "quick" / name)
    print(f"{name}: done, see build/quick/{name}", flush=True)


def run_scratch(name: str) -> None:
    """Execute a notebook with its YAML into ``build/verify``, touching nothing published."""
    print(f"{name}: running aside", flush=True)
    execute(name, read_params(name), paths.BUILD / "verify" / name)


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
    except DeadKernelError as error:
        raise ProjectError(f"{name}: the kernel died (out of memory?); {UNTOUCHED}") from error


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
        shows_clocks = target.stem.endswith(report.TIMING)
        moved[_relative(target)] = "" if shows_clocks else _file_hash(target)
    for old in paths.FIGURES.glob(f"{name}_*"):
        if old.name not in result["figures"]:
            old.unlink()  # a figure the notebook no longer draws
    executed = nbformat.read(staging / f"{name}.ipynb", as_version=4)
    tidy(executed)
    nbformat.write(executed, staging / f"{name}.ipynb")
    for source, folder in (
        (staging / f"{name}.timings.json", paths.RESULTS),
        (staging / f"{name}.ipynb", paths.EXECUTED),
    ):
        if source.exists():
            os.replace(source, folder / source.name)
            moved[_relative(folder / source.name)] = ""  # holds wall clocks: no hash, be there
    result["provenance"] = {"inputs": inputs, "content": _hash(result), "files": moved}
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
        for dated in ("papermill", "execution"):
            cell.metadata.pop(dated, None)


def write_latex() -> None:
    """Write ``paper/generated`` from the results of all notebooks, with the verdicts they give.

    Raises
    ------
    ProjectError : a notebook's results are missing or stale, or lack what a claim needs; the
        claims or the printed values are broken
    """
    claims.check()
    results, timings = [], []
    for name in notebook_names():
        if not is_fresh(name, read_params(name)):
            raise ProjectError(f"results of {name} are missing or stale: run 'make results'")
        results.append(report.read_json(paths.RESULTS / f"{name}.json"))
        clocks = paths.RESULTS / f"{name}.timings.json"
        if clocks.exists():
            timings.append(report.read_json(clocks))
    judged = verdict_tables.judged(verdict_tables.results_in(paths.RESULTS))
    folder = paths.PAPER / "generated"
    folder.mkdir(exist_ok=True)
    files = latex.latex([*results, verdict_tables.result(judged)], timings)
    files["claims_full.tex"] = verdict_tables.chunks(judged[claims.read().reading])
    for old in folder.iterdir():
        if old.name not in files:
            old.unlink()
    for file, content in files.items():
        path = folder / file
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")


def check() -> dict[str, dict[str, Any]]:
    """Check the parameters of all notebooks, the quick ones too; returns the full ones.

    Also what is not read before all notebooks have run: the claims, the printed values, and the
    reference they are compared with.
    """
    for name in notebook_names():
        read_params(name, paths.PARAMS / "quick")
    params = {name: read_params(name) for name in notebook_names()}
    claims.check()
    verdict_tables.results_in(paths.REFERENCE)
    return params


def print_stale() -> None:
    """Print the make targets that bring the results up to date, after checking all parameters.

    The last notebooks first: they take longest, and the short ones fill what is left of two cores.
    """
    for name, params in reversed(check().items()):
        if not is_fresh(name, params):
            print(f"run/{name}")


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m sngr_utils.publish.run", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("check", help="check all parameter files and the claims")
    commands.add_parser("stale", help="print the make targets that are out of date")
    commands.add_parser("latex", help="write paper/generated from fresh results")
    for command, help_text in (
        ("notebook", "run notebooks with their YAML unless their results are fresh"),
        ("quick", "run notebooks with params/quick, into build/quick"),
        ("scratch", "run notebooks with their YAML, into build/verify"),
        ("refresh", "execute committed notebooks in place"),
    ):
        commands.add_parser(command, help=help_text).add_argument("names", nargs="+")
    args = parser.parse_args(arguments)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    try:
        if args.command in ("check", "stale", "latex"):
            {"check": check, "stale": print_stale, "latex": write_latex}[args.command]()
        else:
            work = {
                "notebook": run_notebook,
                "quick": run_quick,
                "scratch": run_scratch,
                "refresh": refresh_notebook,
            }
            for name in args.names:
                work[args.command](name)
    except ProjectError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except BaseException:
        if not _interrupted:
            raise
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # no traceback of the lost kernel
        print(f"interrupted: {UNTOUCHED}", file=sys.stderr)
        return 130
    return 0


_interrupted = []  # signals received: after one, any exception is a consequence of it


def _interrupt(signum, frame):
    _interrupted.append(signum)
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
