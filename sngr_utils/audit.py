"""Driver of notebook 05: which of the paper's claims hold over many worlds, and why not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import joblib
import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from sngr_utils.experiments import (
    estimators,
    isam2_over_worlds,
    sampler_numbers,
    sngr_over_worlds,
    window_posteriors,
)
from sngr_utils.sampling import settings, weighted_samples
from sngr_utils.settings import READING, Positive, Probability
from sngr_utils.slam import levenberg_marquardt
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.sngr import corrected, noop_baseline, trigger, windows
from sngr_utils.sngr.baseline import run_baseline
from sngr_utils.world.scenario import ManyWorlds

Levels = Annotated[list[Probability], Field(min_length=1)]
NOOP_P = 0.3  # where the paper prints the mean log weight of its no-op sampler
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

    n_seeds: Annotated[int, Field(ge=2)] = 30
    p_levels: Levels = [0.0, 0.1, 0.2, 0.3, 0.4]
    taus: Annotated[list[Positive], Field(min_length=1)] = [3.9, 3.92, 3.96, 4.0]
    tau: Positive = 3.96
    p_refined: Levels = [0.0, 0.1, 0.2, 0.3]
    tau_refined: Positive = 3.9
    n_corrected: Annotated[int, Field(ge=2)] = 12
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
        for name in ("p_levels", "taus", "p_refined", "p_corrected", "p_robust"):
            values = getattr(self, name)
            if len(set(values)) < len(values):
                raise ValueError(f"{name} is {values}: it must not repeat a value")
        return self


def run_sweep(config: Config) -> isam2_over_worlds.Sweep:
    """iSAM2 and the trigger on all worlds, under all presets, at all thresholds."""
    seeds = config.seeds(config.n_seeds)
    return isam2_over_worlds.run_sweep(
        config.scenario, PRESETS, config.p_levels, seeds, config.taus, config.jobs
    )


def run_refined(config: Config) -> pd.DataFrame:
    """SNGR as the paper has it on all worlds, under all presets."""
    return sngr_over_worlds.run_sweep(
        config.scenario, PRESETS, config.p_refined, config.seeds(config.n_seeds),
        tau=config.tau_refined, jobs=config.jobs,
    )  # fmt: skip


def run_corrected(config: Config) -> pd.DataFrame:
    """SNGR, and corrected SNGR in both versions, on the same worlds and windows."""
    return sngr_over_worlds.run_sweep(
        config.scenario, PRESETS, config.p_corrected, config.seeds(config.n_corrected),
        sngr_over_worlds.VARIANTS, config.tau_refined, config.jobs,
    )  # fmt: skip


def run_robust(config: Config) -> pd.DataFrame:
    """Dead reckoning, robust losses and the oracle on the same worlds."""
    return estimators.compare(
        config.scenario, PRESETS[READING], config.p_robust, config.seeds(config.n_robust),
        ROBUST, list(estimators.STARTS), jobs=config.jobs,
    )  # fmt: skip


def run_nees(config: Config) -> pd.DataFrame:
    """NEES on clean data with a true and a drawn mean of the x0 prior, under all presets."""
    seeds = config.seeds(config.n_seeds)
    tables = [
        isam2_over_worlds.nees_variants(config.scenario, conventions, seeds, config.jobs).assign(
            preset=name
        )
        for name, conventions in PRESETS.items()
    ]
    return pd.concat(tables, ignore_index=True)


@dataclass(frozen=True)
class WindowStudies:
    """Tables of the experiments window by window, one row per window and setting.

    Attributes
    ----------
    widths : sampled over conditional and marginal standard deviations, three readings
    ratios : marginal over conditional standard deviations, all presets
    gains : attainable gain, factor 1/2 as printed, at estimates settled more and more
    gaussianity : Laplace evidence against importance sampling, both treatments of separators
    ess : effective sample sizes of windows of the settled estimate and of exact Gaussians
    evidence : nested against importance sampling of the corrected target
    """

    widths: pd.DataFrame
    ratios: pd.DataFrame
    gains: pd.DataFrame
    gaussianity: pd.DataFrame
    ess: pd.DataFrame
    evidence: pd.DataFrame


def run_windows(config: Config) -> WindowStudies:
    """All experiments window by window, world by world."""
    done = joblib.Parallel(n_jobs=config.jobs)(
        joblib.delayed(_study)(config, preset, seed)
        for preset in PRESETS
        for seed in config.seeds(config.n_windows)
    )
    return WindowStudies(*(pd.concat(tables, ignore_index=True) for tables in zip(*done)))  # noqa: B905


def _study(config: Config, preset: str, seed: int) -> list[pd.DataFrame]:
    """The six tables of one world."""
    base = run_baseline(config.scenario, PRESETS[preset], config.p_windows, seed)
    rng = np.random.default_rng([seed, 6])
    sampler = settings.SamplerSettings(min_walks=50)
    n = len(base.covariances)
    some = list(range(trigger.FIRST_ELIGIBLE, n, max(1, n // 5)))
    settled = levenberg_marquardt.converge(base.solution)
    covariances = windows.covariances(settled)
    at_rest = replace(base, solution=settled, covariances=covariances)
    checks, laplace = [], []
    for separators, walks in (("conditional", 100), ("marginal", corrected.LONG_WALKS)):
        here = {"separators": separators}
        checks.append(
            sampler_numbers.evidence_check(
                settled, covariances, some[:: 1 + (separators == "marginal")], separators, walks,
                rng=rng,
            ).assign(**here)
        )  # fmt: skip
        laplace.append(
            window_posteriors.gaussianity(settled, covariances, some, separators, rng=rng).assign(
                **here
            )
        )
    tables = [
        window_posteriors.widths(base, some, sampler, rng=rng),
        window_posteriors.marginal_over_conditional(base),
        window_posteriors.gains(base, factor=0.5),
        pd.concat(laplace),
        sampler_numbers.ess_shares(at_rest, some, sampler, rng=rng),
        pd.concat(checks),
    ]
    return [table.assign(preset=preset, seed=seed) for table in tables]


def run_gaussian_ess(config: Config) -> pd.DataFrame:
    """ESS share of an exact Gaussian in the place of one window of every world."""
    rows = joblib.Parallel(n_jobs=config.jobs)(
        joblib.delayed(_gaussian_ess)(config, preset, seed)
        for preset in PRESETS
        for seed in config.seeds(config.n_seeds)
    )
    return pd.DataFrame(rows, columns=["preset", "seed", "ess_share"])


def _gaussian_ess(config: Config, preset: str, seed: int) -> tuple[str, int, float]:
    base = run_baseline(config.scenario, PRESETS[preset], config.p_windows, seed)
    middle = len(base.covariances) // 2
    table = sampler_numbers.ess_shares(
        base, [middle], settings.SamplerSettings(min_walks=50), (1.0,),
        rng=np.random.default_rng([seed, 7]),
    )  # fmt: skip
    return preset, seed, float(table.loc[table["kind"] == "Gaussian", "ess_share"].iloc[0])


def noop_readings(config: Config) -> pd.DataFrame:
    """Mean log weight of the no-op sampler by reading, averaged over windows, per world."""
    rows = joblib.Parallel(n_jobs=config.jobs)(
        joblib.delayed(_noop)(config, preset, seed)
        for preset in PRESETS
        for seed in config.seeds(config.n_robust)
    )
    return pd.concat(rows, ignore_index=True)


def _noop(config: Config, preset: str, seed: int) -> pd.DataFrame:
    base = run_baseline(config.scenario, PRESETS[preset], NOOP_P, seed)
    table = sampler_numbers.noop_readings(
        base, config.tau_refined, noop_baseline.TriggerOnly(), rng=np.random.default_rng([seed, 8])
    )
    return table.assign(preset=preset, seed=seed)


def bimodality_readings(runs: Sequence[weighted_samples.WeightedSamples]) -> pd.DataFrame:
    """The bimodality coefficient of y by reading, one row per run of notebook 01's experiment."""
    return pd.DataFrame([
        sampler_numbers.bimodality_readings(run.samples[:, 1], run.weights) for run in runs
    ])
