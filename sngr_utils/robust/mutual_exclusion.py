"""Mutual exclusion: no two ranges of a scan came from the same landmark."""

import numpy as np

from sngr_utils.numerics.jit import compile_once

MOST_LANDMARKS = 14  # of mutual exclusion: time and memory grow with 2^K

LEAST = -50.0  # log weight, against a range's largest, below which all weights are alike


def exclusive_posterior(log_weights: np.ndarray, scan_of: np.ndarray | None = None) -> np.ndarray:
    """The same where no two of the ranges of a scan came from the same landmark.

    Exact: the sum over all matchings, by forward and backward recursions over subsets of the
    landmarks (a permanent, in N K 2^K operations). "None" may be taken any number of times.
    Weights below e^-50 of a range's largest are raised to that, so that 14 of them, where two
    ranges fit one landmark only, do not underflow together.

    Parameters
    ----------
    scan_of : (N,) int, ascending, the scan of each range; None if all are of one

    Raises
    ------
    ValueError : more than 14 landmarks, or no matching at all is possible

    Source: the joint association events of Bar-Shalom, Fortmann, Tracking and Data Association,
    1988, chapter 9; Ryser, Combinatorial Mathematics, 1963, on permanents by subsets.
    """
    n_landmarks = log_weights.shape[1] - 1
    if n_landmarks > MOST_LANDMARKS:
        raise ValueError(f"n_landmarks is {n_landmarks}: mutual exclusion takes {MOST_LANDMARKS}")
    relative = log_weights - log_weights.max(axis=1, keepdims=True)
    scaled = np.where(np.isneginf(relative), 0.0, np.exp(np.maximum(relative, LEAST)))
    n = len(scaled)
    ends = [n] if scan_of is None else [*(np.flatnonzero(np.diff(scan_of)) + 1), n]
    found = _matchings_by_scan(scaled, np.array(ends))
    if not np.isfinite(found).all():
        raise ValueError("log_weights allow no matching of ranges and landmarks")
    return found


@compile_once
def _matchings_by_scan(weights, ends):
    """`_matchings` of every scan, whose rows end before `ends`."""
    found, start = np.empty(weights.shape), 0
    for end in ends:
        found[start:end] = _matchings(weights[start:end])
        start = end
    return found


@compile_once
def _matchings(weights):
    """(N, K+1) marginals of all matchings of rows and columns but the last, by subsets."""
    n, columns = weights.shape
    k = columns - 1
    before = np.zeros((n + 1, 1 << k))  # total weight of the first i rows on the subset s
    before[0, 0] = 1.0
    for i in range(n):
        for s in range(1 << k):
            if before[i, s] == 0.0:
                continue
            before[i + 1, s] += before[i, s] * weights[i, k]
            for j in range(k):
                if not s >> j & 1:
                    before[i + 1, s | 1 << j] += before[i, s] * weights[i, j]
    after = np.ones(1 << k)  # of the rows from i on, if the subset s is taken
    marginals = np.zeros((n, columns))
    for i in range(n - 1, -1, -1):
        earlier = np.zeros(1 << k)
        for s in range(1 << k):
            here = weights[i, k] * after[s]
            marginals[i, k] += before[i, s] * here
            earlier[s] = here
            for j in range(k):
                if not s >> j & 1:
                    here = weights[i, j] * after[s | 1 << j]
                    marginals[i, j] += before[i, s] * here
                    earlier[s] += here
        marginals[i] /= marginals[i].sum()
        after = earlier
    return marginals
