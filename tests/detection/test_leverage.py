"""The chi-square of a window's ranges against a dense linear problem, and its law."""

import tracemalloc
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from scipy import special, stats

from sngr_utils.detection import leverage
from sngr_utils.slam import conventions, isam2, selected_inverse
from sngr_utils.sngr import windows
from sngr_utils.world import dead_reckoning, scenario, simulation

C = conventions.PRESETS["C"]


@pytest.fixture(scope="module")
def solved():
    """A world with an uneven number of ranges per pose, and its iSAM2 run."""
    drawn = simulation.simulate(scenario.Scenario(n_poses=12), 0.0, rng=np.random.default_rng(100))
    kept = np.random.default_rng(0).random(len(drawn.ranges)) < 0.7
    drawn = drawn.keep(kept)
    return drawn, isam2.run_isam2(drawn, C)


def dense(the_world, solution):
    """Whitened Jacobian of all factors, and the row of each range in the order of the world."""
    ordering = gtsam.Ordering()
    for key in [*map(X, range(the_world.n_poses)), *map(L, range(the_world.n_landmarks))]:
        ordering.push_back(key)
    factors = solution.graph
    jacobian, _ = factors.linearize(solution.estimate).jacobian(ordering)
    rows, start = {}, 0
    for i in range(factors.size()):
        factor = factors.at(i)
        if isinstance(factor, gtsam.RangeFactor2D):
            rows[tuple(factor.keys())] = start
        start += factor.dim()
    pairs = zip(the_world.pose_of, the_world.label_of, strict=True)
    return jacobian, np.array([rows[X(int(t)), L(int(k))] for t, k in pairs])


def chi_square_of(the_world, solution):
    covariance = selected_inverse.covariance(solution, the_world, C)
    return leverage.chi_square(the_world, solution.poses, solution.landmarks, covariance)


def test_statistic_is_that_of_the_dense_problem(solved):
    the_world, solution = solved
    jacobian, rows = dense(the_world, solution)
    hat = jacobian @ np.linalg.solve(jacobian.T @ jacobian, jacobian.T)
    offset = solution.landmarks[the_world.label_of] - solution.poses[the_world.pose_of, :2]
    residuals = (the_world.ranges - np.linalg.norm(offset, axis=1)) / 0.1
    got = chi_square_of(the_world, solution)
    for t in range(windows.n_windows(the_world.n_poses)):
        mine = (the_world.pose_of >= t) & (the_world.pose_of < t + 3)
        left = np.eye(mine.sum()) - hat[np.ix_(rows[mine], rows[mine])]
        expected = residuals[mine] @ np.linalg.pinv(left, rcond=1e-3) @ residuals[mine]
        assert got.statistic[t] == pytest.approx(expected, rel=1e-6)
        assert got.squares[t] == pytest.approx(np.sum(residuals[mine] ** 2), rel=1e-9)
        assert got.count[t] == mine.sum()
        assert got.rank[t] == np.linalg.matrix_rank(left, tol=1e-3)


def test_p_values_are_uniform_on_linear_problems(solved):
    """Kolmogorov-Smirnov over 2000 draws: fails by chance once in 1e4 runs.

    Without the leverage the same residuals look too small, and it finds that.
    """
    jacobian, rows = dense(*solved)
    mine = rows[(solved[0].pose_of >= 5) & (solved[0].pose_of < 8)]
    hat = jacobian @ np.linalg.solve(jacobian.T @ jacobian, jacobian.T)
    noise = np.random.default_rng(1).normal(size=(2000, len(hat)))
    residuals = (noise - noise @ hat)[:, mine]
    left = np.eye(len(mine)) - hat[np.ix_(mine, mine)]
    q, rank = leverage.quadratic_form(residuals, np.broadcast_to(left, (2000, *left.shape)))
    assert stats.kstest(stats.chi2.sf(q, rank), "uniform").pvalue > 1e-4
    plain = stats.chi2.sf(np.sum(residuals**2, axis=1), len(mine))
    assert stats.kstest(plain, "uniform").pvalue < 1e-6


def test_the_law_holds_for_isam2_on_clean_worlds():
    """Mean of q over its rank, one window of each of 60 worlds: five standard errors of
    sqrt(2 / (18 * 60)), exceeded once in 2e6 runs if the law were exact.
    """
    ratios = []
    for seed in range(200, 260):
        the_world = simulation.simulate(scenario.Scenario(), 0.0, rng=np.random.default_rng(seed))
        test = chi_square_of(the_world, isam2.run_isam2(the_world, C))
        ratios.append(test.statistic[14] / test.rank[14])
    assert np.mean(ratios) == pytest.approx(1, abs=5 * np.sqrt(2 / (18 * 60)))


def test_one_wrong_label_is_seen(solved):
    the_world, solution = solved
    labels = the_world.label_of.copy()
    m = int(np.flatnonzero(the_world.pose_of == 6)[0])
    labels[m] = (labels[m] + 1) % the_world.n_landmarks
    hit = replace(the_world, label_of=labels)
    landmarks, poses = solution.landmarks, solution.poses
    covariance = selected_inverse.covariance_at(poses, landmarks, hit, C)
    test = leverage.chi_square(hit, poses, landmarks, covariance)
    inside = np.arange(4, 7)
    assert (test.surprise[inside] > 3).all()
    assert (np.delete(test.surprise, inside) < 3).all()


def test_an_absent_landmark_takes_its_ranges_along(solved):
    the_world, solution = solved
    landmarks = solution.landmarks.copy()
    landmarks[2] = np.nan
    absent = leverage.chi_square(
        the_world, solution.poses, landmarks,
        selected_inverse.covariance_at(solution.poses, landmarks, the_world, C),
    )  # fmt: skip
    others = the_world.keep(the_world.label_of != 2)
    without = leverage.chi_square(
        others, solution.poses, landmarks,
        selected_inverse.covariance_at(solution.poses, landmarks, others, C),
    )  # fmt: skip
    assert np.allclose(absent.statistic, without.statistic, rtol=1e-9)
    assert np.array_equal(absent.rank, without.rank)
    zero = np.zeros(2, dtype=int)
    nothing = leverage.ChiSquare(np.zeros(2), zero, np.zeros(2), zero)
    assert np.array_equal(nothing.surprise, [0, 0])


def test_a_direction_without_freedom_is_left_out():
    """Two ranges whose difference the fit takes up whole: only their sum is tested."""
    along, across = np.array([1.0, 1.0]) / np.sqrt(2), np.array([1.0, -1.0]) / np.sqrt(2)
    covariance = 0.5 * np.outer(along, along)
    residuals = 2 * along + 0.3 * across
    statistic, rank = leverage.quadratic_form(residuals[None], covariance[None])
    assert statistic[0] == pytest.approx(4 / 0.5)
    assert rank[0] == 1


@pytest.mark.parametrize("rank", [2, 12, 18, 30])
def test_tail_is_exact_far_out(rank):
    """For an even rank the tail is a finite sum: e^-x sum x^k / k!."""
    for statistic in (5.0, 100.0, 1190.0, 1210.0, 3e4, 1e6):
        x, k = statistic / 2, np.arange(rank // 2)
        expected = special.logsumexp(k * np.log(x) - special.gammaln(k + 1)) - x
        got = leverage.log_tail(np.array([statistic]), np.array([rank]))[0]
        assert got == pytest.approx(expected, rel=1e-6)


def test_windows_a_few_at_a_time_are_the_same(solved, monkeypatch):
    once = chi_square_of(*solved)
    monkeypatch.setattr(leverage, "AT_ONCE", 3)
    parts = chi_square_of(*solved)
    assert np.allclose(once.statistic, parts.statistic, rtol=1e-12)
    assert np.array_equal(once.rank, parts.rank)
    assert np.array_equal(once.count, parts.count)


def test_landmarks_that_a_window_does_not_see_cost_it_nothing():
    """150 landmarks, three of them in reach of a pose: no block of all for every window."""
    n_poses, n_landmarks, rng = 300, 150, np.random.default_rng(0)
    poses = np.column_stack([np.arange(n_poses), np.zeros(n_poses), np.zeros(n_poses)])
    landmarks = np.column_stack([2.0 * np.arange(n_landmarks), rng.uniform(1, 4, n_landmarks)])
    distances = np.linalg.norm(poses[:, None, :2] - landmarks, axis=2)
    pose_of, label_of = np.nonzero(distances < 4)
    drawn = simulation.World(
        poses, landmarks, dead_reckoning.relative_motion(poses), pose_of, label_of, label_of,
        distances[pose_of, label_of], scenario.Scenario(), poses[0],
    )  # fmt: skip
    covariance = selected_inverse.covariance_at(poses, landmarks, drawn, C)
    tracemalloc.start()
    leverage.chi_square(drawn, poses, landmarks, covariance)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.02 * 8 * n_poses * (9 + 2 * n_landmarks) ** 2


def test_surprise_is_the_tail_of_the_right_law():
    """Of q with its rank, and of the plain sum with the number of ranges; 0 without a degree."""
    test = leverage.ChiSquare(
        np.array([12.0, 3.0, 0.0]), np.array([4, 2, 0]),
        np.array([15.0, 5.0, 0.0]), np.array([6, 3, 0]),
    )  # fmt: skip
    ours, naive = stats.chi2.sf([12.0, 3.0], [4, 2]), stats.chi2.sf([15.0, 5.0], [6, 3])
    assert test.surprise == pytest.approx([*-np.log10(ours), 0])
    assert test.naive_surprise == pytest.approx([*-np.log10(naive), 0])


@pytest.mark.parametrize("rank", [1, 3, 7])
def test_tail_is_smooth_where_its_series_takes_over(rank):
    """For an odd rank, Mills' ratio: one degree far out is the tail of a normal law twice."""
    statistic = np.linspace(1180, 1240, 61)
    tail = leverage.log_tail(statistic, np.full(61, rank))
    assert np.diff(tail, 2) == pytest.approx(np.zeros(59), abs=1e-5)
    if rank == 1:
        expected = np.log(2) + special.log_ndtr(-np.sqrt(statistic))
        assert tail == pytest.approx(expected, rel=1e-9)
        far = leverage.log_tail(np.array([1e6]), np.array([1]))[0]
        assert far == pytest.approx(np.log(2) + special.log_ndtr(-1e3), rel=1e-9)


def test_directions_count_from_a_thousandth_of_a_unit_variance_on():
    covariances = np.array([np.diag([1.0, 1.1e-3]), np.diag([1.0, 0.9e-3])])
    statistic, rank = leverage.quadratic_form(np.full((2, 2), 2.0), covariances)
    assert rank.tolist() == [2, 1]
    assert statistic == pytest.approx([4 + 4 / 1.1e-3, 4])
