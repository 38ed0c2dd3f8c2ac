"""Driver of notebook 04: what selective refinement costs, and what it saves."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from sngr_utils.experiments import engine_bench, growth
from sngr_utils.sampling import weighted_samples
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.settings import Positive, Probability, Seed
from sngr_utils.slam import selected_inverse
from sngr_utils.slam.conventions import preset_conventions
from sngr_utils.slam.isam2 import run_isam2
from sngr_utils.sngr import algorithm, gate, refine, trigger, windows
from sngr_utils.sngr.baseline import Baseline, run_baseline
from sngr_utils.sngr.closure import touching_factors, variable_closure
from sngr_utils.world.scenario import Scenario

EVERY = 3  # of the windows that do not trigger, every third is run and stands for all of them


class Config(Scenario, SamplerSettings, engine_bench.BenchSettings):
    """Parameters of the cost study; the defaults are the paper's values where it states them.

    timing_calls : likelihood calls behind each time per call
    """

    seed: Seed = 0
    p_levels: Annotated[list[Probability], Field(min_length=1)] = [0.0, 0.1, 0.2, 0.3]
    tau: Positive = 3.9
    timing_calls: Annotated[int, Field(ge=10)] = 2000
    preset: str = "B"
    conventions: dict = {}

    @model_validator(mode="after")
    def _consistent(self):
        preset_conventions(self.preset, self.conventions)
        if len(set(self.p_levels)) < len(self.p_levels):
            raise ValueError(f"p_levels is {self.p_levels}: it must not repeat a value")
        return self


@dataclass(frozen=True)
class Cost:
    """What one world costs. N windows.

    Attributes
    ----------
    baseline : iSAM2 and the trigger
    fired : (N,) bool
    calls : (N,) likelihood calls of each window's run, NaN where there was none; the same on every
        machine
    seconds : (N,) CPU time of each window's run, NaN where there was none
    isam2_seconds : CPU time of the whole iSAM2 run
    """

    baseline: Baseline
    fired: np.ndarray
    calls: np.ndarray
    seconds: np.ndarray
    isam2_seconds: float

    @property
    def saving_calls(self) -> float:
        """Likelihood calls of the exhaustive run over those of the selective one."""
        return saving(self.exhaustive(self.calls), self.calls[self.fired].sum())

    @property
    def saving_seconds(self) -> float:
        """The same as a ratio of CPU times, both from this one run."""
        return saving(self.exhaustive(self.seconds), self.seconds[self.fired].sum())

    def exhaustive(self, values: np.ndarray) -> float:
        """Sum of `calls` or `seconds` over all windows; those not run are like those that were."""
        rest = values[~self.fired]
        others = len(rest) * float(np.nanmean(rest)) if len(rest) else 0.0
        return float(values[self.fired].sum()) + others


def saving(exhaustive: float, selective: float) -> float:
    """How many times dearer the exhaustive run is; NaN if nothing was selected."""
    return float(exhaustive / selective) if selective else float("nan")


def run(config: Config) -> dict[float, Cost]:
    """Refine the windows that trigger at every p, and every third of the others, timing each."""
    return {p: run_level(config, p) for p in config.p_levels}


def run_level(config: Config, p: float) -> Cost:
    """One p. The windows' random streams are those of the full pipeline (notebook 03)."""
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, p, config.seed)
    _, isam2_seconds = engine_bench.timed(lambda: run_isam2(base.world, conventions))
    fired = base.fired(config.tau)
    calls, seconds = np.full((2, len(fired)), np.nan)
    for t in [*np.flatnonzero(fired), *np.flatnonzero(~fired)[::EVERY]]:
        refined, seconds[t] = engine_bench.timed(lambda t=t: _refine(config, base, t))
        calls[t] = refined[0].run.calls
    return Cost(base, fired, calls, seconds, isam2_seconds)


def _refine(
    config: Config, base: Baseline, which: int | slice, engine: str = "dynesty"
) -> list[refine.RefinedWindow]:
    """Windows refined, whatever their scores."""
    conventions = preset_conventions(config.preset, config.conventions)
    return algorithm.run(
        base.world, conventions, partial(trigger.regardless, which=which),
        refine.Paper(config.part(SamplerSettings), engine), gate.Gate(), base,
        rng=np.random.default_rng([config.seed, 1]),
    ).windows  # fmt: skip


def compare_engines(config: Config) -> dict[str, engine_bench.Performance]:
    """All engines on the same windows of one world (`engine_bench.compare`)."""
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, config.bench_p, config.seed)
    settings, sizes = config.part(SamplerSettings), config.part(engine_bench.BenchSettings)
    return engine_bench.compare(base, settings, sizes, rng=np.random.default_rng([config.seed, 4]))


def likelihood_seconds(config: Config) -> float:
    """CPU time of one compiled likelihood call of a window of `compare_engines`, [s]."""
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, config.bench_p, config.seed)
    middle = len(base.covariances) // 2
    return engine_bench.likelihood_seconds(
        base, middle, config.likelihood_factor, config.timing_calls
    )


def grow(config: Config) -> growth.Growth:
    """CPU time against the number of poses (`growth.growth`)."""
    conventions = preset_conventions(config.preset, config.conventions)
    return growth.growth(config.lengths, config.part(Scenario), conventions, config.seed)


def exhaustive_fast(config: Config) -> tuple[float, float]:
    """CPU time of refining every window by the fast path, with all glue, and of iSAM2, [s].

    The marginals are those of the selected inverse; the world is that of `compare_engines`.
    """
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, config.bench_p, config.seed)

    def refine_all():
        covariances = selected_inverse.window_covariances(base.solution, base.world, conventions)
        return _refine(config, replace(base, covariances=covariances), slice(None), "fast")

    refine_all()  # compile, or load what was compiled
    _, isam2_seconds = engine_bench.timed(lambda: run_isam2(base.world, conventions))
    return engine_bench.timed(refine_all)[1], isam2_seconds


@dataclass(frozen=True)
class ClosureCost:
    """The likelihood of a window with the closure taken literally, and with what matters of it.

    Attributes
    ----------
    all_factors, window_factors : number of factors in each
    seconds_loop, seconds_all, seconds_window : CPU time per call: all factors one by one in
        Python, all in one GTSAM call, those that touch the window in one GTSAM call
    largest_difference : largest deviation between the first two differences of log-likelihood
        to the MAP and the third, over random points, [nats]
    """

    all_factors: int
    window_factors: int
    seconds_loop: float
    seconds_all: float
    seconds_window: float
    largest_difference: float


def closure_cost(config: Config, cost: Cost, t: int, *, rng: np.random.Generator) -> ClosureCost:
    """Time the three ways of writing the likelihood of window t, and check they agree."""
    solution, keys = cost.baseline.solution, windows.window_keys(t)
    closed = variable_closure(solution.graph, keys)
    whole = touching_factors(solution.graph, list(closed))
    factors = touching_factors(solution.graph, keys)

    def likelihood(chosen):
        return LocalLikelihood(chosen, solution.estimate, keys, config.likelihood_factor)

    looped = likelihood(engine_bench.FactorLoop(whole))
    all_at_once, local = likelihood(whole), likelihood(factors)
    cholesky = np.linalg.cholesky(cost.baseline.covariances[t])
    points = rng.normal(size=(config.timing_calls, local.dimension)) @ cholesky.T
    values, seconds = [], []
    for function in (looped, all_at_once, local):
        at_points, took = engine_bench.timed(
            lambda f=function: np.array([f(point) for point in points])
        )
        values.append(at_points - function(np.zeros(local.dimension)))
        seconds.append(took / len(points))
    return ClosureCost(
        whole.size(), factors.size(), *seconds,
        largest_difference=float(max(abs(v - values[2]).max() for v in values[:2])),
    )  # fmt: skip


def middle_window(costs: dict[float, Cost]) -> int:
    """First pose of the window in the middle of the trajectory."""
    return len(next(iter(costs.values())).calls) // 2


def single_window(config: Config, t: int) -> weighted_samples.NestedRun:
    """The nested sampling run of window t at the first p, for settings other than the paper's."""
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, config.p_levels[0], config.seed)
    return _refine(config, base, t)[0].run
