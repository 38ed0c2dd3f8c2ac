"""The engines side by side: the same windows, one run, one core, and what each gets wrong."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L

from sngr_utils.experiments.bench import (
    BLACKJAX,
    CLOSURE_LOOP,
    NESTLE,
    WINDOW_LOOP,
    BenchSettings,
    Performance,
)  # fmt: skip
from sngr_utils.sampling import (
    engines,
    importance,
    importance_diagnostics,
    peer_samplers,
    weighted_samples,
)  # fmt: skip
from sngr_utils.sampling.settings import FastSettings, SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.sngr import refine, trigger
from sngr_utils.sngr.baseline import Baseline
from sngr_utils.world.two_anchors import TwoAnchors

T = TypeVar("T")


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
    sample : (likelihood, covariance, settings, rng) -> WeightedSamples
    repeats : runs in each turn that it takes part in
    every : takes part in every so many turns
    """

    name: str
    settings: SamplerSettings
    sample: Callable[..., weighted_samples.WeightedSamples]
    repeats: int = 1
    every: int = 1


def contenders(base: Baseline, settings: SamplerSettings) -> list[Contender]:
    """The paper's sampler written three ways, and the engines that replace it."""

    def through(engine):
        return lambda likelihood, covariance, chosen, rng: engines.sample_window(
            likelihood, covariance, chosen, engine, rng=rng
        )

    def looped(likelihood, covariance, chosen, rng, factors=None):
        loop = LocalLikelihood(
            FactorLoop(factors or likelihood.factors), likelihood.estimate, likelihood.keys,
            likelihood.factor,
        )  # fmt: skip
        run = engines.sample_window(loop, covariance, chosen, rng=rng)
        at_map = np.zeros(likelihood.dimension)
        constant = likelihood(at_map) - loop(at_map)  # of the factors that do not touch the window
        return replace(run, log_evidence=run.log_evidence + constant)

    def whole_closure(likelihood, covariance, chosen, rng):
        return looped(likelihood, covariance, chosen, rng, base.solution.graph)

    n, few = settings.n_live, settings.walks(9)
    long = settings.model_copy(update={"min_walks": max(few, engines.ENOUGH_WALKS)})
    many = long.min_walks
    return [
        Contender(CLOSURE_LOOP, settings, whole_closure, every=9),
        Contender(WINDOW_LOOP, settings, looped, every=3),
        Contender(f"dynesty {n}/{few}, one call to GTSAM", settings, through("dynesty"), every=3),
        Contender(f"compiled nested {n}/{few}", settings, through("nested"), 10),
        Contender(f"compiled nested {n}/{many}", long, through("nested"), 10),
        Contender("fast path", settings, through("fast"), 10),
    ]


def peers(base: Baseline, settings: SamplerSettings) -> list[Contender]:
    """Other people's samplers, those that are installed."""
    window = refine.window_likelihood(
        base.solution, trigger.FIRST_ELIGIBLE, settings.likelihood_factor
    )
    found = []
    if peer_samplers.installed("nestle"):
        found.append(Contender(NESTLE, settings, _nestle))
    if peer_samplers.installed("blackjax"):
        slices = peer_samplers.NestedSlice(engines.flattened(window), settings)

        def sliced(likelihood, covariance, _settings, rng):
            return slices(engines.flattened(likelihood), covariance, rng=rng)

        found.append(Contender(BLACKJAX, settings, sliced, 10))
    return found


def _nestle(likelihood, covariance, settings, rng):
    return peer_samplers.sample_nestle(engines.flattened(likelihood), covariance, settings, rng=rng)


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """The result of `work()` and the CPU time it took, [s]; on one thread, with no waiting."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def repeated(work: Callable[[], object], repeats: int = 9) -> np.ndarray:
    """(repeats,) CPU times of `work()`, [s]."""
    return np.array([timed(work)[1] for _ in range(repeats)])


def spread_evenly(n: int, total: int) -> list[int]:
    """n of `total` windows, spread evenly, of those that may trigger."""
    return np.linspace(trigger.FIRST_ELIGIBLE, total - 1, n).round().astype(int).tolist()


def reference(
    likelihood: LocalLikelihood,
    covariance: np.ndarray,
    settings: SamplerSettings,
    draws: int,
    *,
    rng: np.random.Generator,
) -> weighted_samples.WeightedSamples:
    """A window's posterior by importance sampling with very many draws."""
    factors = engines.flattened(likelihood)
    cholesky = np.linalg.cholesky(settings.prior_scale * covariance)
    return importance.sample(factors, cholesky, FastSettings(n_draws=draws), rng=rng)


def compare(
    base: Baseline,
    settings: SamplerSettings,
    bench: BenchSettings,
    others: list[Contender],
    *,
    rng: np.random.Generator,
) -> dict[str, Performance]:
    """Run all contenders, and `others`, on the same windows in turn, and measure each run.

    Each has a random stream of its own, so its rows are the same whoever else takes part.
    """
    chosen = spread_evenly(bench.bench_windows, len(base.covariances))
    likelihoods = [
        refine.window_likelihood(base.solution, t, settings.likelihood_factor) for t in chosen
    ]
    references = [
        reference(likelihood, base.covariances[t], settings, bench.reference_draws, rng=rng)
        for t, likelihood in zip(chosen, likelihoods, strict=True)
    ]
    field = [*contenders(base, settings), *others]
    streams = rng.spawn(len(field))
    for contender in field[3:]:  # compile, or load what was compiled
        contender.sample(likelihoods[0], base.covariances[chosen[0]], contender.settings, rng)
    rows: dict[str, list] = {contender.name: [] for contender in field}
    for run in range(bench.bench_runs):
        w = run % len(chosen)
        for contender, stream in zip(field, streams, strict=True):
            for _ in range(contender.repeats if run % contender.every == 0 else 0):
                rows[contender.name].append(
                    _one_run(contender, likelihoods[w], base.covariances[chosen[w]],
                             references[w], stream)
                )  # fmt: skip
    return {name: Performance(*np.array(runs).T) for name, runs in rows.items()}


def _one_run(
    contender: Contender,
    likelihood: LocalLikelihood,
    covariance: np.ndarray,
    truth: weighted_samples.WeightedSamples,
    rng: np.random.Generator,
) -> tuple[float, ...]:
    """The numbers of `Performance` for one run, with a random stream of its own."""
    (stream,) = rng.spawn(1)
    run, seconds = timed(
        lambda: contender.sample(likelihood, covariance, contender.settings, stream)
    )
    mean, spread, variances = run.mean, np.diag(run.covariance), np.diag(truth.covariance)
    return (
        seconds,
        run.calls,
        run.log_evidence - truth.log_evidence,
        np.sqrt(np.mean((mean - truth.mean) ** 2 / variances)),
        np.exp(np.mean(np.log(spread / variances))),
        run.ess_share * len(run.samples),
    )


def likelihood_seconds(base: Baseline, t: int, factor: float, calls: int) -> float:
    """CPU time of one compiled likelihood of window t, in a batch of `calls`, [s]."""
    likelihood = refine.window_likelihood(base.solution, t, factor)
    factors = engines.flattened(likelihood)
    xis = np.zeros((calls, likelihood.dimension))
    compiled.log_likelihoods(factors, xis)
    return min(timed(lambda: compiled.log_likelihoods(factors, xis))[1] for _ in range(5)) / calls


def two_modes(
    runs: int = 40, *, rng: np.random.Generator
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The fast path on two equal modes, from one start and from many: starts -> two (runs,).

    Mass of the upper mode, and whether k-hat finds nothing to object to.
    """
    found = {}
    for n_starts in (1, FastSettings().n_starts):
        masses, k_hats = _two_mode_runs(n_starts, runs, rng=rng)
        found[n_starts] = masses, k_hats <= importance_diagnostics.MAX_K_HAT
    return found


def _two_mode_runs(
    n_starts: int, runs: int, *, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Mass of the upper of two equal modes by importance sampling, and k-hat, each (runs,).

    The landmark of notebook 01 with no prior of its own, likelihood factor 1, sampled under
    N(., 50 I); started 0.5 m off the axis of symmetry, where the gradient is not zero.
    """
    scene = TwoAnchors()
    sigma = gtsam.noiseModel.Isotropic.Sigma(1, scene.range_sigma)
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(L(0), scene.saddle + np.array([0.0, 0.5]))
    for k, anchor in enumerate(scene.anchors, start=1):
        values.insert(L(k), anchor)
        factors.push_back(gtsam.RangeFactor2(L(k), L(0), scene.measured_range, sigma))
    flat = compiled.flatten(factors, values, [L(0)], 1.0)
    settings = FastSettings(n_starts=n_starts)
    masses, k_hats = np.empty(runs), np.empty(runs)
    for i, stream in enumerate(rng.spawn(runs)):
        run = importance.sample(flat, np.sqrt(50) * np.eye(2), settings, rng=stream)
        masses[i] = run.weights[run.samples[:, 1] > -0.5].sum()
        k_hats[i] = run.diagnostics.k_hat
    return masses, k_hats
