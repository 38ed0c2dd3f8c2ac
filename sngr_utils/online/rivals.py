"""Other estimates of all data, which the one at hand must stand against.

EM from dead reckoning knows nothing of what the estimator has decided on its way. EM with one
step that slipped is tried at every step: the longer of the two parts makes a map, and the other is
localised in it. A slip before the first landmark was known is found so, and in no other way.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sngr_utils.online import relocalisation, slips
from sngr_utils.online.belief import TURNED, cost
from sngr_utils.robust import em, growing_map
from sngr_utils.robust.em import SoftEstimate
from sngr_utils.slam import landmark_starts
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import NO_LABEL, Log

SCANS = 8  # next to the slip, by which the shorter part is localised
OPEN = 0.5  # probability of no landmark that frees a range for one that starts again
MANY = 0.1  # share of the ranges that no landmark explains
APART = 5.0  # range sigmas, between two places of a landmark that are not the same

Fit = Callable[[Log, tuple[np.ndarray, np.ndarray], float], SoftEstimate]


class Rival(NamedTuple):
    """An estimate with the log that it is of, perhaps with a step wide, and what it costs.

    cost : minus the log evidence, the price of a slip included, [nats]
    """

    log: Log
    found: SoftEstimate
    cost: float


def cost_of(log: Log, found: SoftEstimate) -> float:
    """Minus the log evidence of what EM has found, roughly, [nats]."""
    return cost(log, found.poses, found.landmarks, found.shares)


def blind(log: Log, fit: Fit, poses: np.ndarray, known: np.ndarray) -> SoftEstimate:
    """The best estimate by EM from dead reckoning, or from (T, 3) poses, and a grid; repaired.

    Parameters
    ----------
    known : (K, 2) landmarks that are started there with the poses, NaN for the others
    """
    fits = []
    starts = (
        (dead_reckoning(log.x0_mean, log.odometry), np.full_like(known, np.nan)),
        (poses, known),
    )
    for start, places in starts:
        grid = landmark_starts.start_landmarks(log, start, "grid")
        fits.append(fit(log, (start, np.where(np.isnan(places), grid, places)), em.WIDEST))
    best = min(fits, key=lambda found: cost_of(log, found))
    return renamed(log, repaired(log, best, fit) if _wanting(best) else best, fit)


def _wanting(found: SoftEstimate) -> bool:
    """Is a landmark absent, or are there many ranges that none explains?"""
    return bool(np.isnan(found.landmarks).any() or found.weights[:, -1].mean() > MANY)


def repaired(log: Log, found: SoftEstimate, fit: Fit) -> SoftEstimate:
    """The estimate with landmarks started again, one by one, where that makes it likelier.

    Those that are absent come first, and start by their labels. Then each starts from all ranges
    that are its own or that nothing explains: whatever they are labelled, they are nobody else's.
    """
    absent = np.isnan(found.landmarks[:, 0])
    unlabelled = log._with(label_of=np.full(len(log.ranges), NO_LABEL), label_probabilities=None)
    for lost in [absent, *np.eye(log.n_landmarks, dtype=bool)]:
        nobodys = found.weights[:, -1] > OPEN
        free = nobodys | lost[np.minimum(np.argmax(found.weights, axis=1), log.n_landmarks - 1)]
        places = np.where(lost[:, None], np.nan, found.landmarks)
        asked = log if lost is absent else unlabelled
        places = growing_map.start_missing(asked, found.poses, places, free)
        if lost.any() and not np.array_equal(places, found.landmarks, equal_nan=True):
            other = fit(log, (found.poses, places), growing_map.LAST)
            found = min(found, other, key=lambda one: cost_of(log, one))
    return found


def renamed(log: Log, found: SoftEstimate, fit: Fit) -> SoftEstimate:
    """The estimate with landmarks exchanged as labels have it, if it is likelier so."""
    places = growing_map.named(log, found)
    if np.array_equal(places, found.landmarks, equal_nan=True):
        return found
    other = fit(log, (found.poses, places), 1.0)
    return min(found, other, key=lambda one: cost_of(log, one))


def with_a_slip(log: Log, fit: Fit) -> Rival | None:
    """The likeliest estimate of a log of which one step has slipped; None if none can be made."""
    longest = log.ranges.max(initial=0.0)
    price = slips.SLIP_ODDS + 3 * np.log(longest / np.median(log.range_sigmas))
    rivals = []
    for step in range(log.n_poses - 1):
        start = _put_together(log, step, fit, longest)
        if start is None:
            continue
        wide = log.odometry_covariances.copy()
        wide[step] = np.diag([longest**2, longest**2, TURNED**2])
        slipped = log.with_covariances(wide)
        found = fit(slipped, start, 1.0)
        rivals.append(Rival(slipped, found, cost_of(slipped, found) + price))
    return min(rivals, key=lambda rival: rival.cost) if rivals else None


def _put_together(log: Log, step: int, fit: Fit, longest: float):
    """Poses and landmarks, one part of the log localised in the map of the other; None if vain."""
    early, late = log.first(step + 1), log.after(step + 1)
    path = dead_reckoning(log.x0_mean, log.odometry)
    first = early.n_poses >= late.n_poses  # is it the first part that makes the map?
    mapped, start = (early, path[: step + 1]) if first else (late, path[step + 1 :])
    if not first:
        mapped = replace(late, x0_mean=path[step + 1])
    found = fit(mapped, (start, landmark_starts.start_landmarks(mapped, start, "grid")), em.WIDEST)
    if np.isfinite(found.landmarks[:, 0]).sum() < 2:
        return None
    from_, to = (step + 1, min(step + 1 + SCANS, len(path))) if first else (
        max(step + 1 - SCANS, 0), step + 1)  # fmt: skip
    near = log.first(to).after(from_)
    if len(near.ranges) < 3:
        return None
    part = relocalisation.stretch(
        near, path[from_:to], found.landmarks, np.zeros(log.n_landmarks), found.shares
    )
    joint = step if first else step + 1
    mean = _carried(path[from_ : from_ + 1], path[joint], found.poses[-1 if first else 0])[0]
    sigmas = np.array([longest, longest, TURNED])
    pivot = int(np.argmax(np.bincount(near.pose_of)))
    unknown = np.zeros(2, dtype=bool)
    pose = relocalisation.search(part, mean, sigmas, unknown, pivot).pose
    if first:
        return np.vstack([found.poses, _carried(path[from_:], path[from_], pose)]), found.landmarks
    poses = np.vstack([_carried(path[:to], path[from_], pose), found.poses])
    places = np.column_stack([found.landmarks, np.zeros(log.n_landmarks)])
    return (_carried(poses, poses[0], log.x0_mean), _carried(places, poses[0], log.x0_mean)[:, :2])


def _carried(poses: np.ndarray, at: np.ndarray, to: np.ndarray) -> np.ndarray:
    """(T, 3) poses moved by the rigid motion that brings one pose to another."""
    return relocalisation.moved(np.vstack([at, poses]), to)[1:]


def differ(log: Log, one: SoftEstimate, other: SoftEstimate) -> bool:
    """Are two estimates not the same, by the first one's own covariance, or in a landmark?"""
    if not len(log.ranges):
        return False
    moved = one.poses[:, :2] - other.poses[:, :2]
    squared = np.einsum("ti,tij,tj->t", moved, np.linalg.inv(one.position_covariances), moved)
    places = np.linalg.norm(one.landmarks - other.landmarks, axis=1)
    far = (places > APART * np.median(log.range_sigmas)).any()
    absent = np.isnan(one.landmarks[:, 0]) != np.isnan(other.landmarks[:, 0])
    return bool(squared.mean() > 1.0 or far or absent.any())
