"""The Plaza sets, which the gtsam wheel ships: a mower among four radios, with GPS.

`DRp` are dead-reckoned poses, `GT` is GPS, `TD` has the ranges and `TL` the radios. The heading
that comes with Plaza1's odometry is that of the GPS, to the last bit: whoever drives the measured
lengths along it has the GPS for a compass. The dead-reckoned positions follow a gyro, and their
course is an honest heading. The lengths are those of the GPS too, in both sets, within .1 mm for
most steps: no odometry of these sets is free of the truth.

Source: Djugash, Hamner, Roth, Navigating with ranging radios: five data sets with ground truth,
Journal of Field Robotics 26, 2009.
"""

from pathlib import Path

import numpy as np
from scipy import io

from sngr_utils.files.recording import Recording, frame_sigmas, named
from sngr_utils.world.checks import LARGEST
from sngr_utils.world.dead_reckoning import relative_motion
from sngr_utils.world.log import Log
from sngr_utils.world.truth import Truth

SETS = ("Plaza1", "Plaza2")  # what the wheel has, by name
TABLES = {"DRp": 4, "GT": 4, "TD": 4, "TL": 3}  # columns of each
SLOW = 0.1  # of the median step of those that move, below which a course is noise
# Where `noise_estimation` begins; nothing here is set by the truth
RANGE_SIGMA = 1.0  # m
PER_ROOT_METRE = (0.1, 0.1, 0.01)  # m, m, rad
SCALE, OFFSET = (1.0, 0.1), (0.0, RANGE_SIGMA)  # means and sigmas of what is nearly open
STANDING = 0.01  # m, the least length that a step counts as
SILENCE, BRIDGED = 5.0, 1.0  # s without a range that get poses all the same, and how far apart
HEADINGS = ("course", "leaked")


def wheel(name: str) -> Path:
    """Where the wheel keeps a set.

    Parameters
    ----------
    name : one of `SETS`
    """
    import gtsam

    return Path(gtsam.findExampleDataFile(f"{name}_.mat"))


def read(path: Path, heading: str = "course") -> Recording:
    """The recording in a set: a pose for each time of a range; range scale and offset are open.

    A long silence has poses too, for its odometry is no straight line. The priors on scale and
    offset are weak, and keep a short stretch in bounds.

    Parameters
    ----------
    heading : of the odometry, "course" or "leaked", the one in the file

    Raises
    ------
    ValueError : no such file, tables that do not fit, a robot that stands still, or another heading
    """
    if heading not in HEADINGS:
        raise ValueError(f"heading is {heading!r}: it must be one of {', '.join(HEADINGS)}")
    reckoned, gps, ranges, radios = _tables(path)
    times = _times(ranges[:, 0])
    with named(path):
        way = _honest(reckoned) if heading == "course" else _leaked(reckoned)
    poses = _at(times, reckoned[:, 0], way)
    true = _at(times, gps[:, 0], np.column_stack([gps[:, 1:3], np.unwrap(gps[:, 3])]))
    names = [str(int(radio)) for radio in radios[:, 0]]
    labels = [names.index(str(int(radio))) for radio in ranges[:, 2]]
    lengths = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    variances = np.square(PER_ROOT_METRE) * np.maximum(lengths, STANDING)[:, None]
    with named(path):
        log = Log(
            odometry=relative_motion(poses),
            odometry_covariances=variances[:, :, None] * np.eye(3),
            times=times,
            pose_of=np.searchsorted(times, ranges[:, 0]),
            ranges=ranges[:, 3],
            range_sigmas=RANGE_SIGMA,
            label_of=labels,
            n_landmarks=len(names),
            x0_mean=poses[0],
            x0_sigmas=frame_sigmas(np.array([RANGE_SIGMA])),
            scale=SCALE,
            offset=OFFSET,
        )
    sources = np.array(labels)[log.row_of]
    return Recording(log, Truth(poses=true, landmarks=radios[:, 1:], source_of=sources), names)


def _tables(path: Path) -> list[np.ndarray]:
    """Dead reckoning, GPS, ranges and radios."""
    try:
        found = io.loadmat(str(path), variable_names=list(TABLES))
    except Exception as error:  # whatever a broken file makes SciPy raise
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{path}: not a MATLAB file that can be read ({why})") from None
    for name, columns in TABLES.items():
        table = found.get(name)
        fits = table is not None and table.dtype.kind == "f" and table.ndim == 2
        if not fits or table.shape[1] != columns or not len(table):
            raise ValueError(f"{path}: not a Plaza set: no table {name} of {columns} columns")
        bad = ~(np.abs(table) <= LARGEST).all(axis=1)
        _refuse(path, name, bad, f"must be finite and at most {LARGEST:g}")
    heard, radios = found["TD"], found["TL"][:, 0]
    again = ~np.isin(np.arange(len(radios)), np.unique(radios, return_index=True)[1])
    _refuse(path, "TL", again | (radios % 1 != 0), "must number a radio, once")
    _refuse(path, "TD", ~np.isin(heard[:, 2], radios), "is from a radio that TL has not")
    for name in ("DRp", "GT"):
        times = found[name][:, 0]
        if len(times) < 3 or np.any(np.diff(times) <= 0):
            raise ValueError(f"{path}: the times of {name} must grow")
        early, late = heard[:, 0] < times[0] - SILENCE, heard[:, 0] > times[-1] + SILENCE
        _refuse(path, "TD", early | late, f"is at a time that {name} has not")
    return [found[name] for name in TABLES]


def _refuse(path: Path, table: str, bad: np.ndarray, why: str) -> None:
    if bad.any():
        raise ValueError(f"{path}: {table}[{int(np.argmax(bad))}] {why}")


def _times(heard: np.ndarray) -> np.ndarray:
    """(T,) times of the poses, [s]."""
    times = np.unique(heard)
    silent = np.flatnonzero(np.diff(times) > SILENCE)
    bridges = [np.arange(times[i] + BRIDGED, times[i + 1], BRIDGED) for i in silent]
    return np.unique(np.concatenate([times, *bridges]))


def _honest(reckoned: np.ndarray) -> np.ndarray:
    """(T, 3) dead-reckoned positions and their course, which turns evenly where they stand."""
    steps = np.diff(reckoned[:, 1:3], axis=0)
    lengths = np.hypot(*steps.T)
    fast = lengths[lengths > lengths.mean()]  # none if all are alike
    moves = lengths > SLOW * (np.median(fast) if len(fast) else lengths.max())
    if not moves.any():
        raise ValueError("the positions of DRp never move: they have no course")
    middle = 0.5 * (reckoned[:-1, 0] + reckoned[1:, 0])
    angles = np.unwrap(np.arctan2(steps[moves, 1], steps[moves, 0]))
    course = np.interp(reckoned[:, 0], middle[moves], angles)
    return np.column_stack([reckoned[:, 1:3], course])


def _leaked(reckoned: np.ndarray) -> np.ndarray:
    """(T, 3) where the lengths of the steps lead along the heading in the file."""
    angles = np.unwrap(reckoned[:, 3])
    middle = 0.5 * (angles[:-1] + angles[1:])
    lengths = np.hypot(*np.diff(reckoned[:, 1:3], axis=0).T)
    steps = lengths[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
    return np.column_stack([np.vstack([[0, 0], np.cumsum(steps, axis=0)]), angles])


def _at(times: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at other times, along straight lines."""
    return np.column_stack([np.interp(times, known, column) for column in values.T])
