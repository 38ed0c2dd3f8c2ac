"""The engines side by side: the same windows, one run, one core, and what each gets wrong."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, TypeVar

import gtsam
import numpy as np
import pandas as pd
from pydantic import Field

from sngr_utils import compiled, engines, importance, nested, refine, report, windows
from sngr_utils.baseline import Baseline
from sngr_utils.world import Checked, Probability

T = TypeVar("T")


class BenchSettings(Checked):
    """bench_p : wrong-association probability of the world the engines are compared on

    bench_windows : windows of it, spread evenly
    bench_runs : runs of each dynesty engine, over all windows; the others run ten times as many
    reference_draws : importance samples behind each window's reference evidence and mean
    """

    bench_p: Probability = 0.2
    bench_windows: Annotated[int, Field(ge=1)] = 4
    bench_runs: Annotated[int, Field(ge=2)] = 36
    reference_draws: Annotated[int, Field(ge=1000)] = 100_000


class FactorLoop:
    """A factor graph whose error is summed factor by factor in Python."""

    def __init__(self, graph: gtsam.NonlinearFactorGraph):
        self._factors = [graph.at(i) for i in range(graph.size())]

    def size(self) -> int:
        return len(self._factors)

    def error(self, values: gtsam.Values) -> float:
        return sum(factor.error(values) for factor in self._factors)


@dataclass(frozen=True)
class Contender:
    """One row of the bench.

    Attributes
    ----------
    name : as the table shows it
    settings : of its sampler
    sample : (likelihood, covariance, settings, rng) -> NestedRun
    repeats : runs for each run of dynesty
    """

    name: str
    settings: nested.SamplerSettings
    sample: Callable[..., nested.NestedRun]
    repeats: int = 1


@dataclass(frozen=True)
class Performance:
    """What the runs of one contender came to. R runs over the bench's windows.

    Attributes
    ----------
    seconds : (R,) CPU time of each run
    calls : (R,) likelihood calls
    errors : (R,) log Z less the reference, [nats]
    mean_errors : (R,) root mean square error of the mean, in posterior standard deviations
    variance_ratios : (R,) geometric mean of the variances over the reference's
    ess : (R,) effective samples
    """

    seconds: np.ndarray
    calls: np.ndarray
    errors: np.ndarray
    mean_errors: np.ndarray
    variance_ratios: np.ndarray
    ess: np.ndarray


@dataclass(frozen=True)
class Reference:
    """A window's evidence with its standard error, [nats], and its mean and variances (d,)."""

    log_evidence: float
    error: float
    mean: np.ndarray
    variances: np.ndarray


REFERENCE_ENGINE = "dynesty 100/9, factors in a Python loop"


def contenders(settings: nested.SamplerSettings) -> list[Contender]:
    """The paper's sampler written three ways, and the engines that replace it."""

    def through(engine):
        return lambda likelihood, covariance, chosen, rng: engines.sample_window(
            likelihood, covariance, chosen, engine, rng=rng
        )

    def looped(likelihood, covariance, chosen, rng):
        loop = nested.LocalLikelihood(
            FactorLoop(likelihood.factors), likelihood.estimate, likelihood.keys, likelihood.factor
        )
        return engines.sample_window(loop, covariance, chosen, rng=rng)

    n, few = settings.n_live, settings.walks(9)
    long = settings.model_copy(update={"min_walks": engines.ENOUGH_WALKS})
    return [
        Contender(REFERENCE_ENGINE.replace("100/9", f"{n}/{few}"), settings, looped),
        Contender(f"dynesty {n}/{few}, one call to GTSAM", settings, through("dynesty")),
        Contender(f"dynesty {n}/{long.min_walks}, compiled walk", long, through("dynesty-compiled")),
        Contender(f"compiled nested {n}/{few}", settings, through("nested"), 10),
        Contender(f"compiled nested {n}/{long.min_walks}", long, through("nested"), 10),
        Contender("fast path", settings, through("fast"), 10),
    ]


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """The result of `work()` and the CPU time it took, [s]; on one thread, with no waiting."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def spread_evenly(n: int, total: int) -> list[int]:
    """n of `total` windows, spread evenly, of those that may trigger."""
    return np.linspace(windows.FIRST_ELIGIBLE, total - 1, n).round().astype(int).tolist()


def reference(
    likelihood: nested.LocalLikelihood,
    covariance: np.ndarray,
    settings: nested.SamplerSettings,
    draws: int,
    *,
    rng: np.random.Generator,
) -> Reference:
    """Evidence and moments of a window by importance sampling with very many draws."""
    factors = compiled.flatten(
        likelihood.factors, likelihood.estimate, likelihood.keys, likelihood.factor
    )
    cholesky = np.linalg.cholesky(settings.prior_scale * covariance)
    fast = importance.FastSettings(n_draws=draws)
    run = importance.sample(factors, cholesky, fast, rng=rng)
    weights = np.exp(run.log_weights)
    mean = weights @ run.samples
    variances = weights @ (run.samples - mean) ** 2
    return Reference(run.log_evidence, run.log_evidence_error, mean, variances)


def compare(
    base: Baseline,
    settings: nested.SamplerSettings,
    bench: BenchSettings,
    *,
    rng: np.random.Generator,
) -> dict[str, Performance]:
    """Run all contenders on the same windows, turn by turn, and measure each run."""
    chosen = spread_evenly(bench.bench_windows, len(base.covariances))
    likelihoods = [
        refine.window_likelihood(base.solution, t, settings.likelihood_factor) for t in chosen
    ]
    references = [
        reference(likelihood, base.covariances[t], settings, bench.reference_draws, rng=rng)
        for t, likelihood in zip(chosen, likelihoods, strict=True)
    ]
    field = contenders(settings)
    for contender in field[2:]:  # compile, or load what was compiled
        contender.sample(likelihoods[0], base.covariances[chosen[0]], contender.settings, rng)
    rows: dict[str, list] = {contender.name: [] for contender in field}
    for run in range(bench.bench_runs):
        w = run % len(chosen)
        for contender in field:
            for _ in range(contender.repeats):
                rows[contender.name].append(
                    _one_run(contender, likelihoods[w], base.covariances[chosen[w]],
                             references[w], rng)
                )  # fmt: skip
    return {name: Performance(*np.array(runs).T) for name, runs in rows.items()}


def _one_run(
    contender: Contender,
    likelihood: nested.LocalLikelihood,
    covariance: np.ndarray,
    truth: Reference,
    rng: np.random.Generator,
) -> tuple[float, ...]:
    """The numbers of `Performance` for one run, with a random stream of its own."""
    (stream,) = rng.spawn(1)
    run, seconds = timed(
        lambda: contender.sample(likelihood, covariance, contender.settings, stream)
    )
    mean, spread = run.mean, np.diag(run.covariance)
    return (
        seconds,
        run.calls,
        run.log_evidence - truth.log_evidence,
        np.sqrt(np.mean((mean - truth.mean) ** 2 / truth.variances)),
        np.exp(np.mean(np.log(spread / truth.variances))),
        run.ess_share * len(run.samples),
    )


def speed_table(performances: dict[str, Performance]) -> pd.DataFrame:
    """CPU time of a window and its ratio to the first row, calls, effective samples."""
    slowest = next(iter(performances.values())).seconds.mean()
    rows = [
        [
            name,
            report.text(1e3 * p.seconds.mean(), ".1f" if p.seconds.mean() > 0.01 else ".2f"),
            report.text(slowest / p.seconds.mean(), ".1f" if slowest < 10 * p.seconds.mean() else ".0f"),
            report.text(p.calls.mean(), ".0f"),
            report.text(1e6 * p.seconds.sum() / p.calls.sum(), ".2f"),
            report.text(p.ess.sum() / p.seconds.sum(), ".0f"),
        ]
        for name, p in performances.items()
    ]
    columns = ["engine", "ms per window", "ratio", "calls", "µs per call", "ESS per s"]
    return pd.DataFrame(rows, columns=columns)


def accuracy_table(performances: dict[str, Performance]) -> pd.DataFrame:
    """What each engine gets wrong: bias of log Z, spread, mean, variances."""
    rows = []
    for name, p in performances.items():
        error = report.standard_error(p.errors)
        rows.append([
            name,
            str(len(p.errors)),
            f"{report.text(p.errors.mean(), '+.3f')} ± {report.text(error, '.3f')}",
            report.text(float(np.sqrt(np.mean(p.errors**2))), ".3f"),
            report.text(float(np.sqrt(np.mean(p.mean_errors**2))), ".2f"),
            report.text(float(np.exp(np.mean(np.log(p.variance_ratios)))), ".2f"),
        ])
    columns = ["engine", "runs", "bias of log Z", "rms", "error of the mean", "variance ratio"]
    return pd.DataFrame(rows, columns=columns)
