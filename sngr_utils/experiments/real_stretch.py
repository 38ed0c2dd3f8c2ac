"""Short looks at a Plaza set: a stretch driven online, costs of range scales, second maps."""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from sngr_utils.detection import mirror_image
from sngr_utils.online import estimator
from sngr_utils.robust import losses
from sngr_utils.robust.diagnosis import DoubtWarning
from sngr_utils.settings import READING
from sngr_utils.slam.conventions import PRESETS, Conventions
from sngr_utils.slam.landmark_starts import start_landmarks
from sngr_utils.slam.noise_estimation import SOURCES, step_covariances
from sngr_utils.world.dead_reckoning import dead_reckoning, dead_reckoning_variances
from sngr_utils.world.log import Log

FREE = Conventions(landmark_prior_sigma=1e3)  # m: nothing is known of a landmark
USUAL = estimator.Settings()
ELSEWHERE = 2.0  # m from its place in another map: a landmark that makes it another map

Finder = Callable[..., tuple[np.ndarray, np.ndarray, float]]  # radios, credits, log likelihood


@dataclass(frozen=True)
class Stretch:
    """An online run on the first poses of a drive.

    Attributes
    ----------
    log : what was fed
    truth : (T, 2) positions by GPS, [m]
    radios : (K, 2) surveyed, [m]
    sources : (M,) int, the radio that each range is from
    found : the result
    seconds : (T-1,) CPU time of each step
    """

    log: Log
    truth: np.ndarray
    radios: np.ndarray
    sources: np.ndarray
    found: estimator.OnlineEstimate
    seconds: np.ndarray


def drive(
    log: Log, settings: estimator.Settings = USUAL, *, rng: np.random.Generator
) -> tuple[estimator.OnlineEstimate, np.ndarray]:
    """The online estimator on a log, and (T-1,) the CPU time of each step, [s]."""
    online = estimator.Online(log.first(1), PRESETS[READING], settings, rng=rng)
    clock = [time.thread_time()]
    for t in range(1, log.n_poses):
        online.step(log.measurements(t))
        clock.append(time.thread_time())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)  # who reads the result sees its diagnosis
        return online.result(), np.diff(clock)


def with_noise(log: Log, found: Mapping[str, float]) -> Log:
    """A log with range_sigma and the sigmas of odometry of a row of `real_data.run_plaza`."""
    told = step_covariances({name: found[name.replace(" ", "_")] for name in SOURCES}, log.odometry)
    return replace(log, range_sigmas=found["range_sigma"], odometry_covariances=told)


def costs_of_scales(log: Log, scales: Sequence[float], offset: float) -> np.ndarray:
    """(N,) least cost of a log with each range scale held, [nats]."""
    poses, costs = dead_reckoning(log.x0_mean, log.odometry), []
    at = poses, start_landmarks(log, poses, "grid")
    for scale in scales:
        held = replace(log, scale=(float(scale), 0.0), offset=(offset, 0.0))
        solved = losses.solve(held, FREE, "least_squares", at)
        at = solved.poses, solved.landmarks
        costs.append(solved.cost)
    return np.array(costs)


def mirror_gaps(log: Log, poses: Sequence[int]) -> pd.DataFrame:
    """How much worse the mirror image of each radio explains its ranges, [nats].

    Labels are believed, and dead reckoning with what it may err by.

    Parameters
    ----------
    poses : numbers of poses, in ascending order, after which to look

    Returns
    -------
    columns radio, poses, gap; infinite where there is no image
    """
    reckoned = dead_reckoning(log.x0_mean, log.odometry)
    spread = dead_reckoning_variances(reckoned, log.odometry_covariances)
    starts, rows = start_landmarks(log, reckoned, "grid"), []
    for k in range(log.n_landmarks):
        mine = log.label_of == k
        at = log.pose_of[mine]
        counts = np.searchsorted(at, poses)
        heard = counts > 0
        found = mirror_image.gaps(
            reckoned[at, :2], log.ranges[mine], spread[at] + log.range_sigmas[mine] ** 2,
            starts[k], counts[heard],
        )  # fmt: skip
        rows += [(k, n, gap) for n, gap in zip(np.array(poses)[heard], found, strict=True)]
    return pd.DataFrame(rows, columns=["radio", "poses", "gap"])


def maps_without_labels(
    log: Log, n_poses: int, n_starts: int, find: Finder, *, rng: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """What `find` makes of the first poses of a log, by dead reckoning, from random radios.

    These are no farther from the middle of the way than the longest range, in x and in y.

    Returns
    -------
    radios (K, 2), (M, K) credits and log likelihood of each start, the likeliest first
    """
    part = log.first(n_poses)
    poses = dead_reckoning(part.x0_mean, part.odometry)
    places, middle = poses[part.pose_of, :2], poses[:, :2].mean(axis=0)
    size = (n_starts, log.n_landmarks, 2)
    starts = middle + part.ranges.max() * rng.uniform(-1, 1, size)
    sigma = float(np.median(part.range_sigmas))
    found = [find(places, part.ranges, radios, sigma) for radios in starts]
    return sorted(found, key=lambda one: -one[2])


def runner_up(maps: list[tuple[np.ndarray, np.ndarray, float]]) -> float:
    """By how much the likeliest map that is elsewhere is less likely than the likeliest, [nats].

    Radios have no names: two maps are the same if some order of the radios makes them so.
    """
    best, _, height = maps[0]
    for radios, _, other in maps[1:]:
        apart = np.linalg.norm(best[:, None] - radios, axis=2)
        if apart[linear_sum_assignment(apart)].max() > ELSEWHERE:
            return height - other
    return float("inf")
