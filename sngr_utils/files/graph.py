"""A factor graph of one robot in the plane, as the lines of a file name it, made into a log."""

import itertools
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sngr_utils.files.recording import Recording, frame_sigmas, named
from sngr_utils.files.text import Line
from sngr_utils.world.checks import SMALLEST
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import NO_LABEL, Log
from sngr_utils.world.truth import Truth

NAME = re.compile(r"([A-Za-z]+)(\d{1,15})", re.ASCII)
SAME = 1e-4  # of the way: two paths that differ by rounding


@dataclass
class Range:
    """One range: to one landmark, or to one of several with a weight each."""

    line: Line
    pose: str
    landmarks: list[str]
    weights: list[float]
    value: float
    sigma: float


@dataclass
class Graph:
    """What the lines of a file say; nothing is checked against each other before `recording`."""

    path: Path
    poses: dict[str, tuple] = field(default_factory=dict)  # line, time, (3,)
    landmarks: dict[str, tuple] = field(default_factory=dict)  # line, (2,)
    steps: dict[tuple[str, str], tuple] = field(default_factory=dict)  # line, (3,), (3, 3)
    ranges: list[Range] = field(default_factory=list)
    pose_priors: dict[str, tuple] = field(default_factory=dict)  # line, (3,), (3, 3)
    landmark_priors: dict[str, tuple] = field(default_factory=dict)  # line, (2,), (2, 2)

    def add(self, kind: str, name, line: Line, *values) -> None:
        """Keep what a line says of a name.

        Raises
        ------
        ValueError : it has been said before
        """
        known = getattr(self, kind)
        if name in known:
            shown = name if isinstance(name, str) else " to ".join(name)
            raise line.refuse(f"{shown} again: first in line {known[name][0].number}")
        known[name] = (line, *values)

    def recording(self, vertices_are_true: bool) -> Recording:
        """The log of this graph.

        Parameters
        ----------
        vertices_are_true : False if the values of poses may be dead reckoning; they are then the
            truth only where they differ from it

        Raises
        ------
        ValueError : naming the line, what a log cannot express, or what does not fit
        """
        poses = self._chain()
        names = sorted(self.landmarks, key=_order)
        steps = [self.steps[pair] for pair in itertools.pairwise(poses)]
        at = np.array([self.poses[name][2] for name in poses])
        motions = np.array([step[1] for step in steps]).reshape(-1, 3)
        times = np.array([self.poses[name][1] for name in poses])
        still = len(times) > 1 and np.ptp(times) == 0
        ranges = self._ranges(dict(zip(poses, range(len(poses)), strict=True)), names)
        given = {**ranges, **self._first(poses[0], ranges["range_sigmas"]), **self._surveys(names)}
        rows = [found.line for found in self.ranges]
        surveys = {**self.landmarks, **self.landmark_priors}
        lines = {
            "times": [self.poses[name][0] for name in poses],
            "odometry_covariances": [step[0] for step in steps],
            "x0_sigmas": [prior[0] for prior in self.pose_priors.values()] * 3,
            "landmark_means": [surveys[name][0] for name in names],
            "ranges": rows,
            "range_sigmas": rows,
        }
        with named(self.path, lines):
            log = Log(
                odometry=motions,
                odometry_covariances=np.array([step[2] for step in steps]).reshape(-1, 3, 3),
                n_landmarks=len(names),
                times=None if still else times,
                **given,
            )
        return Recording(log, self._truth(log, at, names, vertices_are_true), names)

    def _chain(self) -> list[str]:
        """Names of the poses in order, each joined to the next by odometry and to no other."""
        if not self.poses:
            raise ValueError(f"{self.path}: no pose")
        robot = _order(next(iter(self.poses)))[0]
        for name, (line, *_) in self.poses.items():
            if _order(name)[0] != robot:
                raise line.refuse(f"a pose of a second robot, {name}: a log has one")
        poses = sorted(self.poses, key=_order)
        follows = dict(itertools.pairwise(poses))
        for (a, b), (line, *_) in self.steps.items():
            for name in (a, b):
                if name not in self.poses:
                    raise line.refuse(f"{name} is no pose of this file")
            if follows.get(a) != b:
                raise line.refuse(f"from {a} to {b}: a log has odometry to the next pose only")
        for a, b in follows.items():
            if (a, b) not in self.steps:
                raise self.poses[b][0].refuse(f"no odometry leads from {a} to {b}")
        return poses

    def _ranges(self, pose_of: dict[str, int], names: list[str]) -> dict:
        """Fields of the log for the ranges, in the file's order."""
        number_of = {name: k for k, name in enumerate(names)}
        labels = np.full(len(self.ranges), NO_LABEL)
        for m, found in enumerate(self.ranges):
            if found.pose not in pose_of:
                raise found.line.refuse(f"{found.pose} is no pose of this file")
            for name, weight in zip(found.landmarks, found.weights, strict=True):
                if name in pose_of:
                    raise found.line.refuse("a range between poses: a log has none")
                if name not in number_of:
                    raise found.line.refuse(f"{name} is no landmark of this file")
                if weight == 1:
                    labels[m] = number_of[name]
        return {
            "pose_of": [pose_of[found.pose] for found in self.ranges],
            "ranges": [found.value for found in self.ranges],
            "range_sigmas": [found.sigma for found in self.ranges],
            "label_of": labels,
            "label_probabilities": self._chances(number_of) if NO_LABEL in labels else None,
        }

    def _chances(self, number_of: dict[str, int]) -> np.ndarray:
        """(M, K) weights of the ranges over the landmarks."""
        chances = np.zeros((len(self.ranges), len(number_of)))
        for row, found in zip(chances, self.ranges, strict=True):
            for name, weight in zip(found.landmarks, found.weights, strict=True):
                row[number_of[name]] += weight
        return chances

    def _first(self, first: str, range_sigmas: list[float]) -> dict:
        """The prior on the first pose."""
        for name, (line, *_) in self.pose_priors.items():
            if name != first:
                raise line.refuse(f"a prior on {name}: a log has one on the first pose, {first}")
        if not self.pose_priors:
            return {"x0_mean": self.poses[first][2], "x0_sigmas": frame_sigmas(range_sigmas)}
        line, mean, covariance = self.pose_priors[first]
        return {"x0_mean": mean, "x0_sigmas": _sigmas(line, covariance)}

    def _surveys(self, names: list[str]) -> dict:
        """Priors on landmarks."""
        means, sigmas = np.full((len(names), 2), np.nan), np.full(len(names), np.nan)
        for name, (line, mean, covariance) in self.landmark_priors.items():
            if name not in names:
                raise line.refuse(f"{name} is no landmark of this file")
            across = _sigmas(line, covariance)
            if across[0] != across[1]:
                raise line.refuse("a prior on a landmark must be alike in x and y")
            means[names.index(name)], sigmas[names.index(name)] = mean, across[0]
        return {"landmark_means": means, "landmark_sigmas": sigmas}

    def _truth(self, log: Log, at: np.ndarray, names: list[str], true: bool) -> Truth:
        reckoned = dead_reckoning(at[0], log.odometry)
        way = np.abs(log.odometry[:, :2]).sum()
        moved = np.abs(at[:, :2] - reckoned[:, :2]).max() > SAME * way
        return Truth(
            poses=at if true or moved else None,
            landmarks=np.array([self.landmarks[name][1] for name in names]).reshape(-1, 2),
            source_of=None,
        )


def name_of(line: Line, name: str) -> str:
    """A name of a pose or a landmark.

    Raises
    ------
    ValueError : not a letter or more and a number
    """
    if not NAME.fullmatch(name):
        raise line.refuse(f"{name[:40]!r} is not a name such as A0 or L1")
    return name


def _sigmas(line: Line, covariance: np.ndarray) -> np.ndarray:
    if np.any(covariance != np.diag(np.diag(covariance))):
        raise line.refuse("a prior with correlations: a log has none")
    variances = np.diag(covariance)
    if np.any(variances < SMALLEST**2):
        raise line.refuse(f"a variance of a prior is {variances.min():g}: it must be positive")
    return np.sqrt(variances)


def _order(name: str) -> tuple[str, int]:
    letters, number = NAME.fullmatch(name).groups()
    return letters, int(number)
