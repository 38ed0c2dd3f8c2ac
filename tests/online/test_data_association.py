"""Innovations and decisions about single ranges, each against what can be worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import SIGMA, scans
from scipy import stats

from sngr_utils.online import data_association
from sngr_utils.online.data_association import DROPPED, Innovations
from sngr_utils.robust import association


def innovations(squared, variance=0.01):
    """What has these squared normalised innovations, all of one variance."""
    squared = np.array(squared, dtype=float)
    return Innovations(np.sqrt(squared * variance), np.where(np.isnan(squared), squared, variance))


def decide(data, found, used=None, p=0.2, exclusive=False, swap=True):
    used = data.label_of if used is None else np.array(used)
    log, shares = data, association.Shares(p, 0.0)
    return data_association.decide(log, found, used, shares, exclusive, swap)


# --- innovations ----------------------------------------------------------------------------


def test_nowhere_is_the_last_column():
    assignment = data_association.nowhere(2, 3)
    assert assignment.used.tolist() == [DROPPED, DROPPED]
    assert assignment.weights.tolist() == [[0, 0, 0, 1]] * 2


def test_residuals_about_an_estimate_taken_for_certain():
    data = scans([0, 1], pose_of=[0, 1], n_landmarks=2, ranges=[5.5, 3.0])
    poses = np.array([[1.0, 1.0, 0.4], [1.0, -3.0, 2.0]])
    landmarks = np.array([[4.0, 5.0], [np.nan, np.nan]])
    residuals = association.residuals(data, poses, landmarks)
    assert residuals[:, 0] == pytest.approx([0.5, 3.0 - np.hypot(3, 8)])
    found = Innovations(residuals, np.full((2, 2), 0.01))
    assert found.squared[0, 0] == pytest.approx(25)
    assert np.isnan(found.squared[:, 1]).all()


@pytest.fixture
def joint():
    """Two poses, three landmarks, and a joint covariance of [x0, x1, l0, l1, l2], small ones."""
    poses = np.array([[0.5, -1.0, 0.7], [2.0, 0.3, -2.1]])
    landmarks = np.array([[4.0, 1.0], [-1.0, 3.0], [0.0, -5.0]])
    root = 0.02 * np.random.default_rng(0).normal(size=(12, 12))
    return poses, landmarks, root @ root.T


def blocks(covariance):
    return SimpleNamespace(
        poses=np.array([covariance[:3, :3], covariance[3:6, 3:6]]),
        pose_landmark=np.array([covariance[:3, 6:], covariance[3:6, 6:]]),
        landmarks=covariance[6:, 6:],
    )


def distance(poses, landmarks, t, k, xi):
    """Of pose t, moved by xi in its own frame, and landmark k, moved likewise in the plane."""
    cos, sin = np.cos(poses[t, 2]), np.sin(poses[t, 2])
    x, y = xi[3 * t : 3 * t + 2]
    place = poses[t, :2] + [cos * x - sin * y, sin * x + cos * y]
    return np.linalg.norm(place - landmarks[k] - xi[6 + 2 * k : 8 + 2 * k])


def test_variance_of_a_range_not_in_the_graph_is_that_of_the_distance_and_the_noise(joint):
    """First order: the gradient of the distance by differences, and the joint covariance."""
    poses, landmarks, covariance = joint
    data = scans([0, 1, 0], pose_of=[0, 0, 1], ranges=[4.0, 4.5, 2.0])
    found = data_association.innovations(
        data, poses, landmarks, np.full(3, DROPPED), blocks(covariance)
    )
    for m, k in np.ndindex(3, 3):
        t = data.pose_of[m]
        ends = np.array([
            [distance(poses, landmarks, t, k, s * 1e-6 * axis) for axis in np.eye(12)]
            for s in (1, -1)
        ])
        gradient = (ends[0] - ends[1]) / 2e-6
        spread = gradient @ covariance @ gradient
        assert spread > 1e-4
        assert found.variances[m, k] == pytest.approx(spread + SIGMA**2, rel=1e-6)
        expected = data.ranges[m] - distance(poses, landmarks, t, k, np.zeros(12))
        assert found.residuals[m, k] == pytest.approx(expected)


def test_a_range_in_the_graph_is_predicted_without_itself(joint):
    """One number with variance s before and z measured: the Kalman gain is s / (s + noise), so the
    innovation has variance s + noise, and is larger than the residual by (s + noise) / noise."""
    poses, landmarks, covariance = joint
    data = scans([0, 1], ranges=[4.0, 4.5])
    outside, inside = (
        data_association.innovations(data, poses, landmarks, np.array(used), blocks(covariance))
        for used in ([DROPPED, DROPPED], [0, DROPPED])
    )
    after, noise = outside.variances[0, 0] - SIGMA**2, SIGMA**2
    before = after * noise / (noise - after)
    assert before * noise / (before + noise) == pytest.approx(after)
    assert inside.variances[0, 0] == pytest.approx(before + noise)
    gain = (before + noise) / noise
    assert inside.residuals[0, 0] == pytest.approx(outside.residuals[0, 0] * gain)
    for ours, theirs in ((inside.variances, outside.variances),
                         (inside.residuals, outside.residuals)):  # fmt: skip
        assert np.array_equal(np.delete(ours, 0), np.delete(theirs, 0))


def test_a_range_that_alone_holds_its_place_says_nothing_of_it(joint):
    """As much variance as the noise, or more by rounding: a vague prediction, no negative one."""
    poses, landmarks, covariance = joint
    data = scans([0], ranges=[4.0])
    found = data_association.innovations(
        data, poses, landmarks, np.array([0]), blocks(1e3 * covariance)
    )
    assert found.variances[0, 0] > 100 * SIGMA**2


# --- decisions ------------------------------------------------------------------------------


def test_labels_that_fit_are_kept_at_no_cost():
    data = scans([0, 1, 2])
    assignment = decide(data, innovations(np.diag([0.0, 1.0, 6.0]) + 50 * (1 - np.eye(3))))
    assert assignment.used.tolist() == [0, 1, 2]
    assert assignment.weights.tolist() == np.eye(4)[:3].tolist()


@pytest.mark.parametrize(("squared", "asked"), [(6.63, False), (6.64, True)])
def test_the_gate_is_the_99_percent_quantile(squared, asked):
    """Chi-square with one degree of freedom: 6.635 in any table."""
    data = scans([0])
    assignment = decide(data, innovations([[squared, 40.0, 40.0]]))
    assert (assignment.weights[0, 0] < 1) == asked


@pytest.mark.parametrize(("sigma", "asked"), [(0.499, False), (0.5, True), (0.501, True)])
def test_a_prediction_of_half_a_metre_is_too_vague_to_keep_a_label(sigma, asked):
    assignment = decide(scans([0]), innovations([[0.0, 40.0, 40.0]], variance=sigma**2))
    assert (assignment.weights[0, 0] < 1) == asked
    assert assignment.used[0] == (DROPPED if asked else 0)


def test_a_doubt_puts_its_own_scan_in_question_and_no_other():
    data = scans([0, 1, 0, 1], pose_of=[0, 0, 1, 1])
    found = innovations([[9, 0, 40], [40, 1, 40], [1, 40, 40], [40, 1, 40]])
    assignment = decide(data, found)
    assert (assignment.weights[:2].max(axis=1) < 1).all()
    assert (assignment.weights[2:].max(axis=1) == 1).all()
    assert assignment.weights.sum(axis=1) == pytest.approx(np.ones(4))


def test_a_range_that_was_dropped_or_swapped_is_asked_again():
    data = scans([0, 1], pose_of=[0, 1])
    found = innovations([[1, 40, 40], [40, 1, 40]])
    assert (decide(data, found, used=[0, 1]).weights.max(axis=1) == 1).all()
    for before in (DROPPED, 2):
        again = decide(data, found, used=[before, 1])
        assert again.weights[0].max() < 1 == again.weights[1].max()
        assert again.used.tolist() == [0, 1]  # it fits its label after all


def bayes(squared, label, p, variance=0.01):
    """Posterior over landmarks of one range, from densities."""
    prior = np.full(len(squared), p / (len(squared) - 1))
    prior[label] = 1 - p
    weight = prior * stats.norm.pdf(np.sqrt(np.array(squared) * variance), 0, np.sqrt(variance))
    return weight / weight.sum()


def test_weights_are_bayes():
    squared = [8.0, 3.0, 5.0]
    assignment = decide(scans([0]), innovations([squared]), p=0.3)
    assert assignment.weights[0, :3] == pytest.approx(bayes(squared, 0, 0.3))
    assert assignment.weights[0, 3] == 0


@pytest.mark.parametrize("share", [0.59, 0.61])
def test_a_range_goes_where_six_tenths_of_its_posterior_are(share):
    """At equal priors, p = 2/3, two landmarks fit, the first by log(share / (1 - share)) more."""
    gap = 2 * np.log(share / (1 - share))
    assignment = decide(scans([2]), innovations([[1.0, 1.0 + gap, 900.0]]), p=2 / 3)
    assert assignment.weights[0, 0] == pytest.approx(share)
    assert assignment.used[0] == (0 if share > 0.6 else DROPPED)


@pytest.mark.parametrize(("squared", "assigned"), [(23.9, True), (24.0, False)])
def test_what_happens_once_in_a_million_is_impossible(squared, assigned):
    """Chi-square with one degree of freedom exceeds 23.93 once in a million times."""
    assignment = decide(scans([1]), innovations([[squared, 400.0, 400.0]]))
    assert assignment.weights[0, 0] == pytest.approx(1)
    assert assignment.used[0] == (0 if assigned else DROPPED)


def test_without_swaps_a_range_keeps_its_label_or_is_dropped():
    data = scans([0, 1], pose_of=[0, 1])
    found = innovations([[90, 0, 90], [90, 8, 90]])
    assert decide(data, found).used.dtype.kind == "i"
    assert decide(data, found).used.tolist() == [1, 1]
    assert decide(data, found, swap=False).used.tolist() == [DROPPED, 1]


def test_no_range_goes_to_a_vague_landmark():
    data = scans([1])
    found = innovations([[0.0, 90.0, 90.0]])
    assert decide(data, found).used[0] == 0
    found.variances[0, 0] = 0.26
    assert decide(data, found).used[0] == DROPPED


def test_exclusion_leaves_one_range_to_a_landmark():
    """Both ranges fit landmark 0, the second nothing else; the first then came from landmark 1."""
    data = scans([0, 2])
    found = innovations([[7.0, 7.5, 900.0], [1.0, 900.0, 900.0]])
    alone, together = (decide(data, found, exclusive=e, p=0.5) for e in (False, True))
    assert alone.used.tolist() == [0, 0]
    assert together.used.tolist() == [1, 0]
    assert together.weights[0, 1] == pytest.approx(1)


def test_ranges_of_different_scans_may_share_a_landmark():
    """Exclusion holds within a scan: two poses may well see the same landmark."""
    data = scans([0, 0], pose_of=[0, 1])
    found = innovations([[7.0, 900.0, 900.0]] * 2)
    assert decide(data, found, exclusive=True).used.tolist() == [0, 0]


def test_a_doubt_in_one_scan_asks_no_question_of_another():
    """The plain range's landmark is the first of the first pose, the doubtful one is the second."""
    data = scans([0, 1], pose_of=[0, 1])
    found = innovations([[4.0, 5.0, 5.0], [1.0, 900.0, 1.0]])
    assignment = decide(data, found, exclusive=True)
    assert assignment.weights[0].tolist() == [1, 0, 0, 0]
    assert assignment.weights[1] == pytest.approx([0.5, 0, 0.5, 0], abs=1e-12)


def test_what_no_known_landmark_explains_came_from_one_that_is_not_in_the_map():
    """Uniform up to the longest range, 5 m, with the prior of all that are absent."""
    data = scans([0, 2], pose_of=[0, 1])
    found = innovations([[2.0, np.nan, np.nan], [12.0, np.nan, np.nan]])
    assignment = decide(data, found, used=[DROPPED, DROPPED], p=0.4)
    densities = stats.norm.pdf(np.sqrt([0.02, 0.12]), 0, 0.1)
    for m, prior in enumerate([(0.6, 0.4), (0.2, 0.8)]):
        known, absent = prior[0] * densities[m], prior[1] / 5.0
        expected = [known / (known + absent), 0, 0, absent / (known + absent)]
        assert assignment.weights[m] == pytest.approx(expected)
    assert assignment.used.tolist() == [0, DROPPED]


def test_the_joint_density_is_prior_times_likelihood():
    data = scans([0, 1], ranges=[5.0, 7.0])
    found = innovations([[1.0, 4.0, np.nan], [9.0, 0.0, np.nan]], variance=0.04)
    shares = association.Shares(0.3, 0.0)
    logs = association.log_joint(data, found.residuals, found.variances, shares)
    density = stats.norm.pdf(np.sqrt(found.squared[:, :2] * 0.04), 0, 0.2)
    prior = np.array([[0.7, 0.15], [0.15, 0.7]])
    assert np.exp(logs[:, :2]) == pytest.approx(prior * density)
    assert np.isneginf(logs[:, 2]).all()
    assert np.exp(logs[:, 3]) == pytest.approx(0.15 / 7)
    known = innovations(np.ones((2, 3)))
    everywhere = association.log_joint(data, known.residuals, known.variances, shares)
    assert np.isneginf(everywhere[:, 3]).all()
