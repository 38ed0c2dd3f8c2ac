"""What `warm_up` has compiled need not be compiled again."""

import numpy as np
from helpers import signatures

from sngr_utils import baseline, chain, estimators, graph, warm_up
from sngr_utils.world import scenario


def test_a_world_needs_nothing_more_compiled():
    warm_up.compile_all(jobs=1)  # here, where the signatures are
    before = signatures()
    assert sum(map(bool, before.values())) > 10
    run = baseline.run_baseline(scenario.Scenario(), graph.PRESETS["C"], 0.2, 101)
    chain.window_covariances(run.solution, run.world, graph.PRESETS["C"])
    for method in ("fastslam", "em_exclusive", "max_mixture_all"):
        rng = np.random.default_rng(0)
        estimators.estimate(run.world, graph.PRESETS["C"], method, "grid", rng=rng)
    assert signatures() == before
