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
        self._map = [_variable(estimate, key) for key in keys]
        sizes = [3 if isinstance(v, gtsam.Pose2) else 2 for v in self._map]
        self._slices = [slice(e - n, e) for e, n in zip(np.cumsum(sizes), sizes, strict=True)]
        self.dimension = int(sum(sizes))

    def variables(self, xi: np.ndarray) -> list[gtsam.Pose2 | np.ndarray]:
        """MAP.retract(xi): the moved variables, in the order of `keys`."""
        return [
            value.retract(xi[part]) if isinstance(value, gtsam.Pose2) else value + xi[part]
            for value, part in zip(self._map, self._slices, strict=True)
        ]

    def __call__(self, xi: np.ndarray) -> float:
        """-factor * sum of error() at a (d,) tangent vector, [nats]."""
        for key, value in zip(self.keys, self.variables(xi), strict=True):
            self._moved.update(key, value)
        return -self.factor * self.factors.error(self._moved)


def _variable(values: gtsam.Values, key: int) -> gtsam.Pose2 | np.ndarray:
    is_pose = gtsam.Symbol(key).chr() == ord("x")
    return values.atPose2(key) if is_pose else values.atPoint2(key)
