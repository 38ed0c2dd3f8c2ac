"""EM over the batch: poses, landmarks and the shares of wrong labels and of clutter together.

The posterior of the associations alternates with a weighted least-squares estimate.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sngr_utils.numerics.jit import compile_once
from sngr_utils.robust import louis_covariance
from sngr_utils.robust.association import (
    JEFFREYS,
    NEGLIGIBLE,
    RARE,
    Shares,
    model_of,
    sources,
    updated,
)
from sngr_utils.slam import (
    chain_problem,
    chain_solver,
    information,
    landmark_starts,
    missed_steps,
)
from sngr_utils.slam.chain_cost import State
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world import dead_reckoning
from sngr_utils.world.log import Log

WIDEST = 6.0  # range sigmas that the annealed one starts with: a landmark start errs that much
COOLING = 0.7  # per iteration
ANCHOR = 1e6  # times the information on the first pose, which makes it as good as known

ITERATIONS, SETTLED = 60, 1e-3  # of EM: at most, and range sigmas that no position then moves


@dataclass(frozen=True)
class SoftEstimate:
    """What EM found. M ranges, K landmarks.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN where none was started
    calibration : (2,) range scale, and offset [m]
    weights : (M, K+1) posterior of each range's source, the last column "none of these"
    shares : of wrong labels and of clutter, estimated
    chain : what it was found from, every range once
    """

    poses: np.ndarray
    landmarks: np.ndarray
    calibration: np.ndarray
    weights: np.ndarray
    shares: Shares
    chain: Chain

    @property
    def responsibilities(self) -> np.ndarray:
        """(M, K) posterior that a range came from a landmark"""
        return self.weights[:, :-1]

    @cached_property
    def position_covariances(self) -> np.ndarray:
        """(T, 2, 2) in the world frame, [m^2], with what the associations leave open"""
        return self._covariances(self.chain)

    @property
    def minimum(self) -> tuple[Chain, State]:
        """The problem with weighted ranges whose minimum this is, and the minimum."""
        chain = chain_problem.weighted(self.chain, self.weights, 1.0, NEGLIGIBLE)
        return chain, self._at(chain)

    @cached_property
    def missed(self) -> missed_steps.Missed:
        """Steps of the odometry that err by more than their noise, on which no covariance counts"""
        return missed_steps.find(*self.minimum)

    def moved(self, by: np.ndarray) -> float:
        """Length of (T, 3) moves of the poses over that of the errors of their positions.

        Both in the mean square. The errors are those given the first pose: what all poses err by
        together is the same in every estimate.
        """
        return float(np.sqrt(np.sum(by[:, :2] ** 2) / self._spread))

    @cached_property
    def _spread(self) -> float:
        """Squared errors of the positions that are expected, given the first pose, [m^2]."""
        known = self.chain._replace(prior_information=ANCHOR * self.chain.prior_information)
        return float(np.trace(self._covariances(known), axis1=1, axis2=2).sum())

    def _covariances(self, chain: Chain) -> np.ndarray:
        """(T, 2, 2) of the positions, [m^2]."""
        return louis_covariance.position_covariances(chain, self._at(chain), self.weights)

    def _at(self, chain: Chain) -> State:
        at = chain_solver.state_of(chain, self.poses, self.landmarks)
        return at._replace(calibration=self.calibration)


def estimate(
    log: Log, conventions: Conventions, start: str, *, exclusive: bool, clutter: bool
) -> SoftEstimate:
    """EM over the batch from dead reckoning, landmarks started as `start` says.

    Parameters
    ----------
    start : one of `landmark_starts.STARTS`
    exclusive, clutter : as for `fit`

    Raises
    ------
    ValueError : unknown start
    """
    if start not in landmark_starts.STARTS:
        raise ValueError(f"start is {start!r}: it must be one of {sorted(landmark_starts.STARTS)}")
    poses = dead_reckoning.dead_reckoning(log.x0_mean, log.odometry)
    landmarks = landmark_starts.start_landmarks(log, poses, start)
    return fit(log, conventions, (poses, landmarks), exclusive=exclusive, clutter=clutter)


def fit(
    log: Log,
    conventions: Conventions,
    start: tuple[np.ndarray, np.ndarray],
    *,
    exclusive: bool,
    clutter: bool,
    widest: float = WIDEST,
) -> SoftEstimate:
    """EM from poses and landmarks to start from, the range sigma annealed from `widest` times.

    Each iteration: responsibilities at the present estimate, the shares from them, then
    Levenberg-Marquardt on ranges weighted by them. A wide sigma at first lets a range look
    beyond the landmark that a bad start makes likely.

    Parameters
    ----------
    start : (T, 3) poses [m, m, rad] and (K, 2) landmarks [m], NaN for one that is not in the map
    exclusive : no two ranges of a scan come from the same landmark
    clutter : a range may come from no landmark, and the share of those is estimated; else there
        are none

    Source: Dempster, Laird, Rubin, JRSS B 39, 1977; soft association in SLAM: Bowman et al.,
    ICRA 2017; annealing: Ueda, Nakano, Neural Networks 11, 1998.
    """
    chain = chain_problem.of_log(log, start[1], conventions.landmark_prior_sigma)
    first = RARE[0] / sum(RARE) if clutter else 0.0
    still = SETTLED * np.median(log.range_sigmas) if len(log.ranges) else 0.0
    at, weights, *shares = _alternate(
        chain, model_of(log, exclusive), chain_solver.state_of(chain, *start), first, widest, still
    )
    poses = information.poses_of(at.frames)
    return SoftEstimate(poses, at.landmarks, at.calibration, weights, Shares(*shares), chain)


@compile_once
def _alternate(chain, model, at, clutter, width, still):
    """`fit`: the estimate, the sources of the ranges, and the shares."""
    wrong = JEFFREYS[0] / (JEFFREYS[0] + JEFFREYS[1])
    for n in range(ITERATIONS):
        before = at.frames.copy()
        weights = sources(model, at.frames, at.landmarks, at.calibration, wrong, clutter, width)
        wrong, clutter = updated(model, weights, at.landmarks, wrong, clutter, JEFFREYS)
        problem = chain_problem.weighted(chain, weights, width, NEGLIGIBLE)
        residuals = np.empty(len(problem.ranges))
        at = State(at.frames, at.landmarks, at.calibration, residuals)
        at = chain_solver.minimise(problem, LEAST_SQUARES, chain_solver.CERES, at)[0]
        moved = np.abs(at.frames[:, :2] - before[:, :2]).max()
        if n == ITERATIONS - 1 or (width == 1.0 and moved <= still):
            break
        width = max(1.0, COOLING * width)
    return at, weights, wrong, clutter
