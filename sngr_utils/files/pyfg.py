"""PyFactorGraph's text format, `.pyfg`: planar, one robot.

Entries of noise are covariances throughout, the upper triangle row by row; the last number of a
range is its variance [m^2]. Vertices hold the truth, or dead reckoning where nobody knows it.

Source: MarineRoboticsGroup/PyFactorGraph, io/pyfg_text.py, for the fields of each line.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from sngr_utils import whole_file
from sngr_utils.files import graph
from sngr_utils.files.recording import Recording, named
from sngr_utils.files.text import Line, lines
from sngr_utils.world import checks
from sngr_utils.world.log import NO_LABEL, Log

REFUSED = {
    "EDGE_SE2_XY": "a landmark seen in x and y: a log has ranges",
    **dict.fromkeys(
        ("VERTEX_SE3:QUAT", "VERTEX_SE3:QUAT:PRIOR", "VERTEX_XYZ", "VERTEX_XYZ:PRIOR",
         "EDGE_SE3:QUAT", "EDGE_SE3_XYZ"), "three dimensions: a log has two",
    ),
}  # fmt: skip


def read(path: Path) -> Recording:
    """The recording in a file.

    Raises
    ------
    ValueError : naming file and line, what is no such file and what a log cannot express
    """
    found = graph.Graph(path)
    for line in lines(path):
        kind, *fields = line.fields
        if kind in REFUSED:
            raise line.refuse(f"{kind[:40]}: {REFUSED[kind]}")
        if kind not in KINDS:
            raise line.refuse(f"{kind[:40]!r} is no kind of line, one of {', '.join(KINDS)}")
        count, take = KINDS[kind]
        if len(fields) != count:
            raise line.refuse(f"{kind} has {len(fields)} fields after it: it must have {count}")
        take(found, line, fields)
    return found.recording(vertices_are_true=False)


def _pose(found: graph.Graph, line: Line, fields: list[str]) -> None:
    time, *at = line.numbers([fields[0], *fields[2:]])
    found.add("poses", graph.name_of(line, fields[1]), line, time, np.array(at))


def _landmark(found: graph.Graph, line: Line, fields: list[str]) -> None:
    found.add("landmarks", graph.name_of(line, fields[0]), line, line.numbers(fields[1:]))


def _gaussian(kind: str, n: int, d: int) -> Callable:
    """What takes a line of n names, d numbers and their covariance: a prior, or a step."""

    def take(found: graph.Graph, line: Line, fields: list[str]) -> None:
        names = tuple(graph.name_of(line, name) for name in fields[1 : n + 1])
        mean = line.numbers([fields[0], *fields[n + 1 : n + 1 + d]])[1:]
        upper = np.zeros((d, d))
        upper[np.triu_indices(d)] = line.numbers(fields[n + 1 + d :], checks.LARGEST**2)
        covariance = upper + np.triu(upper, 1).T
        found.add(kind, names if n > 1 else names[0], line, mean, covariance)

    return take


def _range(found: graph.Graph, line: Line, fields: list[str]) -> None:
    pose, landmark = graph.name_of(line, fields[1]), graph.name_of(line, fields[2])
    _, value = line.numbers([fields[0], fields[3]])
    sigma = line.sigma(fields[4], "a variance", power=2)
    found.ranges.append(graph.Range(line, pose, [landmark], [1.0], value, sigma))


KINDS: dict[str, tuple[int, Callable]] = {
    "VERTEX_SE2": (5, _pose),
    "VERTEX_SE2:PRIOR": (11, _gaussian("pose_priors", 1, 3)),
    "VERTEX_XY": (3, _landmark),
    "VERTEX_XY:PRIOR": (7, _gaussian("landmark_priors", 1, 2)),
    "EDGE_SE2": (12, _gaussian("steps", 2, 3)),
    "EDGE_RANGE": (5, _range),
}


def write(path: Path, log: Log, poses: np.ndarray, landmarks: np.ndarray) -> None:
    """Write a log, with the values of its vertices; ranges in the order of their poses.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2), the truth or an estimate, [m, m, rad] and [m]

    Raises
    ------
    ValueError : naming the field, before anything is written, what the format cannot express: a
        range without a label or with chances, a range scale or offset, times that are all alike,
        a place that is not known
    """
    beyond = {
        "label_of": (NO_LABEL in log.label_of, "a range without a label"),
        "label_probabilities": (log.label_probabilities is not None, "chances of a label"),
        "scale": (log.scale != (1.0, 0.0), "a range scale"),
        "offset": (log.offset != (0.0, 0.0), "a range offset"),
        # equal times say that there are none
        "times": (log.n_poses > 1 and np.ptp(log.times) == 0, "times that are all alike"),
    }
    for name, (true, what) in beyond.items():
        if true:
            raise ValueError(f"{path}: {name}: .pyfg has not {what}")
    with named(path):
        poses = checks.finite("poses", poses, (log.n_poses, 3))
        landmarks = checks.finite("landmarks", landmarks, (log.n_landmarks, 2))
    rows = _rows(log, poses, landmarks)
    whole_file.write_text(path, "".join(" ".join(map(_shown, row)) + "\n" for row in rows))


def _rows(log: Log, poses: np.ndarray, landmarks: np.ndarray) -> Iterator[tuple]:
    """Fields of each line."""
    for t, at in enumerate(poses):
        yield "VERTEX_SE2", log.times[t], f"A{t}", *at
    for k, at in enumerate(landmarks):
        yield "VERTEX_XY", f"L{k}", *at
    prior = np.diag(np.square(log.x0_sigmas))[np.triu_indices(3)]
    yield "VERTEX_SE2:PRIOR", log.times[0], "A0", *log.x0_mean, *prior
    for k in np.flatnonzero(log.surveyed):
        variance = log.landmark_sigmas[k] ** 2
        yield "VERTEX_XY:PRIOR", 0.0, f"L{k}", *log.landmark_means[k], variance, 0.0, variance
    for t, motion in enumerate(log.odometry):
        upper = log.odometry_covariances[t][np.triu_indices(3)]
        yield "EDGE_SE2", log.times[t], f"A{t}", f"A{t + 1}", *motion, *upper
    for m, t in enumerate(log.pose_of):
        variance = log.range_sigmas[m] ** 2
        landmark = f"L{log.label_of[m]}"
        yield "EDGE_RANGE", log.times[t], f"A{t}", landmark, log.ranges[m], variance


def _shown(value) -> str:
    return value if isinstance(value, str) else repr(float(value))
