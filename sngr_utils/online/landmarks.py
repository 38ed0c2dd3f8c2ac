"""Landmarks that wait: started where their posterior has one mode, and taken out if it was wrong.

A landmark seen from a short arc has a mirror image. The mirror test says so without sampling.
Where it sees one place, many starts say whether that is all, and where they would start a
landmark on weights that are not sound, nested sampling is the referee.
"""

import numpy as np

from sngr_utils.online import localisation
from sngr_utils.online.belief import Belief
from sngr_utils.online.data_association import DROPPED
from sngr_utils.robust import association
from sngr_utils.sampling.targets import place
from sngr_utils.slam import landmark_starts

POSES_NEEDED = 4  # with three of a short arc, the mirror image is always there
LIKELY = 0.2  # probability that makes a range a witness of a landmark that waits
FEWEST_USED = 0.5  # share of the expected uses of its label below which a landmark is taken out
YOUNG = 10  # labels that it must have had before it is judged


def start_landmarks(
    belief: Belief, by_nested: bool, delayed: bool, *, rng: np.random.Generator
) -> None:
    """Start every landmark whose place is known.

    Parameters
    ----------
    by_nested : have the referee; else what many starts say stands
    delayed : wait until one mode holds the posterior; else start as the paper does
    """
    for k in np.flatnonzero(np.isnan(belief.landmarks[:, 0])):
        mine, evidence = witnesses(
            belief, k, POSES_NEEDED if delayed else landmark_starts.START_AFTER
        )
        # a posterior changes when there is something new to see
        if evidence is None or belief.data.pose_of[mine].max() < belief.data.n_poses - 1:
            continue
        found = _locate(belief, evidence, by_nested, rng) if delayed else _first_poses(evidence)
        if found is not None:
            used = belief.credit_fitting(mine, np.full(len(mine), k), found, evidence)
            belief.insert(k, found.mean, used)


def _locate(
    belief: Belief, evidence: place.Evidence, by_nested: bool, rng: np.random.Generator
) -> localisation.Mode | None:
    """The place that holds nearly all of the posterior, if there is one."""
    if localisation.mirrored(evidence):
        belief.counts["mirror waits"] += 1
        return None
    belief.counts["landmark questions"] += 1
    cloud, sound = localisation.many_starts(evidence, rng=rng)
    best = localisation.modes(cloud, evidence)[0]
    if by_nested and not sound and best.mass > localisation.ENOUGH_MASS:
        belief.counts["landmark samples"] += 1
        best = localisation.modes(localisation.sample(evidence, rng=rng), evidence)[0]
    return best if best.mass > localisation.ENOUGH_MASS else None


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

    They are credited to no landmark so far, and the label and the others that wait leave k a
    fair chance.
    """
    data, absent = belief.data, np.isnan(belief.landmarks[:, 0])
    prior = np.exp(association.log_prior(belief.log, belief.shares))[:, :-1]
    chances = belief.credit.weights[:, -1] * prior[:, k] / prior[:, absent].sum(axis=1)
    mine = np.flatnonzero((belief.credit.used == DROPPED) & (chances > LIKELY))
    seen_from = data.pose_of[mine]
    if len(np.unique(seen_from)) < least:
        return mine, None
    spread = np.trace(belief.covariance().poses[:, :2, :2], axis1=1, axis2=2) / 2
    anchors, ranges = belief.poses[seen_from, :2], data.ranges[mine]
    return mine, place.Evidence(
        anchors, ranges, spread[seen_from] + data.scenario.range_sigma**2, 1 - chances[mine],
        data.ranges.max(), anchors.mean(axis=0), ranges.max(),
    )  # fmt: skip


def drop_landmarks(belief: Belief) -> None:
    """Take out a landmark that the ranges of its own label do not use: it waits again."""
    for k in np.flatnonzero(np.isfinite(belief.landmarks[:, 0])):
        labelled = belief.data.label_of == k
        used = np.sum(labelled & (belief.credit.used == k))
        expected = (1 - belief.p) * labelled.sum()
        if labelled.sum() >= YOUNG and used < FEWEST_USED * expected:
            belief.remove(k)
            belief.counts["landmark restarts"] += 1
