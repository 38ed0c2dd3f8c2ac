"""The rules, each both ways, and the error probabilities that their docstrings state."""

import math

import numpy as np
import pytest

from sngr_utils.publish import rules
from sngr_utils.publish.printed import number, ratio


def exact(value):
    return number(f"{value:.6f}")


def test_deterministic():
    assert rules.deterministic(-12.4951, number("-12.50"))
    assert not rules.deterministic(-12.494, number("-12.50"))
    assert rules.deterministic(math.nan, number("null"))
    assert not rules.deterministic(1.0, number("null"))


def test_one_world_at_the_ends_of_thirty_worlds():
    sample = np.arange(30.0)
    assert rules.world_interval(sample) == (0, 29)
    assert rules.world_interval(np.arange(100.0)) == (1, 98)
    assert rules.one_world(sample, number("29"))
    assert rules.one_world(sample, number("29.5")) is False
    assert rules.one_world(sample - 0.4, number("29"))  # 28.6 prints as 29
    assert not rules.one_world(sample, number("null"))
    with pytest.raises(ValueError, match=r"19 worlds.*at least 20"):
        rules.world_interval(sample[:19])


def test_counts_and_undefined_values():
    silent = np.zeros(30)
    assert rules.one_world(silent, number("0"))
    assert not rules.one_world(silent, number("1"))
    undefined = np.full(30, math.nan)
    assert rules.one_world(undefined, number("null"))
    assert not rules.one_world(undefined, number("1.00"))
    mixed = np.r_[math.nan, np.full(29, 0.9)]
    assert rules.one_world(mixed, number("null"))
    assert rules.one_world(mixed, number("0.90"))
    assert not rules.one_world(mixed, number("1.00"))


def test_one_world_errs_as_often_as_stated():
    """2/31 = 0.065 for 30 worlds of any law; 4000 trials stay within 0.02 but for 2e-7 (5 se)."""
    rng = np.random.default_rng(1)
    worlds = rng.lognormal(size=(4000, 31))
    wrong = np.mean([not rules.one_world(w[:30], exact(w[30])) for w in worlds])
    assert abs(wrong - 2 / 31) < 0.02


@pytest.mark.parametrize("statistic", ["mean", "std"])
@pytest.mark.parametrize("law", ["normal", "lognormal"])
def test_five_worlds_errs_as_often_as_stated(statistic, law, monkeypatch):
    """At most 7 %: 400 trials exceed 0.12 with a probability of 2e-4."""
    monkeypatch.setattr(rules, "SPLITS", 1000)
    rng = np.random.default_rng(2)
    worlds = getattr(rng, law)(size=(400, 35)) + 10
    of = {"mean": np.mean, "std": lambda five: np.std(five, ddof=1)}[statistic]
    wrong = np.mean([
        not rules.five_worlds(w[:30], exact(of(w[30:])), statistic, rng=rng) for w in worlds
    ])
    assert 0 < wrong < 0.12


def test_five_worlds_can_refute():
    rng = np.random.default_rng(3)
    sample = rng.normal(1.0, 0.1, 30)
    assert rules.five_worlds(sample, number("1.00"), "mean", rng=rng)
    assert not rules.five_worlds(sample, number("1.30"), "mean", rng=rng)
    assert rules.five_worlds(sample, number("0.10"), "std", rng=rng)
    assert not rules.five_worlds(sample, number("0.40"), "std", rng=rng)
    with pytest.raises(ValueError, match="defined"):
        rules.five_worlds(np.r_[sample, math.nan], number("1.00"), "mean", rng=rng)


def test_trend():
    """2.5 % where there is none: 2000 trials stay within 0.0175 of it but for 6e-7 (5 se)."""
    rng = np.random.default_rng(4)
    first, last = rng.normal(size=(2, 2000, 30))
    wrong = np.mean([rules.trend(a, b, "rises") for a, b in zip(first, last, strict=True)])
    assert abs(wrong - 0.025) < 0.0175
    assert rules.trend(first[0], first[0] + 1, "rises")
    assert not rules.trend(first[0], first[0] + 1, "falls")
    assert rules.trend(first[0] + 2, last[0], "falls")
    assert not rules.trend(first[0], first[0], "rises")
    assert not rules.trend(np.full(30, math.nan), last[0], "rises")


@pytest.mark.parametrize(("excess", "seen"), [(-0.01, False), (0.01, True)])
@pytest.mark.parametrize("direction", ["rises", "falls"])
def test_trend_is_seen_from_the_tabled_t_on(excess, seen, direction):
    """Student's t for 29 degrees of freedom and 2.5 % in one tail is 2.045, in any table."""
    noise = np.random.default_rng(6).normal(size=30)
    noise = (noise - noise.mean()) / noise.std(ddof=1)  # its mean has a standard error of 30^-1/2
    last = noise + (2.045 + excess) / math.sqrt(30)
    ends = (np.zeros(30), last) if direction == "rises" else (last, np.zeros(30))
    assert rules.trend(*ends, direction) is seen


def test_trend_of_worlds_defined_at_both_ends():
    """Two worlds may do, if they agree; one says nothing, and an undefined one does not count."""
    both = np.array([1.0, 1.01, math.nan])
    assert rules.trend(np.zeros(3), both, "rises")
    assert not rules.trend(np.zeros(3), np.array([1.0, math.nan, math.inf]), "rises")


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [(600, "reproduced"), (240, "reproduced"), (1602, "reproduced"), (239, "trend reproduced"),
     (1603, "trend reproduced"), (48, "trend reproduced"), (8011, "trend reproduced"),
     (47, "not reproduced"), (8013, "not reproduced")],
)  # fmt: skip
def test_hardware(ours, verdict):
    """600 as printed; 479.3 to 801.2 before rounding, twice and ten times as wide."""
    assert rules.hardware(ours, ratio(number("336"), number("0.02"), 28)) == verdict


@pytest.mark.parametrize(
    ("k", "n", "threshold", "verdict"),
    [(30, 30, 0.8, "reproduced"), (29, 30, 0.8, "reproduced"), (28, 30, 0.8, "trend reproduced"),
     (21, 30, 0.8, "trend reproduced"), (20, 30, 0.8, "not reproduced"),
     (0, 30, 0.8, "not reproduced"), (0, 0, 0.8, "not reproduced")],
)  # fmt: skip
def test_share(k, n, threshold, verdict):
    assert rules.share(np.arange(n) < k, threshold) == verdict


def test_share_interval_is_clopper_pearson():
    low, high = rules.share_interval(np.ones(30, dtype=bool))
    assert (low, high) == pytest.approx((0.025 ** (1 / 30), 1))
