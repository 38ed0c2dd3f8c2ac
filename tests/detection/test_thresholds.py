import numpy as np
import pytest
from scipy import stats

from sngr_utils.detection import thresholds


@pytest.mark.parametrize(("n", "alpha"), [(19, 0.05), (100, 0.05), (37, 0.1)])
def test_a_further_score_exceeds_the_threshold_as_promised(n, alpha):
    """Exchangeable scores: the rank of a new one is uniform, so the rate is exact for any n."""
    threshold = thresholds.conformal_threshold(np.arange(n), alpha)
    rate = 1 - (threshold + 1) / (n + 1)
    assert rate <= alpha + 1e-12
    assert rate > alpha - 1 / (n + 1)


def test_rate_is_kept_over_calibrations():
    """20000 calibrations of 50 normal scores; five standard errors, once in 2e6 runs."""
    rng, n = np.random.default_rng(0), 20000
    fresh = rng.normal(size=n)
    fired = [x > thresholds.conformal_threshold(rng.normal(size=50), 0.1) for x in fresh]
    exact = 1 - np.ceil(51 * 0.9) / 51
    assert np.mean(fired) == pytest.approx(exact, abs=5 * np.sqrt(exact / n))


def test_too_few_scores_never_fire():
    assert thresholds.conformal_threshold(np.arange(18), 0.05) == np.inf
    assert thresholds.conformal_threshold(np.arange(19), 0.05) == 18


def test_surprise_agrees_with_the_threshold():
    """p <= alpha exactly where the score exceeds the conformal threshold."""
    rng = np.random.default_rng(1)
    clean, scores = rng.normal(size=60), rng.normal(size=500)
    for alpha in (0.05, 0.2):
        fired = scores > thresholds.conformal_threshold(clean, alpha)
        p = 10.0 ** -thresholds.surprise(scores, clean)
        assert np.array_equal(fired, p <= alpha + 1e-12)
    assert thresholds.surprise(np.array([9.0, -9.0]), clean) == pytest.approx([np.log10(61), 0])


@pytest.mark.parametrize("n", [30, 200, 780])
def test_interval_of_a_quantile_covers_and_no_more(n):
    """Coverage by the binomial law of the number of scores below the quantile."""
    low, high = thresholds.quantile_interval(np.arange(1, n + 1), 0.05)
    first = 0 if low == -np.inf else int(low)
    last = n + 1 if high == np.inf else int(high)
    below = stats.binom(n, 0.95)
    assert below.cdf(last - 1) - below.cdf(first - 1) >= 0.95
    if last <= n:
        assert below.cdf(last - 2) < 0.975
    assert below.cdf(first) > 0.025
    if n == 30:
        assert high == np.inf  # thirty scores hold no upper limit of their 95 % quantile


def test_interval_of_a_low_quantile_is_that_of_a_high_one_turned_round():
    """Thirty scores hold no lower limit of their 5 % quantile, as no upper one of the 95 %."""
    scores = np.arange(30.0)
    low, high = thresholds.quantile_interval(scores, 0.95)
    turned = thresholds.quantile_interval(-scores, 0.05)
    assert (low, high) == (-turned[1], -turned[0])
    assert low == -np.inf < 0 < high < np.inf


@pytest.mark.parametrize("alpha", [0.0, 1.0, -0.1])
def test_bad_arguments_are_named(alpha):
    with pytest.raises(ValueError, match="alpha"):
        thresholds.conformal_threshold(np.arange(5), alpha)
    with pytest.raises(ValueError, match="clean"):
        thresholds.quantile_interval(np.array([]), 0.05)
    with pytest.raises(ValueError, match="clean"):
        thresholds.surprise(np.zeros(1), np.array([np.nan]))
