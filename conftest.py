"""What nbval leaves out: one execution for the paper and the tests, and the pictures.

It stands here because pytest asks a conftest.py only about items below its own folder, and the
notebooks lie beside tests/.

nbval compares the stored outputs of a notebook with those of a kernel. Here that kernel replays a
run of the notebook (`execution.run_of`), which is executed only if there is none from the same
inputs: `make paper` may have left it, and finds in turn what `make test` leaves.
"""

import base64
import io

import nbformat
import numpy as np
import pytest
from nbval.plugin import IPyNbCell, IPyNbFile
from PIL import Image

from sngr_utils import paths
from sngr_utils.publish import execution, notebooks

# Root mean square difference of two renderings, of 255 grey levels, that counts as the same.
# Rounding in the last digit moves single anti-aliased pixels; a changed point moves far more.
IMAGE_TOLERANCE = 1.0
NOT_COMPARED_BY_NBVAL = ("image/png", "image/jpeg")


class Replay:
    """A kernel, as far as nbval asks it, that answers with the outputs of a finished run."""

    def __init__(self, cells):
        self.cells, self.messages, self.count = cells, [], 0

    def is_alive(self) -> bool:
        return True

    def execute_cell_input(self, source, allow_stdin=None) -> str:
        """Queue the outputs of the next cell of the run, which must be the one that is asked."""
        self.count += 1
        number, (cell, *self.cells) = str(self.count), self.cells or [None]
        if cell is None or cell.source != source or cell.execution_count is None:
            traceback = ["the run did not get to this cell"]
            answers = [("error", {"ename": "NotRun", "evalue": "", "traceback": traceback})]
        else:
            answers = [(output.output_type, output) for output in cell.outputs]
        answers.append(("status", {"execution_state": "idle"}))
        self.messages = [
            {"msg_type": kind, "content": content, "parent_header": {"msg_id": number}}
            for kind, content in answers
        ]
        return number

    def get_message(self, stream, timeout=None) -> dict:
        return self.messages.pop(0)

    def await_reply(self, number, timeout=None) -> None:
        """The outputs are there already."""

    def await_idle(self, number, timeout=None) -> None:
        """Nothing is left to be done."""

    def stop(self) -> None:
        """Nothing runs."""


def replay_of(path) -> Replay:
    """The run of a notebook with its own defaults; as far as it got, if a cell failed."""
    try:
        folder = execution.run_of(path.stem, notebooks.parameters(path.stem))
    except notebooks.ProjectError:
        folder = paths.STAGING / path.stem
        if not (folder / path.name).exists():
            raise
    cells = nbformat.read(folder / path.name, as_version=4).cells
    own = [cell for cell in cells if execution.INJECTED not in cell.metadata.get("tags", [])]
    return Replay([cell for cell in own if cell.cell_type == "code"])


def setup(self):
    """In place of `IPyNbFile.setup`: a replay for the project's notebooks, a kernel for others."""
    if self.path.parent != paths.NOTEBOOKS:
        start_kernel(self)
        return
    self.kernel = replay_of(self.path)
    self.setup_sanitize_files()


start_kernel, IPyNbFile.setup = IPyNbFile.setup, setup


def pytest_collection_modifyitems(items):
    """Notebooks first, by their length: else one worker ends with the longest, alone."""
    items.sort(key=lambda i: (i.path.suffix != ".ipynb", notebooks.length(i.path.stem)))


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
