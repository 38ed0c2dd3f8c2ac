"""PyFactorGraph's text format, `.pyfg`: planar, one robot.

Entries of noise are covariances throughout, the upper triangle row by row; the last number of a
range is its variance [m^2]. Vertices hold the truth, or dead reckoning where nobody knows it.

Source: MarineRoboticsGroup/PyFactorGraph, io/pyfg_text.py, for the fields of each line.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sngr_utils.files import graph
from sngr_utils.files.recording import Recording
from sngr_utils.files.text import Line, lines
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


def _pose_prior(found: graph.Graph, line: Line, fields: list[str]) -> None:
    values = line.numbers([fields[0], *fields[2:]])[1:]
    name = graph.name_of(line, fields[1])
    found.add("pose_priors", name, line, values[:3], _covariance(line, values[3:], 3))


def _landmark(found: graph.Graph, line: Line, fields: list[str]) -> None:
    found.add("landmarks", graph.name_of(line, fields[0]), line, line.numbers(fields[1:]))


def _landmark_prior(found: graph.Graph, line: Line, fields: list[str]) -> None:
    values = line.numbers([fields[0], *fields[2:]])[1:]
    name = graph.name_of(line, fields[1])
    found.add("landmark_priors", name, line, values[:2], _covariance(line, values[2:], 2))


def _step(found: graph.Graph, line: Line, fields: list[str]) -> None:
    values = line.numbers([fields[0], *fields[3:]])[1:]
    pair = graph.name_of(line, fields[1]), graph.name_of(line, fields[2])
    found.add("steps", pair, line, values[:3], _covariance(line, values[3:], 3))


def _range(found: graph.Graph, line: Line, fields: list[str]) -> None:
    line.numbers(fields[:1])
    pose, landmark = graph.name_of(line, fields[1]), graph.name_of(line, fields[2])
    value, sigma = line.positive(fields[3], "a range"), line.variance(fields[4], "a variance")
    found.ranges.append(graph.Range(line, pose, [landmark], [1.0], value, sigma))


KINDS: dict[str, tuple[int, Callable]] = {
    "VERTEX_SE2": (5, _pose),
    "VERTEX_SE2:PRIOR": (11, _pose_prior),
    "VERTEX_XY": (3, _landmark),
    "VERTEX_XY:PRIOR": (7, _landmark_prior),
    "EDGE_SE2": (12, _step),
    "EDGE_RANGE": (5, _range),
}


def _covariance(line: Line, upper: np.ndarray, n: int) -> np.ndarray:
    matrix = np.zeros((n, n))
    matrix[np.triu_indices(n)] = upper
    return graph.covariance_of(line, matrix + np.triu(matrix, 1).T)


def write(path: Path, log: Log, poses: np.ndarray, landmarks: np.ndarray) -> None:
    """Write a log, with the values of its vertices; ranges in the order of their poses.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2), the truth or an estimate, [m, m, rad] and [m]

    Raises
    ------
    ValueError : what the format cannot express: a range without a label or with chances, a range
        scale or offset, a landmark whose place is not known
    """
    if np.any(log.label_of == NO_LABEL) or log.label_probabilities is not None:
        raise ValueError(f"{path}: .pyfg has no range without a label, or with chances")
    if (log.scale, log.offset) != ((1.0, 0.0), (0.0, 0.0)):
        raise ValueError(f"{path}: .pyfg has no range scale and no offset")
    if not np.isfinite(landmarks).all():
        raise ValueError(f"{path}: .pyfg has no landmark whose place is not known")
    pairs = zip(log.times, poses, strict=True)
    rows = [("VERTEX_SE2", time, f"A{t}", *at) for t, (time, at) in enumerate(pairs)]
    rows += [("VERTEX_XY", f"L{k}", *at) for k, at in enumerate(landmarks)]
    prior = np.diag(np.square(log.x0_sigmas))[np.triu_indices(3)]
    rows.append(("VERTEX_SE2:PRIOR", log.times[0], "A0", *log.x0_mean, *prior))
    for k in np.flatnonzero(np.isfinite(log.landmark_sigmas)):
        variance = log.landmark_sigmas[k] ** 2
        rows.append((
            "VERTEX_XY:PRIOR",
            0.0,
            f"L{k}",
            *log.landmark_means[k],
            variance,
            0.0,
            variance,
        ))
    for t, (motion, covariance) in enumerate(
        zip(log.odometry, log.odometry_covariances, strict=True)
    ):
        upper = covariance[np.triu_indices(3)]
        rows.append(("EDGE_SE2", log.times[t], f"A{t}", f"A{t + 1}", *motion, *upper))
    for t, k, value, sigma in zip(
        log.pose_of, log.label_of, log.ranges, log.range_sigmas, strict=True
    ):
        rows.append(("EDGE_RANGE", log.times[t], f"A{t}", f"L{k}", value, sigma**2))
    path.write_text("".join(" ".join(map(_shown, row)) + "\n" for row in rows))


def _shown(value) -> str:
    return value if isinstance(value, str) else repr(float(value))
