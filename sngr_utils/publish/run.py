"""Run the notebooks headless: check parameters, execute what is stale, publish the results."""

import json
import os
import re
from pathlib import Path
from typing import Any

from sngr_utils import paths, whole_file
from sngr_utils.publish import claims, execution, links, notebooks
from sngr_utils.publish.files import entries, read_json, write_json
from sngr_utils.publish.freshness import MALFORMED, STAMP, digest, file_digest, is_fresh, relative
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.publish.parameters import read_params
from sngr_utils.publish.results import results_in

CLOCKS = (".timings.json", "_timing.pdf", "_timing.png")  # ends of names of files of wall clocks


def check() -> dict[str, dict[str, Any]]:
    """Check the parameters of all notebooks, the quick ones too; returns the full ones.

    Also what is not read before all notebooks have run: the claims, the printed values, the
    address that links are made of, and the reference that results are compared with.
    """
    for name in notebooks.names():
        read_params(name, paths.PARAMS / "quick")
    params = {name: read_params(name) for name in notebooks.names()}
    claims.check()
    links.repository()
    results_in(paths.REFERENCE)
    return params


def print_stale() -> None:
    """Print the make targets that bring the results up to date, after checking all parameters.

    The notebooks that take longest come first.
    """
    params_of = check()
    for name in sorted(params_of, key=notebooks.length):
        params = params_of[name]
        if not is_fresh(name, params):
            print(f"run/{name}")


def run_notebook(name: str) -> None:
    """Publish a notebook's results with its YAML unless they are fresh; on success only.

    Raises
    ------
    ProjectError : bad parameters, or the notebook failed. What was published before stays.
    """
    params = read_params(name)
    if is_fresh(name, params):
        print(f"{name}: up to date")
    else:
        publish(name, execution.run_of(name, params))


def publish(name: str, run: Path) -> None:
    """Copy a finished run's figures, results and notebook to their places, results last."""
    result = read_json(run / f"{name}.json")
    copies = {paths.FIGURES / figure: run / figure for figure in result["figures"]}
    copies[paths.EXECUTED / f"{name}.ipynb"] = run / f"{name}.ipynb"
    clocks = run / f"{name}.timings.json"
    if clocks.exists():
        copies[paths.RESULTS / clocks.name] = clocks
    for target, source in copies.items():
        whole_file.copy(source, target)
    for old in _drawn_before(name) - set(result["figures"]):
        (paths.FIGURES / old).unlink(missing_ok=True)
    files = {
        relative(target): "" if target.name.endswith(CLOCKS) else file_digest(target)
        for target in copies
    }
    made_from = read_json(run / STAMP)["inputs"]
    result["provenance"] = {"inputs": made_from, "content": digest(result), "files": files}
    paths.RESULTS.mkdir(parents=True, exist_ok=True)
    write_json(paths.RESULTS / f"{name}.json", result)


def _drawn_before(name: str) -> set[str]:
    """The figures that the results published so far name; nothing else is ever removed."""
    try:
        figures = read_json(paths.RESULTS / f"{name}.json")["figures"]
        return {file for file in figures if re.fullmatch(rf"{name}_\w+\.(pdf|png|html)", file)}
    except MALFORMED:
        return set()


def run_quick(name: str) -> None:
    """Execute a notebook with its small parameters from ``params/quick``, into ``build/quick``."""
    params = read_params(name, paths.PARAMS / "quick")
    print(f"{name}: running with params/quick", flush=True)
    execution.execute(name, params, paths.BUILD / "quick" / name)
    print(f"{name}: done, see build/quick/{name}", flush=True)


def run_aside(name: str) -> None:
    """Execute a notebook with its YAML into ``build/verify``, touching nothing published."""
    print(f"{name}: running aside", flush=True)
    execution.execute(name, read_params(name), paths.BUILD / "verify" / name)


def refresh(name: str) -> None:
    """Store in a committed notebook the outputs that a run with its own defaults gives.

    Raises
    ------
    ProjectError : the notebook failed, or was saved again while it ran
    """
    path = paths.NOTEBOOKS / f"{name}.ipynb"
    defaults = notebooks.parameters(name)
    before = path.read_bytes()
    run = execution.run_of(name, defaults)
    if path.read_bytes() != before:
        shown = os.path.relpath(run, paths.ROOT)
        raise ProjectError(
            f"notebooks/{name}.ipynb was saved while it ran and is left as it is: run again\n"
            f"  the outputs of what ran are in {shown}"
        )
    stored, executed = json.loads(before), execution.code_cells(run / f"{name}.ipynb")
    execution.tidy(stored)
    clocks = run / f"{name}.timings.json"
    if clocks.exists():
        share = read_json(clocks)["values"][execution.others_key(clocks)]["value"]
        stored["metadata"][execution.OTHERS] = round(share, 3)
    ours = [cell for cell in stored["cells"] if cell["cell_type"] == "code"]
    for number, (cell, done) in enumerate(zip(ours, executed, strict=True), start=1):
        cell["outputs"], cell["execution_count"] = done["outputs"], number
        for output in cell["outputs"]:
            if "execution_count" in output:
                output["execution_count"] = number
    execution.write_notebook(path, stored)
    print(f"{name}: stored outputs refreshed", flush=True)


def write_latex() -> None:
    """Write ``paper/generated`` from the results of all notebooks, with the verdicts they give.

    Raises
    ------
    ProjectError : a notebook's results are missing or stale, or lack what a claim needs; the
        claims or the printed values are broken
    """
    from sngr_utils.publish import appendix, latex, verdict_tables  # pandas: two seconds

    claims.check()
    results, timings = [], []
    for name in notebooks.names():
        if not is_fresh(name, read_params(name)):
            raise ProjectError(f"results of {name} are missing or stale: run 'make results'")
        results.append(read_json(paths.RESULTS / f"{name}.json"))
        clocks = paths.RESULTS / f"{name}.timings.json"
        if clocks.exists():
            timings.append(read_json(clocks))
    merged = results_in(paths.RESULTS)
    judged = verdict_tables.judged(merged)
    files = latex.latex([*results, verdict_tables.result(judged)], timings)
    files["sources.tex"] = links.latex()
    files["claims_full.tex"] = verdict_tables.whole(judged.read)
    folder = paths.PAPER / "generated"
    folder.mkdir(exist_ok=True)
    clocks = {key for timing in timings for key in entries(timing)}
    files["appendix.tex"] = appendix.latex_text(judged.read, merged, clocks)
    for old in folder.glob("tab_*.tex"):
        if old.name not in files:
            old.unlink()  # a table that no notebook makes any more
    for file, content in files.items():
        path = folder / file
        if not path.is_file() or path.read_bytes() != content.encode():
            whole_file.write_text(path, content)
