"""Films: one file each, small, the same bytes each time, and nothing asked of a server."""

import io
import re
from base64 import b64decode
from html.parser import HTMLParser

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sngr_utils import paths
from sngr_utils.publish import film, report
from sngr_utils.show import style

COMMITTED = ["01_bimodal_live", "02_trigger_sweep_growing", "08_association_aware_run"]


def pictures(n=3):
    for i in range(n):
        fig, ax = plt.subplots(figsize=(1, 1))
        ax.plot([0, 1], [0, i])
        yield f"step <{i}>", fig


def made():
    return film.Film("Lines & slopes", "Notice the slope.", "step", pictures())


def frames(page):
    """Its pictures, (height, width, 4) each."""
    shown = re.search(r"frames = \[(.*?)\]", page)[1].split(", ")
    return [plt.imread(io.BytesIO(b64decode(one.strip('"').split(",")[1]))) for one in shown]


def test_a_film_is_made_of_the_same_bytes_each_time_and_of_its_pictures():
    page = film.player(made())
    assert page == film.player(made())
    shown = frames(page)
    assert len(shown) == 3
    assert not np.array_equal(shown[0], shown[1])
    assert "Lines &amp; slopes" in page
    assert '"step &lt;2&gt;"' in page
    assert not plt.get_fignums()


def test_the_colours_of_a_picture_are_kept():
    """Of the thin lines too, which cover next to nothing of it."""
    fig, ax = plt.subplots(figsize=(3, 3))
    for i, colour in enumerate(style.SEQUENCE):
        ax.plot([0, 1], [i, i + 3], ":", color=colour, lw=0.8)
    drawn = io.BytesIO()
    fig.savefig(drawn, dpi=film.DPI)
    (shown,) = frames(film.player(film.Film("x", "", "", [("", fig)])))
    drawn.seek(0)
    exact = plt.imread(drawn)
    assert np.abs(shown[..., :3] - exact[..., :3]).max() < 0.1


def test_a_film_needs_pictures():
    with pytest.raises(ValueError, match="needs pictures"):
        film.player(film.Film("None", "", "step", []))


def test_a_film_is_handed_on_as_a_figure(tmp_path):
    to = report.Report("01_x", tmp_path)
    assert to.film("f", made()).data == "Film: [Lines & slopes](../figures/01_x_f.html)"
    to.save()
    assert '"01_x_f.html"' in (tmp_path / "01_x.json").read_text()
    assert (tmp_path / "01_x_f.html").read_text() == film.player(made())


class Parts(HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.parts = {}
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.parts[tag] = dict(attrs)


@pytest.mark.parametrize("name", COMMITTED)
def test_the_committed_films_are_small_ask_nobody_and_are_described(name):
    path = paths.FIGURES / f"{name}.html"
    assert path.stat().st_size < 400_000
    page = path.read_text(encoding="utf-8")
    assert not re.search(r"https?:|//\w|@import|<link|<script src", page.split("base64")[0])
    assert not re.search(r"https?://", page)
    parts = Parts(page).parts
    assert len(frames(page)) == int(parts["input"]["max"]) + 1 >= 9
    assert "Notice" in parts["img"]["alt"]
    assert parts["input"]["aria-label"]
    assert parts["html"]["lang"] == "en"


def test_every_film_that_is_there_is_looked_at():
    assert sorted(path.stem for path in paths.FIGURES.glob("*.html")) == COMMITTED
