from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from helpers import dense_covariance

from sngr_utils.slam import conventions, isam2, landmark_starts, marginals
from sngr_utils.slam.factors import landmark_prior, odometry_factor, pose_prior, range_factor
from sngr_utils.slam.solution import poses_of
from sngr_utils.sngr import baseline, windows
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario


@pytest.mark.parametrize(
    "keys",
    [[X(3), X(4), X(5)], [X(5), X(4), X(3)], [L(2), X(7)], [X(7), L(2), X(0), L(0)], [X(29)]],
)
def test_joint_covariance_is_the_dense_inverse_in_the_order_asked_for(noisy, keys):
    covariance, slices = dense_covariance(noisy.solution)
    expected = np.block([[covariance[slices[i], slices[j]] for j in keys] for i in keys])
    got = marginals.joint_covariance(marginals.gtsam_marginals(noisy.solution), keys)
    assert np.allclose(got, expected, rtol=1e-8, atol=1e-12)


def test_position_covariances_in_both_frames(clean):
    body = marginals.position_covariances(clean.solution, "body")
    rotated = marginals.position_covariances(clean.solution, "world")
    assert np.allclose(np.trace(body, axis1=1, axis2=2), np.trace(rotated, axis1=1, axis2=2))
    theta = clean.solution.poses[5, 2]
    r = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    assert np.allclose(rotated[5], r @ body[5] @ r.T)


def test_odometry_error_in_closed_form():
    """Equation "odometry": a wrong translation, seen from the end that was predicted."""
    predicted, there = np.array([1.0, 0.0, 0.5]), np.array([1.3, 0.4, 0.5])
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose2())
    values.insert(X(1), gtsam.Pose2(*there))
    cos, sin = np.cos(0.5), np.sin(0.5)
    residual = np.array([cos * 0.3 + sin * 0.4, -sin * 0.3 + cos * 0.4])
    expected = 0.5 * np.sum((residual / 0.05) ** 2)
    assert odometry_factor(0, predicted, Scenario()).error(values) == pytest.approx(expected)
    turned = odometry_factor(0, there + np.array([0, 0, 0.03]), Scenario())
    assert turned.error(values) == pytest.approx(0.5 * (0.03 / 0.01) ** 2)


def test_range_error_in_closed_form():
    """Equation "range": half the squared residual, which error() has already."""
    values = gtsam.Values()
    values.insert(X(1), gtsam.Pose2(1.0, 0.0, 0.2))
    values.insert(L(0), np.array([4.0, 4.0]))
    seen = range_factor(1, 0, 6.0, 0.1)
    assert seen.error(values) == pytest.approx(0.5 * ((5.0 - 6.0) / 0.1) ** 2)


def test_prior_errors_in_closed_form():
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose2(0.3, 0.0, 0.0))
    values.insert(L(0), np.array([4.0, 4.0]))
    prior = pose_prior(np.zeros(3), [0.1, 0.2, 0.5])
    assert prior.error(values) == pytest.approx(0.5 * (0.3 / 0.1) ** 2)
    landmark = landmark_prior(0, np.array([3.0, 4.0]), 0.5)
    assert landmark.error(values) == pytest.approx(0.5 * (1 / 0.5) ** 2)


def test_landmark_start_recovers_noise_free_position():
    positions = np.array([[5.0, 0.0], [4.0, 3.0], [0.0, 5.0], [-4.0, 3.0]])
    landmark = np.array([1.0, -2.0])
    ranges = np.linalg.norm(positions - landmark, axis=1)
    assert np.allclose(landmark_starts.start_landmark(positions, ranges), landmark, atol=1e-8)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.25 * np.pi, 2.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_landmark_start_is_on_the_left_of_a_straight_way(angle, scale):
    """Wherever the way lies, and on whichever side the landmark is: the ranges are the same."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    along = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    for side in (2.0, -2.0):
        ranges = np.linalg.norm(along - [3.0, side], axis=1)
        moved = scale * (along @ turn.T + [5.0, -7.0])
        found = landmark_starts.start_landmark(moved, scale * ranges)
        assert np.allclose(found, scale * (turn @ [3.0, 2.0] + [5.0, -7.0]), atol=1e-6 * scale)


@pytest.mark.filterwarnings("error")
def test_landmark_start_bears_a_pose_at_the_centroid_and_a_robot_that_stands():
    cross = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    landmark = np.array([3.0, 2.0])
    found = landmark_starts.start_landmark(cross, np.linalg.norm(cross - landmark, axis=1))
    assert np.allclose(found, landmark)
    found = landmark_starts.start_landmark(np.zeros((3, 2)), np.full(3, 2.0))
    assert np.hypot(*found) == pytest.approx(2.0)


def test_landmark_start_knows_nothing_of_the_truth():
    """The same data with other true positions and labels of truth give the same estimate."""
    drawn = simulation.simulate(Scenario(), 0.3, rng=np.random.default_rng(2))
    blind = simulation.World(
        poses=np.vstack([drawn.poses[:1], np.full((29, 3), np.nan)]),
        landmarks=np.full((6, 2), np.nan),
        odometry=drawn.odometry,
        pose_of=drawn.pose_of,
        label_of=drawn.label_of,
        source_of=np.full(len(drawn.ranges), -1),
        ranges=drawn.ranges,
        scenario=drawn.scenario,
        x0_mean=drawn.x0_mean,
    )
    runs = [isam2.run_isam2(w, conventions.PRESETS["B"]) for w in (drawn, blind)]
    assert np.array_equal(runs[0].poses, runs[1].poses)


def test_every_measurement_becomes_a_factor(clean):
    factors = clean.solution.graph
    assert factors.size() == 1 + 29 + 180 + 6
    assert np.isfinite(clean.solution.landmarks).all()


def test_landmark_seen_from_two_poses_only_is_left_out():
    drawn = simulation.simulate(Scenario(), 0.0, rng=np.random.default_rng(0))
    kept = (drawn.label_of != 5) | (drawn.pose_of < 2)
    fewer = simulation.World(
        drawn.poses, drawn.landmarks, drawn.odometry, drawn.pose_of[kept], drawn.label_of[kept],
        drawn.source_of[kept], drawn.ranges[kept], drawn.scenario,
        drawn.x0_mean,
    )  # fmt: skip
    solution = isam2.run_isam2(fewer, conventions.PRESETS["B"])
    assert np.isnan(solution.landmarks[5]).all()
    assert np.isfinite(solution.landmarks[:5]).all()


def test_isam2_agrees_with_batch_optimisation_on_clean_data(clean):
    batch = gtsam.LevenbergMarquardtOptimizer(clean.solution.graph, clean.solution.estimate)
    optimum = poses_of(batch.optimize(), 30)
    assert np.abs(optimum - clean.solution.poses).max() < 0.02


def test_preset_b_reproduces_the_printed_clean_counts(clean):
    """Windows above 3.90 / 3.92 / 3.96 / 4.0 on clean data, t >= 2: 4 / 0 / 0 / 0."""
    counts = [int(clean.fired(tau).sum()) for tau in (3.90, 3.92, 3.96, 4.0)]
    assert counts == [4, 0, 0, 0]
    near = np.abs(clean.scores[:, None] - [3.90, 3.92, 3.96, 4.0]).min()
    assert near > 1e-6  # no count hangs on rounding


@pytest.mark.parametrize("n_poses", [3, 4, 40])
def test_other_lengths_run(n_poses):
    scenario = Scenario(n_poses=n_poses)
    run = baseline.run_baseline(scenario, conventions.PRESETS["C"], 0.2, 4)
    assert len(run.scores) == windows.n_windows(n_poses) == n_poses - 2
    assert np.isfinite(run.nees)


def test_conventions():
    assert conventions.preset_conventions("A", {"relinearize_skip": 3}).relinearize_skip == 3
    assert conventions.preset_conventions("B") == conventions.Conventions()
    with pytest.raises(ValueError, match="preset is 'D'"):
        conventions.preset_conventions("D")
    with pytest.raises(ValueError, match="relinearize_skop"):
        conventions.preset_conventions("A", {"relinearize_skop": 3})
    with pytest.raises(ValueError, match="landmark_prior_sigma"):
        conventions.preset_conventions("A", {"landmark_prior_sigma": -1.0})


def test_open_conventions_are_checked_when_they_are_set():
    lazy = conventions.OpenConventions(preset="A", conventions={"relinearize_skip": 3})
    assert lazy.chosen == conventions.preset_conventions("A", {"relinearize_skip": 3})
    with pytest.raises(ValueError, match="preset is 'D'"):
        conventions.OpenConventions(preset="D")
    with pytest.raises(ValueError, match="relinearize_skop"):
        conventions.OpenConventions(conventions={"relinearize_skop": 3})


def test_a_shifted_x0_mean_shifts_everything(clean):
    """Nothing but the x0 prior knows where the frame is."""
    shift = np.array([1.0, -2.0, 0.0])
    elsewhere = replace(clean.world, x0_mean=clean.world.x0_mean + shift)
    moved = isam2.run_isam2(elsewhere, conventions.PRESETS["B"])
    assert np.allclose(moved.poses, clean.solution.poses + shift, atol=1e-6)
    assert np.allclose(moved.landmarks, clean.solution.landmarks + shift[:2], atol=1e-6)
