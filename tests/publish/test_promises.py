"""Promises broken on purpose: each must be noticed.

`test_run`, `test_verify` and `test_verdicts` do the same to stale results, to the reference and
to the claims.
"""

import base64
import io
import os
import re
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import nbformat
import numpy as np
import pytest
from helpers import asked_keys, paper_text, read_notebook
from nbformat.v4 import new_code_cell, new_notebook, new_output
from PIL import Image

from sngr_utils import paths
from sngr_utils.experiments import isam2_over_worlds
from sngr_utils.publish import (
    cells,
    claims,
    files,
    judge,
    latex,
    links,
    notebooks,
    trace,
    verdict_tables,
)
from sngr_utils.publish.printed import leaves, matching
from sngr_utils.publish.results import results_in
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world.scenario import Scenario

# --- a stored notebook, under the project's own pytest ------------------------------------------


def encoded(array, **options):
    buffer = io.BytesIO()
    Image.fromarray(array).save(buffer, **{"format": "PNG"} | options)
    return base64.b64encode(buffer.getvalue()).decode()


def shown(**data):
    """A stored output, of kinds "png", "jpeg" or "html"."""
    kinds = {"png": "image/png", "jpeg": "image/jpeg", "html": "text/html"}
    return new_output("display_data", {kinds[kind]: value for kind, value in data.items()})


def printed(text):
    return new_output("stream", name="stdout", text=text)


def panel(marker=None, grey=255):
    """A picture of 300 x 200 pixels, with or without a marker of 5 x 5."""
    pixels = np.full((200, 300, 3), grey, dtype=np.uint8)
    if marker is not None:
        pixels[marker : marker + 5, marker : marker + 5] = 0
    return pixels


def rounded(pixels):
    pixels[100, 100] -= 1
    return pixels


PICTURE, TABLE = encoded(panel(50)), "<table><tr><td>2.25 ± 0.31</td></tr></table>"
DRAW = f"display({{'image/png': {PICTURE!r}}}, raw=True)"
PHOTO = encoded(panel(50), format="JPEG")
JUNK = base64.b64encode(b"no picture").decode()
# what is wrong -> the cell's source, its stored outputs, what the failure says ("": it passes)
CELLS = {
    "nothing, of a picture": (DRAW, [shown(png=PICTURE)], ""),
    "nothing, of two": (f"{DRAW}\n{DRAW}", [shown(png=PICTURE)] * 2, ""),
    "one pixel's rounding": (DRAW, [shown(png=encoded(rounded(panel(50))))], ""),
    "a moved marker": (DRAW, [shown(png=encoded(panel(55)))], "picture 1 differs"),
    "21 grey levels": (DRAW, [shown(png=encoded(panel(50, grey=234)))], "by 21.0 grey levels"),
    "the second of two": (
        f"{DRAW}\n{DRAW}", [shown(png=PICTURE), shown(png=encoded(panel()))], "picture 2 differs",
    ),
    "another size": (DRAW, [shown(png=encoded(panel(50)[1:]))], "by inf grey levels"),
    "all transparent": (
        DRAW, [shown(png=encoded(np.zeros((200, 300, 4), dtype=np.uint8)))], "picture 1 differs",
    ),
    "a deleted picture": (DRAW, [], "0 pictures are stored, 1 are drawn"),
    "a picture no longer drawn": ("pass", [shown(png=PICTURE)], "1 pictures are stored, 0 are"),
    "junk": (DRAW, [shown(png=JUNK)], "picture 1 cannot be read"),
    "no base64": (DRAW, [shown(png="?")], "picture 1 cannot be read"),
    "half a picture": (DRAW, [shown(png=PICTURE[:-80])], "picture 1 cannot be read"),
    "a cell that never ran": (DRAW, [shown(png=PICTURE)], "Unrun reference cell has outputs"),
    "another photo": (
        f"display({{'image/jpeg': {PHOTO!r}}}, raw=True)",
        [shown(jpeg=encoded(panel(80), format="JPEG"))],
        "picture 1 differs",
    ),
    "nothing, of a text": ("print('p = 0.30')", [printed("p = 0.30\n")], ""),
    "a text": ("print('p = 0.30')", [printed("p = 0.31\n")], "Cell outputs differ"),
    "nothing, of a table": (f"display({{'text/html': {TABLE!r}}}, raw=True)",
                            [shown(html=TABLE)], ""),
    "a number in a table": (
        f"display({{'text/html': {TABLE!r}}}, raw=True)",
        [shown(html=TABLE.replace("2.25", "2.26"))],
        "Cell outputs differ",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def failures(tmp_path_factory):
    """Name of the cell -> how it failed, "" if it did not, where pytest runs as in the project."""
    project = tmp_path_factory.mktemp("project")
    for name in ("pyproject.toml", "conftest.py"):
        shutil.copy(paths.ROOT / name, project)
    (project / "tests").mkdir()
    (project / "notebooks").mkdir()
    cells = [
        new_code_cell(source, outputs=outputs, execution_count=None if "never" in name else 1)
        for name, (source, outputs, _) in CELLS.items()
    ]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    nbformat.write(new_notebook(cells=cells, metadata=kernel), project / "notebooks/01_x.ipynb")
    env = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-n0", "--junitxml=report.xml"],
        cwd=project, env=env, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 1, run.stdout + run.stderr
    cases = ElementTree.parse(project / "report.xml").iter("testcase")
    found = {case.get("name"): case.findtext("failure", "") for case in cases}
    return {name: found[f"Cell {number}"] for number, name in enumerate(CELLS)}


@pytest.mark.parametrize("name", CELLS)
def test_an_altered_output_of_a_notebook_fails(failures, name):
    message = CELLS[name][2]
    assert message in failures[name]
    assert bool(message) == bool(failures[name])
    assert "most recent call last" not in failures[name]


# --- the claims ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def reference():
    return results_in(paths.REFERENCE)


@pytest.mark.parametrize(
    ("file", "old", "new", "claim"),
    [
        ("claims.yaml", "above: 0.555, rule: share", "above: 0.556, rule: share", ""),
        ("claims.yaml", "above: 0.555, rule: share", "above: 1.0, rule: share", "bimodal-by-coeff"),
        ("claims.yaml", "ours: bimodal.map_x", "ours: bimodal.map_y", "map-x"),
        ("claims.yaml", "ours: bimodal.sigmas_y, range: distance, rule: one_world",
         "ours: bimodal.sigmas_y, range: distance, rule: mean_of_five", "sigma-y"),
        ("claims.yaml", "at tau 3.92 and", "at tau 3.96 and", "no-false-alarm"),
        ("printed_values.yaml", "nees: 148.52, pre", "nees: 148.53, pre", "nees"),
    ],
)  # fmt: skip
def test_an_altered_claim_is_noticed(reference, tmp_path, monkeypatch, file, old, new, claim):
    """But for a bound moved by less than any of our worlds can tell (claim "")."""
    for name in ("claims.yaml", "printed_values.yaml"):
        text = (paths.PAPER / name).read_text(encoding="utf-8")
        assert name != file or old in text
        changed = text.replace(old, new, 1) if name == file else text
        (tmp_path / name).write_text(changed, encoding="utf-8")
    monkeypatch.setattr(paths, "CLAIMS", tmp_path / "claims.yaml")
    monkeypatch.setattr(paths, "PRINTED_VALUES", tmp_path / "printed_values.yaml")
    cached = (claims.read, leaves, matching)
    for read in cached:
        read.cache_clear()
    try:
        now = verdict_tables.record(judge.evaluate(reference))
    finally:
        for read in cached:
            read.cache_clear()
    committed = files.read_json(paths.VERDICTS)["C"]
    changed = [name for name in committed if now[name] != committed[name]]
    assert [name[: len(claim)] for name in changed] == ([claim] if claim else [])


def test_every_printed_number_stands_beside_ours_in_the_paper(verdicts):
    table = verdict_tables.whole(verdicts.read)
    numbers = [one for row in verdicts.read for one in row.numbers]
    for one in numbers:
        shown = [cell.translate(latex.LATEX_CELL) for cell in (one.id, one.printed, one.ours)]
        assert " & ".join(shown) in table, one.id
    original = [cells.text(one.value, f".{one.decimals}f") for one in leaves().values()]
    shown = [one.printed.split(" (")[0].removeprefix("−") for one in numbers]
    assert sorted(shown) == sorted(text.removeprefix("−") for text in original)


# --- what the paper and the README ask for -------------------------------------------------------


def test_whatever_the_paper_asks_for_is_handed_on(reference, verdicts):
    """Else LaTeX stops, after the long run: \\res, \\tab and \\fig each need what they name.

    And every table stands in the paper or in its supplement.
    """
    body = paper_text()
    made = verdict_tables.result(verdicts)
    values = set(re.findall(r"\\res\{([^}]*)\}", body))
    assert values <= reference.keys() | made["values"].keys()
    sources = {
        name: "\n".join(cell.source for cell in read_notebook(name).cells)
        for name in notebooks.names()
    }
    handed_on = {
        what for name in sources for kind, what in trace.handed_on(name) if kind == "table"
    }
    tables = set(re.findall(r"(?:\\tab\{|generated/tab_)(\w+)\}", body))
    assert tables == handed_on | made["tables"].keys()
    figures = re.findall(r"\\fig\{(\w+)\}\{(\w+)\}", body)
    assert len(figures) > 10
    for notebook, figure in figures:
        drawn = figure.removesuffix("_timing")
        assert re.search(rf"paper\.figure\(.*\"{drawn}\"", sources[notebook]), (notebook, figure)
        timed = figure.endswith("_timing")
        assert timed or (paths.FIGURES / f"{notebook}_{figure}.pdf").exists()


def test_nothing_is_handed_on_that_nobody_asks_for(reference):
    """Nor kept in the reference, but for the numbers of the tables."""
    keys = {key for key in reference if not key.startswith("tab_")}
    assert keys == keys & asked_keys()
    assert len(keys) > 400


# What the papers' texts say in decimals that is neither a parameter nor printed by the original.
SETTINGS = {
    4.2: "a version of GTSAM", 1.35: "worlds.OVERCONFIDENT", 1.5: "estimators.LOST",
    1.6: "misfit's limit", 2.5: "per cent, of a test", 0.012: "the error of a bias that is zero",
}  # fmt: skip


def parameters_and_printed():
    given = (file.read_text(encoding="utf-8") for file in paths.PARAMS.glob("*.yaml"))
    words = (word for text in given for word in re.findall(r"[\d.]+", re.sub("#.*", "", text)))
    return {float(word) for word in words if word.strip(".")} | {
        one.value for one in leaves().values()
    }


def test_no_result_is_typed():
    """Decimals of the text were chosen, or printed by the original: our results are \\res."""
    text = re.sub(r"(?<!\\)%.*|\\(?:res|tab|fig|label|ref|cite)\{[^}]*\}", "", paper_text())
    text = re.sub(r"\\begin\{half\}\[.*?\]|\\setlength\{.*?\}\{.*?\}", "", text)
    typed = {float(word) for word in re.findall(r"(?<![\w.\\])\d*\.\d+(?!\d*\\[a-z])", text)}
    assert len(typed) > 15
    assert typed - parameters_and_printed() == set(SETTINGS)
    assert 1.02 not in parameters_and_printed()  # such as an error over the oracle's


def test_a_missing_value_is_an_error_of_latex():
    """The macro stops at an unknown key, and typesetting stops at the first error."""
    text = (paths.PAPER / "preamble.tex").read_text(encoding="utf-8")
    macro = re.search(r"\\newcommand\{\\res\}\[1\]\{(.*?)\n\s+(.*?)\n", text)
    assert macro[1] == r"\ifcsname res@#1\endcsname\csname res@#1\endcsname\else"
    assert macro[2].startswith(r"\PackageError{sngr}{")
    assert "-halt-on-error" in (paths.ROOT / "scripts/typeset.sh").read_text(encoding="utf-8")


def test_each_committed_figure_is_drawn_by_its_notebook():
    for path in paths.FIGURES.glob("*.p*"):
        (name,) = [name for name in notebooks.names() if path.stem.startswith(name)]
        source = "\n".join(cell.source for cell in read_notebook(name).cells)
        figure = path.stem.removeprefix(f"{name}_").removesuffix("_timing")
        assert re.search(rf"paper\.figure\(.*\"{figure}\"", source), path.name


def test_links_of_the_readme_lead_somewhere():
    text = paths.README.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    assert len(links) > 20
    for link in links:
        assert (paths.ROOT / link).exists(), link


def test_the_python_of_the_readme_runs():
    """With two worlds, and no cluster in the place of one."""
    text = paths.README.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert "range(30)" in code
    names = {
        "distributed": SimpleNamespace(Client=nullcontext),
        "joblib": SimpleNamespace(parallel_config=lambda backend: nullcontext()),
    }
    names |= {"isam2_over_worlds": isam2_over_worlds, "Scenario": Scenario, "PRESETS": PRESETS}
    exec(code.replace("range(30)", "range(2)"), names)


def test_the_versions_of_python_are_the_same_everywhere():
    first, last = "3.11", "3.14"
    readme, setup, project = (
        (paths.ROOT / name).read_text(encoding="utf-8")
        for name in ("README.md", "scripts/setup.sh", "pyproject.toml")
    )
    assert f"Python {first} to {last}" in readme
    assert f"(3, {first[2:]}) <= sys.version_info[:2] <= (3, {last[2:]})" in setup
    assert f'requires-python = ">={first},<3.{int(last[2:]) + 1}"' in project
    assert f"--python-version {first}" in (paths.ROOT / "Makefile").read_text(encoding="utf-8")


def test_what_a_run_makes_is_not_committed():
    ignored = (paths.ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    made = {"build/", ".venv/", "paper/generated/", "figures/*_timing.pdf"}
    documents = [Path(file) for file in links.DOCUMENTS]  # by the rule of scripts/typeset.sh
    texts = {path.name: path.read_text(encoding="utf-8") for path in paths.PAPER.glob("*.tex")}
    assert {file.name for file in documents} == {
        name for name, text in texts.items() if text.startswith("\\documentclass")
    }
    made |= {file.with_suffix(".pdf").as_posix() for file in documents}
    assert made <= set(ignored)
