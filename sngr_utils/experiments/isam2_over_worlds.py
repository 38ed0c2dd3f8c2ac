"""Many worlds: tidy tables of runs, and means with errors.

Each run is a task of its own that draws all it needs from its seed and returns plain numbers, so
the tables are the same serial, in processes or on a cluster, in any order.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils.experiments.many_worlds import map_rows, map_worlds
from sngr_utils.metrics import cluster_bootstrap, precision_recall, rmse_and_nees
from sngr_utils.slam import isam2, marginals
from sngr_utils.slam.conventions import Conventions
from sngr_utils.sngr import trigger
from sngr_utils.sngr.baseline import Baseline, run_baseline
from sngr_utils.world import dead_reckoning, simulation, variations
from sngr_utils.world.scenario import Scenario


@dataclass(frozen=True)
class Sweep:
    """Tidy tables, sorted as the arguments of `run_sweep` were.

    Attributes
    ----------
    runs : one row per preset, p and seed: pose_rmse, landmark_rmse and odometry_rmse (dead
        reckoning from the true first pose) [m], nees, failed (number of failed windows),
        base_rate (share of failed windows among those that may fire)
    detections : one row per preset, p, seed and tau: triggered, tp, fp, fn, tn, precision,
        recall, over all windows, as the paper counts, also the first `trigger.FIRST_ELIGIBLE`,
        which never fire; and mcc, over those that may
    scores : one row per preset, p, seed and window: score, score_cm (with positions in
        centimetres), log_lambda_min, log_lambda_max, failed, eligible (may it fire?)
    refined : the rows of `refine`, headed by preset, p and seed; empty without
    """

    runs: pd.DataFrame
    detections: pd.DataFrame
    scores: pd.DataFrame
    refined: pd.DataFrame


def run_sweep(
    scenario: Scenario,
    presets: Mapping[str, Conventions],
    p_levels: Sequence[float],
    seeds: Sequence[int],
    taus: Sequence[float],
    jobs: int | None = None,
    refine: Callable[[Baseline, Conventions], list[dict]] | None = None,
) -> Sweep:
    """iSAM2 on every world under every preset, judged at every tau.

    Parameters
    ----------
    presets : conventions by name, e.g. `conventions.PRESETS`
    refine : rows of what else is made of each run, e.g. `sngr_over_worlds.Refinement`
    jobs : processes; None leaves number and backend to ``joblib.parallel_config``

    Raises
    ------
    ValueError : an empty or repeated list entry, which would make the errors wrong
    """
    for name, given in {"p_levels": p_levels, "seeds": seeds, "taus": taus}.items():
        _require_distinct(name, given)
    _require_distinct("presets", presets)
    heads = [
        {"preset": name, "p": p, "seed": seed}
        for name in presets
        for p in p_levels
        for seed in seeds
    ]
    cases = [(scenario, presets[h["preset"]], h["p"], h["seed"], list(taus), refine) for h in heads]
    *parts, refined = zip(*map_worlds(_run_one, cases, jobs), strict=True)
    rows = [head | row for head, mine in zip(heads, refined, strict=True) for row in mine]
    return Sweep(*(_stacked(heads, part) for part in parts), pd.DataFrame(rows))


def _stacked(heads: list[dict], parts: Sequence[Mapping[str, Sequence]]) -> pd.DataFrame:
    """The columns of all runs one after the other, each row headed by its run's keys."""
    lengths = [len(next(iter(columns.values()))) for columns in parts]
    keys = pd.DataFrame(heads)
    table = {name: np.repeat(keys[name].to_numpy(), lengths) for name in keys}
    table |= {name: np.concatenate([columns[name] for columns in parts]) for name in parts[0]}
    return pd.DataFrame(table)


def _require_distinct(name: str, given: Iterable) -> None:
    values = list(given)
    if not values or len(set(values)) < len(values):
        raise ValueError(f"{name} is {values}: it must hold something and repeat nothing")


def _run_one(
    scenario: Scenario, conventions: Conventions, p: float, seed: int, taus: list[float],
    refine: Callable | None,
) -> list[dict[str, Sequence] | list[dict]]:  # fmt: skip
    """The columns of the three tables of one run, and the rows of the fourth."""
    run = run_baseline(scenario, conventions, p, seed)
    return [_columns([_run_row(run)]), _columns([_detection_row(run, tau) for tau in taus]),
            _window_columns(run), refine(run, conventions) if refine else []]  # fmt: skip


def _columns(rows: list[dict[str, float]]) -> dict[str, list[float]]:
    return {name: [row[name] for row in rows] for name in rows[0]}


def _run_row(run: Baseline) -> dict[str, float]:
    blind = dead_reckoning.dead_reckoning(run.world.x0_mean, run.world.odometry)
    return {
        "pose_rmse": run.pose_rmse,
        "landmark_rmse": run.landmark_rmse,
        "nees": run.nees,
        "odometry_rmse": rmse_and_nees.rmse(blind[:, :2], run.world.poses[:, :2]),
        "failed": int(run.failed.sum()),
        "base_rate": run.base_rate,
    }


def _detection_row(run: Baseline, tau: float) -> dict[str, float]:
    found = run.detection(tau)
    counts = {
        "tp": found.true_positives, "fp": found.false_positives,
        "fn": found.false_negatives, "tn": found.true_negatives,
    }  # fmt: skip
    eligible = slice(trigger.FIRST_ELIGIBLE, None)
    may_fire = precision_recall.detection(run.fired(tau)[eligible], run.failed[eligible])
    rates = {"precision": found.precision, "recall": found.recall, "mcc": may_fire.matthews}
    return {"tau": tau, "triggered": found.triggered, **counts, **rates}


def _window_columns(run: Baseline) -> dict[str, np.ndarray]:
    smallest, largest = trigger.log_extremes(run.covariances).T
    low_cm, high_cm = trigger.log_extremes(trigger.in_units(run.covariances, 100)).T
    place = np.arange(len(run.scores))
    return {
        "window": place,
        "score": run.scores,
        "score_cm": high_cm - low_cm,
        "log_lambda_min": smallest,
        "log_lambda_max": largest,
        "failed": run.failed,
        "eligible": place >= trigger.FIRST_ELIGIBLE,
    }


def nees_variants(
    scenario: Scenario,
    presets: Mapping[str, Conventions],
    seeds: Sequence[int],
    jobs: int | None = None,
) -> pd.DataFrame:
    """NEES on clean data with the mean of the x0 prior true or drawn, and P in either frame.

    A prior that is centred on the truth errs by nothing, which its sigmas deny. If its mean is
    drawn from its own law and P is in the frame of the errors, a consistent estimator has NEES
    2, the number of coordinates.

    Returns
    -------
    one row per preset, seed, x0_mean ("truth", "drawn") and frame ("world", "body"): nees
    """
    _require_distinct("seeds", seeds)
    cases = [(scenario, name, presets[name], seed) for name in presets for seed in seeds]
    rows = map_rows(_nees_rows, cases, jobs)
    return pd.DataFrame(rows, columns=["x0_mean", "frame", "seed", "nees", "preset"])


def _nees_rows(
    scenario: Scenario, preset: str, conventions: Conventions, seed: int
) -> list[tuple[str, str, int, float, str]]:
    rng = np.random.default_rng(seed)
    the_world = simulation.simulate(scenario, 0.0, rng=rng)
    (prior_rng,) = rng.spawn(1)
    drawn = variations.draw_x0(the_world, conventions.x0_sigmas, rng=prior_rng)
    rows = []
    for name, given in (("truth", the_world), ("drawn", drawn)):
        solution = isam2.run_isam2(given, conventions)
        errors = solution.poses[:, :2] - the_world.poses[:, :2]
        body = marginals.position_covariances(solution, "body")
        world = marginals.in_world_frame(body, solution)
        for frame, covariances in (("world", world), ("body", body)):
            rows.append((name, frame, seed, rmse_and_nees.nees(errors, covariances), preset))
    return rows


def auc_rows(sweep: Sweep, *, rng: np.random.Generator) -> pd.DataFrame:
    """Per preset and p, windows that may fire: pooled AUC, AUC within worlds, precision.

    Returns
    -------
    one row per preset and p: pooled, within, low, high (95 % interval of `within`), worlds (with
    both classes), average_precision, base_rate
    """
    rows = []
    for (preset, p), found in sweep.scores.query("eligible").groupby(["preset", "p"], sort=False):
        score, failed = found["score"].to_numpy(), found["failed"].to_numpy()
        within, n = cluster_bootstrap.within_auc(score, failed, found["seed"].to_numpy(), rng=rng)
        rows.append({
            "preset": preset, "p": p, "pooled": precision_recall.roc_auc(score, failed),
            "within": within.value, "low": within.low, "high": within.high, "worlds": n,
            "average_precision": precision_recall.average_precision(score, failed),
            "base_rate": float(failed.mean()),
        })  # fmt: skip
    return pd.DataFrame(rows)


def curves(
    sweep: Sweep, preset: str, levels: Sequence[float]
) -> dict[str, tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], float]]:
    """ROC curve, precision-recall curve and base rate per p, where both classes are there."""
    eligible = sweep.scores.query("eligible and preset == @preset")
    found = {}
    for p in levels:
        rows = eligible[eligible["p"] == p]
        score, failed = rows["score"].to_numpy(), rows["failed"].to_numpy()
        if failed.any() and not failed.all():
            roc = precision_recall.roc_curve(score, failed)
            found[f"p = {p:g}"] = (
                roc, precision_recall.precision_recall_curve(score, failed), float(failed.mean())
            )  # fmt: skip
    return found
