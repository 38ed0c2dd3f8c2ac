"""Shared fixtures, and the comparison of images that nbval leaves out."""

import base64
import io

import joblib
import numpy as np
import pytest
from nbval.plugin import IPyNbCell
from PIL import Image

from sngr_utils import baseline, graph, trigger_sweep, world

# Root mean square difference of two renderings, of 255 grey levels, that counts as the same.
# Rounding in the last digit moves single anti-aliased pixels; a changed point moves far more.
IMAGE_TOLERANCE = 1.0


def pytest_collection_modifyitems(items):
    """The last notebooks first, which take longest: else one worker ends with them, alone."""
    items.sort(key=lambda i: i.path.name if i.path.suffix == ".ipynb" else "", reverse=True)


def image_difference(first: str, second: str) -> float:
    """RMS difference of two base64 PNGs in grey levels; infinite if their sizes differ."""
    images = [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), dtype=float)
        for data in (first, second)
    ]
    if images[0].shape != images[1].shape:
        return float("inf")
    return float(np.sqrt(np.mean((images[0] - images[1]) ** 2)))


def images(outputs) -> list[str]:
    return [out["data"]["image/png"] for out in outputs if "image/png" in out.get("data", {})]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """After nbval has compared a cell's texts, compare its images."""
    result = yield
    if isinstance(item, IPyNbCell) and item.options["check"]:
        stored, fresh = images(item.cell.outputs), images(item.test_outputs)
        assert len(stored) == len(fresh), "number of images differs from the stored outputs"
        for old, new in zip(stored, fresh, strict=True):
            difference = image_difference(old, new)
            assert difference <= IMAGE_TOLERANCE, f"image differs by {difference:.1f} grey levels"
    return result


@pytest.fixture(scope="session")
def clean() -> baseline.Baseline:
    """The paper's clean world, seed 0, preset B."""
    return baseline.run_baseline(world.Scenario(), graph.PRESETS["B"], 0.0, 0)


@pytest.fixture(scope="session")
def paper_sweep() -> trigger_sweep.Sweep:
    """Notebook 02's sweep with the paper's parameters."""
    return trigger_sweep.run(trigger_sweep.Config())


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
    return baseline.run_baseline(world.Scenario(), graph.PRESETS["B"], 0.3, 0)
