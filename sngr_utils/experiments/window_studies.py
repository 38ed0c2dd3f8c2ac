"""The numbers of `window_posteriors` and `sampler_numbers` for the windows of many worlds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from sngr_utils.experiments import sampler_numbers, window_posteriors
from sngr_utils.experiments.many_worlds import map_worlds
from sngr_utils.sampling import settings
from sngr_utils.settings import READING
from sngr_utils.slam import levenberg_marquardt
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.sngr import corrected, noop_baseline, trigger, window_posterior, windows
from sngr_utils.sngr.baseline import run_baseline
from sngr_utils.world.scenario import Scenario


@dataclass(frozen=True)
class WindowStudies:
    """Tables of the experiments window by window, one row per window and setting.

    Attributes
    ----------
    widths : sampled over conditional and marginal standard deviations, three readings
    ratios : marginal over conditional standard deviations, all presets
    gains : attainable gain, factor 1/2 as printed, at estimates settled more and more
    gaussianity : Laplace evidence against importance sampling, both treatments of separators
    ess : effective sample sizes of windows of the settled estimate and of exact Gaussians, under
        the preset that is our reading only: they are the sampler's, whatever the preset
    evidence : nested against importance sampling of the corrected target, likewise
    """

    widths: pd.DataFrame
    ratios: pd.DataFrame
    gains: pd.DataFrame
    gaussianity: pd.DataFrame
    ess: pd.DataFrame
    evidence: pd.DataFrame


def run(scenario: Scenario, p: float, seeds: Sequence[int], jobs: int) -> WindowStudies:
    """All experiments window by window, world by world, under all presets."""
    cases = [(scenario, preset, p, seed) for preset in PRESETS for seed in seeds]
    done = map_worlds(_of_one_world, cases, jobs)
    return WindowStudies(*(_table(parts) for parts in zip(*done, strict=True)))


def _table(parts: Sequence[dict[str, list]]) -> pd.DataFrame:
    return pd.concat(map(pd.DataFrame, parts), ignore_index=True)


def _of_one_world(scenario: Scenario, preset: str, p: float, seed: int) -> list[dict[str, list]]:
    """The columns of the six tables of one world."""
    base = run_baseline(scenario, PRESETS[preset], p, seed)
    # a stream for each preset: the same draws for the same Gaussian would be one test, not three
    rng = np.random.default_rng([seed, 6, list(PRESETS).index(preset)])
    sampler = settings.SamplerSettings(min_walks=50)
    n = len(base.covariances)
    some = list(range(trigger.FIRST_ELIGIBLE, n, max(1, n // 5)))
    settled = levenberg_marquardt.converge(base.solution)
    covariances = windows.covariances(settled)
    at_rest = replace(base, solution=settled, covariances=covariances)
    checks, laplace, pieces = [], [], window_posterior.expand(settled)
    for separators, walks in (("conditional", 100), ("marginal", corrected.LONG_WALKS)):
        aims = window_posteriors.settled_targets(
            settled, pieces, covariances, some, separators, rng=rng
        )
        found = window_posteriors.gaussianity(aims, rng=rng)
        laplace.append(found.assign(separators=separators))
        if preset == READING:
            fewer = aims[:: 1 + (separators == "marginal")]
            found = sampler_numbers.evidence_check(fewer, walks, rng=rng)
            checks.append(found.assign(separators=separators))
    ess = sampler_numbers.ess_shares(at_rest, some if preset == READING else [], sampler, rng=rng)
    tables = [
        window_posteriors.widths(base, some, sampler, rng=rng),
        window_posteriors.marginal_over_conditional(base),
        window_posteriors.gains(base),
        pd.concat(laplace),
        ess,
        pd.concat(checks) if checks else pd.DataFrame(),
    ]
    return [table.assign(preset=preset, seed=seed).to_dict("list") for table in tables]


def gaussian_ess(scenario: Scenario, p: float, seeds: Sequence[int], jobs: int) -> pd.DataFrame:
    """ESS share of an exact Gaussian in the place of one window of every world.

    Returns
    -------
    one row per preset and seed: ess_share
    """
    cases = [(scenario, preset, p, seed) for preset in PRESETS for seed in seeds]
    rows = map_worlds(_gaussian_ess, cases, jobs)
    return pd.DataFrame(rows, columns=["preset", "seed", "ess_share"])


def _gaussian_ess(scenario: Scenario, preset: str, p: float, seed: int) -> tuple[str, int, float]:
    base = run_baseline(scenario, PRESETS[preset], p, seed)
    middle = len(base.covariances) // 2
    table = sampler_numbers.ess_shares(
        base, [middle], settings.SamplerSettings(min_walks=50), (1.0,),
        rng=np.random.default_rng([seed, 7]),
    )  # fmt: skip
    return preset, seed, float(table.loc[table["kind"] == "Gaussian", "ess_share"].iloc[0])


def noop_readings(
    scenario: Scenario, p: float, seeds: Sequence[int], tau: float, jobs: int
) -> pd.DataFrame:
    """Mean log weight of the no-op sampler by reading, for the windows that fire at `tau`."""
    cases = [(scenario, preset, p, seed, tau) for preset in PRESETS for seed in seeds]
    return _table(map_worlds(_noop, cases, jobs))


def _noop(scenario: Scenario, preset: str, p: float, seed: int, tau: float) -> dict[str, list]:
    base = run_baseline(scenario, PRESETS[preset], p, seed)
    table = sampler_numbers.noop_readings(
        base, tau, noop_baseline.TriggerOnly(), rng=np.random.default_rng([seed, 8])
    )
    return table.assign(preset=preset, seed=seed).to_dict("list")
