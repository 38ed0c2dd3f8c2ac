"""The student edition: all but the solutions, and still able to run."""

import ast
import builtins
import importlib.util
import re

import nbformat
import pytest
from helpers import read_notebook

from sngr_utils import paths

SPEC = importlib.util.spec_from_file_location("student", paths.ROOT / "scripts/student.py")
student = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(student)

NAMES = sorted(path.stem for path in paths.NOTEBOOKS.glob("*.ipynb"))


@pytest.fixture(scope="module")
def edition(tmp_path_factory):
    folder = tmp_path_factory.mktemp("build") / "student"
    return student.write(paths.NOTEBOOKS, folder)


def test_every_notebook_is_written_whole_and_as_jupyter_reads_it(edition):
    assert [path.stem for path in edition] == NAMES
    for path in edition:
        nbformat.validate(nbformat.read(path, as_version=4))


def test_no_solution_is_left_and_every_question_is(edition):
    for path in edition:
        text = path.read_text(encoding="utf-8")
        assert '"solution"' not in text
        assert "details>" not in text
        whole = read_notebook(path.stem)
        asked = [re.findall(r"^\*\*\d\. .*?\*\*", c.source, re.M) for c in whole.cells]
        for question in (q for found in asked for q in found):
            assert question in text
        kept = [c for c in whole.cells if c.cell_type == "code"]
        solutions = sum("solution" in c.metadata.get("tags", []) for c in kept)
        now = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
        assert len(now) == len(kept) - solutions


def names_of(cells):
    """Names that cells assign, define or import, and names that they read."""
    nodes = [node for cell in cells for node in ast.walk(ast.parse(cell.source))]
    loads = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
    stores = {n.id for n in nodes if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Load)}
    stores |= {n.name for n in nodes if isinstance(n, (ast.FunctionDef, ast.ClassDef))}
    stores |= {n.arg for n in nodes if isinstance(n, ast.arg)}
    imports = [n for n in nodes if isinstance(n, (ast.Import, ast.ImportFrom))]
    stores |= {(a.asname or a.name).split(".")[0] for n in imports for a in n.names}
    return stores, loads


def test_no_cell_needs_what_a_solution_defined(edition):
    for path in edition:
        cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
        stores, loads = names_of(cells)
        assert loads - stores - set(dir(builtins)) - {"display"} == set(), path.stem


def test_links_lead_somewhere_from_the_other_folder(edition):
    """A link to a file of the checkout climbs one folder further; the others stay in the folder."""
    for path in edition:
        cells = nbformat.read(path, as_version=4).cells
        text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
        for link in re.findall(r"\]\(([^)#]+)\)", text):
            beside = paths.BUILD / "student"
            there = path.parent / link if "/" not in link else (beside / link).resolve()
            assert there.exists(), f"{path.stem}: {link}"
        sources = "\n".join(cell.source for cell in cells if cell.cell_type == "code")
        assert '"../build/' not in sources
        assert "../by_hand" in sources


def test_the_committed_links_lead_somewhere():
    for name in NAMES:
        cells = [c for c in read_notebook(name).cells if c.cell_type == "markdown"]
        for link in re.findall(r"\]\(([^)#]+)\)", "\n".join(c.source for c in cells)):
            assert (paths.NOTEBOOKS / link).exists(), f"{name}: {link}"
