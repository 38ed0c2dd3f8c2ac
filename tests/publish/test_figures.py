"""The committed figures are those that the notebooks draw: no one has altered or mixed them up.

Coordinates may differ by what no eye can see, for another processor rounds otherwise.
"""

import re
import zlib

import numpy as np
import pytest
from PIL import Image

from sngr_utils import paths
from sngr_utils.publish import execution, notebooks

NUMBER = rb"-?(?:\d+\.?\d*|\.\d+)"
VISIBLE = 0.5  # of a point
GREY = 1.0  # root mean square, of 255 levels, as of a notebook's pictures


def pages(path):
    """Streams of a PDF that hold commands, compressed as they are; fonts and pictures do not."""
    streams = re.findall(rb"stream\r?\n(.*?)\nendstream", path.read_bytes(), re.DOTALL)
    return [stream for stream in streams if zlib.decompress(stream).isascii()]


def drawn(path):
    """What a PDF draws: its commands without their numbers, and the numbers."""
    text = b"\n".join(map(zlib.decompress, pages(path)))
    return re.sub(NUMBER, b"#", text), np.array(re.findall(NUMBER, text), dtype=float)


def differs(committed, made):
    """What differs between two files of a figure, in a word; "" if nothing that can be seen."""
    if committed.suffix == ".png":
        old, new = (
            np.asarray(Image.open(path).convert("RGB"), float) for path in (committed, made)
        )
        same = old.shape == new.shape and np.sqrt(np.mean((old - new) ** 2)) < GREY
        return "" if same else "picture"
    (was, old), (now, new) = drawn(committed), drawn(made)
    if was != now:
        return "commands"
    return "" if np.allclose(old, new, rtol=0, atol=VISIBLE) else "coordinates"


@pytest.mark.parametrize("name", notebooks.names())
def test_each_is_what_its_notebook_draws(name):
    folder = execution.run_of(name, notebooks.parameters(name))
    committed = [path for path in paths.FIGURES.glob(f"{name}_*.p*") if "_timing" not in path.stem]
    assert committed
    assert {path.name: differs(path, folder / path.name) for path in committed} == dict.fromkeys(
        [path.name for path in committed], ""
    )


def test_one_that_is_altered_or_mixed_up_is_noticed(tmp_path):
    one, other = paths.FIGURES / "05_audit_auc.pdf", paths.FIGURES / "05_audit_curves.pdf"
    assert differs(one, one) == ""
    assert differs(one, other) == "commands"
    page = max(pages(one), key=len)
    moved = re.sub(rb"^(\d+)(\.\d+ \S+ l)$", rb"9\1\2", zlib.decompress(page), count=1, flags=re.M)
    altered = one.read_bytes().replace(page, zlib.compress(moved))
    (tmp_path / "moved.pdf").write_bytes(altered)
    assert differs(one, tmp_path / "moved.pdf") == "coordinates"
    picture = paths.FIGURES / "08_association_aware_summary.png"
    assert differs(picture, picture) == ""
    darker = Image.open(picture).convert("RGB").point(lambda grey: max(grey - 21, 0))
    darker.save(tmp_path / "darker.png")
    assert differs(picture, tmp_path / "darker.png") == "picture"
