"""SNGR itself over many worlds, as the paper has it and corrected: tidy tables."""

from collections.abc import Mapping, Sequence

import joblib
import numpy as np
import pandas as pd

from sngr_utils.metrics import rmse_and_nees
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.slam import marginals, solution
from sngr_utils.slam.conventions import Conventions
from sngr_utils.sngr import corrected, gate, noop_baseline, refine
from sngr_utils.sngr.baseline import Baseline, run_baseline
from sngr_utils.world.scenario import Scenario

VARIANTS = ("paper", "conditional", "marginal")


def run_sweep(
    scenario: Scenario,
    presets: Mapping[str, Conventions],
    p_levels: Sequence[float],
    seeds: Sequence[int],
    variants: Sequence[str] = VARIANTS[:1],
    tau: float = 3.9,
    jobs: int | None = None,
) -> pd.DataFrame:
    """SNGR on every world under every preset, one row per variant, preset, p and seed.

    The paper's settings, but for 50 walks instead of 9, in the compiled nested sampler. The
    corrected variants are sampled by importance sampling (`corrected.sample_target`), with which
    nested sampling agrees (`sampler_numbers.evidence_check`). They start from the batch estimate
    and refine the windows the paper's trigger fires on at iSAM2's, so rows of one world differ
    in the method alone.

    Parameters
    ----------
    presets : conventions by name, e.g. `conventions.PRESETS`
    variants : of `VARIANTS`
    jobs : processes; None leaves number and backend to ``joblib.parallel_config``

    Returns
    -------
    triggered, accepted; gain_min, gain_median, gain_max [nats] and gain_peak_window (the first
    pose of the window that gains most); ess_share (median); isam2_pose_rmse, base_pose_rmse
    (before refinement: the same, or the batch estimate's), sngr_pose_rmse,
    sngr_landmark_rmse [m] (refinement moves poses only); isam2_nees, base_nees, sngr_nees;
    saving (all windows over the refined ones: what is saved if each costs the same); noop (mean
    log weight of the trigger-only baseline, in expectation, [nats]). NaN where nothing fires

    Raises
    ------
    ValueError : an unknown variant
    """
    if not set(variants) <= set(VARIANTS):
        raise ValueError(f"variants is {list(variants)}: they must be among {VARIANTS}")
    tasks = [
        joblib.delayed(_run_one)(scenario, name, presets[name], p, seed, list(variants), tau)
        for name in presets
        for p in p_levels
        for seed in seeds
    ]
    done = joblib.Parallel(n_jobs=jobs)(tasks)
    return pd.DataFrame([row for rows in done for row in rows])


def _run_one(
    scenario: Scenario,
    preset: str,
    conventions: Conventions,
    p: float,
    seed: int,
    variants: list[str],
    tau: float,
) -> list[dict[str, object]]:
    base = run_baseline(scenario, conventions, p, seed)
    which = np.flatnonzero(base.fired(tau))
    rows = []
    for variant in variants:
        rng = np.random.default_rng([seed, 1])
        make = _paper if variant == "paper" else _corrected
        rows.append({
            "variant": variant, "preset": preset, "p": p, "seed": seed,
            "triggered": len(which), **make(base, which, variant, conventions.nees_frame, rng),
        })  # fmt: skip
    return rows


def _paper(
    base: Baseline, which: np.ndarray, variant: str, frame: str, rng: np.random.Generator
) -> dict[str, float]:
    settings = SamplerSettings(min_walks=engines.ENOUGH_WALKS)
    refined = refine.refine_windows(
        base.solution, which, base.covariances, settings, gate.Gate(), "nested", rng=rng
    )
    updated = refine.apply_updates(base.solution.estimate, refined)
    truth = base.world.poses[:, :2]
    positions = solution.poses_of(updated, len(truth))[:, :2]
    covariances = marginals.position_covariances(base.solution, frame)
    noop = noop_baseline.TriggerOnly().noop_sigma
    weights = [noop_baseline.noop_expected_log_weight(base.covariances[t], noop) for t in which]
    return {
        **_window_row(base, refined),
        "isam2_pose_rmse": base.pose_rmse,
        "base_pose_rmse": base.pose_rmse,
        "sngr_pose_rmse": rmse_and_nees.rmse(positions, truth),
        "sngr_landmark_rmse": base.landmark_rmse,
        "isam2_nees": base.nees,
        "base_nees": base.nees,
        "sngr_nees": rmse_and_nees.nees(positions - truth, covariances),
        "noop": float(np.mean(weights)) if weights else np.nan,
    }


def _corrected(
    base: Baseline, which: np.ndarray, variant: str, frame: str, rng: np.random.Generator
) -> dict[str, float]:
    settings = corrected.CorrectedSettings(separators=variant)
    sampler = SamplerSettings()
    run = corrected.run(base, which, settings, sampler, gate.NoiseGate(), frame=frame, rng=rng)
    return {
        **_window_row(base, run.windows),
        "isam2_pose_rmse": base.pose_rmse,
        "base_pose_rmse": run.base_rmse,
        "sngr_pose_rmse": run.pose_rmse,
        "sngr_landmark_rmse": run.landmark_rmse,
        "isam2_nees": base.nees,
        "base_nees": run.base_nees,
        "sngr_nees": run.nees,
        "noop": np.nan,
    }


def _window_row(base: Baseline, refined: list[refine.RefinedWindow]) -> dict[str, float]:
    """What the refined windows of one world come to."""
    names = ["gain_min", "gain_median", "gain_max", "gain_peak_window", "ess_share", "saving"]
    if not refined:
        return {"accepted": 0, **dict.fromkeys(names, np.nan)}
    found = np.array([window.delta_logp for window in refined])
    return {
        "accepted": sum(window.accepted for window in refined),
        "gain_min": found.min(),
        "gain_median": float(np.median(found)),
        "gain_max": found.max(),
        "gain_peak_window": refined[int(np.argmax(found))].t,
        "ess_share": float(np.median([window.run.ess_share for window in refined])),
        "saving": len(base.covariances) / len(refined),
    }
