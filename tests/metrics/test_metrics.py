import sys
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from sngr_utils.metrics import (
    bimodality,
    cluster_bootstrap,
    effective_sample_size,
    precision_recall,
    rmse_and_nees,
    summaries,
)


@pytest.fixture
def silent():
    """What is undefined is said by a NaN, not by a warning as well."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_rmse_closed_form_and_missing_rows(silent):
    truth = np.array([[1.0, -2.0], [0.0, 0.0], [5.0, 5.0]])
    estimate = truth + np.array([[3.0, 4.0], [np.nan, np.nan], [0.0, 0.0]])
    assert rmse_and_nees.rmse(estimate, truth) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rmse_and_nees.rmse(estimate[1:2], truth[1:2]))


def test_nees_closed_form():
    errors = np.array([[1.0, 2.0], [0.0, 3.0]])
    covariances = np.array([np.diag([1.0, 4.0]), [[2.0, 1.0], [1.0, 2.0]]])
    # 1 + 1, and 9 * (inverse)_{11} = 9 * 2 / 3
    assert rmse_and_nees.nees(errors, covariances) == pytest.approx((2 + 6) / 2)


def test_nees_of_consistent_errors_is_the_dimension():
    """Sum of 4000 NEES values is chi-square with 8000 degrees. Failure probability 2e-5."""
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(4000, 2, 2)) + 2 * np.eye(2)
    errors = np.einsum("nij,nj->ni", factor, rng.normal(size=(4000, 2)))
    value = rmse_and_nees.nees(errors, factor @ factor.transpose(0, 2, 1))
    assert 1e-5 < stats.chi2.cdf(value * 4000, 8000) < 1 - 1e-5


def test_detection_counts():
    found = precision_recall.detection([1, 1, 1, 0, 0, 0], [1, 1, 0, 1, 0, 0])
    assert (found.true_positives, found.false_positives) == (2, 1)
    assert (found.false_negatives, found.true_negatives) == (1, 2)
    assert (found.triggered, found.failed, found.total) == (3, 3, 6)
    assert found.precision == found.recall == pytest.approx(2 / 3)
    assert found.base_rate == 0.5


def test_detection_without_triggers_or_failures():
    silent = precision_recall.detection([0, 0], [0, 0])
    assert np.isnan(silent.precision)
    assert np.isnan(silent.recall)
    assert np.isnan(precision_recall.detection([], []).base_rate)


def test_bimodality_of_two_spikes_and_of_a_weighted_sample():
    spikes = np.array([-1.0, 4.0])
    for masses in ([1.0, 1.0], [0.2, 0.8], [9.0, 1.0]):
        assert bimodality.bimodality_coefficient(spikes, np.array(masses)) == pytest.approx(1)
    # a weight of two is a point drawn twice
    x = np.array([0.0, 1.0, 5.0])
    assert bimodality.bimodality_coefficient(x, np.array([1.0, 2.0, 1.0])) == pytest.approx(
        bimodality.bimodality_coefficient(np.array([0.0, 1.0, 1.0, 5.0]), np.ones(4))
    )


def test_bimodality_of_the_uniform_law():
    x = np.linspace(0, 1, 100_001)
    assert bimodality.bimodality_coefficient(x, np.ones(len(x))) == pytest.approx(5 / 9, abs=1e-4)


def test_effective_sample_size():
    assert effective_sample_size.effective_sample_size(np.full(7, 1e-5)) == pytest.approx(7)
    assert effective_sample_size.effective_sample_size(np.array([1.0, 0.0])) == pytest.approx(1)
    assert effective_sample_size.effective_sample_size(np.array([1.0, 1.0, 2.0])) == pytest.approx(
        16 / 6
    )


def test_matthews_is_the_correlation_of_the_indicators():
    rng = np.random.default_rng(0)
    fired, failed = rng.random((2, 50)) < [[0.3], [0.8]]
    found = precision_recall.detection(fired, failed)
    assert found.matthews == pytest.approx(np.corrcoef(fired, failed)[0, 1])
    assert precision_recall.detection(failed, failed).matthews == pytest.approx(1)
    assert precision_recall.detection(~failed, failed).matthews == pytest.approx(-1)
    assert np.isnan(precision_recall.detection(np.zeros(50), failed).matthews)
    assert np.isnan(precision_recall.detection(fired, np.ones(50)).matthews)


def test_roc_auc_counts_won_pairs_and_halves_ties():
    rng = np.random.default_rng(1)
    scores, truth = rng.integers(0, 6, size=40).astype(float), rng.random(40) < 0.4
    pairs = [np.sign(a - b) / 2 + 0.5 for a in scores[truth] for b in scores[~truth]]
    assert precision_recall.roc_auc(scores, truth) == pytest.approx(np.mean(pairs))
    false_rate, true_rate = precision_recall.roc_curve(scores, truth)
    assert np.trapezoid(true_rate, false_rate) == pytest.approx(np.mean(pairs))


def test_average_precision_closed_form():
    scores, truth = np.array([4.0, 3.0, 2.0, 1.0]), np.array([True, False, True, False])
    assert precision_recall.average_precision(scores, truth) == pytest.approx(0.5 * 1 + 0.5 * 2 / 3)
    recall, precision = precision_recall.precision_recall_curve(scores, truth)
    assert recall.tolist() == [1, 1, 0.5, 0.5, 0]
    assert precision == pytest.approx([0.5, 2 / 3, 0.5, 1, 1])


def test_auc_within_worlds_is_not_fooled_by_their_levels():
    """Perfect ranking in each world, hidden in the pool by levels that run the other way."""
    scores = np.array([0.0, 1.0, 10.0, 11.0])
    truth = np.array([False, True, False, True])
    worlds = np.array([0, 0, 1, 1])
    assert precision_recall.roc_auc(scores, truth) < 1
    rng = np.random.default_rng(0)
    found, n = cluster_bootstrap.within_auc(scores, truth, worlds, rng=rng)
    within, low, high = found.value, found.low, found.high
    assert (within, n) == (1.0, 2)
    assert np.isnan([low, high]).all()  # two worlds say too little
    many = cluster_bootstrap.within_auc(
        np.tile(scores, 5), np.tile(truth, 5), np.repeat(np.arange(10), 2), rng=rng
    )
    assert many == (cluster_bootstrap.Interval(1.0, 1.0, 1.0), 10)
    alone = cluster_bootstrap.within_auc(scores, np.ones(4, bool), worlds, rng=rng)
    assert alone == (cluster_bootstrap.NOTHING, 0)


def test_auc_within_one_world_is_the_auc_and_halves_ties():
    rng = np.random.default_rng(2)
    scores, truth = rng.integers(0, 5, size=40).astype(float), rng.random(40) < 0.4
    within, _ = cluster_bootstrap.within_auc(scores, truth, np.zeros(40), rng=rng)
    assert within.value == pytest.approx(precision_recall.roc_auc(scores, truth))
    tied = cluster_bootstrap.within_auc(np.ones(2), np.array([True, False]), np.zeros(2), rng=rng)
    assert tied[0].value == 0.5


@pytest.mark.parametrize("n", [4, 5])
def test_auc_within_has_an_interval_from_five_worlds_on(n):
    """One pair a world, the first lost: the interval reaches 1 where that world is not drawn."""
    scores = np.tile([0.0, 1.0], n)
    truth, worlds = np.tile([False, True], n), np.repeat(np.arange(n), 2)
    truth[:2] = [True, False]
    found, counted = cluster_bootstrap.within_auc(
        scores, truth, worlds, rng=np.random.default_rng(0)
    )
    assert (found.value, counted) == (1 - 1 / n, n)
    ends = [found.low, found.high]
    assert np.isnan(ends).all() if n < 5 else ends[0] < found.value < ends[1] == 1


def test_interval_of_auc_within_is_that_of_drawn_worlds():
    """30 of 50 worlds won, one pair each: won pairs of a draw are binomial(50, 0.6) of 50.

    The ends of 2000 draws are the law's 2.5 % quantiles or next to them, but for 2e-10.
    """
    scores, worlds = np.tile([0.0, 1.0], 50), np.repeat(np.arange(50), 2)
    truth = np.tile([False, True], 50)
    truth[60:] = ~truth[60:]
    rng = np.random.default_rng(0)
    found, _ = cluster_bootstrap.within_auc(scores, truth, worlds, rng=rng)
    law = stats.binom(50, 0.6)
    assert 50 * np.array([found.low, found.high]) == pytest.approx(
        [law.ppf(0.025), law.ppf(0.975)], abs=1.01
    )


def test_precision_over_the_base_rate_of_the_same_world():
    """Rows of the runs in another order; nothing to find out where all failed, or nothing fired."""
    worlds = {"preset": ["C"] * 4, "p": [0.1] * 4, "seed": [1, 2, 3, 4]}
    fired = pd.DataFrame({**worlds, "precision": [0.75, 1.0, np.nan, 0.4]})
    runs = pd.DataFrame({**worlds, "base_rate": [0.5, 1.0, 0.2, 0.6]}).iloc[::-1]
    found = summaries.precision_over_base(fired, runs)
    assert found.to_numpy() == pytest.approx([0.25, np.nan, np.nan, -0.2], nan_ok=True)


def test_a_median_of_nothing_is_undefined(silent):
    frame = pd.DataFrame({"name": ["a", "a", "a", "b"], "x": [3.0, 1.0, np.nan, np.nan]})
    found = summaries.medians(frame, "x", ["name"])
    shown = found[["median", "low", "high", "n", "missing"]].to_numpy()
    expected = [[2.0, np.nan, np.nan, 2, 1], [np.nan, np.nan, np.nan, 0, 1]]
    assert shown == pytest.approx(np.array(expected), nan_ok=True)


@pytest.mark.parametrize("value", [True, False])
def test_an_empty_class_has_no_area_and_no_curve(value, silent, monkeypatch):
    """Nor is scikit-learn, which takes a second, imported to say so."""
    monkeypatch.setitem(sys.modules, "sklearn", None)
    monkeypatch.setitem(sys.modules, "sklearn.metrics", None)
    truth = np.full(3, value)
    assert np.isnan(precision_recall.roc_auc(np.arange(3.0), truth))
    assert np.isnan(precision_recall.average_precision(np.arange(3.0), truth))
    for curve in (precision_recall.roc_curve, precision_recall.precision_recall_curve):
        with pytest.raises(ValueError, match=r"^truth holds one class only"):
            curve(np.arange(3.0), truth)
