"""Every page: no error, no request that leaves the site, narrow screens, accessibility."""

from axe_playwright_python.sync_playwright import Axe

# The default rules. axe would fetch the style sheets a second time, which a browser refuses in a
# folder; only its rule against locked orientation looks at them. What passes need not be told.
FROM_A_FOLDER = {"preload": False, "resultTypes": ["violations"]}
BACKGROUND = {"light": 255, "dark": 0}  # grey level, nearly
GREY = """() => getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3)
  .reduce((sum, colour) => sum + Number(colour) / 3, 0)"""


def test_each_page_is_sound_in_both_colour_schemes(name, page):
    shown = page.open(name)
    for scheme, grey in BACKGROUND.items():
        shown.emulate_media(color_scheme=scheme)
        shown.wait_for_function(f"Math.abs(({GREY})() - {grey}) < 60", timeout=10_000)
        shown.wait_for_function("document.getAnimations().length === 0")  # colours on their way
        findings = Axe().run(shown, options=FROM_A_FOLDER).response["violations"]
        grave = [one for one in findings if one["impact"] in {"serious", "critical"}]
        assert not {one["id"]: [node["html"][:200] for node in one["nodes"]] for one in grave}
    shown.set_viewport_size({"width": 360, "height": 800})
    assert shown.evaluate("document.documentElement.scrollWidth") <= 360
