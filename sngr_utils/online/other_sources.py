"""Estimates of all data in which one range comes from elsewhere.

A loop may be closed by one range: where two sources of it are plausible, predicted without it,
there are two estimates of the whole, each of which makes its own source look right.
"""

import numpy as np

from sngr_utils.online.belief import Belief
from sngr_utils.online.data_association import DROPPED
from sngr_utils.online.rivals import Fit, Rival, rival
from sngr_utils.robust import association, mutual_exclusion

PLAUSIBLE = 0.01  # posterior of another source of a range, for it to be tried
CHOICES, TRIED = 50, 5  # other sources that are tried, and estimates made of them


def with_another_source(
    belief: Belief, ours: Rival, told: np.ndarray, fit: Fit, exclusive: bool
) -> list[Rival]:
    """Estimates that begin where one range has another source, and the path moves for it.

    Parameters
    ----------
    belief : of the whole log, at our estimate
    """
    log, n = belief.log, belief.log.n_landmarks
    innovations, used = belief.innovations(), belief.assignment.used
    joint = association.log_joint(log, innovations.residuals, innovations.variances, belief.shares)
    weights = (
        mutual_exclusion.exclusive_posterior(joint, log.pose_of)
        if exclusive
        else association.posterior(joint)
    )
    weights[np.arange(len(used)), used] = 0.0  # the last column is that of none, and of DROPPED
    ranges, sources = np.nonzero(weights > PLAUSIBLE)
    likeliest = np.argsort(-weights[ranges, sources], kind="stable")[:CHOICES]
    moving = []
    for m, k in zip(ranges[likeliest], sources[likeliest], strict=True):
        other = used.copy()
        if exclusive:
            other[(log.pose_of == log.pose_of[m]) & (used == k)] = DROPPED
        other[m] = k if k < n else DROPPED
        cost_of_it, poses, landmarks = belief.settled(belief.landmarks, other)
        if ours.found.moved(poses - belief.poses) > 1:
            moving.append((cost_of_it, (poses, landmarks)))
    best = sorted(moving, key=lambda one: one[0])[:TRIED]
    return [rival(ours.log, told, fit(ours.log, start, 1.0)) for _, start in best]
