"""Real range-only data: the Plaza sets with labels made wrong or taken away, and GOATS."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

from sngr_utils.files import formats, plaza
from sngr_utils.files.recording import Recording
from sngr_utils.metrics.alignment import aligned_errors, aligned_rmse, incremental_rmse, rigid
from sngr_utils.metrics.rmse_and_nees import nees
from sngr_utils.robust import diagnosis, growing_map, losses
from sngr_utils.robust.growing_map import GrownMap
from sngr_utils.slam import chain_problem, chain_solver, missed_steps
from sngr_utils.slam.aligned_covariance import aligned_covariances
from sngr_utils.slam.landmark_starts import start_landmarks
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import NO_LABEL, Log
from sngr_utils.world.truth import Truth
from sngr_utils.world.wrong_associations import wrong_associations

SETS = plaza.SETS[::-1]  # the shorter one first
OTHER = dict(zip(SETS, reversed(SETS), strict=True))  # the same radios on another day
BATCH = ("least_squares", "huber", "cauchy")
FAR = 5.0  # m, a held-out error that is told apart
INCREMENT = 10.0  # m of way, over which an incremental error is taken
CLUTTER, STRETCHED = 0.6, 1.2  # provoked: share of ranges from nothing, factor on all ranges
NAMELESS = ("no labels", "shuffled")  # labels that do not tell landmarks apart
COUNTED, MOST_LANDMARKS = 400, 6  # first poses by which radios are counted, and how many at most
KINDS = ("labels", "no labels", "clutter", "shuffled", "stretched", "cut")


def plaza_cells(seeds: range) -> list[tuple]:
    """Arguments of `run_plaza` for the whole study, the first seed first."""
    once = [(kind, 0.0, seeds[0]) for kind in KINDS]
    wrong = [("labels", p, seed) for seed in seeds for p in (0.2, 0.4, 0.6)]
    return [(name, *cell) for cell in once + wrong for name in SETS]


def run_plaza(name: str, kind: str, p: float, seed: int) -> list[dict]:
    """Every method on a Plaza set.

    Parameters
    ----------
    name : "Plaza1" or "Plaza2"
    kind : one of `KINDS`: labels wrong with probability p, none at all, or a failure provoked
    seed : of what is drawn

    Raises
    ------
    ValueError : another kind
    """
    recording = plaza.read(plaza.wheel(name))
    log, truth = changed(recording, kind, p, rng=np.random.default_rng(seed))
    head = {"set": name, "kind": kind, "p": p, "seed": seed}
    rows = []
    if kind == "labels":
        for method, poses in _batch(log):
            rows.append({**head, "method": method, **path_errors(log, truth, poses)})
    grown = growing_map.estimate(log)
    rows.append({
        **head,
        "method": "growing_map",
        **judged(grown, log, truth, kind not in NAMELESS),
        "landmarks_found": _counted(log) if kind == "no labels" else float("nan"),
    })
    return rows


def _counted(log: Log) -> int:
    return growing_map.count_landmarks(log.first(COUNTED), MOST_LANDMARKS)[0]


def changed(
    recording: Recording, kind: str, p: float, *, rng: np.random.Generator
) -> tuple[Log, Truth]:
    """The log and its truth, with what a kind of run does to them."""
    log, truth = recording.log, recording.truth
    count, k = len(log.ranges), log.n_landmarks
    if kind == "labels":
        return replace(log, label_of=wrong_associations(truth.source_of, k, p, rng=rng)), truth
    if kind == "no labels":
        return replace(log, label_of=np.full(count, NO_LABEL)), truth
    if kind == "clutter":
        nothing = rng.random(count) < CLUTTER
        drawn = rng.uniform(0, log.ranges.max(), count)
        sources = np.where(nothing, NO_LABEL, truth.source_of)
        return (
            replace(log, ranges=np.where(nothing, drawn, log.ranges)),
            replace(truth, source_of=sources),
        )
    if kind == "shuffled":
        return replace(log, label_of=rng.permutation(log.label_of)), truth
    if kind == "stretched":
        return replace(log, ranges=STRETCHED * log.ranges), truth
    if kind == "cut":
        odometry = log.odometry.copy()
        odometry[len(odometry) // 2 :] = 0
        return replace(log, odometry=odometry), truth
    raise ValueError(f"kind is {kind!r}: it must be one of {', '.join(KINDS)}")


def _batch(log: Log) -> list[tuple[str, np.ndarray]]:
    """(T, 3) poses of dead reckoning and of each loss, the noise as the log gives it."""
    poses = dead_reckoning(log.x0_mean, log.odometry)
    found = [("dead_reckoning", poses)]
    landmarks = start_landmarks(log, poses, "grid")
    chain = free_chain(log, landmarks)
    for method in BATCH:
        loss = losses.LOSSES[method]
        solved = chain_solver.solve(chain, poses, landmarks, loss, chain_solver.CERES)
        found.append((method, solved.poses))
    return found


def free_chain(log: Log, landmarks: np.ndarray) -> chain_problem.Chain:
    """The problem of a log, labels believed, nothing known of the landmarks (K, 2) but a start."""
    return chain_problem.of_log(log, landmarks, growing_map.WIDE * float(log.ranges.max()))


def path_errors(log: Log, truth: Truth, poses: np.ndarray) -> dict:
    """Aligned RMSE over the poses that have ranges, and incremental, [m]."""
    heard = np.unique(log.pose_of)
    ours, theirs = poses[heard, :2], truth.poses[heard, :2]
    return {
        "rmse": heard_rmse(log, truth, poses),
        "incremental": incremental_rmse(ours, theirs, INCREMENT),
    }


def heard_rmse(log: Log, truth: Truth, poses: np.ndarray) -> float:
    """Aligned RMSE over the poses that have ranges, [m].

    All methods are compared so: what they say of a silence of minutes is odometry.
    """
    heard = np.unique(log.pose_of)
    return aligned_rmse(poses[heard, :2], truth.poses[heard, :2])


def told_truly(log: Log, truth: Truth) -> Log:
    """The log with the true label of each range, without ranges from nothing: the oracle's."""
    sources = truth.source_of[: len(log.ranges)]
    return replace(log, label_of=sources, label_probabilities=None).keep(sources != NO_LABEL)


def least_squares(log: Log, poses: np.ndarray, landmarks: np.ndarray) -> chain_solver.Estimate:
    """Labels believed, nothing known of the landmarks, from a start."""
    chain = free_chain(log, landmarks)
    return chain_solver.solve(chain, poses, landmarks, LEAST_SQUARES, chain_solver.CERES)


def judged(grown: GrownMap, log: Log, truth: Truth, named: bool) -> dict:
    """What a grown map is worth, and what it says of itself.

    Parameters
    ----------
    named : whether landmarks are told apart by labels; else by most of their ranges
    """
    soft, noise = grown.soft, grown.noise
    credited, used = soft.responsibilities.argmax(axis=1), soft.weights[:, -1] < 0.5
    if not named:
        credited = _renamed(credited, truth.source_of, log.n_landmarks)
    right = used & (credited == truth.source_of)
    heard = np.unique(log.pose_of)
    calibration, sigmas = soft.calibration.tolist(), grown.calibration_sigmas.tolist()
    oracle = least_squares(told_truly(noise.log, truth), soft.poses, soft.landmarks)
    return {
        **path_errors(log, truth, soft.poses),
        "oracle": heard_rmse(log, truth, oracle.poses),
        "nees": aligned_nees(*soft.minimum, soft.position_covariances, soft.missed, heard, truth),
        "missed_steps": len(soft.missed.poses),
        "precision": float(right.sum() / max(used.sum(), 1)),
        "recall": float(right.sum() / np.count_nonzero(truth.source_of != NO_LABEL)),
        "share_wrong": soft.shares.wrong,
        "clutter": soft.shares.clutter,
        "scale": calibration[0],
        "scale_sigma": sigmas[0],
        "offset": calibration[1],
        "range_sigma": float(np.median(noise.log.range_sigmas)),
        **{name.replace(" ", "_"): value for name, value in noise.sigmas.items()},
        "unexplained": grown.unexplained,
        "doubtful": bool(grown.doubts),
    }


def aligned_nees(
    chain: chain_problem.Chain,
    at: chain_solver.State,
    covariances: np.ndarray,
    missed: missed_steps.Missed,
    heard: np.ndarray,
    truth: Truth,
) -> float:
    """NEES of the positions of some poses after their alignment; see `aligned_covariances`."""
    estimate, true = at.frames[heard, :2], truth.poses[heard, :2]
    rotation, _ = rigid(estimate, true)
    found = aligned_covariances(chain, at, covariances, heard, missed.poses)
    return nees(aligned_errors(estimate, true), rotation @ found @ rotation.T)


def _renamed(credited: np.ndarray, sources: np.ndarray, n_landmarks: int) -> np.ndarray:
    """Landmarks under the names with which most ranges are credited rightly."""
    names = itertools.permutations(range(n_landmarks))
    best = max(names, key=lambda name: np.count_nonzero(np.array(name)[credited] == sources))
    return np.array(best)[credited]


def run_goats(number: int) -> list[dict]:
    """A GOATS set, judged by every tenth range, which the estimate does not see.

    Residuals of the ranges that it does see have heavier tails than a Gaussian (`kurtosis`), most
    of them on the side of an echo (`too_long`, of those that are far off), so the held-out errors
    are given after Huber's loss too.

    Parameters
    ----------
    number : 15 or 16
    """
    import gtsam

    recording = formats.read(Path(gtsam.findExampleDataFile(f"goats_{number}.pyfg")))
    log = recording.log
    held = np.arange(len(log.ranges)) % diagnosis.HELD_OUT == 0
    grown = growing_map.estimate(log.keep(~held))
    soft, asked, seen = grown.soft, log.keep(held), grown.noise.log
    chain = free_chain(seen, soft.landmarks)
    doubted = chain_solver.solve(
        chain, soft.poses, soft.landmarks, losses.LOSSES["huber"], chain_solver.CERES
    )
    errors = np.abs(_missed(asked, soft.poses, soft.landmarks))
    left = _missed(seen, soft.poses, soft.landmarks)
    far = left[np.abs(left) > FAR]
    left = left[soft.weights[:, -1] < 0.5]
    return [{
        "set": f"goats_{number}", "held_out": int(held.sum()),
        "median": float(np.median(errors)),
        "median_error": _error_of_median(errors, rng=np.random.default_rng(number)),
        "ninth_decile": float(np.quantile(errors, 0.9)),
        "seen_far": len(far), "too_long": float(np.mean(far > 0)),
        "median_huber": float(np.median(np.abs(_missed(asked, doubted.poses, doubted.landmarks)))),
        "kurtosis": float(stats.kurtosis(left, fisher=False)),
        "beacons_rmse": aligned_rmse(soft.landmarks, recording.truth.landmarks),
        "clutter": soft.shares.clutter,
        **dict(zip(("beacon_sigma_least", "beacon_sigma_most"), _widest(grown), strict=True)),
    }]  # fmt: skip


def _missed(log: Log, poses: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """(M,) by how much ranges are longer than what an estimate foretells by label, [m]."""
    return log.ranges - np.linalg.norm(landmarks[log.label_of] - poses[log.pose_of, :2], axis=1)


def _error_of_median(values: np.ndarray, *, rng: np.random.Generator) -> float:
    """Standard error of a median, by the bootstrap."""
    found = stats.bootstrap((values,), np.median, n_resamples=500, method="percentile", rng=rng)
    return float(found.standard_error)


def _widest(grown: GrownMap) -> tuple[float, float]:
    """Least and largest, over the beacons, of the sigma on the longest axis, [m]."""
    joint, n = grown.noise.estimate.covariance.landmarks, len(grown.soft.landmarks)
    blocks = [joint[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(n)]
    sigmas = np.sqrt(np.linalg.eigvalsh(blocks)[:, -1])
    return float(sigmas.min()), float(sigmas.max())
