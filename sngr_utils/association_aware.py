"""Driver of notebook 08: where ranges came from, asked of one scan, in batch and online."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from sngr_utils.settings import READING, Levels, Positive, Probability, Seed
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world.scenario import ManyWorlds

# What runs is imported where it runs: a check of all parameters needs no GTSAM and no compiler.
if TYPE_CHECKING:
    import pandas as pd

    from sngr_utils.experiments.one_range import Scan
    from sngr_utils.experiments.online_variants import Frame
    from sngr_utils.world.simulation import World

FRAMES = [3, 5, 8, 15, 29]  # poses of the film that are printed
SLOW = ("sngr", "fastslam")  # which notebook 07 has at several levels; here at p_film only


class Config(ManyWorlds):
    """Parameters of the study. Worlds are those of seeds first_seed, first_seed + 1, ...

    n_seeds : worlds
    p_levels : shares of wrong associations
    p_peers : those, among p_levels, at which the peers run too
    n_slip, p_slip, slip_steps, slip_sigma : worlds with slips of the odometry
    p_film : share of wrong associations, among p_peers, of the run that is drawn, and at which
        all are compared pose by pose
    """

    first_seed: Seed = 6000
    n_landmarks: Annotated[int, Field(ge=2, le=8)] = 6  # a cell sums over all matchings
    n_seeds: Annotated[int, Field(ge=2)] = 30
    p_levels: Levels = [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5]
    p_peers: Levels = [0.1, 0.2, 0.3, 0.4, 0.5]
    n_slip: Annotated[int, Field(ge=2)] = 20
    p_slip: Probability = 0.3
    slip_steps: Annotated[int, Field(ge=1)] = 4
    slip_sigma: Positive = 0.7
    p_film: Probability = 0.4

    @model_validator(mode="after")
    def _consistent(self):
        if not set(self.p_peers) <= set(self.p_levels) or max(self.p_peers) == 0:
            raise ValueError(f"p_peers is {self.p_peers}: all must be among p_levels, one above 0")
        if self.p_film not in self.p_peers:
            raise ValueError(f"p_film is {self.p_film}: it must be among p_peers")
        if self.slip_steps >= self.n_poses:
            raise ValueError(f"slip_steps is {self.slip_steps}: there are {self.n_poses - 1} steps")
        if self.n_poses <= FRAMES[-2]:
            raise ValueError(f"n_poses is {self.n_poses}: the strip has {FRAMES[-2] + 1} and more")
        return self


def run(config: Config) -> pd.DataFrame:
    """Ours, batch EM and the oracle at all levels, the peers at `p_peers`, on the same worlds.

    Returns
    -------
    the tables of `estimators.compare` and `online_variants.run_variants` with the ratios of
    `estimators.relative_to_oracle` and of `filtered_errors.relative`
    """
    import pandas as pd

    from sngr_utils.experiments import estimators, filtered_errors, online_variants
    from sngr_utils.online import estimator

    given, seeds = (config.scenario, PRESETS[READING]), config.seeds(config.n_seeds)
    others = [p for p in config.p_levels if p not in config.p_peers]
    quick = [method for method in estimators.METHODS if method not in SLOW]
    asked = [(config.p_peers, quick), ([config.p_film], SLOW)]
    asked += [(others, (estimators.BATCH, "oracle"))] if others else []
    ours = {online_variants.NAME: estimator.Settings()}
    tables = [estimators.compare(*given, p, seeds, names, jobs=config.jobs) for p, names in asked]
    tables.append(online_variants.run_variants(*given, ours, config.p_levels, seeds, config.jobs))
    runs = estimators.relative_to_oracle(pd.concat(tables, ignore_index=True))
    newest = filtered_errors.run(*given, config.p_film, seeds, config.jobs)
    runs = filtered_errors.relative(runs, newest)
    return runs.sort_values("p", kind="stable", ignore_index=True)


def run_slips(config: Config) -> pd.DataFrame:
    """Worlds where the odometry slips."""
    from sngr_utils.experiments import estimators, online_variants

    runs = online_variants.run_slips(
        config.scenario, PRESETS[READING], config.p_slip, config.slip_steps,
        config.slip_sigma, config.seeds(config.n_slip), config.jobs,
    )  # fmt: skip
    return estimators.relative_to_oracle(runs)


def first_world(config: Config) -> World:
    """The world that is drawn."""
    import numpy as np

    from sngr_utils.world import simulation

    rng = np.random.default_rng(config.first_seed)
    return simulation.simulate(config.scenario, config.p_film, rng=rng)


def ambiguous(config: Config) -> Scan:
    """The scan of the first world with the range that EM leaves most in doubt."""
    from sngr_utils.experiments import one_range

    return one_range.ambiguous(config.scenario, config.p_film, config.first_seed)


def film(config: Config) -> list[Frame]:
    """The run of the first world, stopped at every pose but the first."""
    from sngr_utils.experiments import online_variants

    at = range(1, config.n_poses)
    return online_variants.film(first_world(config), PRESETS[READING], at, config.first_seed)


def future_is_unknown(config: Config) -> bool:
    """Does the past stay as it was, to the last bit, if all later ranges are changed?"""
    from sngr_utils.experiments import online_variants

    return online_variants.future_is_unknown(
        first_world(config), PRESETS[READING], config.first_seed
    )
