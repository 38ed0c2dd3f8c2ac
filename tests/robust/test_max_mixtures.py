from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.experiments import gtsam_estimates
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.robust import losses, max_mixtures
from sngr_utils.slam import conventions, landmark_starts, solution
from sngr_utils.slam.factors import range_factor, sure_factors
from sngr_utils.world import dead_reckoning, simulation
from sngr_utils.world.scenario import Scenario

C = conventions.PRESETS["C"]


def drawn(p=0.3, seed=100, start="grid"):
    the_world = simulation.simulate(Scenario(), p, rng=np.random.default_rng(seed))
    blind = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
    return the_world, (
        blind,
        landmark_starts.start_landmarks(the_world.log(C.x0_sigmas), blind, start),
    )


def test_the_null_hypothesis_takes_over_where_the_two_gaussians_cross():
    """Ranges that all err alike have the spread of the distances, which fixes the null's sigma."""
    the_world, (poses, landmarks) = drawn(0.0)
    offsets = landmarks[the_world.label_of] - poses[the_world.pose_of, :2]
    distances = np.linalg.norm(offsets, axis=1)
    sigma, null = 0.1, np.sqrt(2) * distances.std()
    edge = np.sqrt(2 * np.log(null / sigma) / (1 / sigma**2 - 1 / null**2))
    for factor, expected in ((0.99, sigma), (1.01, null)):
        shifted = replace(the_world, ranges=distances + factor * edge)
        _, sigmas = max_mixtures.choose_null(shifted.log(C.x0_sigmas), poses, landmarks)
        assert np.allclose(sigmas, expected)


def test_a_range_goes_to_the_landmark_that_explains_it_unless_its_label_nearly_does():
    """The label weighs (K-1) times another landmark: it keeps a range up to ln(K-1) nats worse."""
    edge = 0.1 * np.sqrt(2 * np.log(2))
    poses, landmarks = np.zeros((1, 3)), np.array([[2.0, 0.0], [2.0 + edge, 0.0], [9.0, 0.0]])
    scenario, none = Scenario(n_landmarks=3), np.zeros(4, int)
    ranges = np.array([9.0, 2.0, 2.0 + 0.99 * edge, 2.0 + 1.01 * edge])
    the_world = simulation.World(
        poses, landmarks, np.zeros((0, 3)), none, none, none, ranges, scenario, poses[0]
    )
    chosen, sigmas = max_mixtures.choose_landmark(the_world.log(C.x0_sigmas), poses, landmarks)
    assert list(chosen) == [2, 0, 0, 1]
    assert (sigmas == 0.1).all()


@pytest.mark.parametrize("components", max_mixtures.COMPONENTS)
def test_the_solution_is_the_optimum_of_the_components_it_would_choose(components):
    the_world, start = drawn()
    found = max_mixtures.solve(the_world.log(C.x0_sigmas), C, start, components)
    choose = {"null": max_mixtures.choose_null, "all": max_mixtures.choose_landmark}[components]
    label, sigmas = choose(the_world.log(C.x0_sigmas), found.poses, found.landmarks)
    assert (sigmas == 0.1).mean() > 0.6
    factors = sure_factors(the_world, C, start[1])
    for t, k, distance, sigma in zip(
        the_world.pose_of, label, the_world.ranges, sigmas, strict=True
    ):
        factors.push_back(range_factor(int(t), int(k), distance, sigma))
    best = gtsam_estimates.levenberg_marquardt(
        factors, solution.values_of(found.poses, found.landmarks)
    )
    assert np.abs(solution.poses_of(best, 30) - found.poses).max() < 1e-4


def test_all_landmarks_recover_the_oracle_up_to_a_few_ranges():
    """Four fixed worlds with four wrong labels in ten: nothing here is random."""
    for seed in range(100, 104):
        the_world, start = drawn(0.4, seed)
        found = max_mixtures.solve(the_world.log(C.x0_sigmas), C, start, "all")
        chosen, _ = max_mixtures.choose_landmark(
            the_world.log(C.x0_sigmas), found.poses, found.landmarks
        )
        assert (the_world.label_of == the_world.source_of).mean() < 0.7
        assert (chosen == the_world.source_of).mean() > 0.85
        oracle, _ = losses.estimate(the_world, C, "oracle", "grid")
        assert rmse_and_nees.rmse(found.poses[:, :2], oracle[:, :2]) < 0.1


@pytest.mark.parametrize("components", max_mixtures.COMPONENTS)
def test_a_landmark_that_is_absent_explains_nothing(components):
    the_world, (poses, landmarks) = drawn()
    landmarks[5] = np.nan
    found = max_mixtures.solve(the_world.log(C.x0_sigmas), C, (poses, landmarks), components)
    assert np.isfinite(found.poses).all()
    assert np.isnan(found.landmarks[5]).all()
    assert np.isfinite(found.landmarks[:5]).all()


def test_unknown_components_are_refused():
    the_world, start = drawn()
    with pytest.raises(ValueError, match="components is 'both'"):
        max_mixtures.solve(the_world.log(C.x0_sigmas), C, start, "both")
