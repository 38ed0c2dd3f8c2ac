import tracemalloc

import numpy as np
import pytest
from scipy import stats

from sngr_utils.world import dead_reckoning, simulation, wrong_associations
from sngr_utils.world.scenario import Scenario


def make(p=0.0, seed=0, **changes):
    return simulation.simulate(Scenario(**changes), p, rng=np.random.default_rng(seed))


def test_scenario_is_the_papers():
    """A circle of 5 m in 30 poses, 6 landmarks in [-4, 4]^2 m; 0.05 m, 0.01 rad, 0.1 m."""
    assert Scenario().model_dump() == {
        "n_poses": 30, "radius": 5.0, "n_landmarks": 6, "landmark_half_width": 4.0,
        "odometry_sigma_xy": 0.05, "odometry_sigma_theta": 0.01, "range_sigma": 0.1,
    }  # fmt: skip
    assert Scenario(n_poses=3, n_landmarks=2).n_landmarks == 2  # the least of either


def test_circle_is_a_circle_with_tangent_heading():
    poses = simulation.circle_poses(30, 5.0)
    assert np.allclose(np.hypot(*poses[:, :2].T), 5)
    heading = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    assert np.allclose(np.sum(heading * poses[:, :2], axis=1), 0)
    turning = poses[:, 0] * heading[:, 1] - poses[:, 1] * heading[:, 0]
    assert np.all(turning > 0)  # counter-clockwise
    assert np.linalg.norm(poses[0] - poses[-1]) > 1  # the end point is not repeated


def test_relative_motion_and_dead_reckoning_are_inverse():
    poses = make(n_poses=50).poses
    again = dead_reckoning.dead_reckoning(poses[0], dead_reckoning.relative_motion(poses))
    assert np.allclose(again, poses, atol=1e-12)


@pytest.mark.parametrize("angle", [-np.pi, np.pi, 3 * np.pi, -0.1, 7.0])
def test_wrap_angle(angle):
    wrapped = dead_reckoning.wrap_angle(angle)
    assert -np.pi <= wrapped < np.pi
    assert np.isclose(np.exp(1j * wrapped), np.exp(1j * angle))


def test_draw_order_is_the_documented_one():
    drawn, rng = make(seed=7), np.random.default_rng(7)
    assert np.array_equal(drawn.landmarks, rng.uniform(-4, 4, (6, 2)))
    noise = rng.normal(size=(29, 3)) * [0.05, 0.05, 0.01]
    assert np.allclose(
        drawn.odometry, dead_reckoning.relative_motion(drawn.poses) + noise, rtol=0, atol=0
    )
    distance = np.linalg.norm(drawn.poses[:, None, :2] - drawn.landmarks, axis=2)
    assert np.array_equal(drawn.ranges, (distance + rng.normal(size=(30, 6)) * 0.1).ravel())
    assert np.array_equal(drawn.pose_of, np.repeat(np.arange(30), 6))


def test_p_changes_associations_and_nothing_else():
    worlds = [make(p=p, seed=3) for p in (0.0, 0.2, 0.5, 1.0)]
    for other in worlds[1:]:
        for name in ("poses", "landmarks", "odometry", "pose_of", "source_of", "ranges"):
            assert np.array_equal(getattr(other, name), getattr(worlds[0], name))
    wrong = [w.label_of != w.source_of for w in worlds]
    assert not wrong[0].any()
    assert wrong[-1].all()
    assert np.all(wrong[1] <= wrong[2])  # nested: wrong at a small p is wrong at a larger one


def test_wrong_associations_follow_their_law():
    """Binomial share and uniform other label. Failure probability 2e-4 in all."""
    source = np.tile(np.arange(6), 5000)
    labels = wrong_associations.wrong_associations(source, 6, 0.3, rng=np.random.default_rng(1))
    wrong = labels != source
    assert stats.binomtest(int(wrong.sum()), len(source), 0.3).pvalue > 1e-4
    shift = (labels - source)[wrong] % 6
    counts = np.bincount(shift, minlength=6)
    assert counts[0] == 0
    assert stats.chisquare(counts[1:]).pvalue > 1e-4


def test_a_single_landmark_has_no_wrong_one():
    source, rng = np.zeros(5, dtype=int), np.random.default_rng(1)
    assert (wrong_associations.wrong_associations(source, 1, 0.0, rng=rng) == 0).all()
    with pytest.raises(ValueError, match=r"p is 0.3: with 1 landmark there is no wrong one"):
        wrong_associations.wrong_associations(source, 1, 0.3, rng=rng)


def test_noise_has_the_stated_sigmas():
    """Chi-square on 870 odometry and 1800 range residuals. Failure probability 2e-4."""
    drawn = make(n_poses=300, seed=5)
    residual = drawn.odometry - dead_reckoning.relative_motion(drawn.poses)
    z = (residual / [0.05, 0.05, 0.01]).ravel()
    distance = np.linalg.norm(
        drawn.poses[drawn.pose_of, :2] - drawn.landmarks[drawn.source_of], axis=1
    )
    for values in (z, (drawn.ranges - distance) / 0.1):
        tail = stats.chi2.cdf(np.sum(values**2), len(values))
        assert 5e-5 < tail < 1 - 5e-5


@pytest.mark.parametrize(
    ("name", "value"),
    [("range_sigma", -0.1), ("range_sigma", 0.0), ("n_poses", 2), ("n_poses", 30.0),
     ("n_landmarks", 1), ("radius", float("nan")), ("odometry_sigma_xy", "high"), ("rage", 1.0)],
)  # fmt: skip
def test_bad_scenario_names_the_parameter(name, value):
    with pytest.raises(ValueError, match=name):
        Scenario(**{name: value})


@pytest.mark.parametrize(("name", "least"), [("range_sigma", 5e-4), ("radius", 4e-4)])
def test_lengths_that_no_linear_system_spans_are_refused(name, least):
    Scenario(**{name: 1.1 * least})
    with pytest.raises(ValueError, match=rf"is [45]\.0 and {name} .*: they may span 10000 at most"):
        Scenario(**{name: 0.9 * least})


@pytest.mark.parametrize("p", [-0.1, 1.1, float("nan")])
def test_bad_p_is_refused(p):
    with pytest.raises(ValueError, match="p is"):
        make(p=p)


def test_pick_and_part():
    names = {**Scenario(radius=2.0).model_dump(), "unrelated": 1}
    assert Scenario.pick(names).radius == 2.0
    with pytest.raises(KeyError, match="n_poses"):
        Scenario.pick({})


def test_dead_reckoning_variances_against_simulation():
    """Variance over 3000 runs, mean of x and y: at most 2.6 % standard error, 5 of them allowed.

    Failure probability 2e-6 for each of four poses.
    """
    rng = np.random.default_rng(11)
    truth = make().poses
    motion, sigmas = dead_reckoning.relative_motion(truth), np.array([0.05, 0.05, 0.03])
    runs = np.array([
        dead_reckoning.dead_reckoning(truth[0], motion + rng.normal(size=(29, 3)) * sigmas)[:, :2]
        for _ in range(3000)
    ])
    told = dead_reckoning.dead_reckoning_variances(truth, np.diag(sigmas**2))
    assert told[0] == 0
    assert told[1] == pytest.approx(0.05**2)
    for t in (1, 5, 15, 29):
        assert runs[:, t].var(axis=0).mean() == pytest.approx(told[t], rel=0.13)


def test_dead_reckoning_variances_are_the_sum_over_all_earlier_steps():
    """Pair by pair, far from the origin, and without an array of all pairs."""
    rng = np.random.default_rng(1)
    roots = 0.05 * rng.normal(size=(199, 3, 3))
    covariances = roots @ roots.swapaxes(1, 2)
    poses = np.cumsum(rng.normal(size=(200, 3)), axis=0) + np.array([1e4, -1e5, 0.0])
    squares = np.sum((poses[:, None, :2] - poses[:, :2]) ** 2, axis=2)
    turned = [squares[t, 1 : t + 1] @ covariances[:t, 2, 2] for t in range(200)]
    own = [np.trace(covariances[:t, :2, :2].sum(axis=0)) / 2 for t in range(200)]
    expected = np.array(own) + 0.5 * np.array(turned)
    got = dead_reckoning.dead_reckoning_variances(poses, covariances)
    assert np.allclose(got, expected, rtol=1e-12, atol=0)
    tracemalloc.start()
    dead_reckoning.dead_reckoning_variances(rng.normal(size=(10_000, 3)), np.eye(3))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200 * 10_000  # bytes: a few numbers a pose
