import numpy as np
import pytest

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


@pytest.mark.parametrize("alpha", [0.0, 1.0, -0.1])
def test_bad_arguments_are_named(alpha):
    with pytest.raises(ValueError, match="alpha"):
        thresholds.conformal_threshold(np.arange(5), alpha)
    with pytest.raises(ValueError, match="clean"):
        thresholds.conformal_threshold(np.array([]), 0.05)
    with pytest.raises(ValueError, match="clean"):
        thresholds.surprise(np.zeros(1), np.array([np.nan]))
