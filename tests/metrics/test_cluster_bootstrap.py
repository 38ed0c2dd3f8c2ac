"""Bootstraps over worlds: the estimate is the library's, each draw is one of repeated worlds."""

import numpy as np
import pytest
from scipy import stats

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


def test_worlds_of_one_class_may_be_the_last(windows):
    """Worlds 6 and 7 are all failed and all sound here; the numbers of worlds are names."""
    scores, truth, worlds = windows
    counts = np.array([2, 0, 1, 1, 3, 0, 0, 1])
    for name in RANKING:
        of = getattr(cluster_bootstrap, name)
        plain = of(scores, truth, worlds, rng=Repeats(counts))
        turned = of(scores, truth, 7 - worlds, rng=Repeats(counts[::-1]))
        assert (turned.value, turned.low) == pytest.approx((plain.value, plain.low))
    plain = cluster_bootstrap.share(truth, ~truth | truth, worlds, rng=Repeats(counts))
    turned = cluster_bootstrap.share(truth, ~truth | truth, 7 - worlds, rng=Repeats(counts[::-1]))
    assert (turned.value, turned.low) == pytest.approx((plain.value, plain.low))


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


class Alternates:
    """In the place of a generator: every other draw is the first world alone."""

    def multinomial(self, n, shares, size):
        assert shares == pytest.approx(np.full(n, 1 / n))
        drawn = np.ones((size, n), dtype=int)
        drawn[::2], drawn[::2, 0] = 0, n
        return drawn


def test_draws_in_which_it_is_undefined_are_left_out():
    """The first world has nothing to mark, so a draw of it alone says nothing of the share."""
    worlds = np.repeat(np.arange(5), 4)
    among, marked = worlds > 0, np.tile([True, False, False, False], 5)
    got = cluster_bootstrap.share(marked, among, worlds, rng=Alternates())
    assert (got.value, got.low, got.high) == (0.25, 0.25, 0.25)
    for name in RANKING:  # nor of a ranking, with one class only
        got = getattr(cluster_bootstrap, name)(
            np.arange(20.0), among & marked, worlds, rng=Alternates()
        )
        assert got.low == got.high == pytest.approx(got.value)


@pytest.mark.parametrize("n", [4, 5])
def test_five_worlds_make_an_interval(n):
    worlds, marked = np.arange(n), np.arange(n) > 0
    got = cluster_bootstrap.share(marked, np.ones(n, bool), worlds, rng=np.random.default_rng(0))
    assert got.value == pytest.approx(1 - 1 / n)
    assert np.isnan([got.low, got.high]).all() if n < 5 else got.low < got.value < got.high == 1


def test_interval_holds_the_middle_95_percent_of_500_draws():
    """A share of worlds alike is binomial over its draws: within 2 of 60 worlds of its quantiles.

    The 2.5 % quantile of 500 draws lies three worlds off with a probability below 2e-5.
    """
    worlds, marked = np.arange(60), np.arange(60) < 24
    got = cluster_bootstrap.share(marked, np.ones(60, bool), worlds, rng=np.random.default_rng(0))
    law = stats.binom(60, 0.4)
    ends = 60 * np.array([got.low, got.high])
    assert ends == pytest.approx([law.ppf(0.025), law.ppf(0.975)], abs=2.01)


class Counts:
    """In the place of a generator: each world once in every draw, and how many were asked."""

    def multinomial(self, n, shares, size):
        self.size = size
        return np.ones((size, n), int)


def test_a_ratio_of_sums_is_drawn_two_thousand_times():
    drawn = Counts()
    got = cluster_bootstrap.ratio(np.arange(5.0), np.full(5, 4.0), rng=drawn)
    assert (got.value, got.low, got.high) == (0.5, 0.5, 0.5)
    assert drawn.size == 2000


def test_all_alike_has_no_ranking(windows):
    scores, truth, worlds = windows
    for name in RANKING:
        for alike in (np.ones(96, bool), np.zeros(96, bool)):
            got = getattr(cluster_bootstrap, name)(
                scores, alike, worlds, rng=Repeats(np.ones(8, int))
            )
            assert np.isnan([got.value, got.low, got.high]).all()
    assert truth.any()
