"""How well scores rank or decide, with intervals that know that windows come in worlds.

Windows of one world share poses, landmarks and wrong labels; a bootstrap of windows would take
them for independent. Here whole worlds are drawn, with replacement.

Source: Field & Welsh, Bootstrapping clustered data, JRSS B 69, 2007.
"""

import math
from dataclasses import dataclass

import numpy as np

from sngr_utils.metrics import precision_recall

DRAWS, WITHIN_DRAWS = 500, 2000
FEW = 5  # worlds below which there is no interval


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % interval; NaN where undefined, or from too few worlds."""

    value: float
    low: float
    high: float


NOTHING = Interval(math.nan, math.nan, math.nan)


def roc_auc(
    scores: np.ndarray, truth: np.ndarray, worlds: np.ndarray, *, rng: np.random.Generator
) -> Interval:
    """Area under the ROC curve of all windows pooled, ties counting one half.

    Parameters
    ----------
    scores : (N,) higher means more likely true
    truth : (N,) bool
    worlds : (N,) which world each window is of, e.g. its seed
    """
    if truth.all() or not truth.any():
        return NOTHING
    order = np.argsort(worlds, kind="stable")
    scores, truth, (names, group) = scores[order], truth[order], _groups(worlds[order])
    n = len(names)
    positives, negatives = np.bincount(group, truth, n), np.bincount(group, ~truth, n)
    gap = scores[truth][:, None] - scores[~truth]
    better = (gap > 0) + 0.5 * (gap == 0)
    rows = np.add.reduceat(better, _starts(group[truth]), axis=0)
    won = np.zeros((n, n))  # by the true windows of one world over the false ones of another
    won[np.ix_(positives > 0, negatives > 0)] = np.add.reduceat(
        rows, _starts(group[~truth]), axis=1
    )
    counts = _draws(n, rng)
    wins = np.einsum("bi,ij,bj->b", counts, won, counts, optimize=True)
    return _interval(wins, (counts @ positives) * (counts @ negatives), n)


def within_auc(
    scores: np.ndarray, truth: np.ndarray, worlds: np.ndarray, *, rng: np.random.Generator
) -> tuple[Interval, int]:
    """AUC from pairs of windows of the same world only, and the number of worlds that count.

    A pooled AUC also compares windows of different worlds, whose scores may differ in level; this
    one asks whether a score ranks the windows of one world. Worlds where all windows are alike
    have no pair. Arguments as `roc_auc`.
    """
    won, pairs = [], []
    for name in np.unique(worlds):
        here = np.asarray(worlds) == name
        positive, negative = scores[here & truth], scores[here & ~truth]
        if len(positive) and len(negative):
            gap = positive[:, None] - negative
            won.append(float(np.sum((gap > 0) + 0.5 * (gap == 0))))
            pairs.append(gap.size)
    n = len(pairs)
    if n == 0:
        return NOTHING, 0
    won, pairs = np.array(won), np.array(pairs)
    if n < FEW:
        return Interval(float(won.sum() / pairs.sum()), math.nan, math.nan), n
    counts = _draws(n, rng, WITHIN_DRAWS)
    return _interval(counts @ won, counts @ pairs, n), n


def average_precision(
    scores: np.ndarray, truth: np.ndarray, worlds: np.ndarray, *, rng: np.random.Generator
) -> Interval:
    """Area under the precision-recall curve as a step function. Arguments as `roc_auc`."""
    if truth.all() or not truth.any():
        return NOTHING
    order = np.argsort(-scores, kind="stable")
    (names, group), truth, scores = _groups(worlds[order]), truth[order], scores[order]
    weights = _draws(len(names), rng)[:, group]
    last = np.searchsorted(-scores, -scores, side="right") - 1  # of those tied with each
    found, fired = np.cumsum(weights * truth, axis=1), np.cumsum(weights, axis=1)
    precision = found[:, last] / np.maximum(fired[:, last], 1)
    area = np.sum(weights * truth * precision, axis=1)
    return _interval(area, found[:, -1], len(names))


def matthews(
    fired: np.ndarray, truth: np.ndarray, worlds: np.ndarray, *, rng: np.random.Generator
) -> Interval:
    """Matthews correlation of decisions and truth, both (N,) bool; see `Detection.matthews`."""
    names, group = _groups(worlds)
    cells = [fired & truth, fired & ~truth, ~fired & truth, ~fired & ~truth]
    counts = np.array([np.bincount(group, cell, len(names)) for cell in cells])
    above, below = precision_recall.matthews_parts(*(counts @ _draws(len(names), rng).T))
    return _interval(above, below, len(names))


def share(
    marked: np.ndarray, among: np.ndarray, worlds: np.ndarray, *, rng: np.random.Generator
) -> Interval:
    """Share of the windows `among` that are `marked`, both (N,) bool.

    Among all: the rate of firing. Among the clean: false positives; the failed: recall; those
    that fired: precision.
    """
    names, group = _groups(worlds)
    hit = np.bincount(group, marked & among, len(names))
    counts = _draws(len(names), rng)
    return _interval(counts @ hit, counts @ np.bincount(group, among, len(names)), len(names))


def ratio(above: np.ndarray, below: np.ndarray, *, rng: np.random.Generator) -> Interval:
    """Sum of a count over the sum of another, each (n,), one number a world."""
    counts = _draws(len(above), rng, WITHIN_DRAWS)
    return _interval(counts @ above, counts @ below, len(above))


def _groups(worlds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Names of the worlds, and the (N,) number of each window's."""
    return np.unique(worlds, return_inverse=True)


def _starts(group: np.ndarray) -> np.ndarray:
    """Where each run of equal numbers begins in a sorted array."""
    return np.flatnonzero(np.diff(group, prepend=-1))


def _draws(n: int, rng: np.random.Generator, times: int = DRAWS) -> np.ndarray:
    """(1 + times, n) how often each world counts: once in the first row, then as drawn."""
    drawn = rng.multinomial(n, np.full(n, 1 / n), size=times)
    return np.vstack([np.ones(n), drawn])


def _interval(numerator: np.ndarray, denominator: np.ndarray, n: int) -> Interval:
    """First ratio, with the quantiles of the others; draws where it is undefined are left out.

    Parameters
    ----------
    n : worlds
    """
    defined = denominator > 0
    if not defined[0]:
        return NOTHING
    ratio = numerator[defined] / denominator[defined]
    if n < FEW:
        return Interval(float(ratio[0]), math.nan, math.nan)
    low, high = np.quantile(ratio[1:], [0.025, 0.975])
    return Interval(float(ratio[0]), float(low), float(high))
