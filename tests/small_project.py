"""A small project of its own for tests of the runner: one notebook, its YAML, the package."""

import shutil
from contextlib import contextmanager
from functools import cache
from importlib.machinery import PathFinder

import nbformat
import pytest
from helpers import read_notebook
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

import sngr_utils
from sngr_utils import paths
from sngr_utils.publish import claims, dependencies, printed, report

NAME = "01_bimodal"
CLAIMS = f"""
reading: C
why_this_reading: there is nothing to read
headline: [seed, small]
ranges:
  any: {{low: 0, high: 26, why: a count}}
counted_once: []
numbers:
- {{id: seed, printed: baseline/0.0/triggered, what: a, where: b, ours: seed, rule: deterministic,
   range: any, notebook: {NAME}, cell: c}}
prose:
- {{id: small, where: b, says: the seed is small, ours: seed, at_most: 9, rule: value,
   notebook: {NAME}, cell: c}}
"""
BODY = """
from sngr_utils.publish import report
import matplotlib.pyplot as plt
paper = report.Report("01_bimodal", output_dir)
fig, ax = plt.subplots()
ax.plot([seed, 1])
paper.figure(fig, "f")
paper.value("seed", seed)
paper.value("clock", 3.0, timing=True)
paper.figure(fig, "f", timing=True)
paper.save()
"""


def light_body(*figures):
    """Code that leaves results and empty figures, and imports nothing that takes seconds."""
    return f"""
import json
from pathlib import Path
figures = {list(figures)}
for name in figures:
    Path(output_dir, name).write_bytes(b"%PDF")
result = {{"notebook": "{NAME}", "values": {{}}, "tables": {{}}, "figures": figures}}
Path(output_dir, "{NAME}.json").write_text(json.dumps(result))
"""


@cache
def part_of_the_package():
    """What the notebook and its helper import: a tenth of all, as each test copies it."""
    cells = [f"from sngr_utils import {NAME[3:]}", "from sngr_utils.publish import report"]
    files = dependencies.imported_files(NAME, cells)
    return [file.relative_to(paths.ROOT) for file in files]


def make_project(folder):
    """A copy of what the runner needs, with a small notebook in place of the real 01."""
    for file in part_of_the_package():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(paths.ROOT / file, folder / file)
    (folder / "params/quick").mkdir(parents=True)
    for params in ("params", "params/quick"):
        shutil.copy(paths.PARAMS / f"{NAME}.yaml", folder / params)
    (folder / "paper").mkdir()
    shutil.copy(paths.PRINTED_VALUES, folder / "paper")
    (folder / "paper/claims.yaml").write_text(CLAIMS)
    shutil.copy(paths.LOCK, folder)
    shutil.copy(paths.CITATION, folder)
    (folder / "notebooks").mkdir()
    real = read_notebook(NAME)
    (declared,) = (c for c in real.cells if "parameters" in c.metadata.get("tags", []))
    write_notebook(folder, declared, BODY)


@contextmanager
def at_home_in(folder):
    """All of the project's paths lead into a folder, and grimp reads the package there."""
    root, cached = paths.ROOT, (claims.read, printed.leaves, report.printed_values)
    for read in cached:
        read.cache_clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sngr_utils, "__spec__", PathFinder.find_spec("sngr_utils", [str(folder)]))
        for name in [name for name in vars(paths) if name.isupper()]:
            patch.setattr(paths, name, folder / getattr(paths, name).relative_to(root))
        yield folder
    for read in cached:
        read.cache_clear()


@contextmanager
def a_copy_to_spoil(project, folder):
    """All of a project in another folder, which is home: what is done there leaves it alone."""
    shutil.copytree(project, folder, dirs_exist_ok=True)
    with at_home_in(folder):
        yield folder


def write_notebook(project, declared, body, extra=""):
    cells = [new_markdown_cell("# hello"), declared, new_code_cell(body + extra)]
    nbformat.write(new_notebook(cells=cells), project / f"notebooks/{NAME}.ipynb")


def declared_cell(project):
    return nbformat.read(project / f"notebooks/{NAME}.ipynb", as_version=4).cells[1]
