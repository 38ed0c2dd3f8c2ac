"""Delayed initialisation: a landmark starts where its posterior has one mode, or is removed.

A landmark seen from a short arc has a mirror image. The mirror test says so without sampling.
Where it sees one place, many starts say whether that is all, and where they would start a
landmark on weights that are not sound, nested sampling decides.
"""

import numpy as np
from scipy import stats

from sngr_utils.online import localisation
from sngr_utils.online.belief import Belief
from sngr_utils.online.data_association import DROPPED, VAGUE
from sngr_utils.robust import association, mirrors
from sngr_utils.sampling import importance
from sngr_utils.sampling.targets import place
from sngr_utils.slam import landmark_starts
from sngr_utils.world.log import NO_LABEL

POSES_NEEDED = 4  # with three of a short arc, the mirror image is always there
LONG = 8  # poses from which a landmark that is seen may enter on one of two sides
LIKELY = 0.2  # probability that makes a range a witness of a landmark not yet initialised
FEWEST_USED = 0.5  # share of the expected uses of its label below which a landmark is taken out
YOUNG = 10  # labels that it must have had before it is judged


def start_landmarks(
    belief: Belief, by_nested: bool, delayed: bool, *, rng: np.random.Generator
) -> None:
    """Start every landmark whose place is known.

    Parameters
    ----------
    by_nested : ask nested sampling in doubt; else what many starts say stands
    delayed : wait until one mode holds the posterior; else start as the paper does
    """
    for k in np.flatnonzero(~belief.present):
        mine, evidence = witnesses(
            belief, k, POSES_NEEDED if delayed else landmark_starts.START_AFTER
        )
        # a posterior changes when there is something new to see
        if evidence is None or belief.log.pose_of[mine].max() < len(belief.poses) - 1:
            continue
        found = _locate(belief, evidence, by_nested, rng) if delayed else _first_poses(evidence)
        if found is not None:
            used = belief.assign_fitting(mine, np.full(len(mine), k), found, evidence)
            belief.insert(k, found.mean, used)
            belief.in_doubt[k] = found.mass <= localisation.ENOUGH_MASS


def _locate(
    belief: Belief, evidence: place.Evidence, by_nested: bool, rng: np.random.Generator
) -> localisation.Mode | None:
    """The place that holds nearly all of the posterior, if there is one."""
    patient = len(np.unique(evidence.anchors, axis=0)) < LONG
    if patient and localisation.mirrored(evidence):
        belief.counts["mirror waits"] += 1
        return None
    belief.counts["landmark questions"] += 1
    try:
        cloud, sound = localisation.many_starts(evidence, rng=rng)
    except importance.NoModeError:
        return None
    found = localisation.modes(cloud, evidence)
    if by_nested and not sound and _enough(found, evidence, patient):
        belief.counts["landmark samples"] += 1
        found = localisation.modes(localisation.sample(evidence, rng=rng), evidence)
    return found[0] if _enough(found, evidence, patient) else None


def _enough(found: list[localisation.Mode], evidence: place.Evidence, patient: bool) -> bool:
    """Does one place hold nearly all of the posterior; or, after long, two narrow ones?"""
    if found[0].mass > localisation.ENOUGH_MASS or patient:
        return found[0].mass > localisation.ENOUGH_MASS
    both = found[:2]
    widest = max(np.linalg.eigvalsh(mode.covariance)[-1] for mode in both)
    narrow = widest < VAGUE**2 * evidence.variances.min()
    return narrow and sum(mode.mass for mode in both) > localisation.ENOUGH_MASS


def turn_over(belief: Belief) -> None:
    """Landmarks in doubt go to their mirror image where that is better, and are believed again.

    One that has turned may make others turn.
    """
    for _ in range(len(belief.landmarks)):
        turned = False
        for k in np.flatnonzero(belief.in_doubt & belief.present):
            gap, poses, landmarks = belief.mirrored(k)
            gap += _votes(belief, k, belief.landmarks[k]) - _votes(belief, k, landmarks[k])
            if gap < 0:
                belief.poses, belief.landmarks, turned = poses, landmarks, True
                belief.counts["landmarks turned over"] += 1
            belief.in_doubt[k] = abs(gap) < mirrors.DECIDED
        if not turned:
            return


def _votes(belief: Belief, k: int, spot: np.ndarray) -> float:
    """Log-likelihood of the ranges labelled k that are assigned to nothing, [nats].

    Were landmark k at a (2,) spot, where it is not believed to be, some of them might fit.
    """
    log = belief.log
    mine = np.flatnonzero((log.label_of == k) & (belief.assignment.used == DROPPED))
    if len(mine) == 0:
        return 0.0
    poses, wrong = log.pose_of[mine], 1 - (1 - belief.shares.wrong) * (1 - belief.shares.clutter)
    spread = np.trace(belief.covariance(anchored=True).poses[:, :2, :2], axis1=1, axis2=2) / 2
    sigmas = np.sqrt(spread[poses] + log.range_sigmas[mine] ** 2)
    errors = log.ranges[mine] - np.linalg.norm(belief.poses[poses, :2] - spot, axis=1)
    right = stats.norm.pdf(errors, scale=sigmas)
    return float(np.log((1 - wrong) * right + wrong / belief.longest).sum())


def _first_poses(evidence: place.Evidence) -> localisation.Mode | None:
    """Least squares on the ranges of the first three poses, as `isam2.run_isam2` starts it."""
    _, first = np.unique(evidence.anchors, axis=0, return_index=True)
    few = np.sort(first)[: landmark_starts.START_AFTER]
    position = landmark_starts.start_landmark(evidence.anchors[few], evidence.ranges[few])
    return localisation.Mode(position, np.eye(2), 1.0) if np.isfinite(position).all() else None


def witnesses(
    belief: Belief, k: int, least: int = POSES_NEEDED
) -> tuple[np.ndarray, place.Evidence | None]:
    """The ranges that may well be landmark k's, and what they say; None if from too few poses.

    They are assigned to no landmark so far, and the label and the others not yet initialised leave
    k a fair chance.
    """
    log, absent = belief.log, ~belief.present
    prior = np.exp(association.log_prior(log, belief.shares))
    open_to = prior[:, np.append(absent, True)].sum(axis=1)  # those that wait, and no landmark
    chances = belief.assignment.weights[:, -1] * prior[:, k] / np.maximum(open_to, 1e-300)
    mine = np.flatnonzero((belief.assignment.used == DROPPED) & (chances > LIKELY))
    seen_from = log.pose_of[mine]
    if len(np.unique(seen_from)) < least:
        return mine, None
    spread = np.trace(belief.covariance(anchored=True).poses[:, :2, :2], axis1=1, axis2=2) / 2
    anchors, ranges = belief.poses[seen_from, :2], log.ranges[mine]
    return mine, place.Evidence(
        anchors, ranges, spread[seen_from] + log.range_sigmas[mine] ** 2, 1 - chances[mine],
        belief.longest, anchors.mean(axis=0), ranges.max(),
    )  # fmt: skip


def drop_landmarks(belief: Belief) -> None:
    """Take out a landmark that the ranges of its own label do not use: it is initialised anew."""
    label_of, n = belief.log.label_of, belief.log.n_landmarks
    named = label_of != NO_LABEL
    labelled = np.bincount(label_of[named], minlength=n)
    used = np.bincount(label_of[named & (belief.assignment.used == label_of)], minlength=n)
    expected = (1 - belief.shares.wrong) * (1 - belief.shares.clutter) * labelled
    unused = (labelled >= YOUNG) & (used < FEWEST_USED * expected)
    for k in np.flatnonzero(unused & belief.present & ~belief.log.surveyed):
        belief.remove(k)
        belief.counts["landmark restarts"] += 1
