"""The local log-likelihood of a window, by GTSAM."""

import gtsam
import numpy as np


class LocalLikelihood:
    """Log-likelihood of a few variables, all others held at the MAP (paper eq. "ll").

    Parameters
    ----------
    factors : the factors that touch `keys`
    estimate : MAP values of all variables
    keys : variables that move, poses or points
    factor : factor on GTSAM's error(), see `SamplerSettings`
    """

    def __init__(
        self,
        factors: gtsam.NonlinearFactorGraph,
        estimate: gtsam.Values,
        keys: list[int],
        factor: float,
    ) -> None:
        self.keys = keys
        self.factors = factors
        self.estimate = estimate
        self.factor = factor
        self._moved = gtsam.Values(estimate)
        self._own = gtsam.Values()
        own = [_variable(estimate, key) for key in keys]
        for key, variable in zip(keys, own, strict=True):
            self._own.insert(key, variable)
        sizes = [3 if isinstance(v, gtsam.Pose2) else 2 for v in own]
        slices = [slice(e - n, e) for e, n in zip(np.cumsum(sizes).tolist(), sizes, strict=True)]
        self._parts = list(zip(keys, slices, strict=True))
        self.dimension = sum(sizes)

    def variables(self, xi: np.ndarray) -> list[gtsam.Pose2 | np.ndarray]:
        """MAP.retract(xi): the moved variables, in the order of `keys`."""
        moved = self._retracted(xi)
        return [_variable(moved, key) for key in self.keys]

    def __call__(self, xi: np.ndarray) -> float:
        """-factor * sum of error() at a (d,) tangent vector, [nats]."""
        self._moved.update(self._retracted(xi))
        return -self.factor * self.factors.error(self._moved)

    def _retracted(self, xi: np.ndarray) -> gtsam.Values:
        """All that moves, in one call: for every variable alone, GTSAM tries all types there are"""
        step = gtsam.VectorValues()
        for key, part in self._parts:
            step.insert(key, xi[part])
        return self._own.retract(step)


def _variable(values: gtsam.Values, key: int) -> gtsam.Pose2 | np.ndarray:
    is_pose = gtsam.Symbol(key).chr() == ord("x")
    return values.atPose2(key) if is_pose else values.atPoint2(key)
