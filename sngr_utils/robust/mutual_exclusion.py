"""Mutual exclusion: no two ranges of a scan came from the same landmark.

The posterior of a range is then a sum over all matchings of its scan, a permanent. Ranges are
taken one after another, and all that a later one must know is which of the landmarks that it may
have come from are taken: those are *open*. Time and memory grow with 2^(open landmarks), however
many there are in all; ranges that share no plausible landmark, directly or through others, are
never open together. Where too many are open, belief propagation stands in for the sum.
"""

import math
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.robust.belief_propagation import LEAST, propagate

MOST = 12 << 12  # landmarks times subsets of those open: all of twelve, ten open of forty
MANY, TOO_MANY = 9, 64  # open landmarks whose work is felt, and what stands for more than `MOST`

PLAUSIBLE = 1e-16  # weight, against a range's largest, above which a pair is looked at first
EXACT = 1e-14  # share of the matchings that may be overlooked, where no more must be
RESCALED = 4  # rows after which weights are made to sum to one: at e^-50 each, none is lost


def exclusive_posterior(log_weights: np.ndarray, scan_of: np.ndarray | None = None) -> np.ndarray:
    """(N, K+1) posterior where no two of the ranges of a scan came from the same landmark.

    The sum over all matchings. "None" may be taken any number of times; where there is no
    matching at all, it is as likely as the least likely landmark. Weights below e^-50 of a
    range's largest are raised to that, so that many of them, where two ranges fit one landmark
    only, do not underflow together.

    Pairs of a range and a landmark that are not plausible are left out as long as all matchings
    with any of them weigh less than `EXACT` of the rest. Where that is too much work, as it never
    is with twelve landmarks, `belief_propagation` stands in for the sum.

    Parameters
    ----------
    log_weights : (N, K+1) log of prior times likelihood, the last column that of "none"; -inf
        for what cannot be, but not all along a row
    scan_of : (N,) int, ascending, the scan of each range; None if all are of one

    Source: the joint association events of Bar-Shalom, Fortmann, Tracking and Data Association,
    1988, chapter 9; permanents by subsets: Ryser, Combinatorial Mathematics, 1963; of sparse
    matrices: Cifuentes, Parrilo, Linear Algebra and its Applications 493, 2016.
    """
    return matched(np.ascontiguousarray(log_weights), ends_of(len(log_weights), scan_of))


def ends_of(n: int, scan_of: np.ndarray | None) -> np.ndarray:
    """(S,) int, behind the last of the n rows of each scan, see `exclusive_posterior`."""
    changes = [] if scan_of is None else np.flatnonzero(np.diff(scan_of)) + 1
    return np.append(np.asarray(changes, dtype=np.int64), n)


@compile_once
def matched(log_weights, ends):
    """`exclusive_posterior` of scans whose rows end before `ends`."""
    weights, found = np.zeros(log_weights.shape), np.empty(log_weights.shape)
    for i in range(len(weights)):
        largest = log_weights[i].max()
        for j in range(weights.shape[1]):
            if log_weights[i, j] > -math.inf:
                weights[i, j] = math.exp(max(log_weights[i, j] - largest, LEAST))
    start = 0
    for end in ends:
        _one_scan(weights[start:end], found[start:end])
        start = end
    return found


@compile_once
def _one_scan(weights, found):
    """Fill the (n, K+1) posterior of one scan, from as few pairs as will do."""
    threshold, plan, log_total = PLAUSIBLE, _plan(weights, PLAUSIBLE), 0.0
    if MANY <= plan.n_open < TOO_MANY:  # all pairs at once: the check often fails, twice the work
        everything = _plan(weights, 0.0)
        if everything.n_open <= plan.n_open + 1:
            threshold, plan = 0.0, everything
    if plan.n_open < TOO_MANY:
        log_total = _matchings(weights, plan, found)
        if log_total < _log_overlooked(weights, threshold) - math.log(EXACT):
            plan = _plan(weights, 0.0)
            log_total = _matchings(weights, plan, found) if plan.n_open < TOO_MANY else 0.0
    if plan.n_open == TOO_MANY:
        propagate(weights, found)
    elif log_total == -math.inf:
        weights[:, -1] = math.exp(LEAST)
        _matchings(weights, plan, found)


class Plan(NamedTuple):
    """In which order the n ranges of a scan are taken, and what is remembered between them.

    allowed : (n, K) bool, the pairs of a range and a landmark that are looked at
    order : (n,) int, rows, so chosen that few landmarks are open at a time
    bit : (K,) int, in a set of taken landmarks the bit of each; 0 if no two ranges share it
    kept : (n,) int, bits of the landmarks that are still open after each step
    n_open : landmarks that are open at a time, at most; `TOO_MANY` if the plan is given up
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
                if k << place + 1 > MOST:
                    return Plan(allowed, order, bit, kept, TOO_MANY)
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
    bits, shared = np.empty(k, np.int64), np.empty(k)  # of the landmarks that a row competes for
    before = np.empty((n + 1, size))  # weight of the first i rows on the subset s, to a factor
    before[0, 0], before[0, 1:] = 1.0, 0.0
    for i in range(n):
        now, then = before[i], before[i + 1]
        rivals, alone = _options(weights, plan, plan.order[i], bits, shared)
        for s in range(size):
            then[s] = now[s] * alone
        for c in range(rivals):
            bit, share = bits[c], shared[c]
            for s in range(size):
                if s & bit:
                    then[s] += now[s ^ bit] * share
        closed, bit = _closed(plan, i), 1
        while bit <= closed:
            if closed & bit:  # whether it was taken matters no more
                for s in range(size):
                    if s & bit:
                        then[s ^ bit] += then[s]
                        then[s] = 0.0
            bit *= 2
        if i % RESCALED == 0 or i == n - 1:
            total = then.sum()
            if total == 0.0:
                return -math.inf
            then /= total
            log_total += math.log(total)
    after, earlier = np.ones(size), np.empty(size)  # of later rows, if the subset s is taken
    sums = np.empty(k)
    for i in range(n - 1, -1, -1):
        now, row, free = before[i], plan.order[i], 0.0
        rivals, alone = _options(weights, plan, row, bits, shared)
        closed, bit = _closed(plan, i), 1
        while bit <= closed:
            if closed & bit:
                for s in range(size):
                    if s & bit:
                        after[s] = after[s ^ bit]
            bit *= 2
        for s in range(size):
            free += now[s] * after[s]
            earlier[s] = alone * after[s]
        for c in range(rivals):
            bit, share, total = bits[c], shared[c], 0.0
            for s in range(size):
                if not s & bit:
                    if_taken = after[s | bit]
                    total += now[s] * if_taken
                    earlier[s] += share * if_taken
            sums[c] = share * total
        _spread(weights, plan, row, free, sums, found)
        after, earlier = earlier, after
        if i % RESCALED == 0:
            largest = 0.0
            for s in range(size):
                if now[s] > 0.0:
                    largest = max(largest, after[s])
            for s in range(size):
                after[s] = after[s] / largest if now[s] > 0.0 else 0.0
    return log_total


@compile_once
def _closed(plan, i):
    """Bits of the landmarks that no row after the i-th competes for."""
    return plan.kept[i - 1] & ~plan.kept[i] if i > 0 else 0


@compile_once
def _options(weights, plan, row, bits, shared):
    """Bits and weights of the landmarks that other rows want too: how many; the rest's weight."""
    k, rivals = weights.shape[1] - 1, 0
    alone = weights[row, k]
    for j in range(k):
        if plan.allowed[row, j]:
            if plan.bit[j]:
                bits[rivals], shared[rivals] = plan.bit[j], weights[row, j]
                rivals += 1
            else:
                alone += weights[row, j]
    return rivals, alone


@compile_once
def _spread(weights, plan, row, free, sums, found):
    """The marginals of a row, from those of the landmarks it competes for in order."""
    k, c = weights.shape[1] - 1, 0
    found[row] = 0.0
    found[row, k] = weights[row, k] * free
    for j in range(k):
        if plan.allowed[row, j]:
            if plan.bit[j]:
                found[row, j] = sums[c]
                c += 1
            else:
                found[row, j] = weights[row, j] * free
    _share_out(found[row], found[row])


@compile_once
def _share_out(weights, shares):
    """(n,) weights over their sum, into `shares`."""
    total = weights.sum()
    for j in range(len(weights)):
        shares[j] = weights[j] / total


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
