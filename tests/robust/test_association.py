"""The posterior over landmarks against enumeration, EM against the oracle, Louis' information."""

import itertools
import time
import tracemalloc
import warnings
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from scipy import linalg, special, stats

from sngr_utils.experiments import gtsam_estimates
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.robust import (
    association,
    belief_propagation,
    em,
    losses,
    louis_covariance,
    mutual_exclusion,
)
from sngr_utils.robust.association import Shares
from sngr_utils.slam import (
    chain_problem,
    chain_solver,
    conventions,
    information,
    landmark_starts,
    solution,
)
from sngr_utils.slam.factors import range_factor, sure_factors
from sngr_utils.world import dead_reckoning, log, scenario, simulation

C = conventions.PRESETS["C"]


def enumerated(log_weights):
    """Marginals over all matchings, one by one; the last column may be taken more than once."""
    n, columns = log_weights.shape
    total = np.zeros((n, columns))
    for choice in itertools.product(range(columns), repeat=n):
        taken = [j for j in choice if j < columns - 1]
        if len(set(taken)) == len(taken):
            weight = np.exp(log_weights[np.arange(n), list(choice)].sum())
            total[np.arange(n), list(choice)] += weight
    return total / total.sum(axis=1, keepdims=True)


def test_scans_end_where_the_pose_changes():
    alone, three = (mutual_exclusion.ends_of(5, scans) for scans in (None, [0, 0, 2, 3, 3]))
    assert (alone.tolist(), three.tolist()) == ([5], [2, 3, 5])
    assert alone.dtype == three.dtype == np.int64  # what compiled code is made for


@pytest.mark.parametrize(
    ("n", "k", "none"), [(1, 3, True), (4, 4, False), (3, 5, True), (5, 3, True)]
)
def test_exclusive_posterior_is_the_sum_over_all_matchings(n, k, none):
    log_weights = 3 * np.random.default_rng(n).normal(size=(n, k + 1))
    if not none:
        log_weights[:, -1] = -np.inf
    found = mutual_exclusion.exclusive_posterior(log_weights)
    assert np.allclose(found, enumerated(log_weights), atol=1e-12)
    if n > k:  # somebody must be left over
        assert (1 - found[:, :-1].sum(axis=0) > -1e-12).all()


def test_without_rivals_exclusion_changes_nothing():
    log_weights = np.random.default_rng(0).normal(size=(1, 7))
    alone = mutual_exclusion.exclusive_posterior(log_weights)
    assert np.allclose(alone, association.posterior(log_weights))


def test_exclusion_settles_what_two_ranges_leave_open():
    """The second range can only be landmark 0, so the first, torn between two, is landmark 1."""
    log_weights = np.log(np.array([[0.5, 0.5, 1e-300], [1.0, 1e-300, 1e-300]]))
    assert association.posterior(log_weights)[0, 0] == pytest.approx(0.5)
    assert mutual_exclusion.exclusive_posterior(log_weights)[0, 1] == pytest.approx(1.0)


def by_all_subsets(log_weights):
    """Marginals by the recursion over every subset of the landmarks, nothing left out."""
    relative = log_weights - log_weights.max(axis=1, keepdims=True)
    weights = np.exp(np.maximum(relative, mutual_exclusion.LEAST)) * ~np.isneginf(relative)
    n, k = len(weights), weights.shape[1] - 1

    def steps():  # pairs of a subset before and after, and the column that joins them
        sets = np.arange(1 << k)
        yield sets, sets, k
        for j in range(k):
            free = sets[sets >> j & 1 == 0]
            yield free, free | 1 << j, j

    before, after = np.zeros((n + 1, 1 << k)), np.ones((n + 1, 1 << k))
    before[0, 0] = 1.0
    for i in range(n):
        for s, there, j in steps():
            np.add.at(before[i + 1], there, before[i, s] * weights[i, j])
    found = np.zeros(weights.shape)
    for i in range(n - 1, -1, -1):
        after[i] = 0.0
        for s, there, j in steps():
            found[i, j] = np.sum(before[i, s] * weights[i, j] * after[i + 1, there])
            np.add.at(after[i], s, weights[i, j] * after[i + 1, there])
    return found / found.sum(axis=1, keepdims=True)


def scan_of_ranges(k, seed, none, sigma=0.1, n=None):
    """Log weights of the ranges of one scan to k landmarks, half of them mislabelled."""
    rng = np.random.default_rng(seed)
    distances = rng.uniform(1, 9, k)
    ranges = rng.permutation(np.resize(distances, n or k)) + rng.normal(0, sigma, n or k)
    labels = rng.integers(k, size=len(ranges))
    residuals = ranges[:, None] - distances
    logs = np.log(0.5 * np.eye(k)[labels] + 0.5 * (1 - np.eye(k)[labels]) / (k - 1))
    logs -= 0.5 * (residuals / sigma) ** 2
    return np.column_stack([logs, np.full(len(ranges), none)])


@pytest.mark.parametrize("none", [-np.inf, -20.0])
@pytest.mark.parametrize(("k", "n"), [(4, 4), (7, 5), (9, 9), (11, 11)])
def test_pairs_that_are_left_out_are_not_missed(k, n, none):
    for seed in range(3):
        logs = scan_of_ranges(k, seed, none, n=n)
        found = mutual_exclusion.exclusive_posterior(logs)
        assert np.allclose(found, by_all_subsets(logs), rtol=0, atol=1e-12)


@pytest.mark.parametrize("none", [-np.inf, -30.0])
def test_where_only_implausible_matchings_exist_nothing_is_left_out(none):
    """Three ranges fit the first landmark only: two of them have to go somewhere."""
    logs = np.random.default_rng(0).uniform(-60, -45, (3, 6))
    logs[:, 0], logs[:, -1] = 0.0, none
    found = mutual_exclusion.exclusive_posterior(logs)
    assert np.allclose(found, by_all_subsets(logs), rtol=0, atol=1e-12)


def test_more_ranges_than_landmarks_and_one_landmark_measured_twice():
    """Whoever finds no landmark free came from none of them, said or not that this can be."""
    for none in (-np.inf, -20.0):
        found = mutual_exclusion.exclusive_posterior(scan_of_ranges(3, 0, none, n=5))
        assert found.sum(axis=1) == pytest.approx(np.ones(5))
        assert found[:, :-1].sum(axis=0) == pytest.approx(np.ones(3))
        assert found[:, -1].sum() == pytest.approx(2.0)
    twice = np.array([[0.0, -200.0, -20.0], [0.0, -200.0, -20.0]])
    found = mutual_exclusion.exclusive_posterior(twice)
    assert found == pytest.approx(np.array([[0.5, 0, 0.5], [0.5, 0, 0.5]]), abs=1e-9)
    alone = np.array([[0.0, -np.inf, -np.inf], [0.0, -np.inf, -np.inf]])
    assert mutual_exclusion.exclusive_posterior(alone) == pytest.approx(found, abs=1e-9)


def test_scans_are_independent_and_their_rows_have_no_order():
    logs = np.vstack([scan_of_ranges(6, seed, -20.0) for seed in (1, 2)])
    found = mutual_exclusion.exclusive_posterior(logs, np.repeat([4, 7], 6))
    assert np.array_equal(found[6:], mutual_exclusion.exclusive_posterior(logs[6:]))
    turned = mutual_exclusion.exclusive_posterior(logs[:6][::-1])[::-1]
    assert np.allclose(found[:6], turned, rtol=0, atol=1e-14)


def operations(k):
    """Subsets that are gone through for a scan of as many ranges as landmarks, on average."""
    sizes = []
    for seed in range(20):
        logs = scan_of_ranges(k, seed, -np.inf, sigma=0.5 / k)
        weights = np.exp(np.maximum(logs - logs.max(axis=1, keepdims=True), -50.0))
        sizes.append(k << mutual_exclusion._plan(weights, mutual_exclusion.PLAUSIBLE).n_open)
    return np.mean(sizes)


def test_cost_grows_with_the_landmarks_that_are_open_and_not_with_all_of_them():
    """As many neighbours in range, however many landmarks: all subsets would be 2^42 as many."""
    few, many = operations(6), operations(48)
    assert many < 8**2 * few  # quadratic at most


def test_thirty_landmarks_are_no_more_than_those_open():
    logs = scan_of_ranges(30, 0, -20.0, sigma=0.02)
    found = mutual_exclusion.exclusive_posterior(logs)
    assert found.sum(axis=1) == pytest.approx(np.ones(30))
    assert (found[:, :-1].sum(axis=0) < 1 + 1e-9).all()


def propagated(logs):
    """What stands in for the sum where it is too much work, however little it would be here."""
    relative = logs - logs.max(axis=1, keepdims=True)
    weights = np.exp(np.maximum(relative, mutual_exclusion.LEAST)) * ~np.isneginf(relative)
    found = np.empty(weights.shape)
    belief_propagation.propagate(weights, found)
    return found


# Sparse scans and dense ones: the largest error over the scans, and the median of each scan's.
# Measured on these seeds: 0.109, 0.050; 0.093, 0.063; 0.102, 0.034; 0.030, 0.025; 0.036, 0.021;
# 0.188, 0.057
@pytest.mark.parametrize(
    ("k", "n", "sigma", "none", "largest", "median"),
    [
        (8, 8, 0.1, -5.0, 0.115, 0.055), (12, 12, 0.1, -5.0, 0.1, 0.07),
        (10, 14, 0.1, -5.0, 0.11, 0.04), (12, 12, 3.0, -5.0, 0.035, 0.03),
        (12, 12, 3.0, -20.0, 0.04, 0.025), (12, 8, 0.5, -20.0, 0.2, 0.065),
    ],
)  # fmt: skip
def test_propagation_errs_by_no_more_than_measured(k, n, sigma, none, largest, median):
    """Less than half as much as without exclusion."""
    errors, alone = [], []
    for seed in range(20):
        logs = scan_of_ranges(k, seed, none, sigma=sigma, n=n)
        exact = mutual_exclusion.exclusive_posterior(logs)
        errors.append(np.abs(propagated(logs) - exact).max())
        alone.append(np.abs(association.posterior(logs) - exact).max())
    assert np.max(errors) < largest
    assert np.median(errors) < median < np.median(alone) / 2


@pytest.mark.parametrize("k", [12, 13, 40])
def test_two_ranges_of_one_landmark_among_many_go_where_they_can(k):
    """ "None" is far less likely than any other landmark: one of them is from another."""
    logs = np.full((2, k + 1), -40.0)
    logs[:, 0], logs[:, -1] = 0.0, -50.0
    found = mutual_exclusion.exclusive_posterior(logs)
    assert found[:, 0] == pytest.approx([0.5, 0.5], abs=1e-3)
    assert (found[:, -1] < 1e-4).all()


def test_propagation_of_two_swapped_ranges_is_sure_of_the_likelier_way():
    """Its known fault, where "none" is all but impossible: two ways, of three quarters and one."""
    logs = np.log(np.array([[3.0, 1.0, 1e-9], [1.0, 1.0, 1e-9]]))
    exact = mutual_exclusion.exclusive_posterior(logs)[:, 0]
    assert exact == pytest.approx([0.75, 0.25], abs=1e-6)
    assert propagated(logs)[:, 0] == pytest.approx([1.0, 0.0], abs=0.01)


def test_propagation_without_a_cycle_is_exact():
    """Each range torn between two neighbours in a row: a tree, on which messages are exact."""
    logs = np.full((9, 11), -np.inf)
    drawn = np.random.default_rng(0).normal(size=(3, 9))
    logs[np.arange(9), np.arange(9)], logs[np.arange(9), np.arange(1, 10)], logs[:, -1] = drawn
    exact = mutual_exclusion.exclusive_posterior(logs)
    assert np.allclose(propagated(logs), exact, rtol=0, atol=1e-3)


def test_propagation_shares_out_alike_what_is_alike():
    """Any n ranges and k landmarks, all pairs alike and "none" all but impossible."""
    for n, k in ((18, 18), (18, 30), (40, 18)):
        logs = np.zeros((n, k + 1))
        logs[:, -1] = -np.inf
        found = mutual_exclusion.exclusive_posterior(logs)
        expected = min(n, k) / (n * k)
        assert found[:, :-1] == pytest.approx(np.full((n, k), expected), abs=1e-4)
        assert found[:, -1] == pytest.approx(np.full(n, 1 - k * expected), abs=1e-4)


@pytest.mark.parametrize("none", [-np.inf, -50.0, -3.0])
@pytest.mark.parametrize("contrast", [0.1, 3.0, 100.0])
@pytest.mark.parametrize("n", [14, 30, 60])
def test_dense_scans_of_any_contrast_have_a_posterior(n, contrast, none):
    """More ranges than landmarks or fewer; weights down to e^-50 and beyond."""
    logs = contrast * np.random.default_rng(n).normal(size=(n, 31))
    logs[:, -1] = logs[:, :-1].max(axis=1) + none
    found = mutual_exclusion.exclusive_posterior(logs)
    assert np.isfinite(found).all()
    assert found.sum(axis=1) == pytest.approx(np.ones(n))
    assert (found[:, :-1].sum(axis=0) < 1.05).all()
    assert np.array_equal(found, mutual_exclusion.exclusive_posterior(logs))


def test_two_clusters_far_apart_are_exact_though_sixteen_landmarks_are_in_question():
    near, far = (np.random.default_rng(seed).normal(size=(8, 9)) for seed in (0, 1))
    both = np.full((16, 17), -np.inf)
    both[:8, :8], both[8:, 8:16] = near[:, :8], far[:, :8]
    both[:8, -1], both[8:, -1] = near[:, -1], far[:, -1]
    found = mutual_exclusion.exclusive_posterior(both)
    assert np.allclose(found[:8, :8], by_all_subsets(near)[:, :8], rtol=0, atol=1e-12)
    assert np.allclose(found[8:, 8:], by_all_subsets(far), rtol=0, atol=1e-12)


def test_a_scan_of_forty_ranges_costs_no_more_than_a_dense_one_of_twelve():
    """The sum over all subsets of twelve is the most that is done; ten times for slow clocks."""

    def seconds(logs):
        times = []
        for _ in range(5):
            start = time.perf_counter()
            mutual_exclusion.exclusive_posterior(logs)
            times.append(time.perf_counter() - start)
        return min(times)

    twelve = seconds(np.random.default_rng(0).normal(size=(12, 13)))
    for sigma in (0.05, 0.2, 3.0):
        assert seconds(scan_of_ranges(40, 0, -20.0, sigma=sigma)) < 10 * twelve
    assert seconds(scan_of_ranges(40, 0, -20.0, n=500)) < 20 * twelve


def test_unknown_start_is_refused():
    clean = simulation.simulate(scenario.Scenario(), 0.0, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="start is 'truth'"):
        em.estimate(clean.log(C.x0_sigmas), C, "truth", exclusive=False, clutter=False)


def scans(pose_of, label_of, ranges, poses, landmarks, **changed):
    """A log of ranges that some poses have of some landmarks."""
    return log.Log(**{
        "odometry": np.zeros((len(poses) - 1, 3)), "odometry_covariances": np.eye(3),
        "pose_of": pose_of, "label_of": label_of, "ranges": ranges, "range_sigmas": 0.1,
        "n_landmarks": len(landmarks), "x0_mean": poses[0], "x0_sigmas": np.ones(3), **changed,
    })  # fmt: skip


@pytest.mark.filterwarnings("error::RuntimeWarning")  # without clutter there is a log of zero
def test_prior_of_a_label_and_of_all_others_alike():
    drawn = scans([0, 1, 1], [2, 0, -1], np.ones(3), np.zeros((2, 3)), np.zeros((4, 2)))
    for clutter in (0.0, 0.2):
        prior = np.exp(association.log_prior(drawn, Shares(0.3, clutter)))
        landmarks = np.array([[0.1, 0.1, 0.7, 0.1], [0.7, 0.1, 0.1, 0.1], 4 * [0.25]])
        assert np.allclose(prior[:, :4], (1 - clutter) * landmarks)
        assert np.allclose(prior[:, 4], clutter)


def test_label_probabilities_are_a_label_that_may_mean_several():
    """All for one landmark are its label; what they leave over is for none; alike, no label."""
    rows = [[0, 1, 0], [0.5, 0.3, 0], [1 / 3] * 3]
    given = [0, 0, 0], [-1, -1, -1], np.ones(3), np.zeros((1, 3)), np.zeros((3, 2))
    soft = scans(*given, label_probabilities=np.array(rows))
    prior = np.exp(association.log_prior(soft, Shares(0.4, 0.0)))
    hard = scans(*given[:1], [1, -1, -1], *given[2:])
    assert np.allclose(prior[[0, 2]], np.exp(association.log_prior(hard, Shares(0.4, 0.0)))[:2])
    assert np.allclose(prior[1], [0.6 * 0.5 + 0.2 * 0.3, 0.6 * 0.3 + 0.2 * 0.5, 0.2 * 0.8, 0.2])


def test_one_landmark_leaves_no_label_to_be_wrong():
    drawn = scans([0], [0], [3.0], np.zeros((1, 3)), np.zeros((1, 2)))
    prior = np.exp(association.log_prior(drawn, Shares(0.4, 0.2)))
    assert np.allclose(prior, [[0.8, 0.2]])


PLACES = np.array([[0.0, 0.0, 0.3], [1.0, -1.0, 2.0]]), np.array([[3.0, 4.0], [5.0, 1.0]])


@pytest.mark.parametrize("width", [1.0, 4.0])
def test_responsibilities_are_bayes(width):
    """Prior times a normal density of the distance, whose sigma is `width` of the noise's."""
    drawn = scans([0, 0, 1], [0, 1, 1], [5.2, 5.05, 4.6], *PLACES)
    got = association.responsibilities(drawn, *PLACES, Shares(0.3, 0), width, False)
    poses, landmarks = PLACES
    distances = np.linalg.norm(poses[[0, 0, 1], None, :2] - landmarks, axis=2)
    prior = np.array([[0.7, 0.3], [0.3, 0.7], [0.3, 0.7]])
    joint = prior * stats.norm.pdf(drawn.ranges[:, None], distances, width * 0.1)
    assert np.allclose(got[:, :2], joint / joint.sum(axis=1, keepdims=True), rtol=1e-9)
    assert not got[:, 2].any()


def test_an_absent_landmark_may_be_the_source_of_any_range():
    """Its ranges are uniform up to the longest; two absent ones have their prior together."""
    poses, landmarks = PLACES[0], np.vstack([PLACES[1], np.full((2, 2), np.nan)])
    drawn = scans([0, 1], [0, 2], [5.2, 4.6], poses, landmarks)
    got = association.responsibilities(drawn, poses, landmarks, Shares(0.3, 0), 1.0, False)
    distances = np.linalg.norm(poses[:, None, :2] - landmarks[:2], axis=2)
    prior = np.array([[0.7, 0.1], [0.1, 0.1]])
    joint = np.zeros((2, 5))
    joint[:, :2] = prior * stats.norm.pdf(drawn.ranges[:, None], distances, 0.1)
    joint[:, 4] = np.array([0.2, 0.8]) / 5.2
    assert np.allclose(got, joint / joint.sum(axis=1, keepdims=True), rtol=1e-9)


def test_exclusion_is_by_scan():
    """Each scan as if it were alone, by all matchings; the ranges of another do not compete."""
    drawn = scans([0, 0, 1, 1], [0, 0, 0, 1], [5.0, 5.05, 5.3, 4.4], *PLACES)
    got = association.responsibilities(drawn, *PLACES, Shares(0.4, 0), 2.0, True)
    alone = association.responsibilities(drawn, *PLACES, Shares(0.4, 0), 2.0, False)
    with np.errstate(divide="ignore"):
        expected = [enumerated(np.log(alone[rows])) for rows in (slice(2), slice(2, 4))]
    assert np.allclose(got, np.vstack(expected), atol=1e-12)
    assert not np.allclose(got, alone, atol=0.1)


def test_share_of_wrong_labels_is_the_mean_under_a_beta_prior():
    weights = np.array([[0.9, 0.1, 0.0], [0.3, 0.5, 0.2], [0.0, 1.0, 0.0], [0.2, 0.8, 0.0]])
    drawn = scans([0, 0, 1, 1], [0, 1, 0, -1], np.ones(4), *PLACES)
    # right: 0.9 + 0.5 + 0 of three labels; what is nobody's judges none
    found = association.estimate_shares(drawn, weights, PLACES[1], Shares(0.2, 0.1))
    assert found.wrong == pytest.approx((0.5 + 2.8 - 1.4) / (1 + 2.8))
    assert found.clutter == pytest.approx((0.5 + 0.2) / (10 + 4))
    found = association.estimate_shares(drawn, weights, PLACES[1], Shares(0.2, 0.1), (2, 8))
    assert found.wrong == pytest.approx((2 + 2.8 - 1.4) / (10 + 2.8))
    assert association.estimate_shares(drawn, weights, PLACES[1], Shares(0.2, 0.0)).clutter == 0


def test_none_of_these_is_clutter_and_landmarks_that_are_not_in_the_map():
    """Half of it each, if both were as likely before: here .1 of clutter, .9 x .111 of wrong."""
    landmarks = np.vstack([PLACES[1], np.full((1, 2), np.nan)])
    drawn = scans([0, 1], [0, 2], np.ones(2), PLACES[0], landmarks)
    weights = np.array([[0.6, 0.0, 0.0, 0.4], [0.3, 0.0, 0.0, 0.7]])
    found = association.estimate_shares(drawn, weights, landmarks, Shares(2 / 9, 0.1))
    # the second range: .1 of clutter, .9 x 7 / 9 of its own landmark
    clutter = 0.2 + 0.7 * 0.1 / 0.8
    assert found.clutter == pytest.approx((0.5 + clutter) / 12)
    assert found.wrong == pytest.approx((0.5 + 0.2 + 0.3) / (1 + 2 - clutter))


@pytest.mark.parametrize("clutter", [0.0, 0.15])
def test_shares_are_those_of_data_drawn_with_them(clutter):
    """5000 ranges, sources known: each share within 5 standard errors; fails by chance in 1e-6."""
    rng, n = np.random.default_rng(3), 5000
    nobody = rng.random(n) < clutter
    source = rng.integers(5, size=n)
    label = np.where(rng.random(n) < 0.3, (source + rng.integers(1, 5, n)) % 5, source)
    weights = np.eye(6)[np.where(nobody, 5, source)]
    drawn = scans(np.zeros(n), label, np.ones(n), np.zeros((1, 3)), np.zeros((5, 2)))
    found = association.estimate_shares(drawn, weights, np.zeros((5, 2)), Shares(0.5, clutter))
    assert found.wrong == pytest.approx(0.3, abs=5 * np.sqrt(0.21 / n / (1 - clutter)))
    assert found.clutter == pytest.approx(clutter, abs=5 * np.sqrt(clutter / n) + 1e-12)


@pytest.mark.parametrize("clutter", [0.0, 0.2])
def test_joint_density_integrates_to_one_with_landmarks_absent_or_not(clutter):
    """Over all ranges up to the longest: sources are certain to be one or another."""
    grid, shares, pose = np.linspace(1e-9, 9, 6001), Shares(0.3, clutter), np.zeros((1, 3))
    many = scans(np.zeros(6001), np.full(6001, 2), grid, pose, np.zeros((6, 2)))
    for gone in ([], [1], [2, 5]):
        landmarks = np.column_stack([1.0 + 0.5 * np.arange(6), np.ones(6)])
        landmarks[gone] = np.nan
        found = association.residuals(many, pose, landmarks)
        joint = association.log_joint(many, found, np.full(found.shape, 0.01), shares)
        assert np.isneginf(joint[:, gone]).all()
        total = np.trapezoid(np.exp(joint), grid, axis=0)
        assert total.sum() == pytest.approx(1, abs=1e-6)
        prior = np.exp(association.log_prior(many, shares))[0]
        assert total[-1] == pytest.approx(prior[gone].sum() + clutter, abs=1e-6)


def test_residuals_know_scale_and_offset():
    drawn = scans([0, 1], [0, 1], [5.3, 4.6], *PLACES, scale=(2.0, 0.0), offset=(0.5, 1.0))
    distances = np.linalg.norm(PLACES[0][:, None, :2] - PLACES[1], axis=2)
    plain = drawn.ranges[:, None] - 2 * distances - 0.5
    assert np.allclose(association.residuals(drawn, *PLACES), plain)
    assert np.allclose(association.residuals(drawn, *PLACES, np.array([2.0, 0.7])), plain - 0.2)


def test_a_range_that_fits_no_landmark_is_nobodys():
    """With all landmarks mapped; without clutter in the model it has to be somebody's."""
    drawn = simulation.simulate(scenario.Scenario(), 0.0, rng=np.random.default_rng(0)).first(1)
    drawn = replace(drawn, ranges=np.append(drawn.ranges[:-1], 25.0))
    for exclusive, clutter in itertools.product((True, False), (0.0, 0.01)):
        weights = association.responsibilities(
            drawn.log(C.x0_sigmas), drawn.poses, drawn.landmarks, Shares(0.1, clutter), 1.0,
            exclusive,
        )  # fmt: skip
        assert weights[-1, -1] == pytest.approx(float(clutter > 0))
        assert weights[:-1, -1] == pytest.approx(np.zeros(5), abs=0.01)


def cluttered(seed, share):
    """A world of which some ranges are replaced by ones from nowhere, and which those are."""
    drawn, rng = (
        simulation.simulate(scenario.Scenario(), 0.2, rng=np.random.default_rng(seed)),
        (np.random.default_rng([seed, 1])),
    )
    nobody = rng.random(len(drawn.ranges)) < share
    ranges = np.where(nobody, rng.uniform(0, drawn.ranges.max(), len(nobody)), drawn.ranges)
    return replace(drawn, ranges=ranges), nobody


@pytest.mark.parametrize("exclusive", [False, True])
def test_em_finds_clutter_its_share_and_the_poses(exclusive):
    """Fixed worlds, one range in ten from nowhere; seed 103 ends with a landmark elsewhere."""
    for seed in (100, 101, 102, 104):
        drawn, nobody = cluttered(seed, 0.1)
        found = em.estimate(drawn.log(C.x0_sigmas), C, "grid", exclusive=exclusive, clutter=True)
        oracle, _ = losses.estimate(drawn.keep(~nobody), C, "oracle", "grid")
        assert rmse_and_nees.rmse(found.poses[:, :2], oracle[:, :2]) < 0.06
        assert found.shares.clutter == pytest.approx(nobody.mean(), abs=0.05)
        assert found.weights[~nobody, -1].mean() < 0.1 < 0.5 < found.weights[nobody, -1].mean()


def test_em_without_clutter_in_the_data_finds_next_to_none():
    drawn = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(112))
    given = drawn.log(C.x0_sigmas), C, "grid"
    plain, free = (em.estimate(*given, exclusive=True, clutter=c) for c in (False, True))
    assert 0 < free.shares.clutter < 0.01
    assert np.abs(free.poses - plain.poses)[:, :2].max() < 0.01


@pytest.mark.parametrize("start", ["grid", "first_poses"])
def test_em_starts_where_it_is_told_and_without_clutter_gives_it_nothing(start):
    drawn = simulation.simulate(scenario.Scenario(n_poses=12), 0.4, rng=np.random.default_rng(100))
    given = drawn.log(C.x0_sigmas)
    poses = dead_reckoning.dead_reckoning(given.x0_mean, given.odometry)
    at = poses, landmark_starts.start_landmarks(given, poses, start)
    kinds = {"exclusive": False, "clutter": False}
    found, told = em.estimate(given, C, start, **kinds), em.fit(given, C, at, **kinds)
    assert np.array_equal(found.poses, told.poses)
    assert not found.weights[:, -1].any()


@pytest.mark.parametrize("exclusive", [False, True])
def test_on_clean_data_em_is_the_oracle(exclusive):
    clean = simulation.simulate(scenario.Scenario(), 0.0, rng=np.random.default_rng(101))
    found = em.estimate(clean.log(C.x0_sigmas), C, "grid", exclusive=exclusive, clutter=False)
    poses, landmarks = losses.estimate(clean, C, "oracle", "grid")
    # the posterior of a right label is below one by less than 1e-2 where circles cross
    assert np.abs(found.poses - poses).max() < 2e-3
    assert np.abs(found.landmarks - landmarks).max() < 5e-3
    assert found.shares.wrong < 0.01
    marginals = gtsam.Marginals(*_oracle_graph(clean, poses, landmarks))
    for t in (0, 15, 29):
        rotation = gtsam.Rot2(poses[t, 2]).matrix()
        expected = rotation @ marginals.marginalCovariance(X(t))[:2, :2] @ rotation.T
        assert np.allclose(found.position_covariances[t], expected, rtol=0.05)


def _oracle_graph(clean, poses, landmarks):
    factors = sure_factors(clean, C, landmarks)
    factors.push_back(gtsam_estimates.range_factors(clean, landmarks))
    return factors, solution.values_of(poses, landmarks)


def test_with_wrong_labels_em_stays_near_the_oracle_and_finds_p():
    """Least squares is worse by more than twice on all of these; EM by less than a quarter."""
    for seed in (110, 111, 112):
        wrong = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(seed))
        truth = wrong.poses[:, :2]
        ratio = {}
        oracle = rmse_and_nees.rmse(losses.estimate(wrong, C, "oracle", "grid")[0][:, :2], truth)
        found = em.estimate(wrong.log(C.x0_sigmas), C, "grid", exclusive=True, clutter=False)
        ratio["em"] = rmse_and_nees.rmse(found.poses[:, :2], truth) / oracle
        plain = losses.estimate(wrong, C, "least_squares", "grid")[0]
        ratio["plain"] = rmse_and_nees.rmse(plain[:, :2], truth) / oracle
        assert ratio["em"] < 1.25 < 2 < ratio["plain"]
        drawn_wrong = (wrong.label_of != wrong.source_of).mean()
        # the share drawn is known but for the labels nobody can tell; 180 ranges
        assert found.shares.wrong == pytest.approx(drawn_wrong, abs=0.05)


@pytest.mark.parametrize("exclusive", [False, True])
def test_em_ends_at_a_fixed_point_and_leaves_its_start_alone(exclusive):
    """Weights, shares and estimate follow from one another, at the range noise as it is."""
    drawn = simulation.simulate(
        scenario.Scenario(n_poses=10, n_landmarks=4), 0.2, rng=np.random.default_rng(112)
    )
    start, given = losses.estimate(drawn, C, "oracle", "grid"), drawn.log(C.x0_sigmas)
    kept = start[0].copy(), start[1].copy()
    found = em.fit(given, C, start, exclusive=exclusive, clutter=True, widest=2.0)
    assert all(np.array_equal(ours, before) for ours, before in zip(start, kept, strict=True))
    weights = association.responsibilities(
        given, found.poses, found.landmarks, found.shares, 1.0, exclusive
    )
    assert np.abs(weights - found.weights).max() < 0.01
    again = association.estimate_shares(given, weights, found.landmarks, found.shares)
    assert again == pytest.approx(found.shares, abs=1e-3)
    factors = sure_factors(drawn, C, start[1])
    for m, k in np.argwhere(found.responsibilities > association.NEGLIGIBLE):
        sigma = 0.1 / np.sqrt(found.weights[m, k])
        factors.push_back(range_factor(int(drawn.pose_of[m]), k, drawn.ranges[m], sigma))
    values = solution.values_of(found.poses, found.landmarks)
    best = gtsam_estimates.levenberg_marquardt(factors, values)
    assert np.abs(solution.poses_of(best, 10) - found.poses)[:, :2].max() < 1e-4
    assert np.array_equal(found.responsibilities, found.weights[:, :-1])


def test_em_keeps_to_the_priors_and_steps_of_its_log():
    """A prior on x_0 elsewhere moves the whole estimate by as much; a surveyed landmark stays;
    a step that is hardly known is found all the same."""
    drawn = simulation.simulate(
        scenario.Scenario(n_poses=8, n_landmarks=4), 0.0, rng=np.random.default_rng(101)
    )
    start, given = losses.estimate(drawn, C, "oracle", "grid"), drawn.log(C.x0_sigmas)
    kinds = {"exclusive": False, "clutter": False}
    plain = em.fit(given, C, start, **kinds)
    shift = np.array([0.3, -0.2])
    moved = replace(given, x0_mean=given.x0_mean + np.append(shift, 0.0))
    other = em.fit(moved, C, (start[0], start[1] + shift), **kinds)
    assert np.allclose(other.poses[:, :2] - plain.poses[:, :2], shift, atol=1e-3)
    means, sigmas = np.full((4, 2), np.nan), np.full(4, np.nan)
    means[2], sigmas[2] = start[1][2] + [0.2, 0.1], 1e-4
    surveyed = replace(given, landmark_means=means, landmark_sigmas=sigmas)
    other = em.estimate(surveyed, C, "grid", **kinds)
    assert np.allclose(other.landmarks[2], means[2], atol=1e-3)
    odometry, covariances = given.odometry.copy(), given.odometry_covariances.copy()
    odometry[3, 0] += 2.0
    covariances[3, :2, :2] = 9.0 * np.eye(2)
    slipped = replace(given, odometry=odometry, odometry_covariances=covariances)
    other = em.fit(slipped, C, start, **kinds)
    assert np.abs(other.poses - plain.poses)[:, :2].max() < 0.1  # of a slip of 2 m


def test_em_finds_a_range_offset_with_the_rest():
    drawn = simulation.simulate(scenario.Scenario(), 0.2, rng=np.random.default_rng(101))
    given = replace(
        drawn.log(C.x0_sigmas), ranges=drawn.ranges + 0.2, offset=(0.0, 1.0), scale=(1.0, 0.0)
    )
    found = em.estimate(given, C, "grid", exclusive=True, clutter=False)
    assert found.calibration == pytest.approx([1.0, 0.2], abs=0.03)
    assert (np.linalg.eigvalsh(found.position_covariances) > 0).all()
    known = em.estimate(replace(given, offset=(0.2, 0.0)), C, "grid", exclusive=True, clutter=False)
    assert np.abs(found.poses - known.poses)[:, :2].max() < 0.1


def matrix(blocks):
    """The whole matrix of a chain's blocks."""
    size = 3 * len(blocks[0]) + len(blocks[2]) - 3
    return louis_covariance.times(*blocks, np.eye(size))


def louis(drawn, poses, landmarks, weights, prior_sigma=C.landmark_prior_sigma):
    """Chain and state that Louis' covariance takes, and the weights."""
    chain = chain_problem.of_log(drawn, landmarks, prior_sigma)
    return chain, chain_solver.state_of(chain, poses, landmarks), weights


def test_open_ranges_add_up_in_what_they_withhold():
    """The covariance of the score over two landmarks, range by range, at its poses and landmarks.

    An absent landmark has no rows; a range whose source is certain withholds nothing.
    """
    poses = PLACES[0]
    landmarks = np.array([[3.0, 4.0], [np.nan, np.nan], [5.0, 1.0]])
    drawn = scans([0, 1, 1], [0, 2, 0], [5.2, 4.5, 5.0], poses, landmarks)
    weights = np.array([[0.7, 0.0, 0.3, 0.0], [0.4, 0.0, 0.5, 0.1], [1.0, 0.0, 0.0, 0.0]])
    present = np.array([0, 2])
    got = matrix(louis_covariance._withheld(*louis(drawn, poses, landmarks, weights)))
    assert not got[8:10].any()
    got = np.delete(np.delete(got, [8, 9], axis=0), [8, 9], axis=1)
    expected = np.zeros((10, 10))
    for m in (0, 1):
        t, scores = drawn.pose_of[m], np.zeros((3, 10))  # the last: "none of these" has no score
        for row, k in enumerate(present):
            values = solution.values_of(poses, landmarks)
            factor = range_factor(t, k, drawn.ranges[m], 0.1)
            jacobian, b = factor.linearize(values).jacobian()
            scores[row, 3 * t : 3 * t + 3] = jacobian[0, :3] * b[0]
            scores[row, 6 + 2 * row : 8 + 2 * row] = jacobian[0, 3:] * b[0]
        share = weights[m, [0, 2, 3]]
        mean = share @ scores
        expected += (scores - mean).T @ (share[:, None] * (scores - mean))
    assert np.allclose(got, expected, rtol=1e-9, atol=1e-9)


def test_covariance_without_and_with_open_associations():
    """One pose with a prior, one range to a pinned landmark: without a doubt the inverse of the
    information; in doubt at most nine tenths of it are withheld in any direction."""
    poses, landmarks = np.array([[0.0, 0.0, np.pi / 2]]), np.array([[10.0, 0.0], [0.0, 10.0]])
    drawn = scans([0], [0], [10.0], poses, landmarks, x0_sigmas=[0.5, 1.0, 0.1])

    def covariance(of, weights):
        given = louis(of, poses, landmarks, np.array([weights]), 1e-6)
        return louis_covariance.position_covariances(*given)

    certain = covariance(drawn, [1.0, 0.0, 0.0])
    # the body's y axis points to minus x of the world, where the range is measured
    assert np.allclose(certain[0], np.diag([1 / (1 / 1.0**2 + 1 / 0.1**2), 0.5**2]), rtol=1e-6)
    doubtful = replace(drawn, ranges=np.array([11.0]))
    got, kept = covariance(doubtful, [0.5, 0.5, 0.0]), covariance(drawn, [0.5, 0.5, 0.0])
    assert np.allclose(kept[0], np.diag([1 / (1 + 50), 1 / (4 + 50)]), rtol=1e-6)
    # 1 m off at a sigma of 0.1 m: the score has a variance of 2500 (1, -1) (1, -1)^T
    information = np.diag([51.0, 54.0])
    direction = linalg.eigh(2500 * np.array([[1.0, -1], [-1, 1]]), information)[1]
    closed = direction @ np.diag([1.0, 10.0]) @ direction.T
    assert np.allclose(got[0], closed, rtol=1e-5)


def test_what_the_associations_withhold_is_the_curvature_of_the_mixture():
    """Far landmarks, so that a distance is linear: Louis' information is minus the Hessian of the
    log mixture, here of one range that either of two landmarks may have sent."""
    sigma, poses = 0.1, np.array([[0.0, 0.0, 0.3]])
    landmarks = np.array([[1e5, 0.0], [1e5 * np.cos(1.0), 1e5 * np.sin(1.0)]])
    range_ = 1e5 + 0.1
    drawn = scans([0], [0], [range_], poses, landmarks)
    weights = association.responsibilities(drawn, poses, landmarks, Shares(0.4, 0), 1.0, False)
    missing = matrix(louis_covariance._withheld(*louis(drawn, poses, landmarks, weights)))
    unit = landmarks / 1e5

    def log_mixture(x, y):
        """Of the pose shifted by (x, y) in its own frame."""
        cos, sin = np.cos(0.3), np.sin(0.3)
        shift = np.array([cos * x - sin * y, sin * x + cos * y])
        residual = (range_ - (1e5 - unit @ shift)) / sigma
        return special.logsumexp(np.log([0.6, 0.4]) - 0.5 * residual**2)

    rotation = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    jacobian = -unit @ rotation
    complete = (
        sum(w * np.outer(j, j) for w, j in zip(weights[0], jacobian, strict=False)) / sigma**2
    )
    h = 1e-3
    hessian = np.empty((2, 2))
    for i, j in itertools.product(range(2), repeat=2):
        a, b = h * np.eye(2)[i], h * np.eye(2)[j]
        hessian[i, j] = (
            log_mixture(*(a + b)) - log_mixture(*(a - b))
            - log_mixture(*(b - a)) + log_mixture(*(-a - b))
        ) / (4 * h**2)  # fmt: skip
    assert np.allclose(complete - missing[:2, :2], -hessian, rtol=1e-3, atol=0.05)
    assert np.abs(missing[:2, :2]).max() > 10


def dense(chain, at, weights):
    """Louis' covariances by the eigenvectors of the whole pencil, and its largest shares."""
    complete = matrix(louis_covariance._linearised(chain, at, weights)[:3])
    withheld = matrix(louis_covariance._withheld(chain, at, weights))
    poses = information.poses_of(at.frames)
    shares, directions = linalg.eigh(withheld, complete)
    scaled = directions / np.sqrt(1 - np.clip(shares, 0, louis_covariance.MOST_MISSING))
    blocks = []
    for t, heading in enumerate(poses[:, 2]):
        rotation = gtsam.Rot2(heading).matrix()
        own = scaled[3 * t : 3 * t + 2]
        blocks.append(rotation @ own @ own.T @ rotation.T)
    return np.array(blocks), shares


@pytest.mark.parametrize("few", [0, 250])
@pytest.mark.parametrize(("torn", "above"), [(0, 0), (1, 1), (4, 3), (60, 20)])
def test_louis_covariance_by_blocks_is_that_of_the_whole_pencil(torn, above, few, monkeypatch):
    """Some ranges made to be torn between their landmark and one that is 0.6 m off: what they
    withhold exceeds what there is in a few directions, or in many."""
    drawn = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))
    weights = association.responsibilities(
        drawn.log(C.x0_sigmas), drawn.poses, drawn.landmarks, Shares(0.3, 0), 1.0, True
    )
    ranges = drawn.ranges.copy()
    for m in 3 * np.arange(torn):
        source = drawn.source_of[m]
        ranges[m] += 0.6
        weights[m] = 0.0
        weights[m, [source, (source + 1) % 6]] = 0.7, 0.3
    moved = replace(drawn.log(C.x0_sigmas), ranges=ranges)
    given = louis(moved, drawn.poses, drawn.landmarks, weights)
    monkeypatch.setattr(louis_covariance, "FEW", few)
    expected, shares = dense(*given)
    assert np.sum(shares > louis_covariance.MOST_MISSING) >= above
    got = louis_covariance.position_covariances(*given)
    assert np.allclose(got, expected, rtol=1e-9, atol=1e-9 * expected.max())


def test_of_an_estimate_that_is_lost_louis_covariance_is_a_bound_in_linear_time(monkeypatch):
    """No less than by all directions."""
    drawn = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))
    at = drawn.poses + np.random.default_rng(0).normal(size=(30, 3)), drawn.landmarks
    weights = np.random.default_rng(1).dirichlet(np.ones(7), len(drawn.ranges))
    given = louis(drawn.log(C.x0_sigmas), *at, weights)
    expected, shares = dense(*given)
    assert np.sum(shares > louis_covariance.MOST_MISSING) > 20
    monkeypatch.setattr(louis_covariance, "FEW", 0)
    monkeypatch.setattr(louis_covariance, "MANY", 20)
    got = louis_covariance.position_covariances(*given)
    assert np.linalg.eigvalsh(got - expected).min() > -1e-9 * expected.max()
    assert np.trace(got, axis1=1, axis2=2).sum() < 10 * np.trace(expected, axis1=1, axis2=2).sum()


def test_louis_information_is_that_of_gtsams_weighted_graph():
    """Where headings err by more than the 1e-3 rad below which GTSAM's derivative loses digits."""
    drawn = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))
    rng = np.random.default_rng(0)
    at = drawn.poses + rng.normal(size=(30, 3)) * [0.0, 0.0, 0.3], drawn.landmarks
    weights = rng.dirichlet(np.ones(7), len(drawn.ranges))
    factors = sure_factors(drawn, C, drawn.landmarks)
    for m, k in np.argwhere(weights[:, :-1] > association.NEGLIGIBLE):
        sigma = 0.1 / np.sqrt(weights[m, k])
        factors.push_back(range_factor(int(drawn.pose_of[m]), k, drawn.ranges[m], sigma))
    ordering = gtsam.Ordering()
    for key in [*(X(t) for t in range(30)), *(L(k) for k in range(6))]:
        ordering.push_back(key)
    expected, _ = factors.linearize(solution.values_of(*at)).hessian(ordering)
    system = louis_covariance._linearised(*louis(drawn.log(C.x0_sigmas), *at, weights))
    got = matrix(system[:3])
    assert np.allclose(got, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_louis_covariance_needs_no_matrix_of_all_variables():
    """Four times the poses, four times the memory; the whole matrix would be sixteen times."""
    peaks = []
    for n_poses in (200, 800):
        drawn = simulation.simulate(
            scenario.Scenario(n_poses=n_poses, n_landmarks=2), 0.2, rng=np.random.default_rng(1)
        )
        given, at = drawn.log(C.x0_sigmas), (drawn.poses, drawn.landmarks)
        weights = association.responsibilities(given, *at, Shares(0.2, 0), 1.0, True)
        given = louis(given, *at, weights)
        tracemalloc.start()
        louis_covariance.position_covariances(*given)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 5 * peaks[0]


def test_em_starts_with_one_range_in_twenty_from_nowhere_and_needs_no_range(monkeypatch):
    clean = simulation.simulate(scenario.Scenario(n_poses=6), 0.0, rng=np.random.default_rng(1))
    log, started = clean.log(C.x0_sigmas), []
    alternate = em._alternate

    def recorded(*args):
        started.append(args[3])
        return alternate(*args)

    monkeypatch.setattr(em, "_alternate", recorded)
    start, kinds = (clean.poses, clean.landmarks), {"exclusive": True}
    for clutter in (True, False):
        em.fit(log, C, start, clutter=clutter, **kinds)
    assert started == [pytest.approx(1 / 20), 0.0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        none = em.fit(log.keep(np.zeros(len(log.ranges), bool)), C, start, clutter=True, **kinds)
    assert none.weights.shape == (0, clean.n_landmarks + 1)
