"""Every window of the paper's world, whatever its score, sampled by dynesty.

Notebook 04 samples those that trigger and every third of the others, which stand for all. Whether
they may, and what dynesty's evidence is worth over more runs than a lesson has time for, is here.
"""

import numpy as np

from sngr_utils.experiments import engine_bench
from sngr_utils.experiments.estimators import TAU
from sngr_utils.experiments.refinement_cost import refine_windows
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.settings import READING
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.sngr import refine, windows
from sngr_utils.sngr.baseline import run_baseline
from sngr_utils.world.scenario import Scenario

P_LEVELS, SEED = (0.0, 0.1, 0.2, 0.3), 0  # those of notebook 04
DRAWS, STREAM = 100_000, 7  # importance samples behind a reference, and their random numbers
CELLS = [(p, t) for p in P_LEVELS for t in range(windows.n_windows(Scenario().n_poses))]


def rows(p: float, t: int) -> list[dict]:
    """One window: does it trigger; calls and CPU time [s] of its run; log Z beside a reference's.

    The run is that of notebook 04 for the same window, call by call.
    """
    conventions, settings = PRESETS[READING], SamplerSettings()
    base = run_baseline(Scenario(), conventions, p, SEED)
    ((window,), seconds) = engine_bench.timed(
        lambda: refine_windows(base, conventions, t, settings)
    )
    likelihood = refine.window_likelihood(base.solution, t, settings.likelihood_factor)
    rng = np.random.default_rng([SEED, STREAM, round(100 * p), t])
    truth = engine_bench.reference(likelihood, base.covariances[t], settings, DRAWS, rng=rng)
    return [{
        "p": p, "window": t, "fired": bool(base.fired(TAU)[t]), "calls": window.run.calls,
        "seconds": seconds, "error": window.run.log_evidence - truth.log_evidence,
    }]  # fmt: skip
