"""SNGR itself over many worlds, as the paper has it and corrected."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sngr_utils.metrics import rmse_and_nees
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.slam.conventions import Conventions
from sngr_utils.sngr import corrected, gate, noop_baseline, refine, trigger
from sngr_utils.sngr.baseline import Baseline
from sngr_utils.sngr.noop_baseline import TriggerOnly
from sngr_utils.sngr.refined_world import refine_world

VARIANTS = ("paper", "conditional", "marginal")


@dataclass(frozen=True)
class Refinement:
    """SNGR on an iSAM2 run, for `isam2_over_worlds.run_sweep`: one row per variant.

    The paper's settings, but for 50 walks instead of 9, in the compiled nested sampler. The
    corrected variants are sampled by importance sampling (`corrected.sample_target`), with which
    nested sampling agrees (`sampler_numbers.evidence_check`). They start from the batch estimate
    and refine the windows the paper's trigger fires on at iSAM2's, so rows of one world differ
    in the method alone.

    Attributes
    ----------
    variants : of `VARIANTS`, by p and seed; a world that is not there is not refined
    tau : threshold on the score

    Raises
    ------
    ValueError : an unknown variant
    """

    variants: Mapping[tuple[float, int], Sequence[str]]
    tau: float = 3.9

    def __post_init__(self):
        unknown = {name for names in self.variants.values() for name in names} - set(VARIANTS)
        if unknown:
            raise ValueError(f"variants has {sorted(unknown)}: they must be among {VARIANTS}")

    def __call__(self, base: Baseline, conventions: Conventions) -> list[dict[str, object]]:
        """The rows of one world.

        Returns
        -------
        variant, triggered, accepted; gain_min, gain_median, gain_max [nats] and gain_peak_window
        (the first pose of the window that gains most); ess_share (median); isam2_pose_rmse,
        base_pose_rmse (before refinement: the same, or the batch estimate's), sngr_pose_rmse,
        sngr_landmark_rmse [m] (refinement moves poses only); sngr_nees;
        saving (all windows over the refined ones: what is saved if each costs the same); noop
        (mean log weight of the trigger-only baseline, in expectation, [nats]). NaN where nothing
        fires
        """
        triggered = int(base.fired(self.tau).sum())
        return [
            {"variant": variant, "triggered": triggered}
            | _variant_row(base, conventions, variant, self.tau)
            for variant in self.variants.get((base.p, base.seed), ())
        ]


def _variant_row(
    base: Baseline, conventions: Conventions, variant: str, tau: float
) -> dict[str, float]:
    """One variant on one world. The windows are those that fire at iSAM2's estimate."""
    sampling, the_gate, noop = corrected.Corrected(variant), gate.NoiseGate(), []
    if variant == "paper":
        settings, sigma = SamplerSettings(min_walks=engines.ENOUGH_WALKS), TriggerOnly().noop_sigma
        sampling, the_gate = refine.Paper(settings, "nested"), gate.Gate()
        fired = base.covariances[base.fired(tau)]
        noop = [noop_baseline.noop_expected_log_weight(covariance, sigma) for covariance in fired]
    refined = refine_world(
        base, conventions, partial(trigger.triggers, tau=tau), sampling, the_gate,
        rng=np.random.default_rng([base.seed, 1]),
    )  # fmt: skip
    landmarks = refined.solution.landmarks
    return {
        **_window_row(base, refined.windows),
        "isam2_pose_rmse": base.pose_rmse,
        "base_pose_rmse": refined.solution_rmse,
        "sngr_pose_rmse": refined.pose_rmse,
        "sngr_landmark_rmse": rmse_and_nees.rmse(landmarks, base.world.landmarks),
        "sngr_nees": refined.nees,
        "noop": float(np.mean(noop)) if noop else np.nan,
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
