"""Noise from the data: the slope of its likelihood, and sigmas that cover the true ones."""

from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.detection import leverage
from sngr_utils.slam import chain_problem, chain_solver, noise_estimation
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.log import Log
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate

TOLD = 2.0  # times the true sigmas


def drawn(seed, n_poses=80):
    scenario = Scenario(n_poses=n_poses, odometry_sigma_xy=0.03, odometry_sigma_theta=0.05)
    return simulate(scenario, 0.0, rng=np.random.default_rng(seed))


def told(world, factor=TOLD):
    s = world.scenario
    return Log(
        odometry=world.odometry, odometry_covariances=np.diag((factor * s.odometry_sigmas) ** 2),
        pose_of=world.pose_of, ranges=world.ranges, range_sigmas=factor * s.range_sigma,
        label_of=world.label_of, n_landmarks=world.n_landmarks, x0_mean=world.x0_mean,
        x0_sigmas=[0.01, 0.01, 0.001],
    )  # fmt: skip


def weights(world):
    return np.eye(world.n_landmarks)[world.source_of]


def test_the_slope_is_that_of_the_likelihood():
    world = drawn(100, 40)
    likelihood = noise_estimation.Likelihood(
        told(world), world.poses, world.landmarks, weights(world), 100.0
    )
    at = likelihood.start()
    slope = likelihood.slope(at)
    for i, step in enumerate(1e-3 * np.eye(len(at))):
        difference = (likelihood.value(at + step) - likelihood.value(at - step)) / 2e-3
        # the information's own dependence on the estimate is left out, as the source does
        assert slope[i] == pytest.approx(difference, abs=0.02 * np.abs(slope).max() + 0.1)


def found(seed):
    world = drawn(seed)
    return noise_estimation.estimate(
        told(world), world.poses, world.landmarks, weights(world), landmark_prior_sigma=100.0
    )


def test_the_noise_found_covers_the_true_one():
    """15 range sigmas in units of their errors: their mean square within its 1e-4 quantiles.

    Of the odometry each world gives a variance to some 30 %, so 15 worlds to 8 %: a factor of
    1.35 in their mean is four of these.
    """
    scores, variances = [], []
    for seed in range(100, 115):
        noise = found(seed)
        logarithm = np.log(TOLD * noise.sigmas[noise_estimation.RANGE])
        scores.append(logarithm / noise.errors[noise_estimation.RANGE])
        mean = noise.log.odometry_covariances.mean(axis=0)
        variances.append([(mean[0, 0] + mean[1, 1]) / 2 / 0.03**2, mean[2, 2] / 0.05**2])
    assert 0.2 < np.mean(np.square(scores)) < 2.8
    ratios = np.mean(variances, axis=0)
    assert np.all((ratios > 1 / 1.35) & (ratios < 1.35)), ratios


@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_noise_that_a_log_hardly_holds_does_not_vanish(factor):
    """Of the heading of these drives, 60 poses and three landmarks, the ranges say little.

    The likelihood alone was largest at a seventh of the true sigma or less in three of these 20,
    and in one of these the map then erred by a squared distance of 103, for 6 coordinates. At the
    true noise one of 20 is above 30 with a chance of 8e-4.
    """
    ratios, distances = [], []
    for seed in range(100, 120):
        scenario = Scenario(n_poses=60, n_landmarks=3, odometry_sigma_theta=0.005)
        world = simulate(scenario, 0.0, rng=np.random.default_rng(seed))
        noise = noise_estimation.estimate(
            told(world, factor), world.poses, world.landmarks, weights(world),
            landmark_prior_sigma=100.0,
        )  # fmt: skip
        heading = noise.log.odometry_covariances[:, 2, 2].mean()
        ratios.append(np.sqrt(heading) / 0.005)
        errors = (noise.estimate.landmarks - world.landmarks).ravel()
        joint = noise.estimate.covariance.landmarks
        distances.append(errors @ np.linalg.solve(joint, errors))
    assert min(ratios) > 0.3
    assert max(distances) < 30


def test_an_error_that_the_data_do_not_hold_is_said_to_be_large():
    noise = found(100)
    # all steps are alike: per metre and per step cannot be told apart
    errors = [noise.errors[f"position per {what}"] for what in ("root metre", "step")]
    assert min(errors) > 0.3


def test_two_poses_are_refused():
    world = drawn(100).first(2)
    with pytest.raises(ValueError, match="2 poses: noise needs three"):
        noise_estimation.estimate(
            told(world), world.poses, world.landmarks, weights(world), landmark_prior_sigma=100.0
        )


def test_a_heading_that_errs_along_a_step_moves_its_end():
    """Against sums of many small turns: 4000 draws, relative error of a variance 1 / 45."""
    rng = np.random.default_rng(100)
    length, pieces = 3.0, 200
    turns = np.cumsum(rng.normal(size=(4000, pieces)) * np.sqrt(length / pieces) * 0.01, axis=1)
    aside = np.sin(turns).sum(axis=1) * length / pieces
    drawn_covariance = np.cov(aside, turns[:, -1])
    shape = noise_estimation.shapes(np.array([[length, 0.0, 0.0]]))[2, 0]
    np.testing.assert_allclose(drawn_covariance, 1e-4 * shape[1:, 1:], rtol=0.12)


def test_the_chi_square_of_windows_keeps_its_level_with_the_noise_found():
    """Told a fifth too little, it rejects one window in three; with what is found one in 28.

    Over seeds 400 to 499 of four kinds, told 1.25 and .8 times the noise of ranges, 2 times that
    of odometry or the truth, it is 3.4 to 4.1 %, with a standard deviation of 4.3 % between
    worlds: the mean of 12 is above 9 % with a chance below 1e-4.
    """
    before, after = [], []
    for seed in range(400, 412):
        world = simulate(Scenario(), 0.0, rng=np.random.default_rng(seed))
        log, start = told(world, 0.8), (world.poses, world.landmarks)
        chain = chain_problem.of_log(log, world.landmarks, 100.0)
        as_told = chain_solver.solve(chain, *start, LEAST_SQUARES, chain_solver.CERES)
        noise = noise_estimation.estimate(log, *start, weights(world), landmark_prior_sigma=100.0)
        factor = noise.sigmas[noise_estimation.RANGE]
        assert factor == pytest.approx(1.25, abs=0.4)
        for levels, best, sigma in (
            (before, as_told, 0.08), (after, noise.estimate, 0.08 * factor)
        ):  # fmt: skip
            known = replace(world, scenario=Scenario(range_sigma=sigma))
            test = leverage.chi_square(known, best.poses, best.landmarks, best.covariance)
            levels.append(np.mean(test.surprise > -np.log10(0.05)))
    assert np.mean(before) > 0.2
    assert np.mean(after) < 0.09
