"""The online estimator over many worlds: its variants, odometry that slips, and one run filmed."""

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from sngr_utils.experiments import estimators
from sngr_utils.experiments.many_worlds import map_rows
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.online import estimator, landmarks, localisation
from sngr_utils.online.belief import Belief
from sngr_utils.online.data_association import DROPPED
from sngr_utils.online.estimator import OnlineEstimate, Settings
from sngr_utils.robust.diagnosis import DoubtWarning
from sngr_utils.settings import READING
from sngr_utils.slam import isam2
from sngr_utils.slam.conventions import PRESETS, Conventions
from sngr_utils.world import simulation, variations
from sngr_utils.world.scenario import Scenario

NAME = "online"  # of the method itself, among its variants
ABLATION_P = 0.4  # wrong associations in the worlds of `ablation`
STREAM, SLIPS, FILM = 80, 81, 82  # of random numbers, beside the seed of the world
COUNTS = (
    "landmark questions", "position questions", "landmark samples", "position samples",
    "mirror waits", "landmark restarts", "batch restarts", "slips", "swapped", "dropped",
)  # fmt: skip

PARTS = {  # what a variant changes of the settings
    NAME: {},
    "no nested sampling": {"nested": False},
    "landmarks as in the paper": {"delayed": False},
    "no exclusion in a scan": {"exclusive": False},
    "drop, no swap": {"swap": False},
    "no second look": {"sweep": False},
    "p held at 0.1": {"p": 0.1},
}
NO_NETS = {"restart": False, "soft": False}  # EM in trouble, and in what is read out


def run_unwarned(*args, **kwargs) -> OnlineEstimate:
    """`estimator.run` without its warning: a study judges by the truth what was doubted."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DoubtWarning)
        return estimator.run(*args, **kwargs)


def variants(nets: bool) -> dict[str, Settings]:
    """Every part switched off by itself, with the two safety nets of EM or without them."""
    without = {} if nets else NO_NETS
    return {name: Settings(**change, **without) for name, change in PARTS.items()}


def run_variants(
    scenario: Scenario,
    conventions: Conventions,
    settings: Mapping[str, Settings],
    p_levels: Sequence[float],
    seeds: Sequence[int],
    jobs: int | None = None,
) -> pd.DataFrame:
    """Variants of the online estimator on the same worlds.

    Returns
    -------
    one row per p, seed and variant, with the columns of `estimators.compare` (start "none"),
    then graph_rmse (of iSAM2's graph) and filtered_rmse (of each pose when it was the newest),
    [m], p_found, miscredited (ranges
    assigned to another landmark than they came from) and how often what was done, see
    `estimator.OnlineEstimate`
    """
    cases = [(scenario, conventions, settings, p, seed) for p in p_levels for seed in seeds]
    return pd.DataFrame(map_rows(_variants_of_one, cases, jobs))


def ablation(seed: int) -> list[dict]:
    """Every part switched off by itself, with and without the safety nets, in one world.

    Returns
    -------
    a row for each variant: method, nets, p, seed and ratio, its pose RMSE over the oracle's
    """
    given, rows = (Scenario(), PRESETS[READING]), []
    for nets in (True, False):
        found = run_variants(*given, variants(nets), [ABLATION_P], [seed], jobs=1)
        rows.append(found[["method", "p", "seed", "pose_rmse"]].assign(nets=nets))
    oracle = estimators.compare(*given, [ABLATION_P], [seed], ("oracle",), jobs=1)["pose_rmse"]
    table = pd.concat(rows).assign(ratio=lambda runs: runs.pop("pose_rmse") / oracle[0])
    return table.to_dict("records")


def _variants_of_one(scenario, conventions, settings, p, seed) -> list[dict]:
    the_world = simulation.simulate(scenario, p, rng=np.random.default_rng(seed))
    key = {"start": "none", "p": p, "seed": seed}
    return [
        {"method": name, **key, **_judged(the_world, conventions, one, seed)}
        for name, one in settings.items()
    ]


def _judged(
    the_world: simulation.World, conventions: Conventions, settings: Settings, seed: int
) -> dict[str, float]:
    """What there is to say about one run."""
    before = time.thread_time()
    rng = np.random.default_rng([seed, STREAM])
    log = the_world.log(conventions.x0_sigmas)
    found = run_unwarned(log, conventions, settings, rng=rng)
    seconds = time.thread_time() - before
    truth = the_world.poses[:, :2]
    wrong = (found.used != DROPPED) & (found.used != the_world.source_of)
    return {
        "pose_rmse": rmse_and_nees.rmse(found.poses[:, :2], truth),
        "landmark_rmse": rmse_and_nees.rmse(found.landmarks, the_world.landmarks),
        "nees": estimators.expected_nees(
            the_world, conventions, found.poses, found.position_covariances
        ),
        "seconds": seconds,
        "graph_rmse": rmse_and_nees.rmse(found.graph_poses[:, :2], truth),
        "filtered_rmse": rmse_and_nees.rmse(found.filtered[:, :2], truth),
        "p_found": found.p,
        "miscredited": int(wrong.sum()),
        **{name: found.counts[name] for name in COUNTS},
    }


def run_slips(
    scenario: Scenario,
    conventions: Conventions,
    p: float,
    steps: int,
    sigma: float,
    seeds: Sequence[int],
    jobs: int | None = None,
) -> pd.DataFrame:
    """Worlds with `steps` slips of the odometry, which no estimator is told.

    Parameters
    ----------
    steps, sigma : of `variations.slip`

    Returns
    -------
    one row per seed and method: pose_rmse, [m], and of the two online ones the counts. "trusting"
    is the online estimator that takes the odometry at its word; the oracle, and EM over the batch,
    do so too
    """
    cases = [(scenario, conventions, p, steps, sigma, seed) for seed in seeds]
    return pd.DataFrame(map_rows(_slipped, cases, jobs))


def _slipped(scenario, conventions, p, steps, sigma, seed) -> list[dict]:
    rng = np.random.default_rng([seed, SLIPS])
    sound = simulation.simulate(scenario, p, rng=np.random.default_rng(seed))
    the_world = variations.slip(sound, steps, sigma, rng=rng)
    key = {"start": "none", "p": p, "seed": seed}
    rows = [
        {"method": name, **key, **_judged(the_world, conventions, settings, seed)}
        for name, settings in ((NAME, Settings()), ("trusting", Settings(doubt_odometry=False)))
    ]
    start = estimators.REFERENCE_START
    for method in ("cauchy", "em_exclusive", "oracle"):
        found = estimators.estimate(the_world, conventions, method, start, rng=rng)
        rows.append({
            "method": method, **key, "start": start,
            "pose_rmse": rmse_and_nees.rmse(found.poses[:, :2], the_world.poses[:, :2]),
            "landmark_rmse": rmse_and_nees.rmse(found.landmarks, the_world.landmarks),
        })  # fmt: skip
    return rows


@dataclass(frozen=True)
class Frame:
    """What is believed at one pose.

    Attributes
    ----------
    truth, poses, plain : (T, 2) true positions, ours, and plain iSAM2's, so far, [m]
    landmarks : (K, 2) ours, [m]; NaN for one not yet initialised
    clouds : landmark not yet initialised -> (P, 2) places from its posterior, [m]
    label_of, used : of the ranges of the newest pose: the landmark it is labelled with, and the
        one it is assigned to (-1 for none)
    true_landmarks : (K, 2), [m]
    """

    truth: np.ndarray
    poses: np.ndarray
    plain: np.ndarray
    landmarks: np.ndarray
    clouds: dict[int, np.ndarray]
    label_of: np.ndarray
    used: np.ndarray
    true_landmarks: np.ndarray


def film(
    the_world: simulation.World, conventions: Conventions, at: Sequence[int], seed: int
) -> list[Frame]:
    """One run of the online estimator, stopped at the poses `at`.

    Raises
    ------
    ValueError : a pose that is not there, or the very first, before which nothing is known
    """
    if not all(0 < t < the_world.n_poses for t in at):
        raise ValueError(f"at is {list(at)}: poses go from 1 to {the_world.n_poses - 1}")
    frames = []

    def watch(belief: Belief) -> None:
        t = belief.n_poses - 1
        if t in at:
            drawn = np.random.default_rng([seed, FILM, t])
            frames.append(_frame(the_world.first(t + 1), belief, conventions, rng=drawn))

    rng = np.random.default_rng([seed, STREAM])
    log = the_world.log(conventions.x0_sigmas)
    run_unwarned(log, conventions, Settings(), watch, rng=rng)
    return frames


def _frame(
    data: simulation.World, belief: Belief, conventions: Conventions, *, rng: np.random.Generator
) -> Frame:
    newest = data.pose_of == data.n_poses - 1
    clouds = {}
    for k in np.flatnonzero(np.isnan(belief.landmarks[:, 0])):
        _, evidence = landmarks.witnesses(belief, k, least=1)
        if evidence is not None:
            cloud = localisation.sample(evidence, rng=rng)
            drawn = rng.choice(len(cloud.samples), 300, p=cloud.weights / cloud.weights.sum())
            clouds[int(k)] = cloud.samples[drawn]
    return Frame(
        data.poses[:, :2], belief.poses[:, :2], isam2.run_isam2(data, conventions).poses[:, :2],
        belief.landmarks, clouds, data.label_of[newest], belief.assignment.used[belief.newest],
        data.landmarks,
    )  # fmt: skip


def future_is_unknown(the_world: simulation.World, conventions: Conventions, seed: int) -> bool:
    """Does the past stay as it was, to the last bit, if all later ranges are changed?"""
    middle, pasts = the_world.n_poses // 2, []
    later = the_world.pose_of > middle
    spoilt = np.where(later, the_world.ranges[::-1], the_world.ranges)
    for ranges in (the_world.ranges, spoilt):
        changed = replace(the_world, ranges=ranges)
        rng = np.random.default_rng(seed)
        log = changed.log(conventions.x0_sigmas)
        found = run_unwarned(log, conventions, Settings(), rng=rng)
        pasts.append(found.filtered[: middle + 1])
    return bool(np.array_equal(*pasts))
