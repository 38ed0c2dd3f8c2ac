"""The log of a run: all that an estimator may know, checked at the door.

What happened in truth (`simulation.World`) is another object: who estimates takes a log, who
judges takes both.
"""

import warnings
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from sngr_utils.world import checks

NO_LABEL = -1
BY_NOISE = 5.0  # sigmas, below zero, that a short range may be measured
ROUNDING = 1e-9  # of chances that sum to one
MOST_LANDMARKS, MOST_ROWS = 10**6, 2**53
TOLD = 10  # landmarks that a warning names


class LogWarning(UserWarning):
    """What is odd in a log, and usable."""


@dataclass(frozen=True, kw_only=True)
class Log:
    """Odometry and ranges of one robot in the plane. T poses, M ranges, K landmarks.

    Lists serve as arrays. Ranges are sorted by their pose (those of one pose keep their order),
    and `row_of` says which row of the given ones each was.

    Attributes
    ----------
    odometry : (T-1, 3) measured motion from pose t to t+1 in the body frame of t, [m, m, rad]
    odometry_covariances : (T-1, 3, 3) of each step in that frame, or one (3, 3) of all
    pose_of : (M,) int, pose of each range
    ranges : (M,), [m]; positive, but that noise may take a short one below zero
    range_sigmas : (M,), or one of all, [m]
    label_of : (M,) int, landmark each range says it is from (perhaps wrongly), -1 for no label
    n_landmarks : K; landmarks are 0 ... K-1
    x0_mean, x0_sigmas : (3,) prior on pose 0, sigmas in its body frame, [m, m, rad]
    times : (T,) of the poses, not decreasing, [s]; None for the pose's number
    label_probabilities : (M, K) of each range over the landmarks, rows that sum to at most one
        (the rest is for none of them); None if the labels are all that is known
    landmark_means, landmark_sigmas : (K, 2) and (K,) of surveyed landmarks, NaN for the others,
        or one sigma of all, [m]
    scale, offset : mean and sigma of what multiplies a distance, and of what is added to it [m],
        to give a range; a sigma of 0 for one that is known, infinite for one without a prior
    row_of : (M,) int, row in which each range was given

    Raises
    ------
    ValueError : naming field and row: a shape that does not fit, an index out of bounds, what is
        no finite real number, a range, sigma or variance that is not positive, a time that goes
        back, ranges without a landmark to be from

    Warns
    -----
    LogWarning : landmarks that no label names
    """

    odometry: np.ndarray
    odometry_covariances: np.ndarray
    pose_of: np.ndarray
    ranges: np.ndarray
    range_sigmas: np.ndarray
    label_of: np.ndarray
    n_landmarks: int
    x0_mean: np.ndarray
    x0_sigmas: np.ndarray
    times: np.ndarray | None = None
    label_probabilities: np.ndarray | None = None
    landmark_means: np.ndarray | None = None
    landmark_sigmas: np.ndarray | None = None
    scale: tuple[float, float] = (1.0, 0.0)
    offset: tuple[float, float] = (0.0, 0.0)
    row_of: np.ndarray | None = None

    @property
    def n_poses(self) -> int:
        return len(self.odometry) + 1

    @property
    def surveyed(self) -> np.ndarray:
        """(K,) bool, landmarks whose place is known to a sigma"""
        return np.isfinite(self.landmark_sigmas)

    def __post_init__(self) -> None:
        found = {**_poses(self), **_landmarks(self), **_ranges(self), **_calibration(self)}
        for name, value in found.items():
            object.__setattr__(self, name, value)
        _warn(self)

    def keep(self, marked: np.ndarray) -> Self:
        """The same log with the (M,) marked ranges only."""
        return self._with(**{name: getattr(self, name)[marked] for name in self._per_range()})

    def first(self, n: int) -> Self:
        """The first n poses, with their odometry and ranges."""
        ends = np.searchsorted(self.pose_of, n)
        return self._with(
            **{name: getattr(self, name)[:ends] for name in self._per_range()},
            odometry=self.odometry[: n - 1],
            odometry_covariances=self.odometry_covariances[: n - 1],
            times=self.times[:n],
        )

    def after(self, n: int) -> Self:
        """The log from pose n on. Its prior on the first pose is still that of pose 0."""
        part = self.keep(self.pose_of >= n)
        return part._with(
            pose_of=part.pose_of - n,
            odometry=self.odometry[n:],
            odometry_covariances=self.odometry_covariances[n:],
            times=self.times[n:],
        )

    def joined(self, later: Self) -> Self:
        """This log and a later one, whose first pose is the last one here."""
        shifted = later._with(pose_of=later.pose_of + self.n_poses - 1, times=later.times[1:])
        names = [*self._per_range(), "odometry", "odometry_covariances", "times"]
        return self._with(**{
            name: np.concatenate([getattr(self, name), getattr(shifted, name)]) for name in names
        })

    def with_covariances(self, odometry_covariances: np.ndarray) -> Self:
        """The same log with other (T-1, 3, 3) covariances of the odometry."""
        return self._with(odometry_covariances=odometry_covariances)

    def measurements(self, t: int) -> "Measurements":
        """What was measured at pose t, from 1 on, and on the way to it."""
        mine = slice(*np.searchsorted(self.pose_of, [t, t + 1]))
        chances = self.label_probabilities
        return Measurements(
            motion=self.odometry[t - 1],
            covariance=self.odometry_covariances[t - 1],
            ranges=self.ranges[mine],
            range_sigmas=self.range_sigmas[mine],
            label_of=self.label_of[mine],
            time=self.times[t],
            label_probabilities=None if chances is None else chances[mine],
            row_of=self.row_of[mine],
        )

    def following(self, new: "Measurements") -> Self:
        """The log of the last pose here and of the next one, which `new` is about.

        Raises
        ------
        ValueError : as for a log
        """
        n = checks.count("ranges", new.ranges)
        now = self.times[-1]
        pair = self._with(
            odometry=[new.motion],
            odometry_covariances=new.covariance,
            pose_of=np.ones(n),
            ranges=new.ranges,
            range_sigmas=new.range_sigmas,
            label_of=new.label_of,
            times=[now, now + 1 if new.time is None else new.time],
            label_probabilities=new.label_probabilities,
            row_of=np.arange(n) if new.row_of is None else new.row_of,
        )
        return pair._with(**_poses(pair), **_ranges(pair))

    def _per_range(self) -> list[str]:
        names = ["pose_of", "ranges", "range_sigmas", "label_of", "row_of"]
        return names + ["label_probabilities"] * (self.label_probabilities is not None)

    def _with(self, **changed) -> Self:
        """A part of this log, which needs no second check."""
        part = object.__new__(type(self))
        for field in fields(self):
            object.__setattr__(part, field.name, changed.get(field.name, getattr(self, field.name)))
        return part


@dataclass(frozen=True, kw_only=True)
class Measurements:
    """What is measured at one pose, for an estimator that is fed as the robot goes. N ranges.

    Attributes
    ----------
    motion : (3,) measured motion to it, in the body frame of the pose before, [m, m, rad]
    covariance : (3, 3) of the motion, in that frame
    ranges, range_sigmas, label_of : (N,), as in a `Log`
    time : [s]; None for a second after the last one
    label_probabilities : (N, K) or None, as in a `Log`
    row_of : (N,) int, rows of a file; None if there is none
    """

    motion: np.ndarray
    covariance: np.ndarray
    ranges: np.ndarray
    range_sigmas: np.ndarray
    label_of: np.ndarray
    time: float | None = None
    label_probabilities: np.ndarray | None = None
    row_of: np.ndarray | None = None


# --- the checks -----------------------------------------------------------------------------


def _poses(log: Log) -> dict:
    """The fields of poses and odometry."""
    steps = checks.count("odometry", log.odometry)
    name, shape = "odometry_covariances", (steps, 3, 3)
    covariances = checks.finite(name, log.odometry_covariances, shape, True, checks.LARGEST**2)
    each = covariances[:1] if np.ndim(log.odometry_covariances) == 2 else covariances
    checks.refuse(name, each, ~checks.proper(each), "it must be symmetric and positive definite")
    times = np.arange(steps + 1.0) if log.times is None else log.times
    times = checks.finite("times", times, (steps + 1,))
    back = np.append(False, np.diff(times) < 0)
    checks.refuse("times", times, back, "time must not go back")
    return {
        "odometry": checks.finite("odometry", log.odometry, (steps, 3)),
        "odometry_covariances": (covariances + covariances.swapaxes(1, 2)) / 2,
        "times": times,
        "x0_mean": checks.finite("x0_mean", log.x0_mean, (3,)),
        "x0_sigmas": checks.positive("x0_sigmas", log.x0_sigmas, (3,)),
    }


def _landmarks(log: Log) -> dict:
    """The number of landmarks, and what a survey says of them."""
    k = log.n_landmarks
    whole = isinstance(k, int | np.integer) and not isinstance(k, bool)
    if not whole or not 0 <= k <= MOST_LANDMARKS:
        why = f"it must be an integer from 0 to {MOST_LANDMARKS}"
        raise ValueError(f"n_landmarks is {checks.shown(k)}: {why}")
    if (log.landmark_means is None) != (log.landmark_sigmas is None):
        raise ValueError("landmark_means and landmark_sigmas: give both or none")
    means, sigmas = np.full((k, 2), np.nan), np.full(k, np.nan)
    if log.landmark_means is not None:
        means = checks.floats("landmark_means", log.landmark_means, (k, 2))
        sigmas = checks.floats("landmark_sigmas", log.landmark_sigmas, (k,), True)
    surveyed = (np.abs(means) <= checks.LARGEST).all(axis=1)
    surveyed &= (sigmas >= checks.SMALLEST) & (sigmas <= checks.LARGEST)
    unknown = np.isnan(means).all(axis=1) & np.isnan(sigmas)
    why = "give a finite mean and a positive sigma, or NaN for all"
    checks.refuse("landmark_means", means, ~(surveyed | unknown), why)
    return {"n_landmarks": int(k), "landmark_means": means, "landmark_sigmas": sigmas}


def _ranges(log: Log) -> dict:
    """The fields of ranges, in the order of their poses."""
    m, steps, k = checks.count("ranges", log.ranges), len(log.odometry), int(log.n_landmarks)
    if m and not k:
        raise ValueError(f"n_landmarks is 0, and ranges has {m} rows: to what are they measured?")
    rows = np.arange(m) if log.row_of is None else log.row_of
    found = {
        "pose_of": checks.indices("pose_of", log.pose_of, m, 0, steps),
        "ranges": checks.finite("ranges", log.ranges, (m,)),
        "range_sigmas": checks.positive("range_sigmas", log.range_sigmas, (m,), True),
        "label_of": checks.indices("label_of", log.label_of, m, NO_LABEL, k - 1),
        "row_of": checks.indices("row_of", rows, m, 0, MOST_ROWS),
    }
    bad = (found["ranges"] == 0) | (found["ranges"] < -BY_NOISE * found["range_sigmas"])
    checks.refuse("ranges", found["ranges"], bad, "it must be positive, or below zero by noise")
    if log.label_probabilities is not None:
        chances = checks.finite("label_probabilities", log.label_probabilities, (m, k))
        bad = (chances < 0).any(axis=1) | (chances.sum(axis=1) > 1 + ROUNDING)
        why = "chances from 0 to 1 that sum to at most 1"
        checks.refuse("label_probabilities", chances, bad, why)
        found["label_probabilities"] = chances
    order = np.argsort(found["pose_of"], kind="stable")
    return {name: value[order] for name, value in found.items()}


def _calibration(log: Log) -> dict:
    """What is known of a scale and an offset of all ranges."""
    found = {}
    for name, least in (("scale", checks.SMALLEST), ("offset", -checks.LARGEST)):
        value = getattr(log, name)
        mean, sigma = map(float, checks.floats(name, value, (2,)))
        known = sigma in (0, np.inf) or checks.SMALLEST <= sigma <= checks.LARGEST
        if not (known and least <= mean <= checks.LARGEST):
            why = "a finite mean and a sigma of zero or more"
            raise ValueError(f"{name} is {checks.shown(value)}: {why}")
        found[name] = mean, sigma
    return found


def _warn(log: Log) -> None:
    named = np.bincount(log.label_of[log.label_of >= 0], minlength=log.n_landmarks)
    labelled = (log.label_of != NO_LABEL).any() and log.label_probabilities is None
    unseen = np.flatnonzero(named == 0)
    if labelled and len(unseen):
        more = f" and {len(unseen) - TOLD} others" * (len(unseen) > TOLD)
        text = f"landmarks {list(map(int, unseen[:TOLD]))}{more} have no range"
        warnings.warn(text, LogWarning, stacklevel=4)
