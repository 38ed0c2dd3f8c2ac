"""Mutual exclusion: no two ranges of a scan came from the same landmark.

The posterior of a range is then a sum over all matchings of its scan, a permanent. Ranges are
taken one after another, and all that a later one must know is which of the landmarks that it may
have come from are taken: those are *open*. Time and memory grow with 2^(open landmarks), however
many there are in all; ranges that share no plausible landmark, directly or through others, are
never open together.
"""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once

MOST_OPEN = 14  # landmarks at a time

LEAST = -50.0  # log weight, against a range's largest, below which all weights are alike

PLAUSIBLE = 1e-16  # weight, against a range's largest, above which a pair is looked at first
EXACT = 1e-14  # share of the matchings that may be overlooked, where no more must be
DISPENSABLE = 1e-3  # weight up to which pairs are left out where too many landmarks are open


def exclusive_posterior(log_weights: np.ndarray, scan_of: np.ndarray | None = None) -> np.ndarray:
    """(N, K+1) posterior where no two of the ranges of a scan came from the same landmark.

    The sum over all matchings. "None" may be taken any number of times; where there is no
    matching at all, it is as likely as the least likely landmark. Weights below e^-50 of a
    range's largest are raised to that, so that many of them, where two ranges fit one landmark
    only, do not underflow together.

    Pairs of a range and a landmark that are not plausible are left out as long as all matchings
    with any of them weigh less than `EXACT` of the rest. Where more than `MOST_OPEN` landmarks
    are open, the least plausible pairs are left out until they are not, but none that weighs
    more than `DISPENSABLE` of its range's likeliest; where that does not help, the ranges of the
    scan are treated each on its own. With up to `MOST_OPEN` landmarks neither can happen.

    Parameters
    ----------
    log_weights : (N, K+1) log of prior times likelihood, the last column that of "none"; -inf
        for what cannot be, but not all along a row
    scan_of : (N,) int, ascending, the scan of each range; None if all are of one

    Source: the joint association events of Bar-Shalom, Fortmann, Tracking and Data Association,
    1988, chapter 9; permanents by subsets: Ryser, Combinatorial Mathematics, 1963; of sparse
    matrices: Cifuentes, Parrilo, Linear Algebra and its Applications 493, 2016.
    """
    relative = log_weights - log_weights.max(axis=1, keepdims=True)
    scaled = np.where(np.isneginf(relative), 0.0, np.exp(np.maximum(relative, LEAST)))
    n = len(scaled)
    ends = [n] if scan_of is None else [*(np.flatnonzero(np.diff(scan_of)) + 1), n]
    return _by_scan(scaled, np.array(ends))


@compile_once
def _by_scan(weights, ends):
    """`_one_scan` of every scan, whose rows end before `ends`."""
    found, start = np.empty(weights.shape), 0
    for end in ends:
        _one_scan(weights[start:end], found[start:end])
        start = end
    return found


@compile_once
def _one_scan(weights, found):
    """Fill the (n, K+1) posterior of one scan, from as few pairs as will do."""
    threshold, plan = PLAUSIBLE, _plan(weights, PLAUSIBLE)
    while plan.n_open > MOST_OPEN and threshold < DISPENSABLE:
        threshold *= 10.0
        plan = _plan(weights, threshold)
    if plan.n_open > MOST_OPEN:
        for i in range(len(weights)):
            found[i] = weights[i] / weights[i].sum()
        return
    log_total = _matchings(weights, plan, found)
    if log_total < _log_overlooked(weights, threshold) - math.log(EXACT):
        everything = _plan(weights, 0.0)
        if everything.n_open <= MOST_OPEN:
            plan, log_total = everything, _matchings(weights, everything, found)
    if log_total == -math.inf:
        weights[:, -1] = math.exp(LEAST)
        _matchings(weights, plan, found)


class Plan(NamedTuple):
    """In which order the n ranges of a scan are taken, and what is remembered between them.

    allowed : (n, K) bool, the pairs of a range and a landmark that are looked at
    order : (n,) int, rows, so chosen that few landmarks are open at a time
    bit : (K,) int, in a set of taken landmarks the bit of each; 0 if no two ranges share it
    kept : (n,) int, bits of the landmarks that are still open after each step
    n_open : landmarks that are open at a time, at most; more than `MOST_OPEN` if the rest of the
        plan is worth nothing
    """

    allowed: np.ndarray
    order: np.ndarray
    bit: np.ndarray
    kept: np.ndarray
    n_open: int


@compile_once
def _plan(weights, threshold):
    """A `Plan` for the pairs above a threshold: always the range that opens the fewest."""
    n, k = weights.shape[0], weights.shape[1] - 1
    allowed = weights[:, :k] > threshold
    left = np.zeros(k, np.int64)  # ranges to come that may be the landmark's
    for i in range(n):
        left += allowed[i]
    waiting, order = np.ones(n, np.bool_), np.empty(n, np.int64)
    bit, kept, taken, n_open = np.zeros(k, np.int64), np.empty(n, np.int64), 0, 0
    for step in range(n):
        row = _fewest_opened(allowed, waiting, left, bit)
        order[step], waiting[row] = row, False
        for j in range(k):
            if allowed[row, j] and bit[j] == 0 and left[j] > 1:
                place = 0
                while taken >> place & 1:
                    place += 1
                if place >= MOST_OPEN:
                    return Plan(allowed, order, bit, kept, place + 1)
                bit[j], n_open = 1 << place, max(n_open, place + 1)
                taken |= bit[j]
        for j in range(k):
            left[j] -= allowed[row, j]
            if allowed[row, j] and left[j] == 0:
                taken &= ~bit[j]
        kept[step] = taken
    return Plan(allowed, order, bit, kept, n_open)


@compile_once
def _fewest_opened(allowed, waiting, left, bit):
    """The waiting row that opens the fewest landmarks, less those that it closes."""
    row, fewest = -1, 0
    for i in range(len(waiting)):
        if waiting[i]:
            opened = 0
            for j in range(len(left)):
                if allowed[i, j]:
                    opened += bit[j] == 0 and left[j] > 1
                    opened -= bit[j] != 0 and left[j] == 1
            if row < 0 or opened < fewest:
                row, fewest = i, opened
    return row


@compile_once
def _matchings(weights, plan, found):
    """Fill the (n, K+1) marginals of all matchings; the log of their total weight."""
    (n, columns), size = weights.shape, 1 << plan.n_open
    k, log_total = columns - 1, 0.0
    before = np.zeros((n + 1, size))  # weight of the first i rows on the subset s, of sum 1
    before[0, 0] = 1.0
    for i in range(n):
        row, kept = plan.order[i], plan.kept[i]
        for s in range(size):
            if before[i, s] > 0.0:
                before[i + 1, s & kept] += before[i, s] * weights[row, k]
                for j in range(k):
                    if plan.allowed[row, j] and not s & plan.bit[j]:
                        there = (s | plan.bit[j]) & kept
                        before[i + 1, there] += before[i, s] * weights[row, j]
        total = before[i + 1].sum()
        if total == 0.0:
            return -math.inf
        before[i + 1] /= total
        log_total += math.log(total)
    after = np.ones(size)  # of the rows from i on, if the subset s is taken
    for i in range(n - 1, -1, -1):
        row, kept, earlier = plan.order[i], plan.kept[i], np.zeros(size)
        found[row] = 0.0
        for s in range(size):
            if before[i, s] > 0.0:
                earlier[s] = weights[row, k] * after[s & kept]
                found[row, k] += before[i, s] * earlier[s]
                for j in range(k):
                    if plan.allowed[row, j] and not s & plan.bit[j]:
                        here = weights[row, j] * after[(s | plan.bit[j]) & kept]
                        found[row, j] += before[i, s] * here
                        earlier[s] += here
        found[row] /= found[row].sum()
        after = earlier / earlier.max()
    return log_total


@compile_once
def _log_overlooked(weights, threshold):
    """Log of a bound on the weight of all matchings with a pair at or below the threshold.

    The bound of a permanent by the product of its row sums, once for every such pair.
    """
    log_all, share = 0.0, 0.0
    for i in range(len(weights)):
        total = weights[i].sum()
        log_all += math.log(total)
        for j in range(weights.shape[1] - 1):
            if weights[i, j] <= threshold:
                share += weights[i, j] / total
    return log_all + math.log(share) if share > 0.0 else -math.inf
