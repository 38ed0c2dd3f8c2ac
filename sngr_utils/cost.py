"""What notebook 04 runs: what selective refinement costs, and what it saves.

A helper's `Config` is read to check parameters before anything runs. So what is slow to load is
imported by the functions that need it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from sngr_utils.experiments.bench import BenchSettings, Performance
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.settings import Levels, PosesOfWindows, Positive, Seed
from sngr_utils.slam.conventions import PRESETS, OpenConventions
from sngr_utils.world.scenario import Scenario

if TYPE_CHECKING:
    from sngr_utils.experiments.growth import Growth
    from sngr_utils.experiments.refinement_cost import ClosureCost, Cost
    from sngr_utils.sampling.weighted_samples import WeightedSamples
    from sngr_utils.sngr.baseline import Baseline


class Config(Scenario, SamplerSettings, BenchSettings, OpenConventions):
    """Parameters of the cost study; the defaults are the paper's values where it states them.

    timing_calls : likelihood calls behind each time per call
    """

    n_poses: PosesOfWindows = 30
    seed: Seed = 0
    p_levels: Levels = [0.0, 0.1, 0.2, 0.3]
    tau: Positive = 3.9
    timing_calls: Annotated[int, Field(ge=10)] = 2000


def run(config: Config) -> dict[float, Cost]:
    """Refine the windows that trigger at every p, and every third of the others, timing each."""
    from sngr_utils.experiments.refinement_cost import measure

    sampler = config.part(SamplerSettings)
    return {
        p: measure(_baseline(config, p), config.chosen, config.tau, sampler)
        for p in config.p_levels
    }


def run_presets(config: Config, costs: dict[float, Cost]) -> dict[str, dict[float, Cost]]:
    """The same under each preset of the open conventions, on the same data.

    Parameters
    ----------
    costs : what `run` gave: one preset's costs, if no field was replaced. The others are those of
        the compiled nested sampler, which takes a hundredth of the time
    """
    from sngr_utils.experiments.refinement_cost import measure, refine_windows

    sampler, found = config.part(SamplerSettings), {}
    base = _baseline(config, config.p_levels[0])
    refine_windows(base, config.chosen, 0, sampler, "nested")  # compile, or load
    for preset in PRESETS:
        other = config.under(preset)
        found[preset] = costs if other == config else {
            p: measure(_baseline(other, p), other.chosen, config.tau, sampler, "nested")
            for p in config.p_levels
        }  # fmt: skip
    return found


def _baseline(config: Config, p: float) -> Baseline:
    from sngr_utils.sngr.baseline import run_baseline

    return run_baseline(config.part(Scenario), config.chosen, p, config.seed)


def compare_engines(config: Config, *, with_peers: bool = False) -> dict[str, Performance]:
    """All engines, and other people's, on the same windows of a world (`engine_bench.compare`)."""
    from sngr_utils.experiments import engine_bench

    base, rng = _baseline(config, config.bench_p), np.random.default_rng([config.seed, 4])
    settings, sizes = config.part(SamplerSettings), config.part(BenchSettings)
    others = engine_bench.peers(base, settings) if with_peers else []
    return engine_bench.compare(base, settings, sizes, others, rng=rng)


def likelihood_seconds(config: Config) -> float:
    """CPU time of one compiled likelihood call of a window of `compare_engines`, [s]."""
    from sngr_utils.experiments import engine_bench

    base = _baseline(config, config.bench_p)
    middle = len(base.covariances) // 2
    return engine_bench.likelihood_seconds(
        base, middle, config.likelihood_factor, config.timing_calls
    )


def two_modes(config: Config) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The fast path on the landmark of notebook 01 (`engine_bench.two_modes`)."""
    from sngr_utils.experiments import engine_bench

    return engine_bench.two_modes(rng=np.random.default_rng([config.seed, 5]))


def grow(config: Config) -> Growth:
    """CPU time against the number of poses (`growth.growth`)."""
    from sngr_utils.experiments import growth

    return growth.growth(config.lengths, config.part(Scenario), config.chosen, config.seed)


def exhaustive_fast(config: Config) -> tuple[np.ndarray, np.ndarray]:
    """CPU times of refining every window by the fast path, and of iSAM2, several of each, [s].

    On the world of `compare_engines` (`refinement_cost.exhaustive_fast`).
    """
    from sngr_utils.experiments import refinement_cost

    base = _baseline(config, config.bench_p)
    return refinement_cost.exhaustive_fast(base, config.chosen, config.part(SamplerSettings))


def closure_cost(config: Config, cost: Cost, t: int, *, rng: np.random.Generator) -> ClosureCost:
    """Time the three ways of writing the likelihood of window t, and check they agree."""
    from sngr_utils.experiments import refinement_cost

    return refinement_cost.closure_cost(
        cost.baseline, t, config.likelihood_factor, config.timing_calls, rng=rng
    )


def middle_window(costs: dict[float, Cost]) -> int:
    """First pose of the window in the middle of the trajectory."""
    return len(next(iter(costs.values())).calls) // 2


def single_window(config: Config, t: int) -> WeightedSamples:
    """The nested sampling run of window t at the first p, for settings other than the paper's."""
    from sngr_utils.experiments.refinement_cost import refine_windows

    base, sampler = _baseline(config, config.p_levels[0]), config.part(SamplerSettings)
    return refine_windows(base, config.chosen, t, sampler)[0].run
