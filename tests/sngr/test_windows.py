import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from helpers import dense_covariance

from sngr_utils.sngr import closure, failure, trigger, windows


def test_windows_are_the_papers():
    """Three poses, failed above 0.5 m; 28 of 30 poses begin one, and t >= 2 may trigger."""
    assert (windows.WIDTH, failure.FAILURE_ERROR, trigger.FIRST_ELIGIBLE) == (3, 0.5, 2)
    assert windows.n_windows(30) == 28
    assert trigger.triggers(np.full(28, np.inf), 3.96).sum() == 26


def test_counts_of_a_window_are_whole_numbers():
    found = windows.counts(np.array([1, 0, 2, 5]))
    assert found.tolist() == [3, 7]
    assert found.dtype.kind == "i"


def test_score_closed_form():
    """Equation "score": log10 of the ratio of extreme eigenvalues, whatever the basis."""
    rotation, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 9)))
    eigenvalues = np.logspace(-4, 1.5, 9)
    assert trigger.score(rotation * eigenvalues @ rotation.T) == pytest.approx(5.5)
    assert trigger.score(3 * np.eye(9)) == pytest.approx(0)


def test_triggers_need_score_and_position():
    scores = np.array([9.0, 9.0, 9.0, 3.9, 4.0])
    assert trigger.triggers(scores, 3.9).tolist() == [False, False, True, False, True]


def test_scores_of_many_windows_are_those_of_each(noisy):
    assert trigger.score(noisy.covariances).tolist() == [
        float(trigger.score(covariance)) for covariance in noisy.covariances
    ]


def test_means_and_counts_are_of_three_poses():
    assert np.allclose(windows.means(np.array([1.0, 2.0, 3.0, 7.0])), [2, 4])
    assert windows.counts(np.array([1, 0, 2, 5])).tolist() == [3, 7]


def test_failures_are_means_of_three():
    errors = np.array([0.0, 0.0, 1.6, 0.0, 0.0, 1.4])
    assert failure.failures(errors).tolist() == [True, True, True, False]
    assert failure.failures(np.full(5, 0.49)).tolist() == [False] * 3


def test_touching_factors_are_those_with_a_pose_of_the_window(clean):
    keys = windows.window_keys(10)
    assert keys == [X(10), X(11), X(12)]
    # 18 ranges, two odometry factors inside and two at the ends
    assert closure.touching_factors(clean.solution.graph, keys).size() == 22
    assert closure.touching_factors(clean.solution.graph, windows.window_keys(0)).size() == 22
    assert closure.touching_factors(clean.solution.graph, windows.window_keys(27)).size() == 21


def test_conditional_covariance_is_the_inverse_of_the_information_block(noisy):
    solution, keys = noisy.solution, windows.window_keys(12)
    covariance, slices = dense_covariance(solution)
    rows = np.concatenate([np.arange(len(covariance))[slices[key]] for key in keys])
    expected = np.linalg.inv(np.linalg.inv(covariance)[np.ix_(rows, rows)])
    got = closure.conditional_covariance(solution.graph, solution.estimate, keys)
    assert np.allclose(got, expected, rtol=1e-6, atol=1e-12)


def test_closure_is_the_connected_component(clean):
    everything = set(clean.solution.estimate.keys())
    assert closure.variable_closure(clean.solution.graph, windows.window_keys(5)) == everything
    noise = gtsam.noiseModel.Isotropic.Sigma(1, 1.0)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(gtsam.RangeFactor2D(X(0), L(0), 1.0, noise))
    graph.push_back(gtsam.RangeFactor2D(X(1), L(0), 1.0, noise))
    graph.push_back(gtsam.RangeFactor2D(X(2), L(1), 1.0, noise))
    assert closure.variable_closure(graph, [X(0)]) == {X(0), X(1), L(0)}
    assert closure.variable_closure(graph, [X(9)]) == {X(9)}


def test_log_extremes_differ_by_the_score(noisy):
    smallest, largest = trigger.log_extremes(noisy.covariances).T
    assert np.allclose(largest - smallest, noisy.scores)


def test_score_hangs_on_the_unit_of_length(noisy):
    """lambda_min is a heading's and stays; lambda_max is nearly a position's: 100^2 times."""
    assert np.array_equal(trigger.in_units(noisy.covariances, 1.0), noisy.covariances)
    metres = trigger.log_extremes(noisy.covariances)
    centimetres = trigger.log_extremes(trigger.in_units(noisy.covariances, 100.0))
    assert np.allclose(centimetres[:, 1] - metres[:, 1], 4, atol=0.02)
    assert np.allclose(centimetres[:, 0], metres[:, 0], atol=0.05)
    assert np.ptp(metres[:, 0]) < 0.02


def test_a_score_says_how_uncertain_the_positions_are(clean):
    """The largest position sigma of a window's poses, read from its score alone, to 5 %.

    lambda_min is fixed by the odometry, and the largest direction moves all poses together.
    """
    smallest = trigger.log_extremes(clean.covariances)[:, 0]
    for i, covariance in enumerate(clean.covariances):
        blocks = [covariance[j : j + 2, j : j + 2] for j in (0, 3, 6)]
        largest = np.sqrt(np.mean([np.linalg.eigvalsh(block)[-1] for block in blocks]))
        told = np.sqrt(10 ** (clean.scores[i] + smallest[i]) / windows.WIDTH)
        assert told == pytest.approx(largest, rel=0.05)
