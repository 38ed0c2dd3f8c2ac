"""Studies: resumed, published, and checked by sample, on a toy that takes no time."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from toy_study import FACTOR, draw

from sngr_utils import __main__ as command_line
from sngr_utils.experiments import real_online, row_store, studies
from sngr_utils.experiments.many_worlds import map_worlds
from sngr_utils.files import plaza


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """Where the toy study keeps its rows and its file."""
    study = studies.Study(draw, [("nowhere", seed) for seed in range(300)])
    monkeypatch.setitem(studies.STUDIES, "toy", study)
    monkeypatch.setitem(FACTOR, "of x", 1.0)
    return {"rows": tmp_path / "rows.sqlite", "folder": tmp_path / "studies"}


def test_half_a_study_can_be_read_and_taken_up(toy):
    rows = {"rows": toy["rows"]}
    assert studies.status("toy", **rows) == (0, 300)
    with row_store.kept_in(toy["rows"]):
        map_worlds(draw, studies.STUDIES["toy"].cells[:150], 1)
    assert studies.status("toy", **rows) == (150, 300)
    assert list(studies.table("toy", **rows)["seed"]) == list(range(150))
    studies.run("toy", 1, **toy)
    assert studies.status("toy", **rows) == (300, 300)


def test_the_file_is_the_same_bytes_however_it_was_computed(toy, tmp_path, forked):
    one = studies.run("toy", 1, **toy).read_bytes()
    other = {"rows": tmp_path / "other.sqlite", "folder": tmp_path / "other"}
    assert studies.run("toy", 2, **other).read_bytes() == one
    saved = json.loads(one)
    assert saved["command"] == "python -m sngr_utils study toy"
    assert saved["code"] == row_store.code_of(draw)
    pd.testing.assert_frame_equal(
        studies.committed("toy", folder=toy["folder"]).astype({"no": float}),
        studies.table("toy", rows=toy["rows"]),
    )


def test_two_that_finish_at_once_write_the_same_file(toy, monkeypatch):
    replace_file, seen = Path.replace, []

    def after_the_other(path, target):
        if not seen:
            seen.append(path)
            studies.run("toy", 1, **toy)  # all cells are kept: it is done at once
        return replace_file(path, target)

    monkeypatch.setattr(Path, "replace", after_the_other)
    path = studies.run("toy", 1, **toy)
    assert len(json.loads(path.read_text())["rows"]) == 300
    assert list(toy["folder"].iterdir()) == [path]


def check(toy):
    return studies.check("toy", 1, rng=np.random.default_rng(0), folder=toy["folder"])


def test_a_sample_is_run_again_only_if_the_code_has_changed(toy, monkeypatch):
    studies.run("toy", 1, **toy)
    FACTOR["of x"] = 2.0
    assert check(toy) == 0  # the fingerprint says that nothing has changed
    monkeypatch.setattr(row_store, "code_of", lambda task: "edited")
    with pytest.raises(ValueError, match=r"study toy, cell \d+: row 0, x is .*, was "):
        check(toy)
    FACTOR["of x"] = 1 + 1e-9
    assert check(toy) == 6  # 2 % of 300
    FACTOR["of x"] = 1 + 1e-5
    with pytest.raises(ValueError, match="x is"):
        check(toy)


def test_times_of_a_machine_are_not_compared(toy, monkeypatch):
    timed = replace(studies.STUDIES["toy"], times=("x",))
    monkeypatch.setitem(studies.STUDIES, "toy", timed)
    studies.run("toy", 1, **toy)
    FACTOR["of x"] = 2.0
    monkeypatch.setattr(row_store, "code_of", lambda task: "edited")
    assert check(toy) == 6


def test_few_cells_are_five_and_other_cells_are_refused(toy, monkeypatch):
    few = studies.Study(draw, [("nowhere", seed) for seed in range(7)])
    monkeypatch.setitem(studies.STUDIES, "toy", few)
    studies.run("toy", 1, **toy)
    with monkeypatch.context() as edited:
        edited.setattr(row_store, "code_of", lambda task: "edited")
        assert check(toy) == 5
    monkeypatch.setitem(studies.STUDIES, "toy", studies.Study(draw, few.cells[1:]))
    with pytest.raises(ValueError, match="other cells"):
        check(toy)


def test_a_study_that_is_not_there_is_named(toy):
    with pytest.raises(ValueError, match="study is 'toys'"):
        studies.run("toys")
    with pytest.raises(ValueError, match=r"toy\.json is missing"):
        check(toy)


@pytest.fixture
def short_drives(monkeypatch):
    """Whichever Plaza set is read has a few poses only."""
    whole = plaza.read(plaza.wheel("Plaza2"))
    log, truth = whole.log.first(130), whole.truth
    sources = truth.source_of[: len(log.ranges)]
    few = replace(whole, log=log, truth=replace(truth, poses=truth.poses[:130], source_of=sources))
    monkeypatch.setattr(plaza, "read", lambda path: few)
    real_online.found_in.cache_clear()
    yield
    real_online.found_in.cache_clear()


@pytest.mark.parametrize("name", [name for name in studies.STUDIES if name != "long_stream"])
def test_the_registered_studies_run(name, short_drives):
    study = studies.STUDIES[name]
    (row,) = map_worlds(study.task, study.cells[:1], 1)
    row_store.text_of(row, "a row")


@pytest.mark.parametrize(
    ("options", "status", "why"),
    [
        (["--jobs", "0"], 2, "--jobs: '0' is no number of workers, 1 to 9999"),
        (["--jobs", "two"], 2, "--jobs: 'two' is no number of workers"),
        (["--scheduler", "nowhere"], 1, "error: --scheduler nowhere: "),
    ],
)
def test_what_makes_no_workers_is_refused_in_a_line(capsys, monkeypatch, options, status, why):
    monkeypatch.setattr(studies, "run", None)  # it would be a TypeError
    try:
        found = command_line.main(["study", "goats", *options])
    except SystemExit as ended:
        found = ended.code
    assert found == status
    assert why in capsys.readouterr().err


@pytest.mark.parametrize("options", [[], ["--status"]])
def test_a_spoiled_store_of_rows_is_named_in_a_line(toy, capsys, monkeypatch, options):
    toy["rows"].write_text("garbage\n" * 200)
    for command in (studies.status, studies.run):
        monkeypatch.setitem(command.__kwdefaults__, "rows", toy["rows"])
    assert command_line.main(["study", "toy", *options]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"error: {toy['rows']} is no store of rows")
    assert said.endswith("remove it\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("name", studies.STUDIES)
def test_a_committed_study_is_what_its_code_makes(name):
    """Where the code behind it has changed; which of its cells are looked at is drawn anew."""
    studies.check(name, rng=np.random.default_rng())
