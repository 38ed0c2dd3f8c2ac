"""Every page: no error, no request that leaves the site, narrow screens, accessibility."""

from axe_playwright_python.sync_playwright import Axe

# The default rules. axe would fetch the style sheets a second time, which a browser refuses in a
# folder; only its rule against locked orientation looks at them. What passes need not be told.
FROM_A_FOLDER = {"preload": False, "resultTypes": ["violations"]}
BLACK, WHITE = 0, 255


def background(page) -> float:
    """Grey level behind the text."""
    colour = page.evaluate("getComputedStyle(document.body).backgroundColor")
    return sum(map(float, colour.split("(")[1].rstrip(")").split(",")[:3])) / 3


def test_each_page_is_sound_in_both_colour_schemes(name, window, request):
    page = window.open(name)
    dark = request.node.callspec.params["window"] == "dark"
    assert abs(background(page) - (BLACK if dark else WHITE)) < 60
    findings = Axe().run(page, options=FROM_A_FOLDER).response["violations"]
    grave = [one for one in findings if one["impact"] in {"serious", "critical"}]
    assert not {one["id"]: [node["html"][:200] for node in one["nodes"]] for one in grave}
    page.set_viewport_size({"width": 360, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
