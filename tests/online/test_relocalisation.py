import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sngr_utils.online import relocalisation
from sngr_utils.robust.association import Shares
from sngr_utils.world import scenario, simulation

SHARES = Shares(0.3, 0.02)


def drive(n_poses, p, seed):
    rng = np.random.default_rng(seed)
    world = simulation.simulate(scenario.Scenario(), p, rng=rng)
    log = world.log([0.1, 0.1, 0.05]).first(n_poses)
    return log, world.poses[:n_poses], world.landmarks


def stretch(log, poses, landmarks):
    return relocalisation.stretch(log, poses, landmarks, np.zeros(len(landmarks)), SHARES)


@pytest.mark.parametrize("free", [(True, False), (False, True), (True, True)])
def test_a_stretch_is_found_again_wherever_a_slip_has_led(free):
    """Three of ten labels are wrong; the shape is the true one. 4 worlds, all of them."""
    for seed in range(300, 304):
        log, poses, landmarks = drive(4, 0.3, seed)
        slip = np.array([3.0, -2.0, 0.8]) * [free[0], free[0], free[1]]
        mean = poses[0] + slip
        part = stretch(log, relocalisation.moved(poses, mean), landmarks)
        sigmas = np.where([free[0], free[0], free[1]], [5.0, 5.0, 1.5], 0.05)
        found = relocalisation.search(part, mean, sigmas, ~np.array(free), 3)
        assert np.linalg.norm(found.pose[:2] - poses[0, :2]) < 0.4
        assert abs(found.pose[2] - poses[0, 2]) < 0.2
        trusted = relocalisation.refined(part, mean, mean, np.full(3, 0.05))
        assert found.log_evidence > trusted.log_evidence + 10
        weights = relocalisation.sources(part, found.pose)
        assert np.mean(np.argmax(weights, axis=1) == np.tile(np.arange(6), 4)) > 0.9


def test_two_ranges_and_two_landmarks_cross_only_as_different_ones():
    log, poses, landmarks = drive(1, 0.0, 300)
    part = stretch(log, poses, landmarks)
    pair = part._replace(landmarks=landmarks[:2], ranges=part.ranges[:2])
    found = relocalisation._crossings(pair, np.arange(2))
    assert len(found) == 4
    away = np.linalg.norm(found[:, None] - landmarks[:2], axis=2)
    met = np.isclose(np.sort(away), np.sort(part.ranges[:2])).all(axis=1)
    assert met.sum() >= 2
    assert np.linalg.norm(found - poses[0, :2], axis=1).min() < 0.5
    assert len(relocalisation._crossings(pair, np.arange(1))) == 2


def test_the_evidence_of_a_pose_is_the_integral_over_it():
    """Laplace's against a sum over a fine grid, at one well-determined place."""
    log, poses, landmarks = drive(3, 0.0, 300)
    part, sigmas = stretch(log, poses, landmarks), np.array([0.1, 0.1, 0.1])
    found = relocalisation.refined(part, poses[0], poses[0], sigmas)
    axes = [np.linspace(-4, 4, 41) * s for s in sigmas]
    offsets = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    logs = relocalisation.log_likelihoods(part, poses[0] + offsets)
    logs -= 0.5 * np.sum((offsets / sigmas) ** 2, axis=1)
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    exact = np.log(np.sum(np.exp(logs)) * cell / np.prod(np.sqrt(2 * np.pi) * sigmas))
    assert found.log_evidence == pytest.approx(exact, abs=0.1)


def test_a_rigid_stretch_keeps_its_shape():
    _, poses, _ = drive(5, 0.0, 300)
    there = relocalisation.moved(poses, np.array([1.0, 2.0, -3.0]))
    assert there[0] == pytest.approx([1.0, 2.0, -3.0])
    turn = Rotation.from_euler("z", -3.0 - poses[0, 2]).as_matrix()[:2, :2]
    assert there[:, :2] - there[0, :2] == pytest.approx((poses[:, :2] - poses[0, :2]) @ turn.T)
