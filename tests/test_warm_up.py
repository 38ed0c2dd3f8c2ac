"""What `warm_up` has compiled need not be compiled again."""

import importlib
import re

import numpy as np

from sngr_utils import baseline, chain, estimators, graph, paths, warm_up, world


def signatures():
    """Types that each compiled function has been compiled for, by name."""
    found = {}
    for path in paths.PACKAGE.rglob("*.py"):
        module = ".".join(path.relative_to(paths.ROOT).with_suffix("").parts)
        for name in re.findall(r"^@compile_once\ndef (\w+)", path.read_text(), flags=re.M):
            compiled = getattr(importlib.import_module(module), name)
            found[f"{module}.{name}"] = list(compiled.signatures)
    return found


def test_a_world_needs_nothing_more_compiled():
    warm_up.compile_all(jobs=1)  # here, where the signatures are
    before = signatures()
    assert sum(map(bool, before.values())) > 10
    run = baseline.run_baseline(world.Scenario(), graph.PRESETS["C"], 0.2, 101)
    chain.window_covariances(run.solution, run.world, graph.PRESETS["C"])
    for method in ("fastslam", "em_exclusive", "max_mixture_all"):
        rng = np.random.default_rng(0)
        estimators.estimate(run.world, graph.PRESETS["C"], method, "grid", rng=rng)
    assert signatures() == before
