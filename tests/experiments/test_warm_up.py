"""What `warm_up` has compiled need not be compiled again."""

import numpy as np
from helpers import signatures

from sngr_utils.experiments import estimators, warm_up
from sngr_utils.slam import conventions, selected_inverse
from sngr_utils.sngr import baseline
from sngr_utils.world import scenario


def test_a_world_needs_nothing_more_compiled():
    warm_up.compile_all(jobs=1)  # here, where the signatures are
    before = signatures()
    assert sum(map(bool, before.values())) > 10
    run = baseline.run_baseline(scenario.Scenario(), conventions.PRESETS["C"], 0.2, 101)
    selected_inverse.window_covariances(run.solution, run.world, conventions.PRESETS["C"])
    for method in ("fastslam", "em_exclusive", "max_mixture_all"):
        rng = np.random.default_rng(0)
        estimators.estimate(run.world, conventions.PRESETS["C"], method, "grid", rng=rng)
    assert signatures() == before
