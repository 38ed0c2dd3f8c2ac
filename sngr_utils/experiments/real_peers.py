"""Other people's estimators on the Plaza sets, all through one door.

Each is handed a log whose ranges are corrected by what the other drive shows, for not all can find
a scale (`real_online.calibrated`), and landmarks that start at the best cell of a grid over all
ranges, which is more than an incremental one could know.

Which other systems are not here, and why: `docs/other_systems.md`.
"""

import time
from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.experiments import estimators, real_data, real_online
from sngr_utils.files import plaza
from sngr_utils.robust import losses
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import landmark_prior, pose_prior, range_factor
from sngr_utils.slam.landmark_starts import start_landmarks
from sngr_utils.slam.solution import poses_of, values_of
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import Log

COMPILED = (
    "least_squares", "huber", "cauchy", "dcs", "geman_mcclure", "gnc_tls", "gnc_gm", "switchable",
    "max_mixture_null", "max_mixture_all", "em",
)  # fmt: skip
DIVERGED = 1e4  # m: farther off is no number
TIMES = ("pose_ms",)  # CPU time of a whole run, by the pose, [ms]
BATCH_STEP = 100  # updates of iSAM
WIDE = 100.0  # m, of a prior on a landmark: as far as the radios reach


def cells(seeds: range) -> list[tuple]:
    """Arguments of `run` for the whole study, the first seed first."""
    levels = [(0.0, seeds[0]), *((p, seed) for seed in seeds for p in (0.2, 0.4, 0.6))]
    return [(name, p, seed) for p, seed in levels for name in real_data.SETS]


def run(name: str, p: float, seed: int) -> list[dict]:
    """Every peer on a Plaza set, labels wrong with probability p."""
    rng = np.random.default_rng(seed)
    log, truth = real_data.changed(plaza.read(plaza.wheel(name)), "labels", p, rng=rng)
    log = real_online.calibrated(log, real_online.found_in(real_data.OTHER[name]))
    poses = dead_reckoning(log.x0_mean, log.odometry)
    start = poses, start_landmarks(log, poses, "grid")
    rows = []
    for method, solve in peers().items():
        before = time.process_time()
        found = solve(log, start)
        spent = time.process_time() - before
        errors = real_data.path_errors(log, truth, found)
        known = errors["rmse"] < DIVERGED
        rows.append({
            "set": name, "p": p, "seed": seed, "method": method,
            **{key: errors[key] if known else float("nan") for key in ("rmse", "incremental")},
            "pose_ms": 1e3 * spent / log.n_poses,
        })  # fmt: skip
    return rows


def peers() -> dict[str, Callable[[Log, losses.Estimate], np.ndarray]]:
    """(T, 3) poses of each method from a log and a start."""
    wide = Conventions(landmark_prior_sigma=WIDE)

    def compiled(method: str) -> Callable:
        return lambda log, start: estimators.batch(log, wide, method, start).poses

    return {
        **{method: compiled(method) for method in COMPILED},
        "gnc_tls_superlinear": gnc,
        "isam": isam,
        "isam2": isam2,
    }


def gnc(log: Log, start: losses.Estimate) -> np.ndarray:
    """GTSAM's truncated least squares by graduated non-convexity, its faster schedule.

    The slower one is "gnc_tls", which agrees with GTSAM's to a hundredth of a millimetre.
    """
    graph = gtsam.NonlinearFactorGraph()
    for t in range(log.n_poses):
        graph.push_back(_step(log, t, start[1])[0])
    n_sure = graph.size()
    for m, t in enumerate(log.pose_of):
        graph.push_back(range_factor(int(t), *_range(log, m)))
    params = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams.CeresDefaults())
    params.setLossType(gtsam.GncLossType.TLS)
    params.setScheduler(gtsam.GncScheduler.SuperLinear)
    params.setKnownInliers(list(range(n_sure)))
    optimizer = gtsam.GncLMOptimizer(graph, values_of(*start), params)
    optimizer.setInlierCostThresholds(losses.GNC_SQUARED / 2)
    return poses_of(optimizer.optimize(), log.n_poses)


def isam(log: Log, start: losses.Estimate) -> np.ndarray:
    """iSAM, which takes no tangent anew but in a batch step every hundred updates.

    Source: Kaess, Ranganathan, Dellaert, Transactions on Robotics 24, 2008, who choose a hundred.
    """
    solver = gtsam.NonlinearISAM(BATCH_STEP)
    return _incremental(log, start, solver.update, lambda: solver.estimate())


def isam2(log: Log, start: losses.Estimate) -> np.ndarray:
    """iSAM2 with its own defaults, an update for each pose."""
    solver = gtsam.ISAM2(gtsam.ISAM2Params())
    return _incremental(log, start, solver.update, solver.calculateEstimate)


def _incremental(
    log: Log, start: losses.Estimate, update: Callable, read: Callable[[], gtsam.Values]
) -> np.ndarray:
    newest = gtsam.Pose2(*log.x0_mean)
    for t in range(log.n_poses):
        graph, values = _step(log, t, start[1])
        if t:
            values.insert(X(t), newest.compose(gtsam.Pose2(*log.odometry[t - 1])))
        for m in np.flatnonzero(log.pose_of == t):
            graph.push_back(range_factor(t, *_range(log, m)))
        update(graph, values)
        newest = read().atPose2(X(t))
    return poses_of(read(), log.n_poses)


def _step(log: Log, t: int, landmarks: np.ndarray):
    """Factors that cannot be outliers of pose t, and start values of what is new but the pose."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    if t:
        noise = gtsam.noiseModel.Gaussian.Covariance(log.odometry_covariances[t - 1])
        motion = gtsam.Pose2(*log.odometry[t - 1])
        graph.push_back(gtsam.BetweenFactorPose2(X(t - 1), X(t), motion, noise))
        return graph, values
    graph.push_back(pose_prior(log.x0_mean, list(log.x0_sigmas)))
    values.insert(X(0), gtsam.Pose2(*log.x0_mean))
    for k, place in enumerate(landmarks):
        graph.push_back(landmark_prior(k, place, WIDE))
        values.insert(L(k), place)
    return graph, values


def _range(log: Log, m: int) -> tuple[int, float, float]:
    """Landmark by its label, distance and sigma of a range."""
    return int(log.label_of[m]), float(log.ranges[m]), float(log.range_sigmas[m])
