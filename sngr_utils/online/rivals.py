"""Other estimates of all data, which the one at hand must stand against.

EM from dead reckoning knows nothing of what the estimator has decided on its way, nor of the slips
that it believes in. EM with one step that slipped is tried where one may have: the longer of the
two parts makes a map, and the other is localised in it. A slip before the first landmark was known
is found so, and in no other way. A short log is also held against maps that grow from a stretch of
it. At the end each slip that is believed in is tried anew. Just over 300 lines: rival after rival.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sngr_utils.online import relocalisation, slips
from sngr_utils.online.belief import LOOSE, TURNED, WINDOW, cost, wider
from sngr_utils.robust import association, diagnosis, em, growing_map, mirrors, naming
from sngr_utils.robust.em import SoftEstimate
from sngr_utils.slam import landmark_starts
from sngr_utils.slam.conventions import Conventions
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import Log

SCANS = 8  # next to the slip, by which the shorter part is localised
STRIDE = 4  # steps for which the parts before and after are placed once
ENDS = 3  # groups of steps at either end that are always asked: wrong labels there are few
EXPLAINED = 0.9  # share of the ranges of scans that lie where they are, clutter left out
OPEN = 0.5  # probability of no landmark that frees a range for one that starts again
BETTER = 1.0  # nats that an estimate must gain to be adopted
MANY = 0.1  # share of the ranges that no landmark explains

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


def dispensable(log: Log, found: SoftEstimate) -> np.ndarray:
    """(K,) bool, landmarks without which the ranges are hardly less likely.

    One that is never in reach, or more than there are, may live on ranges of the others: what it
    gains is then small, however narrow its place. Of one that is surveyed there is no such doubt.
    Nothing is fitted anew, so that some are not found.
    """
    doubted, whole = np.zeros(log.n_landmarks, dtype=bool), cost_of(log, found)
    prior = np.exp(association.log_prior(log, found.shares))[:, :-1]
    from_any = prior.sum(axis=1, keepdims=True) / (1 - found.shares.clutter)
    for k in np.flatnonzero(np.isfinite(found.landmarks[:, 0]) & ~log.surveyed):
        others = np.arange(log.n_landmarks) != k
        left = others * np.maximum(prior, np.finfo(float).tiny)  # its label then means any of them
        left *= from_any / np.maximum(left.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        places = np.where(others[:, None], found.landmarks, np.nan)
        without = log._with(label_probabilities=left)
        shares = found.shares._replace(wrong=0.0)
        doubted[k] = cost(without, found.poses, places, shares) - whole < diagnosis.LEAST_RIVAL
    return doubted


def by_em(
    log: Log, conventions: Conventions, start: tuple[np.ndarray, np.ndarray], widest: float,
    exclusive: bool = True,
) -> SoftEstimate:  # fmt: skip
    """EM with clutter, weak priors on landmarks wider than the scene: they are no data."""
    wide = max(conventions.landmark_prior_sigma, LOOSE * log.ranges.max(initial=0.0))
    loose = conventions.model_copy(update={"landmark_prior_sigma": wide})
    return em.fit(log, loose, start, exclusive=exclusive, clutter=True, widest=widest)


def distrusting(log: Log, steps: np.ndarray | int) -> Log:
    """The log with steps of its odometry that may be anything, in a scene of its ranges' size."""
    longest, wide = log.ranges.max(initial=0.0), log.odometry_covariances.copy()
    wide[steps] = np.diag([longest**2, longest**2, TURNED**2])
    return log.with_covariances(wide)


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


def grown(log: Log, told: np.ndarray, fit: Fit) -> list[Rival]:
    """EM from maps that grow from a short stretch, one by the labels if there are some, one not.

    For a short log only: the work grows faster than it. Such a map is adopted if it is likelier,
    and is no rival otherwise: its landmarks may only be named differently.
    """
    if log.n_poses > 2 * WINDOW or not len(log.ranges):
        return []
    bare, found = growing_map.without_labels(log), []
    for part in [log, bare] if naming.have_labels(log) else [bare]:
        soft = growing_map.grow(part, growing_map.PER_LANDMARK, growing_map.GROWTH)
        places = naming.named(log, soft) if part is bare else soft.landmarks
        found.append(rival(log, told, fit(log, (soft.poses, places), 1.0)))
    return found


def _wanting(found: SoftEstimate) -> bool:
    """Is a landmark absent, or are there many ranges that none explains?"""
    return bool(np.isnan(found.landmarks).any() or found.weights[:, -1].mean() > MANY)


def repaired(log: Log, found: SoftEstimate, fit: Fit) -> SoftEstimate:
    """The estimate with landmarks started again, one by one, where that makes it likelier.

    Those that are absent come first, and start by their labels. Then each starts from all ranges
    that are its own or that nothing explains: whatever they are labelled, they are nobody else's.
    """
    absent = np.isnan(found.landmarks[:, 0])
    unlabelled = growing_map.without_labels(log)
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
    places = naming.named(log, found)
    if np.array_equal(places, found.landmarks, equal_nan=True):
        return found
    other = fit(log, (found.poses, places), 1.0)
    return min(found, other, key=lambda one: cost_of(log, one))


def rival(log: Log, told: np.ndarray, found: SoftEstimate) -> Rival:
    """An estimate of a log, some of whose steps are wider than told."""
    return Rival(log, found, cost_of(log, found) + price_of_slips(log, told))


def price_of_slips(log: Log, told: np.ndarray) -> float:
    """What the steps that are wider than told cost, [nats].

    What such a step can choose costs as a landmark does: the scene is as wide as the longest
    range, and the ranges hold it as finely as one of them does.
    """
    wide = log.odometry_covariances != told
    slipped, freed = wider(log, told).sum(), np.einsum("tii->ti", wide).sum()
    if not slipped:
        return 0.0
    choice = np.log(log.ranges.max(initial=0.0) / np.median(log.range_sigmas))
    return float(slips.SLIP_ODDS * slipped + choice * freed)


def from_nothing(
    log: Log, told: np.ndarray, fit: Fit, poses: np.ndarray, known: np.ndarray
) -> list[Rival]:
    """What EM finds that knows no assignments, see `blind`: with the slips of a log, and without.

    Parameters
    ----------
    told : (T-1, 3, 3) covariances of its steps as measured; where those of the log are others, the
        estimate has it that they slipped
    """
    return [
        rival(each, told, blind(each, fit, poses, known))
        for each in _with_and_without_slips(log, told)
    ]


def _with_and_without_slips(log: Log, told: np.ndarray) -> list[Log]:
    """The log, and it without its slips if it has any."""
    return [log, log.with_covariances(told)] if wider(log, told).any() else [log]


def against(
    log: Log, told: np.ndarray, ours: SoftEstimate, fit: Fit, by_slips: bool
) -> list[Rival]:
    """Other estimates of a whole log: from nothing, and with fewer or other slips.

    Parameters
    ----------
    told : as `from_nothing` has it
    by_slips : ask which step has slipped, if the log is short
    """
    found = [rival(log, told, renamed(log, ours, fit))]
    found += from_nothing(log, told, fit, ours.poses, ours.landmarks)
    if by_slips and log.n_poses <= 2 * WINDOW:
        best = min(found, key=lambda one: one.cost)
        *slipped, plain = _with_and_without_slips(log, told)
        asked = slipped or diagnosis.may_have_slipped(best.log, best.found)
        found += with_a_slip(plain, fit, bool(asked))
    return found


def on_other_sides(told: np.ndarray, ours: Rival, fit: Fit) -> list[Rival]:
    """Estimates with landmarks at their mirror images, see `mirrors.rivals`."""
    found = mirrors.rivals(ours.found, lambda *start: fit(ours.log, start, 1.0))
    return [rival(ours.log, told, one) for one in found]


def with_a_slip(log: Log, fit: Fit, everywhere: bool) -> list[Rival]:
    """Estimates of a log of which one step has slipped, for every step that can be judged.

    Each part of the log lies where it does in a map of the longer one. It does so for a slip at
    any step nearby, so one of each group is asked, and EM tells it from its neighbours.

    Parameters
    ----------
    everywhere : ask all steps; else those near either end, behind which few scans lie
    """
    longest, told = log.ranges.max(initial=0.0), log.odometry_covariances
    found = []
    groups = _neighbours(log.n_poses - 1)
    for steps in groups if everywhere else [*groups[:ENDS], *groups[ENDS:][-ENDS:]]:
        paths = _two_parts(log, steps[len(steps) // 2], fit, longest)
        if paths is None:
            continue
        early, late, places = paths
        for step in steps:
            torn, start = distrusting(log, step), np.vstack([early[: step + 1], late[step + 1 :]])
            found.append(rival(torn, told, fit(torn, (start, places), growing_map.LAST)))
    return found


def reconsidered(ours: Rival, told: np.ndarray, fit: Fit) -> tuple[Rival, list[Rival]]:
    """The estimate with each of its slips anew: one that also turned, none, or a neighbour's.

    What is likelier is taken, until a round over all slips changes nothing; and all that were made.
    """
    best, waiting, made = ours, _slipped(ours.log, told), []
    while waiting:
        step, before = waiting.pop(), best
        for other in (step, None, step - 1, step + 1):
            taken = other in _slipped(before.log, told) and other != step
            if taken or other in (-1, len(told)):
                continue
            torn = _instead(before.log, told, step, other)
            for widest in (1.0, em.WIDEST):
                start = before.found.poses, before.found.landmarks
                made.append(rival(torn, told, fit(torn, start, widest)))
                best = made[-1] if made[-1].cost < best.cost - BETTER else best
        if best is not before:
            waiting = _slipped(best.log, told)
    return best, made


def _slipped(log: Log, told: np.ndarray) -> list[int]:
    """The steps of a log that are wider than told."""
    return np.flatnonzero(wider(log, told)).tolist()


def _instead(log: Log, told: np.ndarray, step: int, other: int | None) -> Log:
    """A log of which one step has not slipped, but another one, if any."""
    covariances = log.odometry_covariances.copy()
    covariances[step] = told[step]
    log = log.with_covariances(covariances)
    return log if other is None else distrusting(log, other)


def _neighbours(n: int) -> list[np.ndarray]:
    """Steps 0 to n-1 in groups of at most `STRIDE`, no longer than the way to either end."""
    groups, first = [], 0
    while first < n:
        length = min(STRIDE, max(first, 1), max((n - first) // 2, 1))
        groups.append(np.arange(first, first + length))
        first += length
    return groups


def _two_parts(log: Log, step: int, fit: Fit, longest: float):
    """(T, 3) paths as they were if only the first part of a log, or only the second, were right.

    The longer part makes the (K, 2) map, and the other is localised in it, if it does not lie where
    the odometry has it; None if there is no map.
    """
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
    long = _carried(path, path[joint], found.poses[-1 if first else 0])
    long[slice(step + 1) if first else slice(step + 1, None)] = found.poses
    pose, tight = long[from_], np.sqrt(SCANS * np.diag(log.odometry_covariances[step]))
    if relocalisation.credited(part, pose, tight) < EXPLAINED * (1 - found.shares.clutter):
        sigmas, pivot = np.array([longest, longest, TURNED]), np.argmax(np.bincount(near.pose_of))
        unknown = np.zeros(2, dtype=bool)
        pose = relocalisation.search(part, pose, sigmas, unknown, int(pivot)).pose
    short = _carried(path, path[from_], pose)
    if first:
        return long, short, found.landmarks
    places = np.column_stack([found.landmarks, np.zeros(log.n_landmarks)])
    early, late, places = (_carried(each, short[0], log.x0_mean) for each in (short, long, places))
    return early, late, places[:, :2]


def _carried(poses: np.ndarray, at: np.ndarray, to: np.ndarray) -> np.ndarray:
    """(T, 3) poses moved by the rigid motion that brings one pose to another."""
    return relocalisation.moved(np.vstack([at, poses]), to)[1:]
