"""What is said of a system that the data leave open: the poses, landmarks and ranges of it."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from sngr_utils.slam import conventions, factors, indeterminate, isam2, marginals
from sngr_utils.slam.solution import Solution
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario

VAGUE = 1e12  # m, a prior that says nothing


def solution_of(ranges, poses=2, landmarks=2):
    """Poses tied by odometry and landmarks at (4, k) with these (pose, landmark) ranges only."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(factors.pose_prior(np.zeros(3), [0.1, 0.1, 0.1]))
    for t in range(poses):
        values.insert(X(t), gtsam.Pose2(t, 0.0, 0.0))
    for t in range(1, poses):
        graph.push_back(factors.odometry_factor(t - 1, np.array([1.0, 0.0, 0.0]), Scenario()))
    for k in range(landmarks):
        values.insert(L(k), np.array([4.0, 1.0 + k]))
    for t, k in ranges:
        graph.push_back(factors.range_factor(t, k, 5.0 + t, 0.1))
    return Solution(None, graph, values, poses, landmarks)


def test_a_landmark_with_one_range_is_named_with_it_and_its_pose():
    bad = solution_of([(0, 0), (1, 0), (1, 1)])
    with pytest.raises(ValueError, match=r"^not determined: landmark 1; .*: range 6.000 m of pose "
                                         r"1 and landmark 1$"):  # fmt: skip
        marginals.gtsam_marginals(bad)


def test_all_that_is_open_is_named_though_gtsam_names_one():
    found = solution_of([(0, 0), (1, 0), (0, 1)])
    found.estimate.insert(X(2), gtsam.Pose2(2.0, 0.0, 0.0))
    found.graph.push_back(factors.range_factor(2, 1, 4.5, 0.1))
    with pytest.raises(RuntimeError, match="near variable") as raw:
        gtsam.Marginals(found.graph, found.estimate)
    assert ("Symbol: l1" in str(raw.value)) != ("Symbol: x2" in str(raw.value))
    with pytest.raises(ValueError, match=r"not determined: landmark 1, pose 2; .*: range 5.000 m "
                                         r"of pose 0 .*, range 4.500 m of pose 2"):  # fmt: skip
        marginals.gtsam_marginals(found)


def test_isam2_names_the_ranges_it_could_do_nothing_with():
    """A robot that stands still sees only one circle of a landmark whose prior says nothing."""
    draw = np.random.default_rng
    still, places = np.tile([1.0, 2.0, 0.0], (5, 1)), np.array([[3.0, 0.0], [-2.0, 0.0]])
    tiny = {"odometry_sigma_xy": 1e-9, "odometry_sigma_theta": 1e-9}  # no notebook may ask for it
    scenario = Scenario(n_poses=5).model_copy(update=tiny)
    world = simulation.measure(still, places, scenario, 0.0, rng=draw(0), association_rng=draw(0))
    open_prior = conventions.PRESETS["B"].model_copy(update={"landmark_prior_sigma": VAGUE})
    with pytest.raises(ValueError, match=r"not determined: .*range \d\.\d{3} m of pose \d"):
        isam2.run_isam2(world, open_prior)


def test_other_errors_pass_as_they_are():
    good = solution_of([(0, 0), (1, 0)])
    with pytest.raises(RuntimeError, match="x9"), indeterminate.named(good.graph, good.estimate):
        good.estimate.atPose2(X(9))
