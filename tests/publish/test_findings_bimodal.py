"""Sentences of notebook 01 about signs and orders, on its stored table."""

import numpy as np
from stored_results import entry, value

PRINTED, OURS = 2, 3  # columns; the rows are those of the whole table


def test_likelihoods_gain_and_spread_agree_and_the_coefficient_does_not():
    for row, tolerance in ((3, 0.01), (4, 0.02), (5, 0.02), (6, 0.001), (8, 0.1)):
        assert abs(entry("bimodal", row, OURS) - entry("bimodal", row, PRINTED)) < tolerance
    assert entry("bimodal", 9, OURS) > 0.9 > 0.7 > entry("bimodal", 9, PRINTED)


def test_the_printed_distance_is_the_error_in_y_alone():
    x, y = (entry("bimodal", 2, PRINTED, part) for part in (1, 2))
    in_y = abs(abs(y) - np.sqrt(5))  # the modes stand at (2, ±√5)
    assert abs(in_y - entry("bimodal", 7, PRINTED)) < 0.0005
    assert np.hypot(x - 2, in_y) > 3 * in_y


def test_one_run_knows_less_than_the_runs_scatter_and_their_mean_is_one_half():
    mean, error = (entry("bimodal", 11, OURS, part) for part in (1, 2))
    assert entry("bimodal", 10, OURS, 2) > 2 * value("bimodal.resampled_error")
    assert abs(mean - 0.5) < 2 * error


def test_an_uneven_split_has_the_printed_coefficient_and_not_the_printed_spread():
    """Two Gaussians, 994 to 6, as wide as a mode is under the printed factor."""
    share, apart, width = 0.006, 2 * np.sqrt(5), 1 / np.sqrt(0.5 * 2 * 5 / 9 / 0.04)
    ends = np.array([0, apart]) - share * apart
    weights = np.array([1 - share, share])
    variance = weights @ (ends**2 + width**2)
    skewness = weights @ (ends**3 + 3 * ends * width**2) / variance**1.5
    kurtosis = weights @ (ends**4 + 6 * ends**2 * width**2 + 3 * width**4) / variance**2
    assert abs((1 + skewness**2) / kurtosis - entry("bimodal", 9, PRINTED)) < 0.02
    assert np.sqrt(variance) < 0.5
