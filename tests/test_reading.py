"""How long a notebook takes to read, counted on a notebook that is counted by hand."""

import importlib.util
import re
import sys

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from sngr_utils import paths

SPEC = importlib.util.spec_from_file_location("reading", paths.ROOT / "scripts/reading.py")
reading = importlib.util.module_from_spec(SPEC)
sys.modules["reading"] = reading  # where its dataclass looks for itself
SPEC.loader.exec_module(reading)


def table(columns, rows, cell):
    head = f"<thead><tr>{'<th>3.0</th>' * columns}</tr></thead>"
    body = f"<tr>{f'<td>{cell}</td>' * columns}</tr>" * rows
    return new_output("display_data", {"text/html": f"<table>{head}{body}</table>"})


def notebook(text, *tables):
    return new_notebook(cells=[new_markdown_cell(text), new_code_cell("x", outputs=list(tables))])


@pytest.mark.parametrize(
    ("text", "words"),
    [("Two words", 2), ("$a + b$ is **a** [link](to/some/place.md)", 3), ("<b>bold</b> 3.5 m", 2),
     ("Gauss-Newton's step", 2), ("$$x\n= y$$ one", 1)],
)  # fmt: skip
def test_words_of_prose_and_nothing_else(text, words):
    assert reading.load_of(notebook(text)).words == words


@pytest.mark.parametrize(
    ("cell", "numbers"),
    [("0.50 ± 0.08", 2), ("−12.5", 1), ("1e-3", 1), ("none", 0), ("3 of 20", 2)],
)
def test_numbers_in_the_cells_of_a_table(cell, numbers):
    load = reading.load_of(notebook("", table(2, 3, cell)))
    assert (load.tables, load.large, load.numbers) == (1, 0, 6 * numbers)
    assert load.unmarked == bool(numbers)
    assert not reading.load_of(notebook("", table(2, 3, f"<strong>{cell}</strong>"))).unmarked


@pytest.mark.parametrize(("columns", "rows", "large"), [(6, 8, 0), (7, 1, 1), (1, 9, 1)])
def test_a_large_table(columns, rows, large):
    assert reading.load_of(notebook("", table(columns, rows, "x"))).large == large


def test_minutes_and_limits():
    load = reading.Load(words=400, tables=1, large=0, unmarked=0, numbers=30)
    assert load.minutes == pytest.approx(2 + 30 * 2.8 / 60)
    table, faults = reading.report({"a": load, "b": load}, {"a": 3.4, "b": 3.3, "all": 7})
    assert faults == ["b: 3.4 minutes, 3.3 allowed"]
    assert len(table.splitlines()) == 4


def test_a_notebook_without_a_limit_is_noticed():
    load = reading.Load(words=1, tables=0, large=0, unmarked=0, numbers=0)
    assert len(reading.report({"new": load}, {"all": 1})[1]) == 1


def test_a_table_that_is_large_or_unmarked_is_a_fault():
    load, minutes = reading.Load(1, 3, 1, 1, 0), {"a": 1, "all": 1}
    assert reading.report({"a": load}, minutes)[1] == ["a: 1 tables are large, 1 without a mark"]


@pytest.mark.parametrize(
    "path", sorted(paths.NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem
)
def test_a_chapter_says_how_long_it_takes_to_read(path):
    said = re.search(r"\*\*Time\*\*: (\d+) minutes? of reading", path.read_text())
    assert float(said[1]) == pytest.approx(
        reading.load_of(nbformat.read(path, 4)).minutes, abs=1.05
    )
