"""What refinement costs: window by window, by closure, and by the fast path on every window."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sngr_utils.experiments.engine_bench import FactorLoop, repeated, timed
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.slam import selected_inverse
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.isam2 import run_isam2
from sngr_utils.sngr import algorithm, gate, refine, trigger, windows
from sngr_utils.sngr.baseline import Baseline
from sngr_utils.sngr.closure import touching_factors, variable_closure

BATCHES = 10  # of likelihood calls, each timed by itself
EVERY = 3  # of the windows that do not trigger, every third is run and stands for all of them


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
    isam2_seconds : CPU time of the whole iSAM2 run, median over repeats
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


def refine_windows(
    base: Baseline,
    conventions: Conventions,
    which: int | slice,
    sampler: SamplerSettings,
    engine: str = "dynesty",
) -> list[refine.RefinedWindow]:
    """Windows refined whatever their scores; their random streams are those of notebook 03."""
    return algorithm.run(
        base.world, conventions, partial(trigger.regardless, which=which),
        refine.Paper(sampler, engine), gate.Gate(), base,
        rng=np.random.default_rng([base.seed, 1]),
    ).windows  # fmt: skip


def measure(
    base: Baseline,
    conventions: Conventions,
    tau: float,
    sampler: SamplerSettings,
    engine: str = "dynesty",
) -> Cost:
    """Refine the windows that trigger, and every third of the others, timing each."""
    isam2_seconds = float(np.median(repeated(lambda: run_isam2(base.world, conventions))))
    fired = base.fired(tau)
    calls, seconds = np.full((2, len(fired)), np.nan)
    for t in [*np.flatnonzero(fired), *np.flatnonzero(~fired)[::EVERY]]:
        refined, seconds[t] = timed(
            lambda t=t: refine_windows(base, conventions, t, sampler, engine)
        )
        calls[t] = refined[0].run.calls
    return Cost(base, fired, calls, seconds, isam2_seconds)


def exhaustive_fast(
    base: Baseline, conventions: Conventions, sampler: SamplerSettings
) -> tuple[np.ndarray, np.ndarray]:
    """CPU times of refining every window by the fast path, with all glue, and of iSAM2, [s].

    Each of several repeats. The marginals are those of the selected inverse.
    """

    def refine_all():
        covariances = selected_inverse.window_covariances(base.solution, base.world, conventions)
        anew = replace(base, covariances=covariances)
        return refine_windows(anew, conventions, slice(None), sampler, "fast")

    refine_all()  # compile, or load what was compiled
    return repeated(refine_all), repeated(lambda: run_isam2(base.world, conventions))


@dataclass(frozen=True)
class ClosureCost:
    """The likelihood of a window with the closure taken literally, and with what matters of it.

    Attributes
    ----------
    all_factors, window_factors : number of factors in each
    seconds_loop, seconds_all, seconds_window : (BATCHES,) CPU time per call in each batch of
        calls: all factors one by one in Python, all in one GTSAM call, those that touch the
        window in one GTSAM call
    largest_difference : largest deviation between the first two differences of log-likelihood
        to the MAP and the third, over random points, [nats]
    """

    all_factors: int
    window_factors: int
    seconds_loop: np.ndarray
    seconds_all: np.ndarray
    seconds_window: np.ndarray
    largest_difference: float


def closure_cost(
    base: Baseline, t: int, factor: float, calls: int, *, rng: np.random.Generator
) -> ClosureCost:
    """Time the three ways of writing the likelihood of window t, and check they agree.

    Parameters
    ----------
    factor : on GTSAM's error(), see `settings.SamplerSettings`
    calls : of each, at random points
    """
    solution, keys = base.solution, windows.window_keys(t)
    whole = touching_factors(solution.graph, list(variable_closure(solution.graph, keys)))
    factors = touching_factors(solution.graph, keys)
    looped, all_at_once, local = (
        LocalLikelihood(chosen, solution.estimate, keys, factor)
        for chosen in (FactorLoop(whole), whole, factors)
    )
    points = rng.normal(size=(calls, local.dimension)) @ np.linalg.cholesky(base.covariances[t]).T
    values, seconds = [], []
    for function in (looped, all_at_once, local):
        batches = [
            timed(lambda f=function, batch=batch: np.array([f(point) for point in batch]))
            for batch in np.array_split(points, BATCHES)
        ]
        at_points = np.concatenate([found for found, _ in batches])
        values.append(at_points - function(np.zeros(local.dimension)))
        seconds.append(np.array([took / len(found) for found, took in batches]))
    return ClosureCost(
        whole.size(), factors.size(), *seconds,
        largest_difference=float(max(abs(v - values[2]).max() for v in values[:2])),
    )  # fmt: skip
