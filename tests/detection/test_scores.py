from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.detection.scores import (
    SCORES,
    disagreement,
    disagreement_sigmas,
    either,
    largest_eigenvalue,
    mirror_weight,
)
from sngr_utils.experiments import detector_scores
from sngr_utils.slam import conventions, isam2, selected_inverse
from sngr_utils.sngr import failure, trigger
from sngr_utils.world import dead_reckoning, simulation
from sngr_utils.world.scenario import Scenario

C = conventions.PRESETS["C"]


@pytest.fixture(scope="module")
def run():
    the_world = simulation.simulate(Scenario(n_poses=15), 0.2, rng=np.random.default_rng(100))
    return the_world, isam2.run_isam2(the_world, C)


def test_largest_eigenvalue_sees_positions_only(run):
    """100 times the unit is four decades; the headings, blown up, change nothing."""
    covariances = selected_inverse.window_covariances(run[1], run[0], C)
    scores = largest_eigenvalue(covariances)
    moved = largest_eigenvalue(trigger.in_units(covariances, 100))
    assert np.allclose(moved - scores, 4)
    scale = np.tile([1.0, 1.0, 1e4], 3)
    assert np.allclose(largest_eigenvalue(covariances * np.outer(scale, scale)), scores)


def test_disagreement_with_the_truth_is_failure(run):
    the_world, solution = run
    errors = np.linalg.norm((solution.poses - the_world.poses)[:, :2], axis=1)
    against_truth = disagreement(solution.poses, the_world.poses)
    assert np.array_equal(against_truth > failure.FAILURE_ERROR, failure.failures(errors))


def test_disagreement_is_a_mean_distance_in_metres_whatever_the_headings():
    reference = np.zeros((5, 3))
    poses = np.array([[3.0, 4, 9], [0, 0, 9], [0, 1, 9], [2, 0, 9], [0, 0, 9]])
    assert disagreement(poses, reference) == pytest.approx([2.0, 1.0, 1.0])


def test_disagreement_in_sigmas_has_its_law(run):
    """The truth drawn about the reference: the distance to it, over sigma_D, has unit variance.

    Far from the reference, where the first order is exact. Five standard errors of a standard
    deviation over 4000 draws: fails once in 2e6 runs.
    """
    the_world, solution = run
    covariance, rng = selected_inverse.covariance(solution, the_world, C), np.random.default_rng(3)
    reference = solution.poses
    plain = reference + np.array([30.0, -40.0, 0.0])
    got = disagreement_sigmas(plain, reference, covariance)
    for t in (0, 7):
        draws = rng.multivariate_normal(np.zeros(9), covariance.windows[t], size=4000)
        body, heading = draws.reshape(-1, 3, 3), reference[t : t + 3, 2]
        cos, sin = np.cos(heading), np.sin(heading)
        x = 30 - (cos * body[..., 0] - sin * body[..., 1])
        y = -40 - (sin * body[..., 0] + cos * body[..., 1])
        spread = np.hypot(x, y).mean(axis=1).std()
        expected = (50 - failure.FAILURE_ERROR) / spread
        assert got[t] == pytest.approx(expected, rel=5 / np.sqrt(2 * 4000))


def test_equal_estimates_do_not_disagree(run):
    the_world, solution = run
    covariance = selected_inverse.covariance(solution, the_world, C)
    scores = disagreement_sigmas(solution.poses, solution.poses, covariance)
    heading = solution.poses[:, 2]
    for t in (0, 7):  # half a metre away, in the deviations of the mean position along x
        east = [[np.cos(h), -np.sin(h), 0.0] for h in heading[t : t + 3]]
        gradient = np.concatenate(east) / 3
        sigma = np.sqrt(gradient @ covariance.windows[t] @ gradient)
        assert scores[t] == pytest.approx(-0.5 / sigma)


def straight(n_poses, landmark):
    """A world that drives along the x axis past one landmark (and a second far away)."""
    poses = np.column_stack([np.arange(n_poses), np.zeros(n_poses), np.zeros(n_poses)])
    landmarks = np.array([landmark, [100.0, 100.0]])
    ranges = np.linalg.norm(poses[:, :2] - landmarks[0], axis=1)
    index, zero = np.arange(n_poses), np.zeros(n_poses, dtype=int)
    odometry = dead_reckoning.relative_motion(poses)
    scenario = Scenario(n_poses=n_poses)
    return simulation.World(
        poses, landmarks, odometry, index, zero, zero, ranges, scenario, poses[0]
    )


def test_mirror_weight_on_a_line_and_round_a_bend():
    line = straight(10, [4.0, 3.0])
    landmarks = np.array([[4.0, 3.0], [np.nan, np.nan]])
    assert mirror_weight(line, line.poses, landmarks) == pytest.approx(0.5)
    bent = line.poses.copy()
    bent[6:, 1] = 2.0 * np.arange(1, 5)
    distance = np.linalg.norm(bent[:, :2] - landmarks[0], axis=1)
    turned = mirror_weight(replace(line, ranges=distance), bent, landmarks)
    assert turned[:4] == pytest.approx(0.5)  # still on the straight part
    assert (turned[5:] < 1e-6).all()


def test_mirror_weight_is_asked_of_windows_that_see_the_landmark():
    """Seen from poses 4 to 6 on a line: by windows 2 to 6, of which each sees one range or more."""
    line = straight(10, [4.0, 3.0])
    seen = line.keep((line.pose_of >= 4) & (line.pose_of <= 6))
    landmarks = np.array([[np.nan, np.nan], [4.0, 3.0]])
    assert not mirror_weight(seen, line.poses, landmarks).any()  # those of an absent one
    seen = replace(seen, label_of=seen.label_of + 1)
    got = mirror_weight(seen, line.poses, landmarks)
    assert got == pytest.approx([0, 0, 0.5, 0.5, 0.5, 0.5, 0.5, 0])


def test_mirror_weight_is_the_largest_of_the_landmarks_and_of_the_ranges_so_far():
    """Landmark 0 is told from its image by the bend at pose 6; 1 was seen from the line only."""
    line = straight(10, [4.0, 3.0])
    bent = line.poses.copy()
    bent[6:, 1] = 2.0 * np.arange(1, 5)
    landmarks = np.array([[4.0, 3.0], [2.0, -2.0]])
    both = [np.linalg.norm(bent[:, :2] - spot, axis=1) for spot in landmarks]
    data = replace(
        line, ranges=np.concatenate([both[0], both[1][:8]]),
        pose_of=np.r_[np.arange(10), np.arange(8)], label_of=np.repeat([0, 1], [10, 8]),
        source_of=np.repeat([0, 1], [10, 8]),
    )  # fmt: skip
    data = data.keep(np.argsort(data.pose_of, kind="stable"))
    first, second = (mirror_weight(data.keep(data.label_of == k), bent, landmarks) for k in (0, 1))
    got = mirror_weight(data, bent, landmarks)
    assert got == pytest.approx(np.maximum(first, second))
    assert second[3] == pytest.approx(0.5)
    assert first[7] < 1e-6


def test_mirror_weight_knows_the_noise():
    """Ranges off by 0.3 m on one side: the image costs as much more as the noise is smaller."""
    line = straight(6, [3.0, 2.0])
    bent = line.poses.copy()
    bent[3:, 1] = 0.3
    distance = np.linalg.norm(bent[:, :2] - [3.0, 2.0], axis=1)
    landmarks, gaps = np.array([[3.0, 2.0], [np.nan, np.nan]]), []
    for sigma in (0.3, 0.6):
        data = replace(line, ranges=distance, scenario=Scenario(n_poses=6, range_sigma=sigma))
        weight = mirror_weight(data, bent, landmarks)[-1]
        gaps.append(np.log(1 / weight - 1))
    assert gaps[0] == pytest.approx(4 * gaps[1], rel=1e-6)


def test_either_is_bonferroni():
    first, second = np.array([3.0, 0.2, 0.1]), np.array([0.0, 2.0, 0.2])
    joint = either(first, second)
    assert joint == pytest.approx([3 - np.log10(2), 2 - np.log10(2), 0.0])
    assert np.array_equal(either(first), first)


def test_scores_read_no_truth():
    case = detector_scores.Case("paper", 0.3)
    the_world = case.draw(Scenario(n_poses=12), 100)
    blind = replace(
        the_world,
        poses=np.full_like(the_world.poses, np.nan),
        landmarks=np.full_like(the_world.landmarks, np.nan),
        source_of=np.full_like(the_world.source_of, -1),
    )
    solution = isam2.run_isam2(the_world, C)
    seen, unseen = (detector_scores.scores(w, C, solution) for w in (the_world, blind))
    assert np.array_equal(seen, unseen)
    assert set(seen) - {"naive"} | {"either"} == set(SCORES)
