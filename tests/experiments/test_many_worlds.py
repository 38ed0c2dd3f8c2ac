"""One helper for all worlds: the same results whoever computes them, and nothing lost to a kill."""

import io
import json
import os
import sqlite3
import subprocess
import sys

import joblib
import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError
from toy_study import CALLS, draw, last_first

from sngr_utils import paths
from sngr_utils.experiments import isam2_over_worlds, many_worlds, row_store
from sngr_utils.experiments.many_worlds import map_worlds
from sngr_utils.world.scenario import Scenario

CASES = [("nowhere", seed) for seed in range(12)]


@pytest.fixture
def calls():
    CALLS.clear()
    return CALLS


@pytest.mark.parametrize("backend", ["threading", "multiprocessing", "sequential"])
def test_results_are_in_the_order_of_the_cases(backend):
    cases = [(seed, 9) for seed in range(9)]
    with joblib.parallel_config(backend=backend, n_jobs=3):
        assert map_worlds(last_first, cases) == list(range(9))
        assert map_worlds(last_first, []) == []


@pytest.mark.parametrize("backend", ["threading", "multiprocessing"])
def test_rows_kept_by_many_workers_are_those_of_one(backend, tmp_path):
    texts = []
    for jobs in (1, 2):
        with row_store.kept_in(tmp_path / f"{jobs}.sqlite") as store:
            with joblib.parallel_config(backend=backend, n_jobs=jobs):
                found = map_worlds(draw, CASES)
            query = "SELECT * FROM rows ORDER BY key"
            texts.append((json.dumps(found), store.connection.execute(query).fetchall()))
    assert texts[0] == texts[1]
    assert len(texts[0][1]) == len(CASES)


def test_a_dask_cluster_finds_the_same(tmp_path):
    distributed = pytest.importorskip("distributed")
    alone = map_worlds(last_first, [(seed, 9) for seed in range(9)], 1)
    local = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with (
        distributed.Client(processes=False, **local),
        joblib.parallel_config(backend="dask"),
        row_store.kept_in(tmp_path / "rows.sqlite"),
    ):
        assert map_worlds(last_first, [(seed, 9) for seed in range(9)]) == alone


def test_a_kept_row_is_not_computed_again_and_is_the_same(calls, tmp_path):
    with row_store.kept_in(tmp_path / "rows.sqlite"):
        first = map_worlds(draw, CASES[:7], 1)
        again = map_worlds(draw, CASES, 1)
    assert calls == list(range(12))
    assert json.dumps(again[:7]) == json.dumps(first)
    plain = map_worlds(draw, CASES, 1)
    assert [row[0]["x"] for row in again] == [row[0]["x"] for row in plain]


def test_other_parameters_and_other_code_are_other_rows(monkeypatch):
    given = Scenario()
    cases = [(given, 1), (given, 2), (given.model_copy(update={"radius": 5.1}), 1), (given, 1.0)]
    keys = {row_store.key_of(task, case) for task in (draw, last_first) for case in cases}
    assert len(keys) == 8
    assert row_store.key_of(draw, (Scenario(), 1)) == row_store.key_of(draw, [given, 1])
    monkeypatch.setattr(row_store, "code_of", lambda task: "edited")
    assert row_store.key_of(draw, (given, 1)) not in keys


def test_the_code_of_a_task_is_all_that_it_imports(monkeypatch, tmp_path):
    """An edit of the lowest module behind a task changes its code; of one it does not use, not.

    Nor does a comment, or what a docstring says.
    """
    read, task = row_store.Path.read_text, isam2_over_worlds.run_sweep
    before = row_store.code_of(task)
    for name, more, same in (
        ("trigger.py", "0\n", False), ("environment.lock", "#\n", False), ("em.py", "0\n", True),
        ("trigger.py", "\n# a word\n", True),
        ("trigger.py", '\ndef of():\n    """A word."""\n', False),
    ):  # fmt: skip
        row_store._code_of.cache_clear()
        edited = lambda p, name=name, more=more: read(p) + more * (p.name == name)  # noqa: E731
        monkeypatch.setattr(row_store.Path, "read_text", edited)
        assert (row_store.code_of(task) == before) == same
        monkeypatch.undo()
    row_store._code_of.cache_clear()


def test_of_a_module_its_code_counts_and_not_its_words():
    text = (
        '''"""Words."""\nX = "#1"  # one\n\ndef f(a):\n    """More\n    words."""\n    return a\n'''
    )
    other = '''"""Other."""\n# words\nX = "#1"\ndef f(a):\n    """Less."""\n    return a  # a\n'''
    assert row_store._code_in(text) == 'X = "#1"\ndef f(a):\n    return a'
    assert row_store._code_in(text) == row_store._code_in(other)
    assert row_store._code_in(text.replace("#1", "#2")) != row_store._code_in(text)


KILLED = """
import sys
from pathlib import Path
from sngr_utils.experiments import many_worlds, row_store
from toy_study import draw
folder = sys.argv[1]
with row_store.kept_in(Path(folder, "rows.sqlite")):
    many_worlds.map_worlds(draw, [(folder, seed) for seed in range(1000)], 1)
"""


def test_a_run_that_is_killed_at_500_of_1000_leaves_500_to_do(calls, tmp_path):
    """The process that computes and keeps the rows ends at once, without any clean-up."""
    (tmp_path / "500").touch()
    path = os.pathsep.join([str(paths.ROOT), str(paths.ROOT / "tests")])
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], env={**os.environ, "PYTHONPATH": path},
        check=False,
    )  # fmt: skip
    assert killed.returncode == 9
    (tmp_path / "500").unlink()
    cases = [(str(tmp_path), seed) for seed in range(1000)]
    with row_store.kept_in(tmp_path / "rows.sqlite"):
        resumed = map_worlds(draw, cases, 1)
    assert calls == list(range(500, 1000))
    with row_store.kept_in(tmp_path / "whole.sqlite"):
        assert json.dumps(map_worlds(draw, cases, 1)) == json.dumps(resumed)


def test_a_worker_that_dies_is_an_error_and_what_was_done_stays(calls, tmp_path):
    (tmp_path / "900").touch()
    cases = [(str(tmp_path), seed) for seed in range(1000)]
    with row_store.kept_in(tmp_path / "rows.sqlite") as store:
        with joblib.parallel_config(backend="loky"), pytest.raises(TerminatedWorkerError):
            map_worlds(draw, cases, 2)
        kept = store.connection.execute("SELECT count(*) FROM rows").fetchone()[0]
        assert 0 < kept < 1000
        (tmp_path / "900").unlink()
        assert [row[0]["seed"] for row in map_worlds(draw, cases, 1)] == list(range(1000))
    assert len(calls) == 1000 - kept


def test_a_row_is_all_there_or_not_at_all(tmp_path):
    """Another process reads while rows are written, and sees whole ones only."""
    path = tmp_path / "rows.sqlite"
    with row_store.kept_in(path) as store:
        map_worlds(draw, CASES[:3], 1)
        with sqlite3.connect(path) as reader:
            seen = reader.execute("SELECT row FROM rows").fetchall()
        reader.close()
        assert [list(json.loads(text)[0]) for (text,) in seen] == [
            ["seed", "x", "n", "no", "text"]
        ] * 3
        map_worlds(draw, CASES, 1)
        assert store.get("nothing") is None


def test_what_cannot_be_kept_is_refused_by_name(tmp_path):
    with row_store.kept_in(tmp_path / "rows.sqlite"), pytest.raises(ValueError, match="object"):
        map_worlds(draw, [(object(), 1)], 1)
    junk = tmp_path / "junk"
    junk.write_bytes(b"no store at all" * 100)
    with pytest.raises(ValueError, match="junk is no store"), row_store.kept_in(junk):
        pass
    assert row_store.active() is None


def test_the_bar_is_for_terminals_only(monkeypatch, tmp_path):
    for terminal in (False, True):
        screen = io.StringIO()
        screen.isatty = lambda terminal=terminal: terminal
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setattr(many_worlds.tqdm, "__init__", _to(screen, many_worlds.tqdm.__init__))
        with row_store.kept_in(tmp_path / f"{terminal}.sqlite"):
            map_worlds(draw, CASES, 1)
        monkeypatch.undo()
        assert ("draw" in screen.getvalue() and "12/12" in screen.getvalue()) == terminal


def _to(screen, init):
    return lambda self, *given, **named: init(self, *given, file=screen, **named)
