"""Estimates with landmarks on the other side of the way: the second places of a road.

Ranges from a straight way do not tell its two sides apart; what does is how it bends, and the
bends are estimated with the landmarks. So it takes several landmarks changed together, with the
path estimated anew for each choice of sides, to find the second place.

The model takes every way for as likely as any other, so bends that noise alone suggests speak for
a choice of sides. On a way that is exactly straight that is an illusion: the true choice stands
anywhere among the others (study `every_world`, column ``sides_likelier``). Where it bends enough
to decide, the odds are far larger. So no odds below `DECIDED` decide a side, and the poses
are the mean over all of up to `MOST` that are open, weighed by the square root of their odds.
"""

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sngr_utils.robust.em import SoftEstimate
from sngr_utils.slam import chain_solver, information
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES

DECIDED = 15.0  # nats by which a choice of sides is worse, to be ruled out
TRUSTED = 0.5  # share of the nats between choices that counts: it errs less, and nowhere more
MOST = 6  # landmarks of which every choice of sides is tried
APART = 5.0  # range sigmas, between two places of a landmark that are not the same
BEST = 3  # choices of sides that are estimated anew, and as many of those that move the path

Fit = Callable[[np.ndarray, np.ndarray], SoftEstimate]
Settled = Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]]


class Turned(NamedTuple):
    """An estimate with some landmarks on their other side, ranges assigned as they were.

    Attributes
    ----------
    cost : above that of the estimate it was made from, [nats]
    poses, landmarks : (T, 3), [m, m, rad] and (K, 2), [m]
    sides : (K,) bool, landmarks that are on their other side
    """

    cost: float
    poses: np.ndarray
    landmarks: np.ndarray
    sides: np.ndarray


def rivals(found: SoftEstimate, fit: Fit) -> list[SoftEstimate]:
    """The best estimates with landmarks on other sides, sources of the ranges found anew.

    Parameters
    ----------
    fit : EM from (T, 3) poses and (K, 2) landmarks
    """
    others = turned(found)
    moving = [one for one in others if found.moved(one.poses - found.poses) > 1][:BEST]
    best = [one for one in others[:BEST] if not any(one is other for other in moving)]
    return [fit(one.poses, one.landmarks) for one in best + moving]


def elsewhere(one: SoftEstimate, other: SoftEstimate) -> np.ndarray:
    """(K,) bool, landmarks that two estimates have in different places, or only one has."""
    places = np.linalg.norm(one.landmarks - other.landmarks, axis=1)
    absent = np.isnan(one.landmarks[:, 0]) != np.isnan(other.landmarks[:, 0])
    sigma = np.median(one.chain.sigmas) if len(one.chain.sigmas) else 0.0
    return absent | (places > APART * sigma)


def differ(one: SoftEstimate, other: SoftEstimate, sure: np.ndarray) -> bool:
    """Is another estimate farther off than the first one expects of the truth, or in a landmark?

    Parameters
    ----------
    sure : (K,) bool, landmarks that the first one does not call in doubt
    """
    if not len(one.chain.ranges):
        return False
    by = one.poses - other.poses
    moved = by[:, :2]
    squared = np.einsum("ti,tij,tj->t", moved, np.linalg.inv(one.position_covariances), moved)
    return bool(squared.mean() > 2 or one.moved(by) > 1 or (elsewhere(one, other) & sure).any())


def turned(found: SoftEstimate) -> list[Turned]:
    """Every choice of sides that an estimate leaves open, see `choices`."""
    chain, at = found.minimum

    def settled(landmarks: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        start = chain_solver.state_of(chain, found.poses, landmarks)
        start = start._replace(calibration=at.calibration.copy())
        best, cost, *_ = chain_solver.minimise(chain, LEAST_SQUARES, chain_solver.CERES, start)
        return cost, information.poses_of(best.frames), best.landmarks

    return choices(chain, found.poses, found.landmarks, np.isfinite(found.landmarks[:, 0]), settled)


def choices(
    chain: Chain, poses: np.ndarray, landmarks: np.ndarray, asked: np.ndarray, settled: Settled
) -> list[Turned]:
    """Every choice of sides that is open, the best first.

    A choice whose landmarks fall back to where they were, or take others along, is the one that it
    ends at, and counts once.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2), the estimate
    asked : (K,) bool, landmarks of which the side may be open
    settled : the minimum from other landmarks: its cost [nats], (T, 3) poses, (K, 2) landmarks
    """
    if not len(chain.ranges) or not asked.any():
        return []
    far, least = APART * np.median(chain.sigmas), settled(landmarks)[0]
    images = _images(chain, poses, landmarks)
    found: dict[bytes, Turned] = {}

    def tried(some: tuple[int, ...]) -> Turned:
        places = landmarks.copy()
        places[list(some)] = images[list(some)]
        cost, path, places = settled(places)
        sides = np.linalg.norm(places - landmarks, axis=1) > far
        known = found.get(sides.tobytes())
        if known is None or cost - least < known.cost:
            known = found[sides.tobytes()] = Turned(cost - least, path, places, sides)
        return known

    alone = {k: tried((k,)) for k in np.flatnonzero(asked & np.isfinite(images[:, 0]))}
    near = [k for k, one in alone.items() if one.sides[k] and one.cost < DECIDED]
    near = sorted(near, key=lambda k: alone[k].cost)[:MOST]
    for n in range(2, len(near) + 1):
        for some in combinations(near, n):
            tried(some)
    best = min(one.cost for one in found.values()) if found else 0.0
    most = min(best, 0.0) + DECIDED
    open_ = [one for one in found.values() if one.sides.any() and one.cost < most]
    return sorted(open_, key=lambda one: one.cost)


class OverSides(NamedTuple):
    """An estimate averaged over the sides on which its landmarks may lie.

    Attributes
    ----------
    poses : (T, 3), the mean, [m, m, rad]
    spread : (T, 2, 2) of the positions about it, [m^2]
    open : (K,) bool, landmarks of which the side is open
    """

    poses: np.ndarray
    spread: np.ndarray
    open: np.ndarray


def over_sides(poses: np.ndarray, others: list[Turned], n_landmarks: int) -> OverSides:
    """The mean over (T, 3) poses and those of all other choices that are open.

    A choice weighs as its likelihood at the minimum to the power `TRUSTED`, and is taken to be as
    wide as the others: its mirror images have nearly the same shape.
    """
    costs = np.array([0.0, *(one.cost for one in others)])
    weights = np.exp(TRUSTED * (costs.min() - costs))
    weights /= weights.sum()
    by = np.array([np.zeros_like(poses), *(one.poses - poses for one in others)])
    by[:, :, 2] = np.angle(np.exp(1j * by[:, :, 2]))
    mean = np.einsum("n,nti->ti", weights, by)
    off = (by - mean)[:, :, :2]
    spread = np.einsum("n,nti,ntj->tij", weights, off, off)
    open_ = np.any([np.zeros(n_landmarks, dtype=bool), *(one.sides for one in others)], axis=0)
    return OverSides(poses + mean, spread, open_)


def _images(chain: Chain, poses: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """(K, 2) landmarks mirrored in the line that fits best the places they were seen from, [m].

    A landmark that was seen from one place, a range sigma wide, is mirrored in that place.
    NaN for one that is absent, or was seen from fewer than two poses.
    """
    images = np.full_like(landmarks, np.nan)
    for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
        mine = chain.landmark_of == k
        if len(np.unique(chain.pose_of[mine])) < 2:
            continue
        places, weights = poses[chain.pose_of[mine], :2], chain.weights[mine]
        centre = np.average(places, axis=0, weights=weights)
        spread = (places - centre).T @ (weights[:, None] * (places - centre))
        widths, axes = np.linalg.eigh(spread / weights.sum())
        offset, across = landmarks[k] - centre, axes[:, 0]
        one_place = widths[1] < np.median(chain.sigmas[mine]) ** 2
        images[k] = landmarks[k] - 2 * (offset if one_place else (offset @ across) * across)
    return images
