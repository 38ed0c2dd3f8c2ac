"""Driver of notebook 04: what selective refinement costs, and what it saves."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from sngr_utils import bench, parameters, report
from sngr_utils.experiments import engine_bench, growth
from sngr_utils.metrics import standard_error
from sngr_utils.sampling import engines, importance, weighted_samples
from sngr_utils.sampling.settings import FastSettings, SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.settings import Positive, Probability, Seed
from sngr_utils.slam import selected_inverse
from sngr_utils.slam.conventions import preset_conventions
from sngr_utils.slam.isam2 import run_isam2
from sngr_utils.sngr import gate, refine, windows
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
    streams = np.random.default_rng([config.seed, 1]).spawn(len(base.covariances))
    fired = base.fired(config.tau)
    calls, seconds = np.full((2, len(fired)), np.nan)
    for t in [*np.flatnonzero(fired), *np.flatnonzero(~fired)[::EVERY]]:
        run, seconds[t] = engine_bench.timed(lambda t=t: _sample(config, base, t, streams[t]))
        calls[t] = run.calls
    return Cost(base, fired, calls, seconds, isam2_seconds)


def _sample(
    config: Config, base: Baseline, t: int, rng: np.random.Generator, engine: str = "dynesty"
) -> weighted_samples.NestedRun:
    """The run of one window."""
    likelihood = refine.window_likelihood(base.solution, t, config.likelihood_factor)
    settings = config.part(SamplerSettings)
    return engines.sample_window(likelihood, base.covariances[t], settings, engine, rng=rng)


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


def print_bench(config: Config) -> None:
    """What ``make bench`` prints: speed and accuracy of the engines, growth of the marginals."""
    performances = compare_engines(config)
    print(bench.speed_table(performances, likelihood_seconds(config)).to_string(index=False))
    print()
    print(bench.accuracy_table(performances).to_string(index=False))
    print()
    print(bench.growth_table(grow(config)).to_string(index=False))


def two_mode_table(*, rng: np.random.Generator, runs: int = 40) -> pd.DataFrame:
    """The fast path on the two-mode landmark of notebook 01, from one start and from many."""
    rows = []
    for n_starts in (1, FastSettings().n_starts):
        masses, k_hats = engine_bench.two_mode_runs(n_starts, runs, rng=rng)
        right = np.abs(masses - 0.5) < 0.1
        content = k_hats <= importance.MAX_K_HAT
        rows.append([
            str(n_starts), f"{right.sum()} of {runs}", f"{(content & ~right).sum()} of {runs}",
            report.mean_std(masses),
        ])  # fmt: skip
    columns = ["starts", "right", "wrong, k-hat content", "mass of the upper mode"]
    return pd.DataFrame(rows, columns=columns)


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
        return refine.refine_windows(
            base.solution, range(len(covariances)), covariances,
            config.part(SamplerSettings), gate.Gate(), "fast",
            rng=np.random.default_rng([config.seed, 1]),
        )  # fmt: skip

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


def saving_series(costs: dict[float, Cost]) -> dict[str, tuple[list[int], list[float]]]:
    """Windows that fire and the saving, ours in calls and as printed, where anything fires."""
    ours = [(int(cost.fired.sum()), cost.saving_calls) for cost in costs.values()]
    printed = [report.printed_values()["cost"].get(p, {}) for p in costs]
    was = [(row["triggered"], row["saving"]) for row in printed if row.get("saving")]
    return {
        name: ([n for n, _ in pairs], [saving for _, saving in pairs])
        for name, pairs in (("ours", ours), ("printed", was))
    }


def per_window(costs: dict[float, Cost]) -> tuple[float, float]:
    """Likelihood calls and CPU time of a window, [s], mean over all windows of all levels."""
    n = sum(len(cost.calls) for cost in costs.values())
    calls = sum(cost.exhaustive(cost.calls) for cost in costs.values()) / n
    return calls, sum(cost.exhaustive(cost.seconds) for cost in costs.values()) / n


def middle_window(costs: dict[float, Cost]) -> int:
    """First pose of the window in the middle of the trajectory."""
    return len(next(iter(costs.values())).calls) // 2


def single_window(config: Config, t: int) -> weighted_samples.NestedRun:
    """The nested sampling run of window t at the first p, for settings other than the paper's."""
    conventions = preset_conventions(config.preset, config.conventions)
    base = run_baseline(config.part(Scenario), conventions, config.p_levels[0], config.seed)
    rng = np.random.default_rng([config.seed, 1]).spawn(len(base.covariances))[t]
    return _sample(config, base, t, rng)


def cost_table(costs: dict[float, Cost]) -> pd.DataFrame:
    """tab:cost, printed beside ours: wall clocks (ours from one run on one machine) and savings."""
    printed, t, rows = report.printed_values()["cost"], report.text, []
    for p, cost in costs.items():
        was = printed.get(p, {})
        rows.append([
            f"{p:g}", t(was.get("triggered"), "d"), str(int(cost.fired.sum())),
            t(was.get("isam2")), t(cost.isam2_seconds, ".3f"),
            t(was.get("refine"), "d"), t(cost.seconds[cost.fired].sum(), ".1f"),
            t(was.get("exhaustive"), "d"), t(cost.exhaustive(cost.seconds), ".1f"),
            t(was.get("saving"), ".1f"), t(cost.saving_seconds, ".1f"), t(cost.saving_calls, ".1f"),
        ])  # fmt: skip
    groups = ["triggered", "iSAM2 [s]", "refine [s]", "exhaustive [s]"]
    heads = [("", "p")] + [(name, who) for name in groups for who in ("printed", "ours")]
    heads += [("saving", who) for who in ("printed", "ours", "in calls")]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(heads))


def closure_table(costs: dict[float, Cost], closure: ClosureCost) -> pd.DataFrame:
    """Time per likelihood call, and per window if all its calls cost that much."""
    calls, seconds = per_window(costs)
    t = report.text
    rows = [
        [name, str(n), t(1e6 * each, ".0f"), t(each / closure.seconds_window, ".1f"),
         t(calls * each), t(100 * calls * each / seconds, ".0f")]
        for name, n, each in (
            ("closure, one by one", closure.all_factors, closure.seconds_loop),
            ("closure, one call", closure.all_factors, closure.seconds_all),
            ("touching factors, one call", closure.window_factors, closure.seconds_window),
        )
    ]  # fmt: skip
    columns = ["likelihood", "factors", "µs per call", "ratio", "s per window", "% of ours"]
    return pd.DataFrame(rows, columns=columns)


def calls_table(costs: dict[float, Cost]) -> pd.DataFrame:
    """Likelihood calls, which are the same on every machine."""
    rows = [
        [
            f"{p:g}",
            str(int(cost.fired.sum())),
            report.text(cost.exhaustive(cost.calls) / len(cost.calls), ".0f"),
            report.text(float(cost.calls[cost.fired].sum()), ".0f"),
            report.text(cost.exhaustive(cost.calls), ".0f"),
            report.text(cost.saving_calls, ".1f"),
        ]
        for p, cost in costs.items()
    ]
    columns = ["p", "triggered", "calls per window", "selective", "exhaustive", "saving"]
    return pd.DataFrame(rows, columns=columns)


def record(
    config: Config, costs: dict[float, Cost], closure: ClosureCost, to: report.Report
) -> None:
    """Hand the costs to the paper, times apart from the rest."""
    to.value("cost.seed", config.seed, ".0f")
    to.value("cost.tau", config.tau)
    first = min(costs)
    to.value("cost.p_first", first, "g")
    to.value("cost.saving_calls", costs[first].saving_calls, ".1f")
    calls, seconds = per_window(costs)
    n = sum(int(np.isfinite(cost.calls).sum()) for cost in costs.values())
    to.value("cost.calls_per_window", calls, ".0f", n=n, within=50)
    to.value("closure.all_factors", closure.all_factors, ".0f")
    to.value("closure.window_factors", closure.window_factors, ".0f")
    isam2 = np.mean([cost.isam2_seconds for cost in costs.values()])
    in_likelihood = calls * closure.seconds_window / seconds
    for key, value, fmt in (
        ("cost.window_over_isam2", seconds / isam2, ".0f"),
        ("cost.likelihood_share", 100 * in_likelihood, ".0f"),
        ("closure.loop_over_window", closure.seconds_loop / closure.seconds_window, ".0f"),
        ("closure.all_over_window", closure.seconds_all / closure.seconds_window, ".1f"),
    ):
        to.value(key, value, fmt, timing=True)
    to.value("cost.isam2_seconds", isam2, ".3f", "s", timing=True)


def record_engines(
    performances: dict[str, engine_bench.Performance],
    grown: growth.Growth,
    fast: tuple[float, float],
    to: report.Report,
) -> None:
    """Hand the comparison of the engines to the paper; `fast` is that of `exhaustive_fast`."""
    keys = dict(zip(performances, (
        "closure_loop", "window_loop", "one_call", "compiled_walk_few", "compiled_walk",
        "nested_few", "nested", "fast",
    ), strict=True))  # fmt: skip
    for name, key in keys.items():
        p, faster = performances[name], engine_bench.ratio(performances, name)
        to.value(f"engine.{key}.ratio", faster, ".1f" if faster < 10 else ".0f", timing=True)
        error = standard_error.standard_error(p.errors)
        to.value(f"engine.{key}.bias", p.errors.mean(), ".3f", "nats", error, len(p.errors))
    rms = float(np.sqrt(np.mean(performances["fast path"].errors ** 2)))
    to.value("engine.fast.rms", rms, ".3f", "nats", n=len(performances["fast path"].errors),
             within=0.005)  # fmt: skip
    to.value("engine.fast_all_over_isam2", fast[0] / fast[1], ".1f", timing=True)
    inverse, together, anew = (
        grown.seconds[f"marginals, {how}"]
        for how in ("selected inverse", "GTSAM", "GTSAM, asked anew for each window")
    )
    known = np.isfinite(together)
    to.value("growth.shortest", grown.lengths[0], ".0f")
    to.value("growth.longest_compared", grown.lengths[known][-1], ".0f")
    to.value("growth.longest", grown.lengths[-1], ".0f")
    for name, other in (("together", together), ("anew", anew)):
        to.value(f"growth.{name}.first", other[0] / inverse[0], ".0f", timing=True)
        last = (other / inverse)[known][-1]
        order = 10.0 ** np.floor(np.log10(last)) if last > 1000 else last  # three windows' worth
        to.value(f"growth.{name}.last", order, ".0f", timing=True)
    to.value("growth.slope", grown.slope("marginals, selected inverse"), timing=True)


if __name__ == "__main__":
    print_bench(Config(**parameters.read_params("04_cost")))
