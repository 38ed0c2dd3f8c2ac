"""Whether the gaps of notebook 08 between the online estimator and its peers return.

Its worlds were looked at while that notebook was written. These were not: drawn once, at one share
of wrong labels, so that a peer is compared once.
"""

import numpy as np

from sngr_utils.experiments import estimators
from sngr_utils.experiments.online_variants import STREAM, run_unwarned
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.online import estimator
from sngr_utils.settings import READING
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario

PEERS = (
    "cauchy", "gnc_tls", "switchable", "max_mixture_null", "max_mixture_all", "em", "em_exclusive",
)  # fmt: skip
P = 0.4  # wrong-association probability, that of the notebook's comparisons


def rows(seed: int) -> list[dict]:
    """One world of the paper's scenario: pose RMSE of the online estimator and its peers, [m]."""
    given = Scenario(), PRESETS[READING]
    world = simulation.simulate(given[0], P, rng=np.random.default_rng(seed))
    found = run_unwarned(
        world.log(given[1].x0_sigmas), given[1], estimator.Settings(),
        rng=np.random.default_rng([seed, STREAM]),
    )  # fmt: skip
    others = estimators.compare(*given, [P], [seed], PEERS, jobs=1).set_index("method")["pose_rmse"]
    online = rmse_and_nees.rmse(found.poses[:, :2], world.poses[:, :2])
    return [{"seed": seed, "online": online, **{name: float(others[name]) for name in PEERS}}]
