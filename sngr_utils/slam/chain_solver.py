"""Levenberg-Marquardt on a chain of poses and its landmarks, compiled, linear in the poses.

Every step eliminates the poses, in order, onto the border (landmarks, range scale and offset).
How to damp, when to accept a step and when to stop is decided as GTSAM decides, so that it ends
in the minimum where `gtsam.LevenbergMarquardtOptimizer` does. Robust losses are reweighted at
every linearisation.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam import damped_step, information
from sngr_utils.slam.chain_cost import State, cost, linearise
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.information import System
from sngr_utils.slam.range_loss import Loss
from sngr_utils.slam.selected_inverse import ChainCovariance, conclude, eliminate_poses
from sngr_utils.world import checks

EPSILON = 2.0**-52
FIDELITY = 1e-3  # of the decrease that the linearised cost promises, a step must keep so much


class Policy(NamedTuple):
    """GTSAM's parameters of Levenberg-Marquardt, and its two ways of damping.

    Attributes
    ----------
    damping, factor : lambda at first, and by what it grows after a step that fails
    lowest, highest : between which lambda is kept; above the highest, no step is found
    scaled : damp by the diagonal of the information, lambda falls by the quality of a step, and
        the factor doubles (Ceres' rule); else by the identity, lambda falls by the factor
    most_steps : that are accepted
    relative, absolute : decrease of the cost, of itself and as it is, at which it has converged
    """

    damping: float
    factor: float
    lowest: float
    highest: float
    scaled: bool
    most_steps: int
    relative: float
    absolute: float


CERES = Policy(1e-4, 2.0, 1e-16, 1e32, True, 50, 1e-6, 0.0)  # GTSAM's CeresDefaults
THOROUGH = CERES._replace(most_steps=500, relative=1e-10, absolute=1e-10)
# GTSAM's defaults, but that its lambda may fall to 0, which no factor raises again: a hang
LEGACY = Policy(1e-5, 10.0, 1e-300, 1e5, False, 100, 1e-5, 1e-5)


@compile_once
def minimise(chain, loss, policy, at):
    """From the point `at` to a minimum of `chain_cost.cost`; `at` is used up.

    Returns the point, its cost, the number of steps, and whether it has converged.

    Source: Levenberg, Quarterly of Applied Mathematics 2, 1944; Madsen, Nielsen, Tingleff,
    Methods for non-linear least squares problems, 2004, on the damping; GTSAM's decisions.
    """
    to = State(at.frames.copy(), at.landmarks.copy(), at.calibration.copy(), at.residuals.copy())
    steps = np.empty((len(at.frames), 3))
    border = np.empty(at.landmarks.size + (chain.columns[0] >= 0) + (chain.columns[1] >= 0))
    now, damping, factor = cost(chain, loss, at), policy.damping, policy.factor
    for n in range(policy.most_steps):
        if now <= 0.0:
            return at, now, n, True
        system = linearise(chain, loss, at)
        before, good = now, False
        while not good:  # lambda grows by a factor every time, and there is a highest
            then = np.inf
            promised = damped_step.solve(system, damping, policy.scaled, steps, border)
            if promised >= 0.0:
                damped_step.move(at, steps, border, chain.columns, to)
                then = cost(chain, loss, to)
            decrease = before - then
            good = promised > EPSILON * before and decrease > FIDELITY * promised
            if good:
                at, to, now = to, at, then
                damping, factor = _relaxed(policy, damping, factor, decrease / promised)
            elif abs(decrease) < policy.relative * before:
                break
            else:
                damping *= factor
                factor *= 2.0 if policy.scaled else 1.0
                if damping >= policy.highest:
                    break
        if before - now <= max(policy.relative * before, policy.absolute):
            return at, now, n + 1, True
    return at, now, policy.most_steps, False


@compile_once
def _relaxed(policy, damping, factor, fidelity):
    """Lambda and its factor after a step that has decreased the cost by `fidelity` of a promise."""
    if policy.scaled:
        damping *= max(1.0 / 3.0, 1.0 - (2.0 * fidelity - 1.0) ** 3)
        return max(damping, policy.lowest), policy.factor
    return max(damping / factor, policy.lowest), factor


@dataclass(frozen=True)
class Estimate:
    """The minimum that `solve` found, or where it stopped.

    Attributes
    ----------
    poses, landmarks : (T, 3) [m, m, rad] and (K, 2) [m]; NaN for a landmark that is absent
    calibration : (2,) range scale, and offset [m]
    residuals : (N,) of the ranges, [m]; 0 for one of no landmark or of no weight
    cost : minus the log posterior but for a constant, [nats]
    steps : how many it took
    converged : False if it has used up the steps of its policy
    """

    poses: np.ndarray
    landmarks: np.ndarray
    calibration: np.ndarray
    residuals: np.ndarray
    cost: float
    steps: int
    converged: bool
    _system: System  # at the estimate, poses eliminated
    _joint: np.ndarray  # covariance of the border

    @cached_property
    def covariance(self) -> ChainCovariance:
        """All blocks from one selected inverse; a loss counts with its weights at the estimate."""
        system = System(*(block.copy() for block in self._system))
        return conclude(system, self._joint, self.landmarks)

    @property
    def log_determinant(self) -> float:
        """Of the information of all that is estimated, [nats] in units of m and rad."""
        poses = np.linalg.slogdet(self._system.own)[1].sum()
        return float(-poses - np.linalg.slogdet(self._joint)[1])

    @property
    def position_covariances(self) -> np.ndarray:
        """(T, 2, 2) in the world frame, [m^2]"""
        cos, sin = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        return information.in_world_frame(self.covariance.poses[:, :2, :2], cos, sin)

    @property
    def calibration_covariance(self) -> np.ndarray:
        """(B, B) of those of range scale and offset that are estimated"""
        return self._joint[self.landmarks.size :, self.landmarks.size :]


def solve(
    chain: Chain, poses: np.ndarray, landmarks: np.ndarray, loss: Loss, policy: Policy
) -> Estimate:
    """Minimise the cost of a chain from a start.

    Parameters
    ----------
    poses, landmarks : (T, 3) [m, m, rad] and (K, 2) [m]; NaN for a landmark that is absent

    Raises
    ------
    ValueError : a start that does not fit or is not finite; a landmark, or the range scale or
        offset, that the data leave open
    """
    return concluded(chain, loss, *minimise(chain, loss, policy, state_of(chain, poses, landmarks)))


def concluded(chain: Chain, loss: Loss, at: State, least: float, steps: int, converged: bool):
    """The `Estimate` that `minimise` has found, with the information at it."""
    system = linearise(chain, loss, at)
    joint = eliminate_poses(system, len(at.landmarks))
    found = information.poses_of(at.frames), at.landmarks, at.calibration, at.residuals
    return Estimate(*found, least, steps, converged, system, joint)


def state_of(chain: Chain, poses: np.ndarray, landmarks: np.ndarray) -> State:
    """A start that compiled code may read and write.

    Raises
    ------
    ValueError : as `solve`
    """
    poses = checks.finite("poses", poses, (len(chain.motions) + 1, 3))
    landmarks = checks.floats("landmarks", landmarks, chain.landmark_means.shape)
    finite = np.isfinite(landmarks)
    if not finite.all():
        known = finite.all(axis=1) | np.isnan(landmarks).all(axis=1)
        checks.refuse(
            "landmarks", landmarks, ~known, "it must be finite, or NaN for one that is absent"
        )
    frames, calibration = information.frames_of(poses), chain.calibration_means.copy()
    return State(frames, landmarks, calibration, np.zeros(len(chain.ranges)))
