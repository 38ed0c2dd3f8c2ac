"""Shared fixtures. What concerns the notebooks is in the conftest.py of the folder above."""

import joblib
import matplotlib.pyplot as plt
import pytest
from helpers import cells_from_scratch

from sngr_utils import paths, trigger_sweep
from sngr_utils.publish import notebooks, verdict_tables
from sngr_utils.publish.results import results_in
from sngr_utils.show import style
from sngr_utils.slam import conventions
from sngr_utils.sngr import baseline
from sngr_utils.world import scenario


@pytest.fixture(scope="session")
def clean() -> baseline.Baseline:
    """The paper's clean world, seed 0, preset B."""
    return baseline.run_baseline(scenario.Scenario(), conventions.PRESETS["B"], 0.0, 0)


@pytest.fixture(scope="session")
def paper_sweep() -> trigger_sweep.Sweep:
    """Notebook 02's sweep with the paper's parameters, preset C."""
    return trigger_sweep.run(trigger_sweep.Config())


@pytest.fixture(scope="session")
def paper_presets(paper_sweep) -> dict[str, trigger_sweep.Sweep]:
    """The same under every preset."""
    return trigger_sweep.run_presets(paper_sweep.config, paper_sweep)


@pytest.fixture(scope="session")
def verdicts() -> verdict_tables.Verdicts:
    """Of the committed reference, under every preset."""
    return verdict_tables.judged(results_in(paths.REFERENCE))


@pytest.fixture
def house_style():
    """Figures in the project's look, closed afterwards."""
    style.use_style()
    yield
    plt.close("all")


@pytest.fixture
def forked():
    """Worker processes forked from this one, which need not import the library again.

    `test_engines` has joblib's own, which start afresh.
    """
    with joblib.parallel_config(backend="multiprocessing"):
        yield


@pytest.fixture(scope="session")
def noisy() -> baseline.Baseline:
    """The paper's world at p = 0.3, seed 0, preset B."""
    return baseline.run_baseline(scenario.Scenario(), conventions.PRESETS["B"], 0.3, 0)


@pytest.fixture(scope="module")
def from_scratch(request):
    """What the cells tagged "from-scratch" of the notebook define that a file of tests is for."""
    stem = request.path.stem.removeprefix("test_")
    (name,) = (each for each in notebooks.names() if each.partition("_")[2] == stem)
    return cells_from_scratch(name)
