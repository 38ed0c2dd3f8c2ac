"""SNGR with its slips mended: the window's own posterior, a settled base, a gate that knows noise.

The paper samples the root of the likelihood under a prior that already holds it. Here the
target is that of `posterior`: every factor, once.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.metrics import rmse_and_nees
from sngr_utils.sampling import engines, importance, laplace, weighted_samples
from sngr_utils.sampling.settings import FastSettings, SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.settings import Checked, Positive
from sngr_utils.slam import marginals
from sngr_utils.slam.levenberg_marquardt import converge
from sngr_utils.slam.solution import Solution, poses_of
from sngr_utils.sngr import refine, window_posterior, windows
from sngr_utils.sngr.baseline import Baseline
from sngr_utils.sngr.gate import NoiseGate, passes_gate

LONG_WALKS = 400  # steps at which the evidence has no bias that we can measure in 27 dimensions
LAPLACE_DRAWS = 2000  # an effective thousand, where nested sampling at 100 live points has 500


class CorrectedSettings(Checked):
    """What replaces the paper's choices.

    separators : what the window is joined to: held at the estimate, or integrated out
    convergence : how the base estimate is settled, see `converge`
    proposal_scale : the sampler starts from N(estimate, c Sigma), Sigma the joint marginal of
        all that moves, and divides it out again; 4 is twice as wide as the marginal posterior
    """

    separators: Literal["conditional", "marginal"] = "marginal"
    convergence: Literal["batch", "updates"] = "batch"
    proposal_scale: Positive = 4.0


def refine_windows(
    solution: Solution,
    which: Iterable[int],
    covariances: np.ndarray,
    settings: CorrectedSettings,
    sampler: SamplerSettings,
    gate: NoiseGate,
    engine: str = "laplace",
    *,
    rng: np.random.Generator,
) -> list[refine.RefinedWindow]:
    """As `refine.refine_windows`, for the corrected target; random streams likewise.

    Parameters
    ----------
    which : first poses of the windows to refine
    covariances : (T-W+1, 9, 9) Sigma_w of all windows
    sampler : its live points, walks and dlogz; prior and likelihood are those of the target
    engine : "laplace", importance sampling about the Laplace Gaussian, or about all modes that
        many starts find where that may not be trusted; or a compiled one of `settings.EngineChoice`
    """
    streams, scale = rng.spawn(len(covariances)), settings.proposal_scale
    pieces = window_posterior.expand(solution) if settings.separators == "marginal" else None
    refined = []
    for t in which:
        aim = window_posterior.target(solution, t, covariances[t], settings.separators, pieces)
        run = sample_target(aim, scale, sampler, engine, rng=streams[t])
        refined.append(judge(solution, int(t), aim, run, gate))
    return refined


def sample_target(
    aim: window_posterior.Target,
    scale: float,
    sampler: SamplerSettings,
    engine: str = "laplace",
    *,
    rng: np.random.Generator,
) -> weighted_samples.NestedRun:
    """Samples of a target from the prior N(0, scale * covariance), divided out again."""
    sampler = sampler.model_copy(update={"prior_scale": scale, "likelihood_factor": 1.0})
    factors, covariance = aim.corrected(scale), aim.covariance
    if engine == "laplace":
        cholesky = np.linalg.cholesky(scale * covariance)
        run = laplace.sample(factors, cholesky, LAPLACE_DRAWS, rng=rng)
        return run if run is not None else _many_modes(factors, cholesky, rng)
    return engines.sample_factors(factors, covariance, sampler, engine, rng=rng)


def _many_modes(
    factors: compiled.Factors, cholesky: np.ndarray, rng: np.random.Generator
) -> weighted_samples.NestedRun:
    """Importance sampling about all modes found, for targets that are not one Gaussian.

    Modes far apart need long walks in nested sampling (engine "nested", 400 of them, agrees);
    here they cost nothing. The diagnostics' objections are kept in the note.
    """
    many = FastSettings(n_draws=10 * LAPLACE_DRAWS)
    draw = importance.sample(factors, cholesky, many, rng=rng)
    return weighted_samples.NestedRun(
        draw.samples, np.exp(draw.log_weights), draw.log_likelihoods, draw.log_evidence,
        draw.log_evidence_error, draw.calls, note=", ".join(draw.diagnostics.objections),
    )  # fmt: skip


def judge(
    solution: Solution,
    t: int,
    aim: window_posterior.Target,
    run: weighted_samples.NestedRun,
    gate: NoiseGate,
) -> refine.RefinedWindow:
    """The gate's decision on the mean of a target's samples; only the window's poses are kept."""
    mean = run.mean
    nothing = compiled.log_likelihood(aim.factors, np.zeros(len(mean)))
    gain = float(compiled.log_likelihood(aim.factors, mean) - nothing)
    slack = gate.slack(len(mean), run.ess_share * len(run.samples))
    moved = [
        solution.estimate.atPose2(X(t + i)).retract(mean[3 * i : 3 * i + 3])
        for i in range(windows.WIDTH)
    ]
    return refine.RefinedWindow(t, gain, passes_gate(gain, slack), moved, run)


@dataclass(frozen=True)
class CorrectedRun:
    """The corrected algorithm on one world.

    Attributes
    ----------
    solution : the settled base estimate
    windows : the refined windows
    base_rmse, pose_rmse : of the settled estimate, and after accepted windows, [m]
    base_nees, nees : likewise, with the covariances of the settled estimate
    landmark_rmse : [m]
    """

    solution: Solution
    windows: list[refine.RefinedWindow]
    base_rmse: float
    pose_rmse: float
    base_nees: float
    nees: float
    landmark_rmse: float


def run(
    base: Baseline,
    which: Iterable[int],
    settings: CorrectedSettings,
    sampler: SamplerSettings,
    gate: NoiseGate,
    engine: str = "laplace",
    frame: str = "world",
    *,
    rng: np.random.Generator,
) -> CorrectedRun:
    """Settle the estimate, sample the windows, ask the gate, apply.

    Parameters
    ----------
    which : windows to refine, e.g. those the paper's trigger fires on, so that both versions
        look at the same ones
    frame : of P in the NEES, see `conventions.Conventions`
    """
    solution = converge(base.solution, settings.convergence)
    refined = refine_windows(
        solution, which, windows.covariances(solution), settings, sampler, gate, engine, rng=rng
    )
    updated = refine.apply_updates(solution.estimate, refined)
    truth, covariances = base.world.poses[:, :2], marginals.position_covariances(solution, frame)
    before, after = solution.poses[:, :2], poses_of(updated, len(truth))[:, :2]
    return CorrectedRun(
        solution,
        refined,
        base_rmse=rmse_and_nees.rmse(before, truth),
        pose_rmse=rmse_and_nees.rmse(after, truth),
        base_nees=rmse_and_nees.nees(before - truth, covariances),
        nees=rmse_and_nees.nees(after - truth, covariances),
        landmark_rmse=rmse_and_nees.rmse(solution.landmarks, base.world.landmarks),
    )
