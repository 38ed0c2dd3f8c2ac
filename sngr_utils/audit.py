"""Driver of notebook 05: which of the paper's claims hold over many worlds, and why not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from sngr_utils.settings import READING, Distinct, Levels, PosesOfWindows, Positive, Probability
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world.scenario import ManyWorlds

# What runs is imported where it runs: a check of all parameters needs no GTSAM and no compiler.
if TYPE_CHECKING:
    import pandas as pd

    from sngr_utils.experiments.isam2_over_worlds import Sweep
    from sngr_utils.experiments.window_studies import WindowStudies

NOOP_P = 0.3  # where the paper prints the mean log weight of its no-op sampler
PRINTED = (0.0, 0.1, 0.2, 0.3, 0.4)  # levels of the paper's table "baseline"
ROBUST = (
    "dead_reckoning", "least_squares", "huber", "cauchy", "dcs", "geman_mcclure", "gnc_tls",
    "oracle",
)  # fmt: skip


class Config(ManyWorlds):
    """Parameters of the audit. Worlds are those of seeds first_seed, first_seed + 1, ...

    n_seeds : worlds of the sweeps
    p_levels, taus : of the sweep over iSAM2 and the trigger
    tau : threshold of the paper's tables of detection
    p_refined, tau_refined : of the sweep over SNGR itself
    n_corrected, p_corrected : worlds and levels of corrected SNGR
    n_robust, p_robust : worlds and levels of the robust losses
    n_windows, p_windows : worlds and level of the experiments window by window
    """

    n_poses: PosesOfWindows = 30
    n_seeds: Annotated[int, Field(ge=2)] = 30
    p_levels: Levels = [0.0, 0.1, 0.2, 0.3, 0.4]
    taus: Annotated[list[Positive], Field(min_length=1), Distinct] = [3.9, 3.92, 3.96, 4.0]
    tau: Positive = 3.96
    p_refined: Levels = [0.0, 0.1, 0.2, 0.3]
    tau_refined: Positive = 3.9
    n_corrected: Annotated[int, Field(ge=2)] = 20
    p_corrected: Levels = [0.2]
    n_robust: Annotated[int, Field(ge=2)] = 10
    p_robust: Levels = [0.0, 0.2, 0.4]
    n_windows: Annotated[int, Field(ge=2)] = 8
    p_windows: Probability = 0.2

    @model_validator(mode="after")
    def _consistent(self):
        for name, value, levels in (
            ("tau", self.tau, "taus"),
            ("tau_refined", self.tau_refined, "taus"),
            ("p_windows", self.p_windows, "p_levels"),
        ):
            if value not in getattr(self, levels):
                raise ValueError(f"{name} is {value}: it must be one of {levels}")
        if not set(self.p_refined) <= set(self.p_levels):
            raise ValueError(f"p_refined is {self.p_refined}: all must be among p_levels")
        if not set(self.p_corrected) <= set(self.p_refined):
            raise ValueError(f"p_corrected is {self.p_corrected}: all must be among p_refined")
        if min(self.p_levels) not in PRINTED or max(self.p_refined) not in PRINTED[1:]:
            rule = f"the least, and the largest of p_refined, must be printed: of {PRINTED}"
            raise ValueError(f"p_levels is {self.p_levels}, p_refined {self.p_refined}: {rule}")
        if self.n_corrected > self.n_seeds:
            raise ValueError(f"n_corrected is {self.n_corrected}: there are {self.n_seeds} worlds")
        return self


def run_sweep(config: Config) -> Sweep:
    """iSAM2, the trigger at all thresholds, and SNGR on all worlds, under all presets.

    SNGR as the paper has it at `p_refined`; both corrected versions beside it on `n_corrected`
    worlds at `p_corrected`.
    """
    from sngr_utils.experiments import isam2_over_worlds
    from sngr_utils.experiments.sngr_over_worlds import VARIANTS, Refinement

    seeds, corrected = config.seeds(config.n_seeds), config.seeds(config.n_corrected)
    variants = {
        (p, seed): VARIANTS if p in config.p_corrected and seed in corrected else VARIANTS[:1]
        for p in config.p_refined
        for seed in seeds
    }
    return isam2_over_worlds.run_sweep(
        config.scenario, PRESETS, config.p_levels, seeds, config.taus, config.jobs,
        Refinement(variants, config.tau_refined),
    )  # fmt: skip


def run_robust(config: Config) -> pd.DataFrame:
    """Dead reckoning, robust losses and the oracle on the same worlds."""
    from sngr_utils.experiments import estimators

    return estimators.compare(
        config.scenario, PRESETS[READING], config.p_robust, config.seeds(config.n_robust),
        ROBUST, list(estimators.STARTS), jobs=config.jobs,
    )  # fmt: skip


def run_nees(config: Config) -> pd.DataFrame:
    """NEES on clean data with a true and a drawn mean of the x0 prior, under all presets."""
    from sngr_utils.experiments import isam2_over_worlds

    seeds = config.seeds(config.n_seeds)
    return isam2_over_worlds.nees_variants(config.scenario, PRESETS, seeds, config.jobs)


def run_windows(config: Config) -> WindowStudies:
    """All experiments window by window, under all presets."""
    from sngr_utils.experiments import window_studies

    seeds = config.seeds(config.n_windows)
    return window_studies.run(config.scenario, config.p_windows, seeds, config.jobs)


def run_gaussian_ess(config: Config) -> pd.DataFrame:
    """ESS share of an exact Gaussian in the place of one window of every world."""
    from sngr_utils.experiments import window_studies

    seeds = config.seeds(config.n_seeds)
    return window_studies.gaussian_ess(config.scenario, config.p_windows, seeds, config.jobs)


def noop_readings(config: Config) -> pd.DataFrame:
    """Mean log weight of the no-op sampler by reading, one row per window that fires."""
    from sngr_utils.experiments import window_studies

    seeds = config.seeds(config.n_robust)
    return window_studies.noop_readings(
        config.scenario, NOOP_P, seeds, config.tau_refined, config.jobs
    )
