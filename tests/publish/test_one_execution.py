"""One execution serves the paper and the test, in either order, and both still notice."""

import base64
import io
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from small_project import NAME, at_home_in, declared_cell, make_project, write_notebook

from sngr_utils import paths
from sngr_utils.publish import run

BODY = """
import os
from pathlib import Path
import matplotlib.pyplot as plt
from sngr_utils.publish import report
with Path("../build/executions").open("a") as log: print(os.getpid(), file=log)
paper = report.Report("01_bimodal", output_dir)
paper.value("seed", seed)
paper.save()
print(f"the seed is {seed}")
fig, ax = plt.subplots(figsize=(2, 2))
ax.plot([seed, 1]);
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A project with the root's conftest.py and pytest options, nothing executed yet."""
    here = tmp_path_factory.mktemp("project")
    make_project(here)
    for file in ("conftest.py", "pyproject.toml"):
        shutil.copy(paths.ROOT / file, here)
    with at_home_in(here):
        paths.BUILD.mkdir()
        write_notebook(here, declared_cell(here), BODY)
        yield here


def executions():
    return len((paths.BUILD / "executions").read_text().splitlines())


def compare(folder):
    """Status and output of the project's own pytest on the notebook."""
    command = [sys.executable, "-m", "pytest", "-n0", "-p", "no:cacheprovider", "notebooks"]
    env = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def edit_stored(change):
    path = paths.NOTEBOOKS / f"{NAME}.ipynb"
    notebook = json.loads(path.read_text())
    change(notebook["cells"][2])
    path.write_text(json.dumps(notebook))


def altered_picture(output):
    picture = np.array(Image.open(io.BytesIO(base64.b64decode(output["data"]["image/png"]))))
    picture[..., :3] = np.clip(picture[..., :3].astype(int) - 21, 0, 255)
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    output["data"]["image/png"] = base64.b64encode(buffer.getvalue()).decode()


def test_paper_test_and_stored_outputs_share_one_execution(folder, capsys):
    run.refresh(NAME)
    assert executions() == 1
    status, shown = compare(folder)  # the test after a run
    assert status == 0, shown
    run.run_notebook(NAME)  # the paper after the test
    assert executions() == 1
    assert "executed before, from the same inputs" in capsys.readouterr().out
    assert (paths.RESULTS / f"{NAME}.json").exists()

    # an altered output and an altered picture are noticed, without executing
    good = (paths.NOTEBOOKS / f"{NAME}.ipynb").read_bytes()
    edit_stored(lambda cell: cell["outputs"][0].update(text=["the seed is 7\n"]))
    status, shown = compare(folder)
    assert status == 1
    assert "the seed is 7" in shown
    (paths.NOTEBOOKS / f"{NAME}.ipynb").write_bytes(good)
    edit_stored(lambda cell: altered_picture(cell["outputs"][1]))
    status, shown = compare(folder)
    assert status == 1
    assert "picture 1 differs from the stored one" in shown
    assert executions() == 1

    # a stale run is executed, by the test first this time, and then serves the paper
    source = BODY.replace("the seed is", "a seed is")
    (paths.NOTEBOOKS / f"{NAME}.ipynb").write_bytes(good)
    edit_stored(lambda cell: cell.update(source=source))
    status, shown = compare(folder)
    assert status == 1  # the stored output is of the old source
    assert "a seed is 0" in shown
    assert executions() == 2
    run.run_notebook(NAME)
    assert executions() == 2

    # a damaged run, and results that came from elsewhere, are no run
    (damaged,) = paths.RUNS.glob(f"{NAME}.*/{NAME}.json")
    damaged.write_text(damaged.read_text().replace("seed", "sead"))
    compare(folder)
    assert executions() == 3


def test_a_failing_cell_is_the_one_that_is_reported(folder):
    write_notebook(folder, declared_cell(folder), "1 / 0")
    status, shown = compare(folder)
    assert status == 1
    assert "ZeroDivisionError" in shown
