"""One execution serves the paper and the test, in either order, and both still notice."""

import base64
import contextlib
import io
import json
import shutil

import numpy as np
import pytest
from PIL import Image
from small_project import (
    NAME,
    a_copy_to_spoil,
    at_home_in,
    declared_cell,
    light_body,
    make_project,
    write_notebook,
)

from sngr_utils import paths
from sngr_utils.publish import run

BODY = (
    light_body()
    + """
import os
import matplotlib.pyplot as plt
with Path("../build/executions").open("a") as log: print(os.getpid(), file=log)
print(f"the seed is {seed}")
fig, ax = plt.subplots(figsize=(2, 2))
ax.plot([seed, 1]);
"""
)


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """A project with the root's conftest.py and pytest options, its notebook executed once."""
    here = tmp_path_factory.mktemp("project")
    make_project(here)
    for file in ("conftest.py", "pyproject.toml"):
        shutil.copy(paths.ROOT / file, here)
    with at_home_in(here):
        paths.BUILD.mkdir()
        write_notebook(here, declared_cell(here), BODY)
        run.refresh(NAME)
        assert executions() == 1
    return here


@pytest.fixture
def folder(executed, tmp_path):
    with a_copy_to_spoil(executed, tmp_path):
        yield tmp_path


def executions():
    return len((paths.BUILD / "executions").read_text().splitlines())


def compare(folder):
    """Status and output of the project's own pytest on the notebook."""
    options = ["-n0", "-p", "no:cacheprovider", "-c", folder / "pyproject.toml"]
    with contextlib.redirect_stdout(io.StringIO()) as shown, contextlib.chdir(folder):
        status = pytest.main([*map(str, options), "notebooks"])
    return status, shown.getvalue()


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
    status, shown = compare(folder)  # the test after a run
    assert status == 0, shown
    run.run_notebook(NAME)  # the paper after the test
    assert executions() == 1
    assert "executed before, from the same inputs" in capsys.readouterr().out
    assert (paths.RESULTS / f"{NAME}.json").exists()


def test_an_altered_output_and_picture_are_noticed_without_executing(folder):
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


def test_a_stale_run_is_executed_by_the_test_and_then_serves_the_paper(folder):
    edit_stored(lambda cell: cell.update(source=BODY.replace("the seed is", "a seed is")))
    status, shown = compare(folder)
    assert status == 1  # the stored output is of the old source
    assert "a seed is 0" in shown
    assert executions() == 2
    run.run_notebook(NAME)
    assert executions() == 2


def test_a_damaged_run_is_no_run(folder):
    (damaged,) = paths.RUNS.glob(f"{NAME}.*/{NAME}.json")
    damaged.write_text(damaged.read_text().replace("values", "volues"))
    compare(folder)
    assert executions() == 2


def test_a_failing_cell_is_the_one_that_is_reported(folder):
    write_notebook(folder, declared_cell(folder), "1 / 0")
    status, shown = compare(folder)
    assert status == 1
    assert "ZeroDivisionError" in shown
