import dataclasses

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from sngr_utils.slam import isam2, selected_inverse
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.slam.factors import landmark_prior, odometry_factor, pose_prior, range_factor
from sngr_utils.slam.marginals import gtsam_marginals, joint_covariance
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import windows
from sngr_utils.world import dead_reckoning, simulation
from sngr_utils.world.scenario import Scenario

TOLERANCE = 1e-9  # of the largest entry of the block compared


def simulated(n_poses, n_landmarks, p, seed):
    scenario = Scenario(n_poses=n_poses, n_landmarks=n_landmarks)
    return simulation.simulate(scenario, p, rng=np.random.default_rng(seed))


def solution_at(the_world, conventions, poses, landmarks):
    """The world's graph and any linearisation point; iSAM2 is left out. NaN: absent."""
    factors, values, w = gtsam.NonlinearFactorGraph(), gtsam.Values(), the_world
    factors.push_back(pose_prior(w.x0_mean, conventions.x0_sigmas))
    for t, pose in enumerate(poses):
        values.insert(X(t), gtsam.Pose2(*pose))
    for t, motion in enumerate(w.odometry):
        factors.push_back(odometry_factor(t, motion, w.scenario))
    for k, landmark in enumerate(landmarks):
        if np.isfinite(landmark[0]):
            values.insert(L(k), landmark)
            factors.push_back(landmark_prior(k, landmark, conventions.landmark_prior_sigma))
    for t, k, distance in zip(w.pose_of, w.label_of, w.ranges, strict=True):
        if np.isfinite(landmarks[k, 0]):
            factors.push_back(range_factor(t, k, distance, w.scenario.range_sigma))
    return Solution(None, factors, values, w.n_poses, w.n_landmarks)


def relative(got, expected):
    """Largest difference, of the largest entry of its block."""
    axes = (-2, -1)
    return np.max(np.abs(got - expected).max(axes) / np.abs(expected).max(axes))


def assert_equals_gtsam(solution, the_world, conventions, sample=None):
    """Windows, the landmarks' joint covariance, and the cross covariances, against GTSAM."""
    got = selected_inverse.covariance(solution, the_world, conventions)
    marginals = gtsam_marginals(solution)
    sample = range(len(got.windows)) if sample is None else sample
    expected = [joint_covariance(marginals, windows.window_keys(t)) for t in sample]
    assert relative(got.windows[sample], np.array(expected)) < TOLERANCE
    present = [k for k in range(solution.n_landmarks) if solution.estimate.exists(L(k))]
    columns = [2 * k + i for k in present for i in range(2)]
    absent = np.setdiff1d(np.arange(2 * solution.n_landmarks), columns)
    assert np.isnan(got.landmarks[absent]).all()
    assert np.isnan(got.landmarks[:, absent]).all()
    assert np.isnan(got.pose_landmark[:, :, absent]).all()
    if not present:
        return
    for t in sample[::7]:
        joint = joint_covariance(marginals, [X(t), *(L(k) for k in present)])
        assert relative(got.landmarks[np.ix_(columns, columns)], joint[3:, 3:]) < TOLERANCE
        mixed = np.block([
            [got.poses[t], got.pose_landmark[t][:, columns]],
            [got.pose_landmark[t][:, columns].T, joint[3:, 3:]],
        ])
        assert relative(mixed, joint) < TOLERANCE


@pytest.mark.parametrize("preset", ["A", "B", "C"])
@pytest.mark.parametrize(
    ("n_poses", "n_landmarks", "p"), [(3, 2, 0.0), (4, 6, 0.4), (12, 3, 0.2), (30, 6, 0.3)]
)
def test_equals_gtsam_at_the_estimate_of_isam2(preset, n_poses, n_landmarks, p):
    drawn, settings = simulated(n_poses, n_landmarks, p, n_poses), PRESETS[preset]
    assert_equals_gtsam(isam2.run_isam2(drawn, settings), drawn, settings)


@pytest.mark.parametrize("preset", ["A", "B", "C"])
@pytest.mark.parametrize("seed", range(5))
def test_equals_gtsam_far_from_any_estimate(preset, seed):
    """Residuals of metres and radians: GTSAM's Jacobians depend on them."""
    rng, drawn = np.random.default_rng([seed, 1]), simulated(15, 4, 0.3, seed)
    poses = np.column_stack([rng.normal(0, 5, (15, 2)), rng.uniform(-np.pi, np.pi, 15)])
    solution = solution_at(drawn, PRESETS[preset], poses, rng.normal(0, 5, (4, 2)))
    assert_equals_gtsam(solution, drawn, PRESETS[preset])


@pytest.mark.parametrize("spread", [0.0, 1e-12, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_equals_gtsam_where_its_logarithm_cancels(spread):
    """Residual headings of every size about zero, so on both sides of GTSAM's branches.

    Between 1e-5 and 1e-3 the last place of a heading moves GTSAM's answer by up to 1e-7, so less
    cannot be asked; a derivative without the cancellation would be off by 1e-5 there.
    """
    rng, drawn = np.random.default_rng(7), simulated(20, 3, 0.0, 3)
    poses = dead_reckoning.dead_reckoning(drawn.x0_mean, drawn.odometry)
    poses += rng.normal(size=poses.shape) * [0.05, 0.05, spread]
    solution = solution_at(drawn, PRESETS["A"], poses, drawn.landmarks)
    got = selected_inverse.window_covariances(solution, drawn, PRESETS["A"])
    assert relative(got, windows.covariances(solution)) < (
        1e-6 if 1e-6 < spread < 1e-2 else TOLERANCE
    )


def test_equals_gtsam_across_the_cut_of_the_angle():
    """Headings within 1e-3 rad of +-pi, on alternate sides, and residual headings near +-pi."""
    rng, drawn = np.random.default_rng(0), simulated(16, 3, 0.2, 1)
    poses = drawn.poses.copy()
    sides = np.where(np.arange(16) % 2, 1, -1)
    poses[:, 2] = sides * (np.pi - rng.exponential(1e-3, 16))
    for turn in (0.0, np.pi):
        odometry = dead_reckoning.relative_motion(poses) + np.array([0.0, 0.0, turn])
        twisted = dataclasses.replace(drawn, odometry=odometry + rng.normal(0, 1e-3, (15, 3)))
        solution = solution_at(twisted, PRESETS["B"], poses, drawn.landmarks)
        assert_equals_gtsam(solution, twisted, PRESETS["B"])


def test_landmarks_that_never_entered_have_no_covariance():
    drawn = simulated(10, 5, 0.2, 0)
    kept = ~np.isin(drawn.label_of, [1, 4]) | (drawn.pose_of < 2)
    fewer = dataclasses.replace(
        drawn,
        **{
            name: getattr(drawn, name)[kept]
            for name in ("pose_of", "label_of", "source_of", "ranges")
        },
    )
    solution = isam2.run_isam2(fewer, PRESETS["B"])
    assert np.isnan(solution.landmarks[[1, 4]]).all()
    assert_equals_gtsam(solution, fewer, PRESETS["B"])


def test_no_landmark_in_the_graph_leaves_the_odometry():
    drawn = simulated(6, 2, 0.0, 0)
    solution = solution_at(drawn, PRESETS["A"], drawn.poses, np.full((2, 2), np.nan))
    assert_equals_gtsam(solution, drawn, PRESETS["A"])


def test_poses_without_ranges_and_ranges_in_any_order():
    drawn, rng = simulated(20, 4, 0.3, 5), np.random.default_rng(5)
    kept = rng.permutation(np.flatnonzero(drawn.pose_of % 3 == 1))
    fewer = dataclasses.replace(
        drawn,
        **{
            name: getattr(drawn, name)[kept]
            for name in ("pose_of", "label_of", "source_of", "ranges")
        },
    )
    solution = solution_at(fewer, PRESETS["C"], drawn.poses, drawn.landmarks)
    assert_equals_gtsam(solution, fewer, PRESETS["C"])


@pytest.mark.parametrize("distance", [0.0, 1e-12, 0.9e-10, 1.1e-10, 1e-6])
def test_a_pose_on_a_landmark_is_taken_as_gtsam_takes_it(distance):
    drawn = simulated(8, 3, 0.0, 2)
    landmarks = drawn.landmarks.copy()
    poses = drawn.poses.copy()
    poses[4, :2] = 0.0
    landmarks[1] = [0.0, distance]
    solution = solution_at(drawn, PRESETS["B"], poses, landmarks)
    assert_equals_gtsam(solution, drawn, PRESETS["B"])


@pytest.mark.parametrize("preset", ["A", "B", "C"])
def test_equals_gtsam_on_a_long_chain(preset):
    drawn, rng = simulated(3000, 6, 0.1, 0), np.random.default_rng(11)
    poses = drawn.poses + rng.normal(size=drawn.poses.shape) * [0.1, 0.1, 0.02]
    solution = solution_at(drawn, PRESETS[preset], poses, drawn.landmarks)
    assert_equals_gtsam(solution, drawn, PRESETS[preset], sample=[0, 1499, 2997])


def test_windows_are_symmetric_positive_definite_and_share_their_blocks(noisy):
    for settings in PRESETS.values():
        got = selected_inverse.covariance(noisy.solution, noisy.world, settings)
        joint = got.windows
        assert np.array_equal(joint, joint.transpose(0, 2, 1))
        assert np.array_equal(got.landmarks, got.landmarks.T)
        assert np.linalg.eigvalsh(joint).min() > 0
        assert np.linalg.eigvalsh(got.landmarks).min() > 0
        assert np.array_equal(joint[1:, :6, :6], joint[:-1, 3:, 3:])
        everything = np.block([
            [joint[4], got.pose_landmark[4:7].reshape(9, -1)],
            [got.pose_landmark[4:7].reshape(9, -1).T, got.landmarks],
        ])
        assert np.linalg.eigvalsh(everything).min() > 0


def test_window_covariances_are_those_of_the_slow_way(noisy):
    got = selected_inverse.window_covariances(noisy.solution, noisy.world, PRESETS["B"])
    assert got.shape == noisy.covariances.shape
    assert relative(got, noisy.covariances) < TOLERANCE


@pytest.mark.parametrize("preset", ["A", "B", "C"])
def test_isam2_has_the_covariances_of_its_own_linearisation_points(noisy, preset):
    """What ISAM2 answers differs from `gtsam_marginals` by old linearisation points only."""
    settings = PRESETS[preset]
    solution = isam2.run_isam2(noisy.world, settings)
    keys = [windows.window_keys(t) for t in range(28)]
    answered = np.array([joint_covariance(solution.isam, key) for key in keys])
    old = dataclasses.replace(solution, estimate=solution.isam.getLinearizationPoint())
    assert (
        relative(selected_inverse.window_covariances(old, noisy.world, settings), answered)
        < TOLERANCE
    )
    assert (
        relative(selected_inverse.window_covariances(solution, noisy.world, settings), answered)
        > 1e-3
    )


def test_what_does_not_fit_is_refused(noisy):
    drawn, settings = noisy.world, PRESETS["B"]
    good = {"poses": drawn.poses, "landmarks": drawn.landmarks, "world": drawn}
    lost = drawn.poses.copy()
    lost[3, 1] = np.nan
    for name, value, message in (
        ("poses", drawn.poses[:2], "poses has shape"),
        ("landmarks", drawn.landmarks[1:], "landmarks has shape"),
        ("poses", lost, "must be finite"),
        ("world", dataclasses.replace(drawn, label_of=drawn.label_of + 1), r"label_of\[\d+\]"),
        ("world", dataclasses.replace(drawn, pose_of=drawn.pose_of - 1), r"pose_of\[0\]"),
    ):
        with pytest.raises(ValueError, match=message):
            selected_inverse.covariance_at(**{**good, name: value}, conventions=settings)
    other = simulated(29, 6, 0.3, 0)
    with pytest.raises(ValueError, match="factors"):
        selected_inverse.covariance(noisy.solution, other, settings)
