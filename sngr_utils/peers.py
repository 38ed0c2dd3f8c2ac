"""Driver of notebook 07: what a wrong association does, and every method that doubts it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from sngr_utils.settings import READING, Levels, Seed
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world.scenario import ManyWorlds

# What runs is imported where it runs: a check of all parameters needs no GTSAM and no compiler.
if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

BEST = "em_exclusive"  # what the others are tested against


class Config(ManyWorlds):
    """Parameters of the comparison. Worlds are those of seeds first_seed, first_seed + 1, ...

    n_seeds : worlds
    p_levels : shares of wrong associations
    p_starts : levels, among p_levels, at which the starts are compared
    n_particles : of FastSLAM
    """

    first_seed: Seed = 6000
    n_seeds: Annotated[int, Field(ge=2)] = 20
    p_levels: Levels = [0.0, 0.2, 0.4]
    p_starts: Levels = [0.4]
    n_particles: Annotated[int, Field(ge=2)] = 300

    @model_validator(mode="after")
    def _consistent(self):
        if max(self.p_levels) == 0:
            raise ValueError("p_levels is [0.0]: nothing there to doubt")
        if not set(self.p_starts) <= set(self.p_levels):
            raise ValueError(f"p_starts is {self.p_starts}: all must be among p_levels")
        return self


def run(config: Config) -> pd.DataFrame:
    """All methods on all worlds from the grid; at `p_starts` from the first poses too.

    Returns
    -------
    the table of `estimators.compare` with the column ratio, see `relative_to_oracle`
    """
    import pandas as pd

    from sngr_utils.experiments import estimators
    from sngr_utils.robust import fastslam

    particles = fastslam.Settings(n_particles=config.n_particles)
    by_start = {"grid": config.p_levels, "first_poses": config.p_starts}
    started = [name for name in estimators.METHODS if name not in estimators.WITHOUT_START]
    methods = {"grid": list(estimators.METHODS), "first_poses": started}
    seeds = config.seeds(config.n_seeds)
    tables = [
        estimators.compare(
            config.scenario, PRESETS[READING], levels, seeds, methods[start],
            [start], particles, config.jobs,
        )
        for start, levels in by_start.items()
    ]  # fmt: skip
    return estimators.relative_to_oracle(pd.concat(tables, ignore_index=True))


def pull(config: Config, distances: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Ten ranges to a landmark, three of them another one's; see `one_range.pull`."""
    from sngr_utils.experiments import one_range

    return one_range.pull(config.scenario, distances)
