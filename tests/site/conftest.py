"""The site as it lies in build/site, opened as files by the Chromium of the system."""

import os
import shutil

import pytest
from playwright.sync_api import sync_playwright

from sngr_utils import paths

SITE = paths.BUILD / "site"
ALL = (path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html"))
PAGES = sorted(name for name in ALL if not name.startswith("_static/"))  # the theme's templates
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
OWN = ("file:", "data:", "blob:")


def pytest_generate_tests(metafunc):
    """A test that asks for `name` runs on each page, and on at least one."""
    if "name" in metafunc.fixturenames:
        assert PAGES, "there is no site to test: make site"
        metafunc.parametrize("name", PAGES)


@pytest.fixture(scope="session")
def browser():
    """Chromium without a window and with an empty user-data-dir."""
    named = [os.environ.get("CHROMIUM", "chromium"), "chromium", "chromium-browser"]
    found = [path for path in map(shutil.which, [*named, "google-chrome"]) if path]
    assert found, "no Chromium was found: bash scripts/install_browser.sh"
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found[0], args=FLAGS)
        yield chromium
        chromium.close()


class Window:
    """A page of the site in a browser, and all that went wrong in it."""

    def __init__(self, context):
        self.page, self.trouble = context.new_page(), []
        self.page.on("console", lambda it: self.note(it.text) if it.type == "error" else None)
        self.page.on("pageerror", lambda error: self.note(str(error)))
        self.page.on("requestfailed", lambda it: self.note(f"not loaded: {it.url}"))
        self.page.on("request", lambda it: None if it.url.startswith(OWN) else self.note(it.url))

    def note(self, what: str) -> None:
        """Remember an error, or a request that leaves the site."""
        self.trouble.append(what)

    def open(self, name: str):
        """The page, with its formulas set."""
        self.page.goto((SITE / name).as_uri())
        self.page.evaluate("window.MathJax?.startup?.promise")
        return self.page


@pytest.fixture
def page(browser):
    """A wide window, in which nothing may go wrong."""
    context = browser.new_context(viewport={"width": 1300, "height": 900}, color_scheme="light")
    window = Window(context)
    yield window
    context.close()
    assert not window.trouble
