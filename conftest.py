"""The comparison of pictures that nbval leaves out.

It stands here because pytest asks a conftest.py only about items below its own folder, and the
notebooks lie beside tests/.
"""

import base64
import io

import numpy as np
import pytest
from nbval.plugin import IPyNbCell
from PIL import Image

# Root mean square difference of two renderings, of 255 grey levels, that counts as the same.
# Rounding in the last digit moves single anti-aliased pixels; a changed point moves far more.
IMAGE_TOLERANCE = 1.0
NOT_COMPARED_BY_NBVAL = ("image/png", "image/jpeg")


def pytest_collection_modifyitems(items):
    """The last notebooks first, which take longest: else one worker ends with them, alone."""
    items.sort(key=lambda i: i.path.name if i.path.suffix == ".ipynb" else "", reverse=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """After nbval has compared a cell's texts, compare its pictures."""
    result = yield
    if isinstance(item, IPyNbCell) and item.options["check"]:
        trouble = difference_of_pictures(item.cell.outputs, item.test_outputs)
        if trouble:
            item.raise_cell_error(trouble)
    return result


def difference_of_pictures(stored_outputs, new_outputs) -> str:
    """What differs between the stored and the new pictures of a cell, in words; "" if nothing."""
    stored, new = pictures(stored_outputs), pictures(new_outputs)
    if len(stored) != len(new):
        return f"{len(stored)} pictures are stored, {len(new)} are drawn now"
    for number, (old, now) in enumerate(zip(stored, new, strict=True), start=1):
        try:
            difference = grey_levels(old, now)
        except (OSError, ValueError, SyntaxError, TypeError) as error:
            return f"stored picture {number} cannot be read: {error}"
        if difference > IMAGE_TOLERANCE:
            return f"picture {number} differs from the stored one by {difference:.1f} grey levels"
    return ""


def pictures(outputs) -> list[str]:
    """The pictures among a cell's outputs, in order, as base64."""
    data = [out.get("data", {}) for out in outputs]
    return [found[kind] for found in data for kind in NOT_COMPARED_BY_NBVAL if kind in found]


def grey_levels(first: str, second: str) -> float:
    """RMS difference of two base64 pictures in grey levels; infinite if their sizes differ.

    Raises
    ------
    OSError, ValueError, SyntaxError : not a picture, or not all of one
    """
    seen = [np.asarray(as_seen(data), dtype=float) for data in (first, second)]
    if seen[0].shape != seen[1].shape:
        return float("inf")
    return float(np.sqrt(np.mean((seen[0] - seen[1]) ** 2)))


def as_seen(data: str) -> Image.Image:
    """A base64 picture on a white page, without transparency."""
    picture = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA")
    page = Image.new("RGBA", picture.size, "white")
    return Image.alpha_composite(page, picture).convert("RGB")
