"""Studies that take longer than a paper may: made by one command, committed, checked by sample.

`run` makes a study, taking up what an earlier run has left, and writes ``paper/studies/NAME.json``
with the command and a fingerprint of the code. When that code has changed, `check` runs a few of
its cells again and fails if one differs.
"""

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from sngr_utils import paths, whole_file
from sngr_utils.experiments import (
    all_windows,
    authors_over_worlds,
    every_world,
    kinds_of_worlds,
    long_stream,
    online_variants,
    peers_again,
    real_data,
    real_online,
    real_peers,
    row_store,
    sensitivity,
)
from sngr_utils.experiments.many_worlds import map_worlds

FOLDER = paths.PAPER / "studies"
PLAZA, ONLINE = range(7500, 7505), range(7460, 7465)  # seeds of wrong labels
SHARE, FEWEST = 0.02, 5  # of the cells that are run again, and how many at least


@dataclass(frozen=True)
class Study:
    """A task for each of many cells.

    Attributes
    ----------
    task : its arguments are a cell; returns a list of rows, each a dict of numbers and strings
    cells : arguments
    within : largest relative difference of a number that counts as the same
    times : columns that are CPU times of one machine, which are not compared
    """

    task: Callable[..., list[dict]]
    cells: list[tuple]
    within: float = 1e-6
    times: tuple[str, ...] = ()


STUDIES = {
    # the trigger and its refinement as the original's authors run them
    "authors_conventions": Study(
        authors_over_worlds.rows, [(seed,) for seed in range(7300, 7400)], within=1e-3
    ),
    # the Plaza sets: labels right, wrong, none, and failures provoked
    "plaza": Study(real_data.run_plaza, real_data.plaza_cells(PLAZA), within=1e-3),
    # the same pose by pose
    "plaza_online": Study(
        real_online.run, real_online.cells(ONLINE), within=1e-3, times=real_online.TIMES
    ),
    # and other people's estimators on it
    "plaza_peers": Study(
        real_peers.run, real_peers.cells(ONLINE[:1]), within=1e-3, times=real_peers.TIMES
    ),
    # GOATS, by ranges held out
    "goats": Study(real_data.run_goats, [(15,), (16,)], within=1e-3),
    # the online estimator in worlds of every kind, and as it drives on
    "every_world": Study(every_world.rows, kinds_of_worlds.cells(range(9100, 9130))),
    # times are those of one machine: only their order of magnitude is checked
    "long_stream": Study(long_stream.rows, [(10_000, 0.0, 100)], within=10.0),
    # and its peers of notebook 08 in worlds that nobody has looked at
    "peers_again": Study(peers_again.rows, [(seed,) for seed in range(8700, 8740)]),
    # every window of the paper's world by dynesty, those that do not trigger too
    "all_windows": Study(all_windows.rows, all_windows.CELLS, within=1e-3, times=("seconds",)),
    # the online estimator with each of its parts switched off
    "ablation": Study(online_variants.ablation, [(seed,) for seed in range(9300, 9340)]),
    # with each of its constants at half and at twice its value
    "sensitivity": Study(sensitivity.rows, sensitivity.cells(range(130, 132))),
}


def named(name: str) -> Study:
    """The study of a name.

    Raises
    ------
    ValueError : there is none
    """
    if name not in STUDIES:
        raise ValueError(f"study is {name!r}: it must be one of {sorted(STUDIES)}")
    return STUDIES[name]


def run(
    name: str, jobs: int | None = None, *, rows: Path = row_store.DEFAULT, folder: Path = FOLDER
) -> Path:
    """Compute the cells that are not kept yet, and write the file of a study.

    Parameters
    ----------
    jobs : workers; None leaves number and backend to ``joblib.parallel_config``
    rows : where results are kept one by one
    folder : of the file, which is the same bytes however it was computed
    """
    study = named(name)
    with row_store.kept_in(rows):
        found = map_worlds(study.task, study.cells, jobs)
    head = {
        "study": name,
        "command": f"python -m sngr_utils study {name}",
        "code": row_store.code_of(study.task),
        "cells": _fingerprint(study),
    }
    lines = [f" {json.dumps(key)}: {json.dumps(value)}," for key, value in head.items()]
    cells = ",\n  ".join(json.dumps(_without_nan(cell), allow_nan=False) for cell in found)
    text = "\n".join(["{", *lines, f' "rows": [\n  {cells}\n ]', "}", ""])
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    whole_file.write_text(path, text)
    return path


def status(name: str, *, rows: Path = row_store.DEFAULT) -> tuple[int, int]:
    """How many cells of a study are kept, of how many."""
    return len(_kept(named(name), rows)), len(named(name).cells)


def table(name: str, *, rows: Path = row_store.DEFAULT) -> pd.DataFrame:
    """The rows of a study that are known so far, in the order of its cells."""
    return pd.DataFrame([row for cell in _kept(named(name), rows) for row in cell])


def committed(name: str, *, folder: Path = FOLDER) -> pd.DataFrame:
    """The rows of a study as its file has them."""
    return pd.DataFrame([row for cell in _read(name, folder)["rows"] for row in cell])


def check(
    name: str, jobs: int | None = None, *, rng: np.random.Generator, folder: Path = FOLDER
) -> int:
    """If the code behind a study's file has changed, run some of its cells again.

    Returns
    -------
    the number of cells run again: none, or `SHARE` of them and at least `FEWEST`, drawn at random

    Raises
    ------
    ValueError : the file is of other cells, or a number of a cell differs; the message names it
    """
    study, saved = named(name), _read(name, folder)
    if saved["cells"] != _fingerprint(study) or len(saved["rows"]) != len(study.cells):
        raise ValueError(f"study {name}: its file is of other cells; {saved['command']}")
    if saved["code"] == row_store.code_of(study.task):
        return 0
    n = min(len(study.cells), max(FEWEST, math.ceil(SHARE * len(study.cells))))
    chosen = sorted(rng.choice(len(study.cells), n, replace=False).tolist())
    again = map_worlds(study.task, [study.cells[i] for i in chosen], jobs)
    for i, fresh in zip(chosen, again, strict=True):
        fresh = _without_nan(json.loads(row_store.text_of(fresh, "a row")))
        difference = _difference(saved["rows"][i], fresh, study)
        if difference:
            raise ValueError(f"study {name}, cell {i}: {difference}; {saved['command']}")
    return n


def _kept(study: Study, rows: Path) -> list[list[dict]]:
    with row_store.kept_in(rows) as store:
        rows = (store.get(row_store.key_of(study.task, cell)) for cell in study.cells)
        return [row for row in rows if row is not None]


def _fingerprint(study: Study) -> str:
    return hashlib.sha256(row_store.text_of(study.cells, "cells").encode()).hexdigest()[:32]


def _read(name: str, folder: Path) -> dict:
    path = folder / f"{name}.json"
    if not path.exists():
        raise ValueError(f"study {name}: {path.name} is missing; python -m sngr_utils study {name}")
    return json.loads(path.read_text())


def _without_nan(rows: list[dict]) -> list[dict]:
    """Rows with None for NaN, which JSON does not have."""
    return [{k: None if v != v else v for k, v in row.items()} for row in rows]


def _difference(saved: list[dict], fresh: list[dict], study: Study) -> str | None:
    """What differs first between two lists of rows, in words; None if nothing does."""
    if [list(row) for row in saved] != [list(row) for row in fresh]:
        return "other rows or columns"
    for i, (old, new) in enumerate(zip(saved, fresh, strict=True)):
        for name in (name for name in old if name not in study.times):
            a, b = old[name], new[name]
            close = a == b or (
                isinstance(a, float) and isinstance(b, float)
                and math.isclose(a, b, rel_tol=study.within)
            )  # fmt: skip
            if not close:
                return f"row {i}, {name} is {b!r}, was {a!r}"
    return None
