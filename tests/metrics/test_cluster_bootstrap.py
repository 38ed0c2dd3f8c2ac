"""Bootstraps over worlds: the estimate is the library's, each draw is one of repeated worlds."""

import numpy as np
import pytest

from sngr_utils.metrics import cluster_bootstrap, precision_recall


class Repeats:
    """In the place of a generator: "draws" the same counts every time."""

    def __init__(self, counts):
        self.counts = counts

    def multinomial(self, n, shares, size):
        assert n == len(shares) == len(self.counts)
        return np.tile(self.counts, (size, 1))


@pytest.fixture
def windows():
    rng = np.random.default_rng(0)
    worlds = np.repeat(np.arange(8), 12)
    truth = rng.random(96) < np.repeat(rng.random(8), 12)
    truth[:12], truth[12:24] = True, False  # worlds of one class
    scores = np.round(rng.normal(size=96) + truth, 1)  # with ties
    mixed = rng.permutation(96)
    return scores[mixed], truth[mixed], worlds[mixed]


RANKING = {
    "roc_auc": precision_recall.roc_auc,
    "average_precision": precision_recall.average_precision,
}


@pytest.mark.parametrize("name", RANKING)
def test_ranking_with_and_without_repeated_worlds(windows, name):
    scores, truth, worlds = windows
    counts = np.array([2, 0, 1, 1, 3, 0, 0, 1])
    got = getattr(cluster_bootstrap, name)(scores, truth, worlds, rng=Repeats(counts))
    assert got.value == pytest.approx(RANKING[name](scores, truth))
    again = np.repeat(np.arange(96), counts[worlds])
    expected = RANKING[name](scores[again], truth[again])
    assert got.low == pytest.approx(expected)
    assert got.high == pytest.approx(expected)


def test_decisions_with_and_without_repeated_worlds(windows):
    scores, truth, worlds = windows
    fired, counts = scores > 0.5, np.array([2, 0, 1, 1, 3, 0, 0, 1])
    again = np.repeat(np.arange(96), counts[worlds])
    once, repeated = (precision_recall.detection(fired[i], truth[i]) for i in (slice(None), again))
    got = cluster_bootstrap.matthews(fired, truth, worlds, rng=Repeats(counts))
    assert (got.value, got.low) == pytest.approx((once.matthews, repeated.matthews))
    got = cluster_bootstrap.share(fired, truth, worlds, rng=Repeats(counts))
    assert (got.value, got.high) == pytest.approx((once.recall, repeated.recall))


def test_windows_that_repeat_each_other_narrow_nothing(windows):
    """Every window twice: an interval that took them for independent would shrink by sqrt 2."""
    scores, truth, worlds = windows
    twice = [np.tile(column, 2) for column in windows]
    for name in RANKING:
        once = getattr(cluster_bootstrap, name)(scores, truth, worlds, rng=np.random.default_rng(1))
        both = getattr(cluster_bootstrap, name)(*twice, rng=np.random.default_rng(1))
        assert (once.value, once.low, once.high) == pytest.approx(
            (both.value, both.low, both.high), abs=1e-9
        )


def test_interval_covers():
    """Share of marked windows, worlds of share 0.2 to 0.6: covers 0.4 in 89 to 99 % of 300 runs.

    An interval that covers in 94 % leaves that range with chance below 1e-3; one over windows as if
    they were independent covers in about 60 %.
    """
    rng, covered, everything = np.random.default_rng(2), 0, np.ones(40 * 26, dtype=bool)
    worlds = np.repeat(np.arange(40), 26)
    for _ in range(300):
        marked = rng.random(len(worlds)) < np.repeat(rng.choice([0.2, 0.6], 40), 26)
        got = cluster_bootstrap.share(marked, everything, worlds, rng=rng)
        covered += got.low <= 0.4 <= got.high
    assert 0.89 <= covered / 300 <= 0.99


def test_what_is_undefined_is_nan(windows):
    scores, truth, worlds = windows
    never = np.zeros(96, dtype=bool)
    rng = np.random.default_rng(0)
    for got in (
        cluster_bootstrap.roc_auc(scores, never, worlds, rng=rng),
        cluster_bootstrap.average_precision(scores, never, worlds, rng=rng),
        cluster_bootstrap.matthews(never, truth, worlds, rng=rng),
        cluster_bootstrap.share(truth, never, worlds, rng=rng),
    ):
        assert np.isnan([got.value, got.low, got.high]).all()
    few = cluster_bootstrap.share(truth, ~never, np.minimum(worlds, 3), rng=rng)
    assert few.value == pytest.approx(truth.mean())
    assert np.isnan(few.low)
