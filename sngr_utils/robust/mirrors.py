"""Estimates with landmarks on the other side of the way: the second places of a road.

Ranges from a straight way do not tell its two sides apart; what does is how it bends, and the
bends are estimated with the landmarks. So it takes several landmarks changed together, with the
path estimated anew for each choice of sides, to find the second place. Where many choices are
nearly as likely, the likeliest is the one that the noise flatters most, and their mean errs less.
"""

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sngr_utils.robust.em import SoftEstimate
from sngr_utils.slam import chain_solver, information
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES

FAR = 15.0  # nats by which a landmark alone may be worse on its other side, to be tried there
MOST = 6  # landmarks of which every choice of sides is tried
APART = 5.0  # range sigmas, between two places of a landmark that are not the same
BEST = 3  # choices of sides that are estimated anew, and as many of those that move the path

Fit = Callable[[np.ndarray, np.ndarray], SoftEstimate]


class Turned(NamedTuple):
    """An estimate with some landmarks on their other side, ranges assigned as they were.

    Attributes
    ----------
    cost : above that of the estimate it was made from, [nats]
    poses, landmarks : (T, 3), [m, m, rad] and (K, 2), [m]
    """

    cost: float
    poses: np.ndarray
    landmarks: np.ndarray


def rivals(found: SoftEstimate, fit: Fit) -> list[SoftEstimate]:
    """The best estimates with landmarks on other sides, sources of the ranges found anew.

    Parameters
    ----------
    fit : EM from (T, 3) poses and (K, 2) landmarks
    """
    choices = turned(found)
    moving = [one for one in choices if found.moved(one.poses - found.poses) > 1][:BEST]
    best = [one for one in choices[:BEST] if not any(one is other for other in moving)]
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
    """Every choice of sides that an estimate leaves open, the best first."""
    chain, _ = found.minimum
    if not len(chain.ranges):
        return []
    here = _settled(chain, found, found.landmarks)
    images = _images(chain, found.poses, found.landmarks)
    far = APART * np.median(chain.sigmas)
    alone = {}
    for k in np.flatnonzero(np.isfinite(images[:, 0])):
        there = _settled(chain, found, _with(found.landmarks, images, (k,)))
        worse = there.cost - here.cost
        if worse < FAR and np.linalg.norm(there.landmarks[k] - here.landmarks[k]) > far:
            alone[k] = there._replace(cost=worse)
    asked = sorted(alone, key=lambda k: alone[k].cost)[:MOST]
    choices = list(alone.values())
    for n in range(2, len(asked) + 1):
        for some in combinations(asked, n):
            there = _settled(chain, found, _with(found.landmarks, images, some))
            choices.append(there._replace(cost=there.cost - here.cost))
    return sorted(choices, key=lambda one: one.cost)


def mean_over_sides(found: SoftEstimate) -> tuple[np.ndarray, np.ndarray]:
    """(T, 3) poses, the mean over all choices of sides, and (T, 2, 2) covariances of positions.

    A choice weighs as its likelihood at the minimum does, and is taken to be as wide as the
    estimate: its mirror images have nearly the same shape.
    """
    choices = turned(found)
    costs = np.array([0.0, *(one.cost for one in choices)])
    weights = np.exp(costs.min() - costs)
    weights /= weights.sum()
    by = np.array([np.zeros_like(found.poses), *(one.poses - found.poses for one in choices)])
    by[:, :, 2] = np.angle(np.exp(1j * by[:, :, 2]))
    mean = np.einsum("n,nti->ti", weights, by)
    apart = (by - mean)[:, :, :2]
    spread = np.einsum("n,nti,ntj->tij", weights, apart, apart)
    return found.poses + mean, found.position_covariances + spread


def _with(landmarks: np.ndarray, images: np.ndarray, some: tuple[int, ...]) -> np.ndarray:
    """(K, 2) landmarks, some of them at their images."""
    places = landmarks.copy()
    places[list(some)] = images[list(some)]
    return places


def _settled(chain: Chain, found: SoftEstimate, landmarks: np.ndarray) -> Turned:
    """The minimum of the cost from other places of the landmarks; its own cost, [nats]."""
    at = chain_solver.state_of(chain, found.poses, landmarks)
    at = at._replace(calibration=found.calibration.copy())
    at, cost, *_ = chain_solver.minimise(chain, LEAST_SQUARES, chain_solver.CERES, at)
    return Turned(cost, information.poses_of(at.frames), at.landmarks)


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
