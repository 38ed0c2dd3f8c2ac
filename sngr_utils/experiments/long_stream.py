"""A robot that drives on and on: what a step of the online estimator costs, and what it holds."""

import resource
import time

import numpy as np

from sngr_utils.online import estimator
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import World

STREAM = 91  # of random numbers, beside the seed of the world
SETTLING = 1000  # poses before a trend is looked for
PARTS = 9  # into which the poses after them are divided
KIBIBYTES = 1024  # in a mebibyte


def drive(n_poses: int, p: float, seed: int) -> World:
    """Many rounds of the paper's circle, one range a pose, to landmarks in turn."""
    rng = np.random.default_rng(seed)
    (association_rng,) = rng.spawn(1)
    scenario = Scenario()
    round_ = simulation.circle_poses(scenario.n_poses, scenario.radius)
    poses = np.tile(round_, (-(-n_poses // len(round_)), 1))[:n_poses]
    half, k = scenario.landmark_half_width, scenario.n_landmarks
    landmarks = rng.uniform(-half, half, (k, 2))
    world = simulation.measure(
        poses, landmarks, scenario, p, rng=rng, association_rng=association_rng
    )
    order = np.concatenate([rng.permutation(k) for _ in range(-(-n_poses // k))])[:n_poses]
    return world.keep(world.source_of == order[world.pose_of])


def rows(n_poses: int, p: float, seed: int) -> list[dict]:
    """CPU time of the steps, part by part, memory, and how far the newest pose is from the truth.

    The final estimate of all poses is not asked for: a stream has no end.
    """
    world, conventions = drive(n_poses, p, seed), PRESETS["C"]
    log = world.log(conventions.x0_sigmas)
    rng = np.random.default_rng([seed, STREAM])
    online = estimator.Online(log.first(1), conventions, estimator.Settings(), rng=rng)
    seconds, start = np.empty(n_poses - 1), _memory()
    for t in range(1, n_poses):
        measured, before = log.measurements(t), time.thread_time()
        online.step(measured)
        seconds[t - 1] = time.thread_time() - before
    later = np.array_split(seconds[SETTLING:], PARTS)
    errors = np.linalg.norm(np.array(online.filtered)[:, :2] - world.poses[:, :2], axis=1)
    common = {
        "n_poses": n_poses, "p": p, "seed": seed, "median_ms": 1e3 * float(np.median(seconds)),
        "most_ms": 1e3 * float(seconds.max()), "mebibytes": _memory() - start,
        "filtered_rmse": float(np.sqrt(np.mean(errors**2))),
        "restarts": online.belief.counts["batch trials"],
    }  # fmt: skip
    return [
        {**common, "part": i, "part_median_ms": 1e3 * float(np.median(part))}
        for i, part in enumerate(later)
    ]


def _memory() -> float:
    """The most memory this process has held, [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KIBIBYTES
