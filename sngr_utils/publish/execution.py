"""One execution of a notebook serves the paper, the tests and the stored outputs.

A finished run stays in ``build/runs``, stamped with the hashes of all it was made from. Whoever
needs the notebook executed asks for the run; it is executed only if no run from the same inputs
is there, whole.
"""

import fcntl
import json
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sngr_utils import paths
from sngr_utils.publish import notebooks, quiet
from sngr_utils.publish.files import read_json, write_json
from sngr_utils.publish.freshness import STAMP, digest, file_digest, inputs, is_whole_run
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.whole_file import write_text

UNTOUCHED = "published results are untouched"
QUIET_KERNEL = ["--log-level=50"]  # no remarks about its transport or its end
SECONDS = "seconds.json"  # how long an execution took, beside it
INJECTED = "injected-parameters"  # papermill's tag of the cell that it adds
OTHERS = "others"  # had this share of the machine meanwhile: of a notebook that hands on times
# Linear algebra by other kernels, or in threads, sums in another order, and where a last digit
# decides a sampler goes another way. A kernel gets these, whoever starts it.
ARITHMETIC = ("OPENBLAS_", "MKL_", "OMP_", "KMP_", "BLIS_")
ALIKE = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}


def run_of(name: str, params: dict[str, Any]) -> Path:
    """The folder of a run of a notebook with these parameters, executed now if there is none.

    It holds ``<name>.ipynb`` with its outputs, ``<name>.json``, figures, and `STAMP`.

    Raises
    ------
    ProjectError : the notebook failed, or saved no results
    """
    folder = paths.RUNS / f"{name}.{digest(params)[:8]}"
    with alone(name):
        wanted = inputs(name, params)  # before the run: an edit meanwhile makes it stale
        if is_whole_run(folder, wanted):
            print(f"{name}: executed before, from the same inputs", flush=True)
            return folder
        staging = paths.STAGING / name
        print(f"{name}: running", flush=True)
        seconds = execute(name, params, staging)
        if not (staging / f"{name}.json").exists():
            raise ProjectError(f"{name} ran but saved no results: it must call Report.save()")
        files = {path.name: file_digest(path) for path in sorted(staging.iterdir())}
        write_json(staging / STAMP, {"inputs": wanted, "files": files})
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        os.replace(staging, folder)
        print(f"{name}: done in {seconds:.0f} s", flush=True)
    return folder


@contextmanager
def alone(name: str) -> Iterator[None]:
    """Wait until no other process runs this notebook; says so if one does."""
    paths.BUILD.mkdir(exist_ok=True)
    # what a link there leads to is not ours to open
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW
    with open(os.open(paths.BUILD / f".{name}.lock", flags, 0o666), "r+") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"{name}: waiting for another process that runs it", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def execute(name: str, params: dict[str, Any], folder: Path) -> float:
    """papermill the notebook into an emptied folder, as ``<folder>/<name>.ipynb``.

    Returns
    -------
    how long it took [s], which a file beside it tells too

    Raises
    ------
    ProjectError : a cell failed, or the kernel died; what was executed stays in the folder
    """
    import sngr_utils.publish.quick_schema  # noqa: F401, I001  before papermill loads nbformat
    import papermill
    from nbclient.exceptions import DeadKernelError
    from papermill.exceptions import PapermillExecutionError

    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    output = folder / f"{name}.ipynb"
    position = notebooks.names().index(name)
    bar = {"desc": name, "position": position, "leave": False, "disable": not sys.stderr.isatty()}
    where, started = os.path.relpath(folder, paths.NOTEBOOKS), time.perf_counter()
    before = quiet.read()
    try:
        with same_arithmetic():
            papermill.execute_notebook(
                paths.NOTEBOOKS / f"{name}.ipynb",
                output,
                parameters={**params, notebooks.OUTPUT_DIR: where},
                kernel_name="python3",
                language="python",
                cwd=paths.NOTEBOOKS,
                progress_bar=bar,
                autosave_cell_every=0,
                coalesce_streams=True,
                extra_arguments=QUIET_KERNEL,
            )
    except PapermillExecutionError as error:
        shown = os.path.relpath(output, paths.ROOT)
        raise ProjectError(
            f"{name} failed in cell {error.cell_index}: {error.ename}: {error.evalue}\n"
            f"  the failed notebook is {shown}; {UNTOUCHED}"
        ) from error
    except DeadKernelError as error:
        raise ProjectError(f"{name}: the kernel died (out of memory?); {UNTOUCHED}") from error
    except RuntimeError as error:  # of nbclient and jupyter_client: it was silent for a minute
        raise ProjectError(f"{name}: the kernel did not start: {error}; {UNTOUCHED}") from error
    executed = json.loads(output.read_text(encoding="utf-8"))
    tidy(executed)
    _note_others(folder / f"{name}.timings.json", quiet.others(before, quiet.read()))
    write_notebook(output, executed)
    seconds = time.perf_counter() - started
    write_json(folder / SECONDS, {"seconds": seconds})
    return seconds


@contextmanager
def same_arithmetic() -> Iterator[None]:
    """What is started meanwhile has linear algebra of one thread and of the machine's kernels."""
    theirs = dict(os.environ)
    for name in theirs:
        if name.startswith(ARITHMETIC):
            del os.environ[name]
    os.environ.update(ALIKE)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(theirs)


def _note_others(clocks: Path, share: float) -> None:
    """Write beside times how busy the machine was."""
    if clocks.exists():
        times = read_json(clocks)
        times["values"][others_key(clocks)] = {
            "value": share, "format": ".0%", "unit": "", "n": 1
        }  # fmt: skip
        write_json(clocks, times)


def others_key(clocks: Path) -> str:
    """Of the share of the machine that others had, among the values of a file of times."""
    return f"clock.{clocks.name.split('.')[0]}.{OTHERS}"


def tidy(notebook: dict) -> None:
    """Remove from a notebook what differs from run to run and says nothing to a reader."""
    notebook["metadata"] = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for number, cell in enumerate(notebook["cells"]):
        cell["id"] = f"cell-{number:02d}"
        for dated in ("papermill", "execution"):
            cell["metadata"].pop(dated, None)


def write_notebook(path: Path, notebook: dict) -> None:
    """Write a notebook as Jupyter does, whole or not at all."""
    write_text(path, json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n")


def code_cells(path: Path) -> list[dict]:
    """The code cells of an executed notebook that the committed one has too, in order."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    return [cell for cell in code if INJECTED not in cell["metadata"].get("tags", [])]
