"""Writes a recording as the tables that `tables` reads."""

import csv
import io
import os
import re
from pathlib import Path

import numpy as np

from sngr_utils import whole_file
from sngr_utils.files.recording import Recording
from sngr_utils.files.tables import CHANCE, COLUMNS, CORRELATIONS, FIXED
from sngr_utils.files.text import LONGEST_LINE
from sngr_utils.world.log import NO_LABEL, Log


def write(folder: Path, recording: Recording) -> None:
    """Write the tables of a recording into a folder, made if need be; ranges as sorted by pose.

    Raises
    ------
    ValueError : before anything is written, a name that cannot stand in a table, and a table that
        is there already and would be read with these
    """
    texts = {folder / f"{name}.csv": _text(*table) for name, table in _tables(recording).items()}
    for path in (folder / f"{name}.csv" for name in COLUMNS):
        if path not in texts and os.path.lexists(path):
            raise ValueError(f"{path}: it is there already, and this recording has none")
    for path, text in texts.items():
        if len(longest := max(text.split("\n"), key=len)) > LONGEST_LINE:
            raise ValueError(f"{path}: a line of {len(longest)} characters: too many landmarks")
    folder.mkdir(parents=True, exist_ok=True)
    whole_file.write_texts(texts)


def _tables(recording: Recording) -> dict[str, tuple]:
    """Header and rows of each table."""
    log, truth, names = recording.log, recording.truth, recording.landmark_names
    _check_names(names, log.n_landmarks)
    found = {"odometry": ([*COLUMNS["odometry"][0], *CORRELATIONS], _odometry_rows(log))}
    columns = ["pose", "time_s", "range_m", "sigma_m", "landmark"]
    label = ["" if k == NO_LABEL else names[k] for k in log.label_of]
    cells = [log.pose_of, log.times[log.pose_of], log.ranges, log.range_sigmas, label]
    if log.label_probabilities is not None:
        columns += [CHANCE + name for name in names]
        cells += list(log.label_probabilities.T)
    if truth is not None and truth.source_of is not None:
        columns.append("source")
        cells.append(["" if k == NO_LABEL else names[k] for k in truth.source_of])
    found["ranges"] = columns, zip(*cells, strict=True)
    known = np.full((log.n_landmarks, 2), np.nan) if truth is None else truth.landmarks
    cells = names, *log.landmark_means.T, log.landmark_sigmas, *known.T
    header = [*COLUMNS["landmarks"][0], *COLUMNS["landmarks"][1]]
    found["landmarks"] = header, zip(*cells, strict=True)
    if truth is not None and truth.poses is not None:
        rows = np.column_stack([log.times, truth.poses])
        found["truth"] = ["time_s", *COLUMNS["truth"][0]], rows
    if (log.scale, log.offset) != tuple(FIXED.values()):
        rows = [("scale", *log.scale), ("offset_m", *log.offset)]
        found["calibration"] = COLUMNS["calibration"][0], rows
    return found


def _check_names(names: list[str], n_landmarks: int) -> None:
    """Refuse names that would not come back."""
    if len(names) != n_landmarks or len(set(names)) < len(names):
        raise ValueError(f"landmark_names: {n_landmarks} landmarks need as many different names")
    for k, name in enumerate(names):
        odd = name != name.strip() or re.search("[\r\n\0\ud800-\udfff]", name)
        if not name or odd:
            raise ValueError(f"landmark_names[{k}] is {name[:40]!r}: it cannot stand in a table")


def _odometry_rows(log: Log) -> np.ndarray:
    """(T, 10) rows, the first one the prior on the first pose."""
    sigmas = np.sqrt(np.diagonal(log.odometry_covariances, axis1=1, axis2=2))
    c = log.odometry_covariances / (sigmas[:, :, None] * sigmas[:, None, :])
    steps = np.column_stack([log.odometry, sigmas, c[:, 0, 1], c[:, 0, 2], c[:, 1, 2]])
    first = np.concatenate([log.x0_mean, log.x0_sigmas, np.zeros(3)])
    return np.column_stack([log.times, np.vstack([first, steps])])


def _text(header: list[str], rows) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *(map(_shown, row) for row in rows)])
    return text.getvalue()


def _shown(cell) -> str | int:
    if isinstance(cell, str | np.integer):
        return cell
    return "" if np.isnan(cell) else repr(float(cell))
