"""SNGR: the paper's Algorithm 1, with what may stand in for its steps as arguments."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import gtsam
import joblib
import numpy as np

from sngr_utils.sampling.weighted_samples import WeightedSamples
from sngr_utils.slam import isam2
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.solution import Solution, poses_of
from sngr_utils.sngr import refine, trigger, windows
from sngr_utils.sngr.baseline import Baseline
from sngr_utils.sngr.gate import Gate
from sngr_utils.world.simulation import World


class Sampling(Protocol):
    """What is sampled of a window, and how: `refine.Paper` or `corrected.Corrected`."""

    def settle(self, solution: Solution, covariances: np.ndarray) -> tuple[Solution, np.ndarray]:
        """The estimate to refine and its windows' (N, 9, 9) marginals, from those of iSAM2."""

    def targets(self, solution: Solution, which: np.ndarray, covariances: np.ndarray) -> list:
        """The posteriors of windows, `which` being their first poses.

        Each has its `log_density` at (d,) offsets from the estimate, the window's poses first.
        """

    def sample(self, target: Any, *, rng: np.random.Generator) -> WeightedSamples:
        """Weighted samples of one of them."""


@dataclass(frozen=True)
class Refined:
    """What SNGR made of one world.

    Attributes
    ----------
    solution : the estimate before refinement
    windows : those that were sampled, ascending
    estimate : after all accepted windows were applied
    """

    solution: Solution
    windows: list[refine.RefinedWindow]
    estimate: gtsam.Values

    @property
    def poses(self) -> np.ndarray:
        """(T, 3) after refinement, [m, m, rad]"""
        return poses_of(self.estimate, self.solution.n_poses)


def run(
    the_world: World,
    conventions: Conventions,
    fires: Callable[[np.ndarray], np.ndarray],
    sampling: Sampling,
    gate: Gate,
    base: Baseline | None = None,
    marginals: Callable[[Solution], np.ndarray] = windows.covariances,
    *,
    rng: np.random.Generator,
) -> Refined:
    """SNGR on one world (paper, Algorithm 1).

    All windows start from the same estimate. Every window of the trajectory has a random stream
    of its own, so its result does not depend on which others are refined, on their order, or on
    how many are sampled at a time (``joblib.parallel_config(n_jobs=...)``).

    Parameters
    ----------
    fires : (N,) scores -> (N,) bool, which windows are refined: the paper's is `triggers`
    base : iSAM2 on this world, if at hand
    marginals : (N, 9, 9) marginal covariances of the windows of an estimate that is not at hand
    """
    solution = base.solution if base else isam2.run_isam2(the_world, conventions)
    covariances = base.covariances if base else marginals(solution)
    which = np.flatnonzero(fires(trigger.score(covariances)))
    solution, covariances = sampling.settle(solution, covariances)
    targets = sampling.targets(solution, which, covariances)
    streams = rng.spawn(len(covariances))
    runs = joblib.Parallel()(
        joblib.delayed(sampling.sample)(target, rng=streams[t])
        for t, target in zip(which, targets, strict=True)
    )
    pending = [
        refine.judge(solution, int(t), target.log_density, run, gate)
        for t, target, run in zip(which, targets, runs, strict=True)
    ]
    return Refined(solution, pending, refine.apply_updates(solution.estimate, pending))
