"""The rules, each both ways, and the error probabilities that their docstrings state."""

import math

import numpy as np
import pytest

from sngr_utils.publish import rules
from sngr_utils.publish.printed import number, ratio


def test_deterministic():
    assert rules.deterministic(-12.4951, number("-12.50"))
    assert not rules.deterministic(-12.494, number("-12.50"))
    assert rules.deterministic(math.nan, number("null"))
    assert not rules.deterministic(1.0, number("null"))


def test_trend_is_a_sign_test_at_its_level():
    """Of 30 changes 21 up is the least with a tail of at most 2.5 % (0.0214; 20 up: 0.0494)."""
    for up, seen in ((21, True), (20, False)):
        change = np.where(np.arange(30) < up, 0.01, -100.0)  # however large the few others are
        assert rules.trend(np.zeros(30), change, "rises") is seen
        assert rules.trend(change, np.zeros(30), "falls") is seen
        assert not rules.trend(np.zeros(30), change, "falls")


def test_trend_errs_as_often_as_stated_for_skewed_changes():
    """2.1 % where there is none: 2000 trials stay below 0.04 but for 1e-8."""
    rng = np.random.default_rng(4)
    first, last = rng.lognormal(sigma=2, size=(2, 2000, 30))
    wrong = np.mean([rules.trend(a, b, "rises") for a, b in zip(first, last, strict=True)])
    assert 0 < wrong < 0.04


def test_trend_of_worlds_that_are_defined_at_both_ends_and_differ():
    assert not rules.trend(np.full(30, math.nan), np.ones(30), "rises")
    assert not rules.trend(np.ones(30), np.ones(30), "rises")
    some = np.r_[np.ones(6), np.full(24, math.nan)]
    assert rules.trend(np.zeros(30), some, "rises")  # 6 of 6: 0.016
    assert not rules.trend(np.zeros(30), np.r_[np.ones(5), np.zeros(25)], "rises")  # 0.031


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
