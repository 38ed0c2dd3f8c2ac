"""What the site does beside showing pages: links, search, folds, tables, downloads."""

import json
import re
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest

from sngr_utils import paths

SITE = paths.BUILD / "site"
ALL = (path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html"))
PAGES = sorted(name for name in ALL if not name.startswith("_static/"))  # the theme's templates
CHAPTERS = [name for name in PAGES if name.startswith("notebooks/")]


class Links(HTMLParser):
    """Addresses and ids of a page, and the pictures on it."""

    def __init__(self, name: str):
        super().__init__()
        self.addresses, self.ids, self.pictures = [], set(), []
        self.feed((SITE / name).read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids |= {given[key] for key in ("id", "name") if key in given}
        self.addresses += [(tag, given[key]) for key in ("href", "src") if key in given]
        if tag == "img":
            self.pictures.append(given)


@pytest.fixture(scope="module")
def links():
    return {name: Links(name) for name in PAGES}


def test_no_link_is_broken(links):
    broken = []
    for name, page in links.items():
        for tag, address in page.addresses:
            parts = urlsplit(address)
            if parts.scheme:
                assert tag == "a" or parts.scheme == "data", (name, address)
                continue
            target = (SITE / name).parent / unquote(parts.path) if parts.path else SITE / name
            key = target.resolve().relative_to(SITE.resolve()).as_posix()
            found = target.exists() and (
                not parts.fragment or key not in links or unquote(parts.fragment) in links[key].ids
            )
            broken += [] if found else [(name, address)]
    assert not broken


def test_every_figure_says_what_it_shows(links):
    shown = [picture for name in CHAPTERS for picture in links[name].pictures]
    assert len(shown) > 30
    for picture in shown:
        assert len(picture["alt"]) > 15
        assert not re.search(r"\.png|_images", picture["alt"])


def test_chapters_are_in_order_and_lead_to_each_other(page):
    assert len(CHAPTERS) == len(list(paths.NOTEBOOKS.glob("*.ipynb")))
    shown = page.open(CHAPTERS[0])
    for name in CHAPTERS[1:]:
        while not shown.url.endswith(name):
            before = shown.url
            shown.click("a.right-next")
            assert shown.url != before
    shown.click("a.left-prev")
    assert shown.url.endswith(CHAPTERS[-2])


def test_the_downloads_are_the_notebooks_as_they_are(links):
    for name in CHAPTERS:
        (address,) = (
            address
            for _, address in links[name].addresses
            if re.search(r"_downloads/\w+/[^/]*\.ipynb", address)
            and ((SITE / name).parent / address).read_bytes() == original(name)
        )
        assert address


def original(name: str) -> bytes:
    """The committed notebook that a chapter shows."""
    return (paths.ROOT / name).with_suffix(".ipynb").read_bytes()


def test_search_finds_the_gate(page):
    shown = page.open("index.html")
    shown.keyboard.press("Control+k")
    shown.keyboard.type("gate")
    shown.keyboard.press("Enter")
    shown.wait_for_selector("ul.search li a")
    found = shown.locator("ul.search li a").evaluate_all("links => links.map(it => it.href)")
    assert any("notebooks/03_full_sngr.html" in address for address in found)
    assert any("api/sngr_utils.sngr.html" in address for address in found)


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_solutions_and_explanations_fold(page, chapter):
    shown = page.open(chapter)
    folds = shown.locator("div.tag_solution details, details:has(> summary:text('Explanation'))")
    assert folds.count() >= 4
    for fold in folds.all():
        inside = fold.locator(":scope > :not(summary)").first
        assert not inside.is_visible()
        fold.locator("summary").first.click()
        assert inside.is_visible()


def test_the_verdicts_sort_by_any_column_both_ways(page):
    shown = page.open("verdicts.html")
    (records,) = {len(judged) for judged in json.loads(paths.VERDICTS.read_text()).values()}
    assert shown.locator("table.sortable tbody tr").count() == records > 100
    heads = shown.locator("table.sortable th").count()
    assert shown.locator("table.sortable td").count() == heads * records
    for column in range(shown.locator("table.sortable th").count()):
        values = []
        for _ in range(2):
            shown.locator("table.sortable th button").nth(column).click()
            cells = shown.locator(f"table.sortable td:nth-child({column + 1})")
            values.append(cells.all_inner_texts())
        assert sorted(values[0]) == sorted(values[1])
        assert values[0] != values[1] or len(set(values[0])) == 1
    by_name = shown.locator("table.sortable th").first
    by_name.locator("button").click()
    assert by_name.get_attribute("aria-sort") == "ascending"
    names = shown.locator("table.sortable td:nth-child(1)").all_inner_texts()
    assert names[0] < names[-1]


def test_terms_are_explained_where_they_are_met(page, links):
    if not (paths.ROOT / "docs/glossary.md").exists():
        pytest.skip("no glossary is written yet")
    shown = page.open(CHAPTERS[0])
    terms, notes = shown.locator("a.term"), shown.locator("aside.margin")
    assert terms.count() > 10
    assert notes.count() > 10
    for term in terms.all():
        assert term.get_attribute("title").endswith(".")
    first = terms.first.get_attribute("href")
    terms.first.click()
    assert shown.url.endswith(first.split("/")[-1])


def test_equations_of_the_paper_stand_beside_their_code(page):
    shown = page.open("api/sngr_utils.sngr.html")
    gate = shown.locator("dl:has(> dt#sngr_utils\\.sngr\\.gate\\.passes_gate)")
    assert gate.locator("mjx-container").count() == 1
    assert not shown.locator("mjx-merror").count()


def test_a_figure_of_the_first_page_leads_to_the_cell_that_draws_it(page):
    shown = page.open("index.html")
    links = [link.get_attribute("href") for link in shown.locator("a:has(img)").all()]
    found = [link for link in links if "#figure-" in link]
    assert found
    for link in found:
        there = page.open(link.split("#")[0])
        anchor = there.locator(f"[id='{link.split('#')[1]}']")
        cell = anchor.locator("xpath=following::div[contains(@class, 'cell')][1]")
        assert anchor.count() == 1
        assert f'"{link.split("#figure-")[1]}"' in cell.inner_text()


FILMS = sorted(path.name for path in paths.FIGURES.glob("*.html"))


@pytest.mark.parametrize("film", FILMS)
def test_films_play_and_obey_the_keyboard(page, film):
    shown = page.open(f"notebooks/{film.rsplit('_', 1)[0]}.html")
    assert "Film: " in shown.locator("iframe.film").get_attribute("title")
    player = shown.frame_locator("iframe.film")
    picture, slider = player.locator("#picture"), player.locator("#at")
    first, caption = picture.get_attribute("src"), player.locator("#caption").inner_text()
    slider.focus()
    slider.press("ArrowRight")
    assert slider.input_value() == "1"
    assert picture.get_attribute("src") != first
    assert player.locator("#caption").inner_text() != caption
    assert len(picture.get_attribute("alt")) > 100
    button = player.locator("#play")
    button.press("Enter")
    assert button.inner_text() == "Stop"
    shown.wait_for_timeout(1000)
    assert int(slider.input_value()) > 1
    button.press("Enter")
    assert button.inner_text() == "Play"


@pytest.mark.parametrize("deck", sorted(path.name for path in paths.NOTEBOOKS.glob("*.ipynb")))
def test_slides_turn_by_key_and_fit_on_a_screen(page, deck):
    shown = page.page
    shown.goto((paths.BUILD / "slides" / deck).with_suffix(".html").as_uri())
    shown.evaluate("MathJax.startup.promise")
    count = shown.locator("section").count()
    for number in range(1, count + 1):
        assert shown.locator("#page").inner_text() == f"{number} / {count}"
        assert shown.evaluate("document.documentElement.scrollHeight") <= 900
        shown.keyboard.press("ArrowRight")
    assert not shown.locator("mjx-merror").count()
