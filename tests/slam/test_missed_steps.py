"""Missed steps: none in white noise, found where planted, and the covariance true with them."""

from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.metrics.alignment import aligned_errors, rigid
from sngr_utils.metrics.rmse_and_nees import nees
from sngr_utils.slam import chain_problem, chain_solver, missed_steps
from sngr_utils.slam.aligned_covariance import aligned_covariances
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.log import Log
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate

AT, SLIP = 30, 40.0  # the step that errs, and by how many sigmas ahead


def world(seed, slip=0.0):
    """A log with right labels and true noise, one range a pose, and what is true."""
    scenario = Scenario(n_poses=80, odometry_sigma_xy=0.03, odometry_sigma_theta=0.01)
    drawn = simulate(scenario, 0.0, rng=np.random.default_rng(seed))
    odometry = drawn.odometry.copy()
    odometry[AT, 0] += slip * scenario.odometry_sigma_xy
    few = np.arange(len(drawn.ranges)) % drawn.n_landmarks == drawn.pose_of % drawn.n_landmarks
    log = Log(
        odometry=odometry, odometry_covariances=np.diag(scenario.odometry_sigmas**2),
        pose_of=drawn.pose_of[few], ranges=drawn.ranges[few], range_sigmas=scenario.range_sigma,
        label_of=drawn.source_of[few], n_landmarks=drawn.n_landmarks, x0_mean=drawn.x0_mean,
        x0_sigmas=[0.01, 0.01, 0.001],
    )  # fmt: skip
    return log, drawn.poses, drawn.landmarks


def solved(log, poses, landmarks):
    chain = chain_problem.of_log(log, landmarks, 100.0)
    found = chain_solver.solve(chain, poses, landmarks, LEAST_SQUARES, chain_solver.THOROUGH)
    at = chain_solver.state_of(chain, found.poses, found.landmarks)
    return chain, at._replace(calibration=found.calibration), found


def judged(seed, slip):
    """NEES of aligned positions, with the missed steps and without, and how many there are."""
    log, poses, landmarks = world(seed, slip)
    chain, at, found = solved(log, poses, landmarks)
    missed, everywhere = missed_steps.find(chain, at), np.arange(log.n_poses)
    pair = found.poses[:, :2], poses[:, :2]
    turn, errors = rigid(*pair)[0], aligned_errors(*pair)
    values = [
        nees(errors, turn @ aligned_covariances(
            chain, at, found.position_covariances, everywhere, moves) @ turn.T)
        for moves in (missed.poses, missed.poses[:0])
    ]  # fmt: skip
    return *values, len(missed.poses)


def test_white_noise_stays_as_it_is():
    """A world is widened with a chance of .05 at most: more than 6 of 40 by chance in 1 of 300.

    The mean of 40 NEES of 2, each of few independent errors, is within 25 % by more than three
    errors: their standard deviation over worlds is 1 at most.
    """
    found = np.array([judged(seed, 0.0) for seed in range(100, 140)])
    assert np.count_nonzero(found[:, 2]) <= 6
    assert found[:, 0].mean() == pytest.approx(2.0, abs=0.5)
    same = found[:, 2] == 0
    np.testing.assert_array_equal(found[same, 0], found[same, 1])


def test_a_slip_is_found_and_its_covariance_is_true():
    """Of forty sigmas, in worlds where a step's error shows: all but few of 15 are found."""
    found = np.array([judged(seed, SLIP) for seed in range(100, 115)])
    assert np.count_nonzero(found[:, 2]) >= 13
    assert np.median(found[:, 1]) > 5
    assert np.median(found[:, 0]) < 2.5


def test_an_error_of_a_missed_step_moves_the_estimate_as_told():
    log, poses, landmarks = world(100, SLIP)
    log = replace(log, scale=(1.0, 0.1))
    chain, at, found = solved(log, poses, landmarks)
    missed = missed_steps.find(chain, at)
    sigma = np.linalg.norm(missed.poses[0])
    odometry = log.odometry.copy()
    odometry[AT, 0] += 1e-3
    again = solved(replace(log, odometry=odometry), found.poses, found.landmarks)[2]
    turned = found.poses[:, 2]
    moved = (again.poses - found.poses)[:, :2]
    ahead = np.cos(turned) * moved[:, 0] + np.sin(turned) * moved[:, 1]
    told = missed.poses[0, :, 0]
    alike = ahead @ told / np.linalg.norm(ahead) / np.linalg.norm(told)
    assert sigma > 0
    assert abs(alike) > 0.99
    way = (again.calibration - found.calibration)[0] / np.linalg.norm(ahead)
    assert abs(way) == pytest.approx(abs(missed.calibration[0, 0]) / np.linalg.norm(told), rel=0.1)
