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
        own = [_variable(estimate, key) for key in keys]
        sizes = [3 if isinstance(v, gtsam.Pose2) else 2 for v in own]
        slices = [slice(e - n, e) for e, n in zip(np.cumsum(sizes).tolist(), sizes, strict=True)]
        moves = [v.retract if isinstance(v, gtsam.Pose2) else v.__add__ for v in own]
        self._moves = list(zip(keys, moves, slices, strict=True))
        self.dimension = sum(sizes)

    def variables(self, xi: np.ndarray) -> list[gtsam.Pose2 | np.ndarray]:
        """MAP.retract(xi): the moved variables, in the order of `keys`."""
        return [move(xi[part]) for _, move, part in self._moves]

    def __call__(self, xi: np.ndarray) -> float:
        """-factor * sum of error() at a (d,) tangent vector, [nats]."""
        for key, move, part in self._moves:
            self._moved.update(key, move(xi[part]))
        return -self.factor * self.factors.error(self._moved)


def _variable(values: gtsam.Values, key: int) -> gtsam.Pose2 | np.ndarray:
    is_pose = gtsam.Symbol(key).chr() == ord("x")
    return values.atPose2(key) if is_pose else values.atPoint2(key)
