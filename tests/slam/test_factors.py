"""Factors in NumPy against GTSAM's own."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.slam.factors import range_derivatives, range_factor


def test_range_derivatives_are_those_of_gtsam():
    rng = np.random.default_rng(0)
    poses, landmarks = rng.normal(size=(4, 1, 3)), rng.normal(size=(5, 2))
    distances, by_pose, by_landmark = range_derivatives(poses, landmarks)
    assert distances.shape == (4, 5)
    for t, k in np.ndindex(4, 5):
        values = gtsam.Values()
        values.insert(X(0), gtsam.Pose2(*poses[t, 0]))
        values.insert(L(0), landmarks[k])
        jacobian, minus_error = range_factor(0, 0, 1.5, 1.0).linearize(values).jacobian()
        assert np.allclose(minus_error, 1.5 - distances[t, k], rtol=0, atol=1e-12)
        expected = [*by_pose[t, k], 0.0, *by_landmark[t, k]]
        assert np.allclose(jacobian[0], expected, rtol=0, atol=1e-12)
