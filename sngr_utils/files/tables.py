"""Tables of comma-separated values in a folder: see docs/data_format.md for their columns.

`odometry.csv` and `ranges.csv` are the log, with `landmarks.csv` and `calibration.csv` where there
is more to tell; `truth.csv` is for judging.
"""

import math
import os
import warnings
from pathlib import Path

import numpy as np

from sngr_utils.files.recording import Recording, named
from sngr_utils.files.text import Line, lines
from sngr_utils.world.checks import SMALLEST
from sngr_utils.world.log import NO_LABEL, Log, LogWarning
from sngr_utils.world.truth import Truth

MOTION = ["dx_m", "dy_m", "dtheta_rad"]
SIGMAS = ["sigma_x_m", "sigma_y_m", "sigma_theta_rad"]
CORRELATIONS = ["rho_xy", "rho_xtheta", "rho_ytheta"]
SHORT = 0.02  # of the time of the poses, in which all ranges lie: a thousandth is milliseconds
# of each table: columns that it must have, and those that it may have
COLUMNS = {
    "odometry": (["time_s", *MOTION, *SIGMAS], CORRELATIONS),
    "ranges": (["range_m", "sigma_m", "landmark"], ["time_s", "pose", "source"]),
    "landmarks": (["landmark"], ["x_m", "y_m", "sigma_m", "true_x_m", "true_y_m"]),
    "truth": (["x_m", "y_m", "theta_rad"], ["time_s"]),
    "calibration": (["quantity", "mean", "sigma"], []),
}
CHANCE = "p:"  # a column of chances that a range is from the landmark named after it
FIXED = {"scale": (1.0, 0.0), "offset_m": (0.0, 0.0)}


def read(folder: Path) -> Recording:
    """The recording in the tables of a folder.

    Raises
    ------
    ValueError : naming file and line, a table that is missing or does not say what it must
    """
    odometry, ranges = _table(folder, "odometry"), _table(folder, "ranges")
    landmarks, truth = _table(folder, "landmarks", False), _table(folder, "truth", False)
    times = _times(odometry)
    names, motions = _names(landmarks, ranges), odometry.numbers(MOTION)
    first, covariances = _noise(odometry)
    given = {
        **_ranges(ranges, times, names),
        **_survey(landmarks),
        **_calibration(_table(folder, "calibration", False)),
    }
    lines = dict.fromkeys(("pose_of", "ranges", "label_probabilities"), ranges.rows)
    lines["odometry_covariances"] = odometry.rows[1:]
    if landmarks is not None:
        lines["landmark_means"] = landmarks.rows
    with named(folder, lines):
        log = Log(
            odometry=motions[1:],
            odometry_covariances=covariances,
            times=times,
            x0_mean=motions[0],
            x0_sigmas=first,
            n_landmarks=len(names),
            **given,
        )
    return Recording(log, _truth(log, truth, landmarks, ranges, names), names)


class Table:
    """A table: its header has been checked, its cells are numbers when they are asked for."""

    def __init__(self, path: Path, rows: list[Line], header: list[str]):
        self.path, self.rows, self.header = path, rows, header

    def cells(self, column: str) -> list[str]:
        """A column; empty cells if the table has none of that name."""
        return [self.cell(row, column) for row in self.rows]

    def numbers(self, columns: list[str], empty: bool = False) -> np.ndarray:
        """(N, C) numbers of some columns; NaN for empty cells, where they may be."""
        found = np.full((len(self.rows), len(columns)), np.nan)
        for i, row in enumerate(self.rows):
            cells = [self.cell(row, name) for name in columns]
            if not (empty and not any(cells)):
                found[i] = row.numbers(cells, names=columns)
        return found

    def cell(self, row: Line, column: str) -> str:
        """The cell of a row; empty if there is no such column."""
        return row.fields[self.header.index(column)] if column in self.header else ""

    def sigmas(self, column: str) -> np.ndarray:
        """(N,) positive numbers of a column."""
        cells = zip(self.rows, self.cells(column), strict=True)
        return np.array([row.sigma(cell, column) for row, cell in cells])


def _table(folder: Path, name: str, required: bool = True) -> Table | None:
    """A table with a header that it may have; None if it is missing and may be."""
    path = folder / f"{name}.csv"
    if not required and not os.path.lexists(path):
        return None
    head, *rows = lines(path, ",")
    must, may = COLUMNS[name]
    for column in must:
        if column not in head.fields:
            more = ", and time_s or pose" * (name == "ranges")
            raise head.refuse(
                f"no column {column}: the header, with commas, must name {', '.join(must)}{more}"
            )
    for column in head.fields:
        chance = name == "ranges" and column.startswith(CHANCE)
        if not chance and column not in [*must, *may]:
            raise head.refuse(
                f"{column[:40]!r} is no column of {path.name}: {', '.join(must + may)}"
            )
        if head.fields.count(column) > 1:
            raise head.refuse(f"column {column} stands there twice")
    for row in rows:
        if len(row.fields) != len(head.fields):
            raise row.refuse(f"{len(row.fields)} cells: the header has {len(head.fields)}")
    return Table(path, rows, head.fields)


def _times(odometry: Table) -> np.ndarray:
    """(T,) times of the poses, [s]."""
    if not odometry.rows:
        raise ValueError(f"{odometry.path}: no pose")
    times = odometry.numbers(["time_s"])[:, 0]
    for row, step in zip(odometry.rows[1:], np.diff(times), strict=True):
        if step < 0:
            raise row.refuse("time must not go back")
    return times


def _noise(odometry: Table) -> tuple[np.ndarray, np.ndarray]:
    """(3,) sigmas of the first pose, and (T-1, 3, 3) covariances of the steps."""
    sigmas = np.column_stack([odometry.sigmas(name) for name in SIGMAS])
    rho = np.hstack([odometry.numbers([name], empty=True) for name in CORRELATIONS])
    rho = np.nan_to_num(rho)
    correlations = np.tile(np.eye(3), (len(rho), 1, 1))
    for (i, j), column in zip(((0, 1), (0, 2), (1, 2)), rho.T, strict=True):
        correlations[:, i, j] = correlations[:, j, i] = column
    if rho[0].any():
        raise odometry.rows[0].refuse("a prior with correlations: a log has none")
    return sigmas[0], (correlations * sigmas[:, :, None] * sigmas[:, None, :])[1:]


def _check_times(table: Table, times: np.ndarray, poses: np.ndarray) -> None:
    """Refuse a row whose time is nearer to another pose than to that which it is of.

    Parameters
    ----------
    poses : of the rows; what is none is for the log to refuse
    """
    middle = (times[1:] + times[:-1]) / 2
    first, last = np.append(-np.inf, middle), np.append(middle, np.inf)
    there = (poses % 1 == 0) & (poses >= 0) & (poses < len(times))
    index = np.where(there, poses, 0).astype(int)
    given = table.numbers(["time_s"])[:, 0]
    wrong = there & ~((first[index] <= given) & (given <= last[index]))
    for i in np.flatnonzero(wrong)[:1]:
        why = f"time_s is {given[i]:.10g}: odometry.csv has {times[index[i]]:.10g} there"
        raise table.rows[i].refuse(why)


def _names(landmarks: Table | None, ranges: Table) -> list[str]:
    """What landmarks are called: those of their table in its order, or of the ranges sorted."""
    if landmarks is None:
        chances = [name[len(CHANCE) :] for name in ranges.header if name.startswith(CHANCE)]
        found = {*ranges.cells("landmark"), *ranges.cells("source"), *chances} - {""}
        if ranges.rows and not found:
            raise ValueError(f"{ranges.path}: it names no landmark, and no landmarks.csv does")
        return sorted(found, key=lambda name: (len(name) if name.isdigit() else 0, name))
    names = landmarks.cells("landmark")
    first = dict(zip(reversed(names), reversed(landmarks.rows), strict=True))
    for row, name in zip(landmarks.rows, names, strict=True):
        if not name or first[name] is not row:
            raise row.refuse(f"landmark {name[:40]!r}: a name must stand there once")
    return names


def _ranges(ranges: Table, times: np.ndarray, names: list[str]) -> dict:
    """Fields of the log for the ranges."""
    columns = [name for name in ranges.header if name.startswith(CHANCE)]
    found = {
        "pose_of": _pose_of(ranges, times),
        "ranges": ranges.numbers(["range_m"])[:, 0],
        "range_sigmas": ranges.sigmas("sigma_m"),
        "label_of": _numbers_of(ranges, "landmark", names),
    }
    if columns:
        chances = np.zeros((len(ranges.rows), len(names)))
        for name in columns:
            if name[len(CHANCE) :] not in names:
                raise ValueError(f"{ranges.path}: column {name}: landmarks.csv has none such")
            chances[:, names.index(name[len(CHANCE) :])] = ranges.numbers([name])[:, 0]
        found["label_probabilities"] = chances
    return found


def _pose_of(ranges: Table, times: np.ndarray) -> np.ndarray:
    """(M,) pose of each range: the one it names, or the nearest in time."""
    last = len(times) - 1
    if "pose" in ranges.header:
        poses = ranges.numbers(["pose"])[:, 0]
        if "time_s" in ranges.header:
            _check_times(ranges, times, poses)
        return poses
    if "time_s" not in ranges.header:
        raise ValueError(f"{ranges.path}: it must have a column time_s or pose")
    when = ranges.numbers(["time_s"])[:, 0]
    slack = np.diff(times).max(initial=0.0)
    for row, time in zip(ranges.rows, when, strict=True):
        if not times[0] - slack <= time <= times[-1] + slack:
            raise row.refuse(f"time_s is {time:g}: the poses go from {times[0]:g} to {times[-1]:g}")
    if len(when) > 1 and np.ptp(when) < SHORT * np.ptp(times):
        text = (
            f"{ranges.path}: from first to last {np.ptp(when):g} s, of {np.ptp(times):g} s of poses"
        )
        warnings.warn(f"{text}: are both in seconds?", LogWarning, stacklevel=5)
    after = np.clip(np.searchsorted(times, when), min(1, last), last)
    before = np.maximum(after - 1, 0)
    return np.where(when - times[before] <= times[after] - when, before, after)


def _numbers_of(table: Table, column: str, names: list[str]) -> np.ndarray:
    """(N,) numbers of the landmarks that a column names, -1 where it is empty."""
    number_of = {name: k for k, name in enumerate(names)} | {"": NO_LABEL}
    for row, name in zip(table.rows, table.cells(column), strict=True):
        if name not in number_of:
            raise row.refuse(f"landmark {name[:40]!r}: landmarks.csv has none such")
    return np.array([number_of[name] for name in table.cells(column)], dtype=int)


def _survey(landmarks: Table | None) -> dict:
    if landmarks is None:
        return {}
    surveyed = landmarks.numbers(["x_m", "y_m", "sigma_m"], empty=True)
    return {"landmark_means": surveyed[:, :2], "landmark_sigmas": surveyed[:, 2]}


def _calibration(table: Table | None) -> dict:
    if table is None:
        return {}
    found = dict(FIXED)
    names = table.cells("quantity")
    for row in table.rows:
        name, *cells = (table.cell(row, column) for column in COLUMNS["calibration"][0])
        if name not in FIXED or names.count(name) > 1:
            raise row.refuse(f"quantity is {name[:40]!r}: {', '.join(FIXED)}, each at most once")
        mean = float(row.numbers(cells[:1])[0])
        sigma = math.inf if cells[1] == "inf" else float(row.numbers(cells[1:])[0])
        if not (sigma == 0 or sigma >= SMALLEST) or (name == "scale" and mean < SMALLEST):
            raise row.refuse(f"{name} has mean {mean:g} and sigma {sigma:g}: too small")
        found[name] = (mean, sigma)
    return {"scale": found["scale"], "offset": found["offset_m"]}


def _truth(
    log: Log, truth: Table | None, landmarks: Table | None, ranges: Table, names: list[str]
) -> Truth | None:
    known = np.full((len(names), 2), np.nan)
    if landmarks is not None:
        known = landmarks.numbers(["true_x_m", "true_y_m"], empty=True)
    sources = "source" in ranges.header
    if truth is None and not sources and np.isnan(known).all():
        return None
    poses = None if truth is None else truth.numbers(["x_m", "y_m", "theta_rad"])
    if poses is not None and len(poses) != log.n_poses:
        raise ValueError(f"{truth.path}: {len(poses)} rows: odometry.csv has {log.n_poses}")
    if truth is not None and "time_s" in truth.header:
        _check_times(truth, log.times, np.arange(log.n_poses))
    source_of = _numbers_of(ranges, "source", names)[log.row_of] if sources else None
    return Truth(poses=poses, landmarks=known, source_of=source_of)
