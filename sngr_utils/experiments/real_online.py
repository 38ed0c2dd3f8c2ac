"""The online estimator on the Plaza sets, with its parts and without some of them.

What the radios are like, scale, offset and noise, is handed to it as found without truth in the
*other* set: the same radios on another day. How the odometry errs differs between the sets, and is
found in the first poses of the drive itself, with its wrong labels.
"""

import functools
import warnings
from dataclasses import replace

import numpy as np

from sngr_utils.experiments import real_data
from sngr_utils.files import plaza
from sngr_utils.metrics.alignment import aligned_rmse
from sngr_utils.online import estimator
from sngr_utils.online.diagnosis import DoubtWarning
from sngr_utils.robust import growing_map
from sngr_utils.settings import READING
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.slam.noise_estimation import step_covariances
from sngr_utils.world.log import Log
from sngr_utils.world.truth import Truth

VARIANTS = {
    "online": {},
    "no nested sampling": {"nested": False},
    "landmarks as in the paper": {"delayed": False},
}
WARM_UP = 400  # poses, three minutes and a half or less
PROVOKED = ("clutter", "shuffled", "stretched", "cut")  # kinds of `real_data`
ASKED = (
    "landmark questions", "mirror waits", "landmark samples", "position questions",
    "position samples", "batch restarts", "slips",
)  # fmt: skip


def cells(seeds: range) -> list[tuple]:
    """Arguments of `run` for the whole study, the first seed with all that is done once first."""
    first, *others = ([("labels", p, seed, "online") for p in (0.4, 0.2, 0.6)] for seed in seeds)
    once = [
        ("labels", 0.0, seeds[0], "online"),
        *(("labels", 0.4, seeds[0], variant) for variant in VARIANTS if variant != "online"),
        *((kind, 0.0, seeds[0], "online") for kind in PROVOKED),
    ]
    return [(name, *cell) for cell in sum(others, first + once) for name in real_data.SETS]


def run(name: str, kind: str, p: float, seed: int, variant: str) -> list[dict]:
    """One drive, pose by pose.

    Parameters
    ----------
    kind, p, seed : of what is changed, as for `real_data.run_plaza`
    variant : one of `VARIANTS`
    """
    rng = np.random.default_rng(seed)
    log, truth = real_data.changed(plaza.read(plaza.wheel(name)), kind, p, rng=rng)
    log, settings = (
        calibrated(log, found_in(real_data.OTHER[name])),
        estimator.Settings(**VARIANTS[variant]),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)  # kept as a column
        found = estimator.run(log, PRESETS[READING], settings, rng=rng)
    head = {"set": name, "kind": kind, "p": p, "seed": seed, "method": variant}
    return [{**head, **judged(found, truth)}]


@functools.cache
def found_in(name: str) -> dict[str, float]:
    """What a Plaza set with its own labels shows, as a row of `real_data.run_plaza`."""
    recording = plaza.read(plaza.wheel(name))
    grown = growing_map.estimate(recording.log)
    return real_data.judged(grown, recording.log, recording.truth, True)


def calibrated(log: Log, found: dict[str, float]) -> Log:
    """A log with corrected ranges, and with the noise that its first poses show.

    Parameters
    ----------
    found : as a row of `real_data.run_plaza`: scale, offset, range_sigma
    """
    log = replace(
        log,
        ranges=(log.ranges - found["offset"]) / found["scale"],
        range_sigmas=found["range_sigma"] / found["scale"],
        scale=(1.0, 0.0),
        offset=(0.0, 0.0),
    )
    noise = growing_map.estimate(log.first(WARM_UP)).noise.sigmas
    return log.with_covariances(step_covariances(noise, log.odometry))


def judged(found: estimator.OnlineEstimate, truth: Truth) -> dict:
    """Aligned errors [m], associations, who was asked how often, and what it says of itself."""
    n, used = len(found.poses), found.used >= 0
    right = used & (found.used == truth.source_of[: len(used)])
    errors = {
        name: aligned_rmse(poses[:, :2], truth.poses[:n, :2])
        for name, poses in (
            ("final", found.poses), ("graph", found.graph_poses), ("filtered", found.filtered),
        )
    }  # fmt: skip
    return {
        **errors,
        "used": float(used.mean()),
        "right": float(right.sum() / max(used.sum(), 1)),  # of use where labels tell radios apart
        "share_wrong": found.p,
        "clutter": found.clutter,
        **{name.replace(" ", "_"): found.counts[name] for name in ASKED},
        "doubtful": found.diagnosis.doubtful,
        "reasons": "; ".join(found.diagnosis.reasons),
    }
