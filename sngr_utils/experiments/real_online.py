"""The online estimator on the Plaza sets, with its parts and without some of them.

What the radios are like is first believed as found without truth in the *other* set, the same
radios on another day; scale and offset stay as open as a set leaves them, and are found on the
way. How the odometry errs differs between the sets, and is found in the first poses of the drive
itself, with its wrong labels.
"""

import functools
from dataclasses import replace

import numpy as np
from scipy import stats

from sngr_utils.experiments import real_data, real_stretch
from sngr_utils.files import plaza
from sngr_utils.metrics.alignment import aligned_rmse
from sngr_utils.online import calibration, estimator
from sngr_utils.robust import growing_map
from sngr_utils.robust.association import NEGLIGIBLE
from sngr_utils.slam import chain_problem, chain_solver, missed_steps
from sngr_utils.slam.landmark_starts import start_landmarks
from sngr_utils.slam.noise_estimation import step_covariances
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import NO_LABEL, Log
from sngr_utils.world.truth import Truth

VARIANTS = {
    "online": {},
    "no nested sampling": {"nested": False},
    "landmarks as in the paper": {"delayed": False},
}
# Newest poses are held against an oracle's at this share of wrong labels, one of so many of them
ORACLE_AT, EVERY = 0.4, 4
BESIDE = ("filtered_oracle", "filtered_beside")
TIMES, PARTS = ("step_ms", "step_ms_95", "step_ms_gain"), 10  # of a drive
WARM_UP = 400  # poses, three minutes and a half or less
PROVOKED = ("clutter", "shuffled", "stretched", "cut")  # kinds of `real_data`
ASKED = (
    "landmark questions", "mirror waits", "landmark samples", "position questions",
    "position samples", "batch restarts", "slips",
)  # fmt: skip


def cells(seeds: range) -> list[tuple]:
    """Arguments of `run` for the whole study: all with the first seed, the others as it is asked.

    That is with two wrong labels in five, the level at which an oracle stands beside.
    """
    first = [("labels", p, seeds[0], "online") for p in (ORACLE_AT, 0.2, 0.6)]
    others = [("labels", ORACLE_AT, seed, "online") for seed in seeds[1:]]
    once = [
        ("labels", 0.0, seeds[0], "online"),
        ("labels", ORACLE_AT, seeds[0], "landmarks as in the paper"),
        ("labels", 0.6, seeds[0], "no nested sampling"),  # with less it is not asked
        *((kind, 0.0, seeds[0], "online") for kind in PROVOKED),
    ]
    return [(name, *cell) for cell in first + once + others for name in real_data.SETS]


def run(name: str, kind: str, p: float, seed: int, variant: str) -> list[dict]:
    """One drive, pose by pose.

    Parameters
    ----------
    kind, p, seed : of what is changed, as for `real_data.run_plaza`
    variant : one of `VARIANTS`
    """
    rng = np.random.default_rng(seed)
    log, truth = real_data.changed(plaza.read(plaza.wheel(name)), kind, p, rng=rng)
    log = handed(log, found_in(real_data.OTHER[name]))
    settings = estimator.Settings(**VARIANTS[variant])
    found, seconds = real_stretch.drive(log, settings, rng=rng)
    head = {"set": name, "kind": kind, "p": p, "seed": seed, "method": variant}
    asked = kind == "labels" and p == ORACLE_AT and variant == "online"
    oracle = _oracle_beside(found, log, truth) if asked else dict.fromkeys(BESIDE, float("nan"))
    return [{**head, **judged(found, log, truth), **oracle, **times_of(seconds)}]


def times_of(seconds: np.ndarray) -> dict[str, float]:
    """CPU time of the steps: median and 95 % [ms], and what the median gains over a drive, [ms].

    The gain is the slope of the line through the medians of tenths of the drive, by Theil and Sen.
    """
    medians = [np.median(tenth) for tenth in np.array_split(1e3 * seconds, PARTS)]
    found = np.median(1e3 * seconds), np.quantile(1e3 * seconds, 0.95)
    gain = (PARTS - 1) * stats.theilslopes(medians).slope
    return dict(zip(TIMES, map(float, (*found, gain)), strict=True))


@functools.cache
def found_in(name: str) -> dict[str, float]:
    """What a Plaza set with its own labels shows, as a row of `real_data.run_plaza`."""
    recording = plaza.read(plaza.wheel(name))
    grown = growing_map.estimate(recording.log)
    return real_data.judged(grown, recording.log, recording.truth, True)


def handed(log: Log, found: dict[str, float]) -> Log:
    """A log with the radios as another day's, and the odometry's noise as its first poses show.

    Parameters
    ----------
    found : as a row of `real_data.run_plaza`: scale, offset, range_sigma
    """
    log = replace(
        log,
        range_sigmas=found["range_sigma"],
        scale=(found["scale"], log.scale[1]),
        offset=(found["offset"], log.offset[1]),
    )
    noise = growing_map.estimate(log.first(WARM_UP)).noise.sigmas
    return log.with_covariances(step_covariances(noise, log.odometry))


def calibrated(log: Log, found: dict[str, float]) -> Log:
    """A log with corrected ranges, and with the noise that its first poses show.

    Parameters
    ----------
    found : as for `handed`
    """
    known = {name: (found[name], 0.0) for name in ("scale", "offset")}
    told = handed(replace(log, **known), found)
    return calibration.of(told).corrected(told)


def filtered_oracle(log: Log, truth: Truth, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Least squares with the true labels of all ranges up to a pose: that pose, as it was then.

    Returns
    -------
    (N,) int poses, `every` of them, and their (N, 3) estimates
    """
    log = real_data.told_truly(log, truth)
    poses = dead_reckoning(log.x0_mean, log.odometry)
    landmarks, path = start_landmarks(log, poses, "grid"), poses[:1]
    asked, newest = np.arange(every, log.n_poses, every), []
    for t in asked:
        ahead = dead_reckoning(path[-1], log.odometry[len(path) - 1 : t])
        found = real_data.least_squares(log.first(t + 1), np.vstack([path, ahead[1:]]), landmarks)
        path, landmarks = found.poses, found.landmarks
        newest.append(path[-1])
    return asked, np.array(newest)


def _oracle_beside(found: estimator.OnlineEstimate, log: Log, truth: Truth) -> dict[str, float]:
    """Aligned RMSE of every few newest poses that heard a range: by the oracle, and found, [m]."""
    asked, poses = filtered_oracle(log, truth, EVERY)
    heard = np.isin(asked, log.pose_of)
    true = truth.poses[asked[heard], :2]
    paths = poses[heard, :2], found.filtered[asked[heard], :2]
    return {name: aligned_rmse(path, true) for name, path in zip(BESIDE, paths, strict=True)}


def judged(found: estimator.OnlineEstimate, log: Log, truth: Truth) -> dict:
    """Aligned errors [m], associations, who was asked how often, and what it says of itself."""
    used = found.used >= 0
    sources = truth.source_of[: len(used)]
    right = used & (found.used == sources)
    final, heard = real_data.path_errors(log, truth, found.poses), np.unique(log.pose_of)
    chain = real_data.free_chain(log, found.landmarks)
    chain = chain_problem.weighted(
        chain, np.eye(log.n_landmarks + 1)[found.used][:, :-1], 1.0, NEGLIGIBLE
    )
    at = chain_solver.state_of(chain, found.poses, found.landmarks)
    at = at._replace(calibration=found.calibration)
    missed = missed_steps.find(chain, at)
    oracle = real_data.least_squares(real_data.told_truly(log, truth), found.poses, found.landmarks)
    return {
        "final": final["rmse"],
        "incremental": final["incremental"],
        "graph": real_data.heard_rmse(log, truth, found.graph_poses),
        "filtered": real_data.heard_rmse(log, truth, found.filtered),
        "oracle": real_data.heard_rmse(log, truth, oracle.poses),
        "nees": real_data.aligned_nees(chain, at, found.position_covariances, missed, heard, truth),
        "missed_steps": len(missed.poses),
        "used": float(used.mean()),
        "right": float(right.sum() / max(used.sum(), 1)),  # of use where labels tell radios apart
        "recall": float(right.sum() / np.count_nonzero(sources != NO_LABEL)),
        "scale": float(found.calibration[0]),
        "share_wrong": found.p,
        "clutter": found.clutter,
        **{name.replace(" ", "_"): found.counts[name] for name in ASKED},
        "doubtful": found.diagnosis.doubtful,
        "reasons": "; ".join(found.diagnosis.reasons),
    }
