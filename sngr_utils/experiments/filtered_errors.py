"""Like against like: each pose when it was the newest, beside what the oracle knew of it then."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from sngr_utils.experiments import estimators
from sngr_utils.experiments.many_worlds import map_rows
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.landmark_starts import start_landmarks
from sngr_utils.world import dead_reckoning, simulation
from sngr_utils.world.scenario import Scenario


def run(
    scenario: Scenario,
    conventions: Conventions,
    p: float,
    seeds: Sequence[int],
    jobs: int | None = None,
) -> pd.DataFrame:
    """EM over the batch and the oracle, asked anew at every pose for the newest one.

    Returns
    -------
    one row per method, p and seed: filtered_rmse, [m]. That of the oracle is the same at every p
    """
    cases = [(scenario, conventions, p, seed) for seed in seeds]
    return pd.DataFrame(map_rows(_of_one, cases, jobs))


def _of_one(scenario, conventions, p, seed) -> list[dict]:
    the_world = simulation.simulate(scenario, p, rng=np.random.default_rng(seed))
    true = replace(the_world, label_of=the_world.source_of)
    poses, rows = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry), []
    for name, method, given in (
        (estimators.BATCH, estimators.BATCH, the_world), ("oracle", "least_squares", true),
    ):  # fmt: skip
        log, newest = given.log(conventions.x0_sigmas), [the_world.x0_mean]
        for n in range(2, log.n_poses + 1):
            part = log.first(n)
            start = start_landmarks(part, poses[:n], estimators.REFERENCE_START)
            found = estimators.batch(part, conventions, method, (poses[:n], start))
            newest.append(found.poses[-1])
        rmse = rmse_and_nees.rmse(np.array(newest)[:, :2], the_world.poses[:, :2])
        rows.append({"method": name, "p": p, "seed": seed, "filtered_rmse": rmse})
    return rows


def relative(runs: pd.DataFrame, newest: pd.DataFrame) -> pd.DataFrame:
    """Runs of the online estimator and others with two ratios more to the oracle, kind by kind.

    Parameters
    ----------
    runs : of `online_variants.run_variants` and `estimators.compare`, with oracle_rmse
    newest : what `run` returns, for the same seeds

    Returns
    -------
    with filtered_rmse of all that have it, and the columns graph (RMSE of the poses before the
    final EM over the oracle's) and filtered (of each pose when it was the newest)
    """
    runs = runs.merge(newest, on=["method", "p", "seed"], how="left", suffixes=("", "_other"))
    runs["filtered_rmse"] = runs["filtered_rmse"].fillna(runs.pop("filtered_rmse_other"))
    oracle = newest[newest["method"] == "oracle"].set_index("seed")["filtered_rmse"]
    return runs.assign(
        graph=runs["graph_rmse"] / runs["oracle_rmse"],
        filtered=runs["filtered_rmse"] / runs["seed"].map(oracle),
    )
