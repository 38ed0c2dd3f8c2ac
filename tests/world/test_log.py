"""What an estimator may know, checked at the door."""

import numpy as np
import pytest

from sngr_utils.world.log import Log, LogWarning
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate

GOOD = {
    "odometry": [[1, 0, 0], [1, 0, 0.1]],
    "odometry_covariances": np.diag([0.01, 0.01, 1e-4]),
    "pose_of": [0, 1, 2, 2],
    "ranges": [1.0, 2.0, 3.0, 4.0],
    "range_sigmas": 0.1,
    "label_of": [0, 1, -1, 0],
    "n_landmarks": 2,
    "x0_mean": [0, 0, 0],
    "x0_sigmas": [0.1, 0.1, 0.05],
}


def with_row(name, row, value):
    """The good field as an array with one row replaced."""
    array = np.array(getattr(Log(**GOOD), name), dtype=float)
    array[row] = value
    return {name: array}


def test_lists_serve_as_arrays_and_one_sigma_serves_all():
    log = Log(**GOOD)
    assert log.n_poses == 3
    assert log.odometry.shape == (2, 3)
    assert log.odometry_covariances.shape == (2, 3, 3)
    assert log.range_sigmas.tolist() == [0.1] * 4
    assert log.times.tolist() == [0, 1, 2]
    assert log.pose_of.dtype == np.int64


BAD = [
    (with_row("ranges", 2, np.nan), r"ranges\[2\]"),
    (with_row("ranges", 1, 0.0), r"ranges\[1\]"),
    (with_row("ranges", 3, -2.0), r"ranges\[3\]"),
    (with_row("ranges", 3, -0.51), r"ranges\[3\]"),
    (with_row("ranges", 3, np.inf), r"ranges\[3\]"),
    (with_row("range_sigmas", 1, 0.0), r"range_sigmas\[1\]"),
    (with_row("odometry", 1, np.inf), r"odometry\[1\]"),
    (with_row("odometry_covariances", 1, -np.eye(3)), r"odometry_covariances\[1\]"),
    (with_row("odometry_covariances", 0, np.eye(3) + np.eye(3, k=1)), r"covariances\[0\]"),
    (with_row("pose_of", 3, 3), r"pose_of\[3\]"),
    (with_row("pose_of", 0, -1), r"pose_of\[0\]"),
    (with_row("label_of", 2, 2), r"label_of\[2\]"),
    (with_row("label_of", 2, 0.5), r"label_of\[2\]"),
    (with_row("label_of", 1, -2), r"label_of\[1\]"),
    ({"pose_of": [0, 1]}, "pose_of has shape"),
    ({"label_of": 0}, "label_of has shape"),
    ({"odometry": [[1, 0], [1, 0]]}, "odometry has shape"),
    ({"odometry_covariances": np.ones((3, 3, 3))}, "odometry_covariances has shape"),
    ({"x0_mean": [0.0, 0.0]}, "x0_mean has shape"),
    ({"landmark_means": np.zeros((2, 2)), "landmark_sigmas": -1.0}, r"landmark_means\[0\]"),
    ({"odometry": [[1, 0, 0], [1, 0]]}, "odometry must hold numbers"),
    ({"ranges": [1, 1, "a", 1]}, r"ranges\[2\] is 'a'"),
    ({"ranges": 1.0}, "ranges is 1.0"),
    ({"n_landmarks": 1}, r"label_of\[1\]"),
    ({"n_landmarks": 2.5}, "n_landmarks"),
    ({"n_landmarks": -1}, "n_landmarks"),
    ({"x0_sigmas": [0.1, 0.1, 0.0]}, r"x0_sigmas\[2\]"),
    ({"times": [0, 2, 1]}, r"times\[2\]"),
    ({"times": 5.0}, "times has shape"),
    ({"odometry": [1, 0, 0], "pose_of": [0, 0, 0, 0]}, "odometry has shape"),
    ({"x0_mean": 0.0}, "x0_mean has shape"),
    ({"x0_sigmas": 0.1}, "x0_sigmas has shape"),
    ({"label_probabilities": [0.5, 0.5]}, "label_probabilities has shape"),
    ({"landmark_means": [1, 2], "landmark_sigmas": [1, 1]}, "landmark_means has shape"),
    ({"odometry_covariances": 0.01}, r"it must be \(2, 3, 3\), or \(3, 3\) for all"),
    ({"label_probabilities": np.full((4, 2), 0.6)}, r"label_probabilities\[0\]"),
    ({"landmark_means": np.zeros((2, 2))}, "landmark_means and landmark_sigmas"),
    ({"landmark_means": np.zeros((2, 2)), "landmark_sigmas": [1, np.nan]}, r"landmark_means\[1\]"),
    ({"scale": (0.0, 0.1)}, "scale"),
    ({"offset": (0.0, -0.1)}, "offset"),
    ({"offset": 1.0}, "offset"),
    ({"scale": (1.0, np.nan)}, "scale"),
    ({"scale": (1e-200, 0.1)}, "scale"),
    ({"offset": (1e200, np.inf)}, "offset"),
    ({"scale": "ab"}, "scale is 'ab'"),
    ({"n_landmarks": 0, "label_of": [-1] * 4}, "n_landmarks is 0, and ranges has 4 rows"),
    ({"n_landmarks": 10**5000}, "n_landmarks is an integer of too many digits"),
    ({"n_landmarks": 10**9}, "n_landmarks is 1000000000"),
    ({"n_landmarks": True}, "n_landmarks is True"),
    ({"n_landmarks": np.array(2)}, "n_landmarks is array"),
    (with_row("ranges", 1, 1e200), r"ranges\[1\]"),
    (with_row("range_sigmas", 1, 1e-200), r"range_sigmas\[1\]"),
    (with_row("odometry", 1, -1e200), r"odometry\[1\]"),
    (with_row("odometry_covariances", 1, np.eye(3) * 1e200), r"odometry_covariances\[1\]"),
    (with_row("odometry_covariances", 1, np.eye(3) * 1e-200), r"odometry_covariances\[1\]"),
    ({"row_of": [0, 1, 2, 1e19]}, r"row_of\[3\]"),
    ({"ranges": [1, 1, 10**400, 1]}, r"ranges\[2\] is 1000"),
    ({"ranges": [1, 1, 1, 10**5000]}, r"ranges\[3\] is an integer of too many digits"),
    ({"ranges": [1, 2j, 1, 1]}, r"ranges\[1\] is 2j"),
    ({"ranges": np.array([1, 2, 3, 4], complex)}, r"ranges\[0\] is .*1\+0j"),
    ({"ranges": [True, False] * 2}, r"ranges\[0\] is True"),
    ({"label_of": np.array([True] * 4)}, r"label_of\[0\] is .*True"),
    ({"ranges": ["1", "2", "3", "4"]}, r"ranges\[0\] is '1'"),
    ({"ranges": "1234"}, "ranges is '1234'"),
    ({"ranges": [1, None, 1, 1]}, r"ranges\[1\] is None"),
    ({"ranges": np.array([1, 2, {}, 4], object)}, r"ranges\[2\] is {}"),
    ({"ranges": [1, 1, np.datetime64("NaT"), 1]}, r"ranges\[2\] is .*NaT"),
    ({"ranges": np.array([1, 2, 3, 4], "m8[s]")}, r"ranges\[0\] is"),
    ({"times": np.array(["2020-01-01"] * 3, "M8[ns]")}, r"times\[0\] is"),
    ({"ranges": np.zeros(4, [("a", float)])}, r"ranges\[0\] is"),
    ({"ranges": np.ma.masked_equal([1, 2, 3, 4], 3)}, r"ranges\[2\] is masked"),
    ({"ranges": (x for x in range(4))}, "ranges is <generator"),
    ({"ranges": {1: 2}}, "ranges is {1: 2}"),
    ({"ranges": np.ones((4, 1))}, "ranges has shape"),
    ({"odometry": 3.0}, "odometry is 3.0"),
    ({"odometry": np.ones((2, 3, 1))}, "odometry has shape"),
    ({"range_sigmas": []}, "range_sigmas has shape"),
    ({"range_sigmas": np.float64("nan")}, r"range_sigmas\[0\]"),
    ({"landmark_means": np.full((2, 2), 1e200), "landmark_sigmas": 1.0}, r"landmark_means\[0\]"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "named"), BAD, ids=[named for _, named in BAD])
def test_what_must_be_refused_is_refused_by_field_and_row(changes, named):
    with pytest.raises(ValueError, match=named) as error:
        Log(**{**GOOD, **changes})
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    "ranges",
    [
        np.array([1, 2, 3, 4], object),
        np.ma.array([1, 2, 3, 4]),
        np.array([1, 2, 3, 4], np.float16),
        np.array([1, 2, 3, 4], np.uint8),
        (1, np.int8(2), np.longdouble(3), 4),
    ],
)
def test_whatever_holds_real_numbers_serves(ranges):
    assert Log(**{**GOOD, "ranges": ranges}).ranges.tolist() == [1, 2, 3, 4]


def test_a_covariance_is_judged_by_its_correlations_and_made_symmetric():
    """Metres beside radians: its eigenvalues are 16 decimals apart, and it can be inverted."""
    wide = np.diag([1e6, 1e6, 1e-14])
    wide[0, 2] = wide[2, 0] = 0.5e-4
    wide[0, 2] *= 1 + 1e-10
    found = Log(**{**GOOD, "odometry_covariances": wide}).odometry_covariances
    assert np.array_equal(found, found.swapaxes(1, 2))
    np.testing.assert_allclose(found, np.tile(wide, (2, 1, 1)), rtol=1e-9)


def test_scale_and_offset_are_pairs_of_floats_whatever_they_came_in():
    log = Log(**{**GOOD, "scale": [1, 0], "offset": np.array([0, np.inf])})
    assert (log.scale, log.offset) == ((1.0, 0.0), (0.0, np.inf))


def test_noise_may_take_a_short_range_below_zero():
    """By five sigmas at most; of a simulated one (seed 115) a log has the size."""
    assert Log(**{**GOOD, **with_row("ranges", 3, -0.49)}).ranges[3] == -0.49
    drawn = simulate(Scenario(), 0.0, rng=np.random.default_rng(115))
    assert drawn.ranges.min() < 0
    assert drawn.log([0.1, 0.1, 0.05]).ranges.min() == drawn.ranges.min()


def test_unsorted_ranges_are_sorted_by_pose_and_know_their_row():
    log = Log(**{**GOOD, "pose_of": [2, 0, 1, 0], "label_of": [0, 1, 0, 1]})
    assert log.pose_of.tolist() == [0, 0, 1, 2]
    assert log.row_of.tolist() == [1, 3, 2, 0]
    assert log.ranges.tolist() == [2, 4, 3, 1]
    assert log.label_of.tolist() == [1, 1, 0, 0]


def test_a_landmark_without_a_range_is_a_warning():
    with pytest.warns(LogWarning, match=r"landmarks \[2\] have no range"):
        Log(**{**GOOD, "n_landmarks": 3})
    with pytest.warns(LogWarning, match=r"10, 11\] and 999988 others have no range"):
        Log(**{**GOOD, "n_landmarks": 10**6})


def test_one_pose_no_ranges_and_no_landmark_is_a_log():
    log = Log(**{
        **GOOD,
        "odometry": [],
        "pose_of": [],
        "ranges": [],
        "label_of": [],
        "n_landmarks": 0,
    })
    assert log.n_poses == 1
    assert log.odometry.shape == (0, 3)
    assert len(log.ranges) == 0


def test_parts_of_a_log():
    world = simulate(Scenario(n_poses=10), 0.3, rng=np.random.default_rng(100))
    log, part = world.log([0.1, 0.1, 0.05]), world.first(4)
    assert np.array_equal(log.first(4).ranges, part.ranges)
    assert np.array_equal(log.first(4).odometry, part.odometry)
    assert len(log.first(4).times) == 4
    marked = world.label_of == 2
    assert np.array_equal(log.keep(marked).ranges, world.ranges[marked])
    assert np.array_equal(log.keep(marked).row_of, np.flatnonzero(marked))
