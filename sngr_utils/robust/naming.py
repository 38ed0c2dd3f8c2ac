"""What landmarks are called: where labels may be wrong, their places do not say it.

EM that looks at distances alone finds the same map whatever its landmarks are called; the labels,
counted over all ranges, name them, or leave it open.
"""

import numpy as np
from scipy import optimize

from sngr_utils.robust.em import SoftEstimate
from sngr_utils.world.log import NO_LABEL, Log

NAMED = np.log(99.0)  # nats by which every other name of a landmark is worse, if it has one
FORBIDDEN = 1e9  # nats


def named(log: Log, soft: SoftEstimate) -> np.ndarray:
    """(K, 2) landmarks in the order in which they agree best with labels; surveyed ones stay."""
    free = np.flatnonzero(~log.surveyed)
    agreeing = _agreeing(log, soft)[np.ix_(free, free)]
    found, names = optimize.linear_sum_assignment(agreeing, maximize=True)
    landmarks = soft.landmarks.copy()
    landmarks[free] = soft.landmarks[free[found[np.argsort(names)]]]
    return landmarks


def have_labels(log: Log) -> bool:
    """Does any range say which landmark it is from, if perhaps wrongly?"""
    return log.label_probabilities is not None or bool((log.label_of != NO_LABEL).any())


def names_open(log: Log, soft: SoftEstimate) -> np.ndarray:
    """(K,) bool, landmarks that are called otherwise in a naming that is hardly less likely.

    A label that agrees is likelier than one that does not by the odds of a right label to one of
    the wrong ones. Where no range has a label, names mean nothing, and none is open; nor is that of
    one that is surveyed.
    """
    n, wrong = log.n_landmarks, soft.shares.wrong
    free, is_open = np.flatnonzero(~log.surveyed), np.zeros(n, dtype=bool)
    if len(free) < 2 or not have_labels(log):
        return is_open
    agreeing = _agreeing(log, soft)[np.ix_(free, free)]
    agreeing *= max(np.log((1 - wrong) * (n - 1) / wrong), 0.0)
    for i, k in enumerate(free):
        others = agreeing.copy()
        others[i, i] = -FORBIDDEN
        gap = np.trace(agreeing) - others[optimize.linear_sum_assignment(-others)].sum()
        is_open[k] = gap < NAMED
    return is_open


def exchanged(log: Log, soft: SoftEstimate) -> np.ndarray:
    """(K,) bool, landmarks that labels call by another one's name for a part of the run.

    Along a landmark's ranges, a label of the other one speaks for that name and its own against
    it, by the odds of `names_open`. Where the other name is wrong, a stretch that speaks for it by
    x nats begins at a range with a chance of e^-x at most, so that names of a log which is as it
    says are doubted with a chance below 1/99. Ranges count as they are assigned.

    Source: Page, Biometrika 41, 1954, on the largest sum of a stretch.
    """
    n, wrong = log.n_landmarks, soft.shares.wrong
    found = np.zeros(n, dtype=bool)
    if n < 2 or log.label_probabilities is not None or not have_labels(log):
        return found
    odds = max(np.log((1 - wrong) * (n - 1) / wrong), 0.0)
    sources = np.argmax(soft.weights, axis=1)
    least = NAMED + np.log(max(len(log.ranges), 1) * (n - 1))
    free = ~log.surveyed
    for k in np.flatnonzero(free):
        called = log.label_of[sources == k]
        for j in np.setdiff1d(called, [NO_LABEL, k]):
            speaks = odds * ((called == j).astype(float) - (called == k))
            total = np.append(0.0, np.cumsum(speaks))
            found[[k, j]] |= (total - np.minimum.accumulate(total)).max() > least
    return found & free


def _agreeing(log: Log, soft: SoftEstimate) -> np.ndarray:
    """(K, K) how many of a landmark's ranges are labelled as each of them."""
    meant = log.label_probabilities
    if meant is None:
        meant = log.label_of[:, None] == np.arange(log.n_landmarks)
    return soft.responsibilities.T @ meant
