"""One world, one iSAM2 run, and what the trigger makes of it (paper, section "Baseline")."""

from dataclasses import dataclass

import numpy as np

from sngr_utils.metrics import precision_recall, rmse_and_nees
from sngr_utils.slam import isam2, marginals
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import failure, trigger, windows
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario


@dataclass(frozen=True)
class Baseline:
    """An iSAM2 run with its windows judged. T poses, N = T - 2 windows.

    Attributes
    ----------
    p, seed : wrong-association probability and seed of the world
    world, solution : the data and the MAP estimate
    covariances : (N, 9, 9) joint marginals of the windows
    scores : (N,) log10 condition numbers
    failed : (N,) bool, mean error above 0.5 m
    pose_rmse, landmark_rmse : [m]
    nees : average over the poses
    """

    p: float
    seed: int
    world: simulation.World
    solution: Solution
    covariances: np.ndarray
    scores: np.ndarray
    failed: np.ndarray
    pose_rmse: float
    landmark_rmse: float
    nees: float

    def fired(self, tau: float) -> np.ndarray:
        """(N,) bool: which windows trigger at `tau`."""
        return trigger.triggers(self.scores, tau)

    def fired_poses(self, tau: float) -> list[int]:
        """Poses of the windows that trigger at `tau`."""
        fired = np.flatnonzero(self.fired(tau))
        return sorted({int(t) + i for t in fired for i in range(windows.WIDTH)})

    @property
    def base_rate(self) -> float:
        """Share of the windows that may fire that failed: the precision of firing at random.

        NaN if the trajectory is so short that none may.
        """
        eligible = self.failed[trigger.FIRST_ELIGIBLE :]
        return float(eligible.mean()) if len(eligible) else float("nan")

    def detection(self, tau: float) -> precision_recall.Detection:
        """The trigger at `tau` against failure, over all N windows."""
        return precision_recall.detection(self.fired(tau), self.failed)


def run_baseline(scenario: Scenario, conventions: Conventions, p: float, seed: int) -> Baseline:
    """Simulate the world of `seed`, run iSAM2, score and judge every window."""
    the_world = simulation.simulate(scenario, p, rng=np.random.default_rng(seed))
    solution = isam2.run_isam2(the_world, conventions)
    errors = solution.poses[:, :2] - the_world.poses[:, :2]
    distances = np.hypot(errors[:, 0], errors[:, 1])
    covariances = windows.covariances(solution)
    position_covariances = marginals.position_covariances(solution, conventions.nees_frame)
    return Baseline(
        p=p,
        seed=seed,
        world=the_world,
        solution=solution,
        covariances=covariances,
        scores=trigger.score(covariances),
        failed=failure.failures(distances),
        pose_rmse=rmse_and_nees.rmse(solution.poses[:, :2], the_world.poses[:, :2]),
        landmark_rmse=rmse_and_nees.rmse(solution.landmarks, the_world.landmarks),
        nees=rmse_and_nees.nees(errors, position_covariances),
    )
