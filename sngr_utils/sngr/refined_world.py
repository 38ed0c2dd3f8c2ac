"""One world refined, and what SNGR made of it (paper, section "Refinement")."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sngr_utils.metrics.rmse_and_nees import nees, rmse
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.marginals import position_covariances
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import algorithm
from sngr_utils.sngr.algorithm import Sampling
from sngr_utils.sngr.baseline import Baseline
from sngr_utils.sngr.closure import conditional_covariance
from sngr_utils.sngr.gate import Gate
from sngr_utils.sngr.refine import RefinedWindow
from sngr_utils.sngr.windows import window_keys
from sngr_utils.world.dead_reckoning import dead_reckoning


@dataclass(frozen=True)
class RefinedWorld:
    """SNGR on one world.

    Attributes
    ----------
    baseline : iSAM2 and the trigger
    solution : the estimate before refinement: iSAM2's, or a settled one
    windows : the refined windows, ascending
    poses : (T, 3) after all accepted windows were applied, [m, m, rad]
    pose_rmse, solution_rmse : after refinement and before, [m]
    nees : after refinement, with the covariances of `solution`
    """

    baseline: Baseline
    solution: Solution
    windows: list[RefinedWindow]
    poses: np.ndarray
    pose_rmse: float
    solution_rmse: float
    nees: float

    @property
    def accepted(self) -> int:
        return sum(window.accepted for window in self.windows)

    @property
    def gains(self) -> np.ndarray:
        """(n,) delta log p of the refined windows, [nats]"""
        return np.array([window.delta_logp for window in self.windows])

    @property
    def median_gain(self) -> float:
        """[nats]; NaN if no window was refined"""
        return float(np.median(self.gains)) if self.windows else float("nan")

    @property
    def largest_gain(self) -> float:
        """[nats]; NaN if no window was refined"""
        return float(self.gains.max()) if self.windows else float("nan")

    @property
    def rmse_change(self) -> float:
        """Pose RMSE after refinement less before, [mm]"""
        return 1e3 * (self.pose_rmse - self.baseline.pose_rmse)

    @property
    def ess_shares(self) -> np.ndarray:
        """(n,) effective sample size of the refined windows as a share of their samples"""
        return np.array([window.run.ess_share for window in self.windows])

    @property
    def odometry_rmse(self) -> float:
        """Of dead reckoning from the true first pose, for scale, [m]"""
        true = self.baseline.world.poses
        dead = dead_reckoning(true[0], self.baseline.world.odometry)
        return rmse(dead[:, :2], true[:, :2])

    def spread_ratios(self, window: RefinedWindow) -> tuple[float, float]:
        """Sampled standard deviation over the marginal, and over the conditional with rest held.

        Geometric means over the window's nine coordinates.
        """
        graph, estimate = self.solution.graph, self.solution.estimate
        marginal = self.baseline.covariances[window.t]
        conditional = conditional_covariance(graph, estimate, window_keys(window.t))

        def ratio(reference):
            variances = np.diag(window.run.covariance) / np.diag(reference)
            return float(np.exp(0.5 * np.mean(np.log(variances))))

        return ratio(marginal), ratio(conditional)


def refine_world(
    base: Baseline,
    conventions: Conventions,
    fires: Callable[[np.ndarray], np.ndarray],
    sampling: Sampling,
    gate: Gate,
    *,
    rng: np.random.Generator,
) -> RefinedWorld:
    """SNGR on the world of a baseline, judged as iSAM2 was; see `algorithm.run`."""
    refined = algorithm.run(base.world, conventions, fires, sampling, gate, base, rng=rng)
    solution, true = refined.solution, base.world.poses[:, :2]
    covariances = position_covariances(solution, conventions.nees_frame)
    before, after = solution.poses[:, :2], refined.poses[:, :2]
    return RefinedWorld(
        base,
        solution,
        refined.windows,
        refined.poses,
        pose_rmse=rmse(after, true),
        solution_rmse=rmse(before, true),
        nees=nees(after - true, covariances),
    )
