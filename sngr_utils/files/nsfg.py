"""The format of NSFG and NF-iSAM, `.fg`: `Variable` and `Factor` lines, planar, one robot.

A covariance is nine numbers, row by row; the last number of a range is its sigma [m]. A factor of
ambiguous data association is a range to one of several landmarks, with a weight for each.

Source: MarineRoboticsGroup/NF-iSAM, example/slam, for the fields of each line.
"""

from pathlib import Path

import numpy as np

from sngr_utils.files import graph
from sngr_utils.files.recording import Recording
from sngr_utils.files.text import Line, lines
from sngr_utils.world.checks import LARGEST

POSE, LANDMARK = ["Pose", "SE2"], ["Landmark", "R2"]
RANGE = "SE2R2RangeGaussianLikelihoodFactor"


def read(path: Path) -> Recording:
    """The recording in a file; a range with weights has no label, but label probabilities.

    Raises
    ------
    ValueError : naming file and line, what is no such file and what a log cannot express
    """
    found = graph.Graph(path)
    for line in lines(path):
        kind, *fields = line.fields
        if kind not in ("Variable", "Factor"):
            raise line.refuse(f"{kind[:40]!r} is no kind of line, Variable or Factor")
        if kind == "Variable":
            _variable(found, line, fields)
        elif not fields or fields[0] not in FACTORS:
            raise line.refuse(f"a factor {' '.join(fields[:1])[:60]!r}: a log has none")
        else:
            FACTORS[fields[0]](found, line, fields[1:])
    return found.recording(vertices_are_true=True)


def _variable(found: graph.Graph, line: Line, fields: list[str]) -> None:
    if fields[:2] == POSE and len(fields) == 6:
        # no times: the log takes the poses' numbers
        found.add("poses", graph.name_of(line, fields[2]), line, 0.0, line.numbers(fields[3:]))
    elif fields[:2] == LANDMARK and len(fields) == 5:
        found.add("landmarks", graph.name_of(line, fields[2]), line, line.numbers(fields[3:]))
    else:
        raise line.refuse("a variable must be: Pose SE2 name x y theta, or Landmark R2 name x y")


def _prior(found: graph.Graph, line: Line, fields: list[str]) -> None:
    name, mean, covariance = _gaussian(line, fields, 1)
    found.add("pose_priors", *name, line, mean, covariance)


def _step(found: graph.Graph, line: Line, fields: list[str]) -> None:
    pair, motion, covariance = _gaussian(line, fields, 2)
    found.add("steps", tuple(pair), line, motion, covariance)


def _gaussian(line: Line, fields: list[str], n: int) -> tuple[list[str], np.ndarray, np.ndarray]:
    """n names, then x y theta, and the covariance."""
    if len(fields) != n + 13 or fields[n + 3] != "covariance":
        raise line.refuse("after the names, it must be: x y theta covariance, and nine numbers")
    names = [graph.name_of(line, name) for name in fields[:n]]
    covariance = line.numbers(fields[n + 4 :], LARGEST**2).reshape(3, 3)
    return names, line.numbers(fields[n : n + 3]), covariance


def _range(found: graph.Graph, line: Line, fields: list[str]) -> None:
    if len(fields) != 4:
        raise line.refuse("a range must be: pose landmark range sigma")
    pose, landmark = (graph.name_of(line, name) for name in fields[:2])
    value, sigma = line.numbers(fields[2:])
    found.ranges.append(graph.Range(line, pose, [landmark], [1.0], value, sigma))


def _ambiguous(found: graph.Graph, line: Line, fields: list[str]) -> None:
    parts, key = {}, None
    for value in fields:
        if value in ("Observer", "Observed", "Weights", "Binary", "Observation", "Sigma"):
            if value in parts:
                raise line.refuse(f"{value} twice")
            parts[key := value] = []
        elif key:
            parts[key].append(value)
    names = parts.get("Observed", [])
    single = [len(parts.get(k, [])) for k in ("Observer", "Binary", "Observation", "Sigma")]
    if single != [1, 1, 1, 1] or not names or len(names) != len(parts.get("Weights", [])):
        raise line.refuse(
            "it must be: Observer pose Observed landmarks Weights, one each, Binary kind "
            "Observation range Sigma sigma"
        )
    if parts["Binary"] != [RANGE]:
        raise line.refuse(f"ambiguous {parts['Binary'][0][:60]}: a log has ambiguous ranges only")
    weights = line.numbers(parts["Weights"])
    if weights.min() < 0 or not weights.sum() > 0:
        raise line.refuse("weights must not be negative, nor all zero")
    pose, *landmarks = (graph.name_of(line, name) for name in [*parts["Observer"], *names])
    value, sigma = line.numbers([*parts["Observation"], *parts["Sigma"]])
    shares = list(weights / weights.sum())
    found.ranges.append(graph.Range(line, pose, landmarks, shares, value, sigma))


FACTORS = {
    "UnarySE2ApproximateGaussianPriorFactor": _prior,
    "SE2RelativeGaussianLikelihoodFactor": _step,
    RANGE: _range,
    "AmbiguousDataAssociationFactor": _ambiguous,
}
