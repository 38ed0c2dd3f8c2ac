"""Slides: what is predicted, shown and looked at, without solutions and without the network."""

import importlib.util
import re

import pytest
from helpers import read_notebook
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from sngr_utils import paths

SPEC = importlib.util.spec_from_file_location("slides", paths.ROOT / "scripts/slides.py")
slides = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(slides)

NAMES = sorted(path.stem for path in paths.NOTEBOOKS.glob("*.ipynb"))


def test_a_deck_has_what_is_taught_in_its_order_and_no_solution():
    picture = new_output("display_data", {"image/png": "QUJD"})
    said = new_output("stream", name="stdout", text="share 0.5\n")
    cells = [
        new_markdown_cell("# 1. Title\n\nA question."),
        new_markdown_cell("Prose.\n\n## Part\n\nMore. **Predict.** [Rises](a.md) $p$?\n\nRest."),
        new_code_cell("idle()", outputs=[new_output("stream", name="stdout", text="unasked")]),
        new_code_cell("draw()", outputs=[picture, said], metadata={"alt": "A curve."}),
        new_markdown_cell("**Look** at it.\n\n## Exercises\n\n**Predict** again."),
        new_code_cell("solve()", outputs=[picture], metadata={"tags": ["solution"]}),
        new_markdown_cell("Folded.\n\n## You can now\n\n* see.\n\n**Limits.** One."),
    ]
    found = list(slides.slides_of(new_notebook(cells=cells)))
    assert [heading for heading, _ in found] == ["1. Title", "Part", "Part", "You can now"]
    text = "".join(content for _, content in found)
    assert "Rises $p$?" in text
    assert re.search(r'alt="A curve\.".*share 0\.5.*<strong>Look', found[2][1], re.S)
    assert not re.search("Rest|again|Folded|Limits|solve|unasked", text)


def test_a_second_look_and_what_another_section_shows_are_slides_of_their_own():
    picture = new_output("display_data", {"image/png": "QUJD"})
    cells = [
        new_markdown_cell("# 1. Title"),
        new_code_cell("draw()", outputs=[picture, picture], metadata={"alt": "A curve."}),
        new_markdown_cell("**Look** once.\n\n**Look** twice."),
        new_code_cell("say()", outputs=[new_output("stream", name="stdout", text="asked")]),
        new_markdown_cell("**Look** at it."),
        new_code_cell("draw()", outputs=[picture], metadata={"alt": "A curve."}),
        new_markdown_cell("## Part\n\n**Look** elsewhere."),
    ]
    found = [content for _, content in slides.slides_of(new_notebook(cells=cells))]
    has = [("<img" in text, "asked" in text, text.count("<strong>Look")) for text in found]
    assert has[1:] == [(1, 0, 0), (1, 0, 1), (0, 0, 1), (0, 1, 1), (1, 0, 0), (0, 0, 1)]


def test_an_algorithm_is_as_large_as_a_slide_has_room_for():
    """Twenty lines of a hundred characters: 80 / 24 of the height, 88 / 62 of the width."""
    assert "min(22px, 3.33vh, 1.42vw)" in slides.verbatim("\n".join(["x" * 100] * 20))


@pytest.mark.parametrize("name", NAMES)
def test_every_chapter_has_a_deck_with_its_figures_and_asks_nobody(name):
    notebook = read_notebook(name)
    taught = [
        cell for cell in notebook.cells
        if cell.cell_type == "code" and "solution" not in cell.metadata.get("tags", [])
    ]  # fmt: skip
    drawn = sum("image/png" in out.get("data", {}) for cell in taught for out in cell.outputs)
    page = slides.deck(notebook)
    assert page.count("<img alt=") == drawn > 2
    assert page.count("<section>") > drawn + 5
    assert 'alt=""' not in page
    assert not re.search(r"https?://(?!www\.w3\.org)", page)
