import numpy as np
import pytest
from scipy import stats

from sngr_utils import metrics


def test_rmse_closed_form_and_missing_rows():
    truth = np.zeros((3, 2))
    estimate = np.array([[3.0, 4.0], [np.nan, np.nan], [0.0, 0.0]])
    assert metrics.rmse(estimate, truth) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(metrics.rmse(estimate[1:2], truth[1:2]))


def test_nees_closed_form():
    errors = np.array([[1.0, 2.0], [0.0, 3.0]])
    covariances = np.array([np.diag([1.0, 4.0]), [[2.0, 1.0], [1.0, 2.0]]])
    # 1 + 1, and 9 * (inverse)_{11} = 9 * 2 / 3
    assert metrics.nees(errors, covariances) == pytest.approx((2 + 6) / 2)


def test_nees_of_consistent_errors_is_the_dimension():
    """Sum of 4000 NEES values is chi-square with 8000 degrees. Failure probability 2e-5."""
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(4000, 2, 2)) + 2 * np.eye(2)
    errors = np.einsum("nij,nj->ni", factor, rng.normal(size=(4000, 2)))
    value = metrics.nees(errors, factor @ factor.transpose(0, 2, 1))
    assert 1e-5 < stats.chi2.cdf(value * 4000, 8000) < 1 - 1e-5


def test_detection_counts():
    found = metrics.detection([1, 1, 1, 0, 0, 0], [1, 1, 0, 1, 0, 0])
    assert (found.true_positives, found.false_positives) == (2, 1)
    assert (found.false_negatives, found.true_negatives) == (1, 2)
    assert (found.triggered, found.failed, found.total) == (3, 3, 6)
    assert found.precision == found.recall == pytest.approx(2 / 3)
    assert found.base_rate == 0.5


def test_detection_without_triggers_or_failures():
    silent = metrics.detection([0, 0], [0, 0])
    assert np.isnan(silent.precision)
    assert np.isnan(silent.recall)
    assert np.isnan(metrics.detection([], []).base_rate)


def test_bimodality_of_two_spikes_and_of_a_weighted_sample():
    spikes = np.array([-1.0, 1.0])
    assert metrics.bimodality_coefficient(spikes, np.ones(2)) == pytest.approx(1)
    # a weight of two is a point drawn twice
    x = np.array([0.0, 1.0, 5.0])
    assert metrics.bimodality_coefficient(x, np.array([1.0, 2.0, 1.0])) == pytest.approx(
        metrics.bimodality_coefficient(np.array([0.0, 1.0, 1.0, 5.0]), np.ones(4))
    )


def test_bimodality_of_the_uniform_law():
    x = np.linspace(0, 1, 100_001)
    assert metrics.bimodality_coefficient(x, np.ones(len(x))) == pytest.approx(5 / 9, abs=1e-4)


def test_effective_sample_size():
    assert metrics.effective_sample_size(np.full(7, 1e-5)) == pytest.approx(7)
    assert metrics.effective_sample_size(np.array([1.0, 0.0])) == pytest.approx(1)
    assert metrics.effective_sample_size(np.array([1.0, 1.0, 2.0])) == pytest.approx(16 / 6)
