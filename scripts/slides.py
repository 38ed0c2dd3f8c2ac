"""Write a deck of slides for each chapter into build/slides, from its cells and stored outputs.

A prediction, a figure with what it shows (its metadata "alt"), a marked table, an algorithm (tagged
"from-scratch") are a slide each, and what to look at stands below what was shown last; exercises
and solutions are left out. A deck is one file that needs MathJax beside it and no network. Arrows
turn the pages; printed, a slide is a page.
"""

import argparse
import html
import importlib.util
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Template

import nbformat
from nbconvert.filters import markdown2html

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\([^)]*\)")
HEADING = re.compile(r"^#+ (.*)$", re.M)
SAID = re.compile(r"\*\*(?:Predict|Look)\b.*?(?=\n\n|\*\*Look|\*\*Predict|\Z)", re.S)
LEFT_OUT, BACK = "## Exercises", re.compile(r"^## (You can now|Synthesis)", re.M)

DECK = Template(r"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<meta name="viewport" content="width=device-width">
<style>
body { margin: 0; font: 26px/1.35 sans-serif; color: #111; background: #fff }
section { box-sizing: border-box; height: 100vh; padding: 3vh 6vw; display: none }
section.shown { display: flex; flex-flow: column }
h1 { font-size: 1.3em; margin: 0.5em 0 } pre { margin: 0.5em 0 }
img { flex: 1; min-height: 0; object-fit: contain }
.long { font-size: 21px } img ~ .look, table ~ .look { font-size: 20px }
table { border-collapse: collapse; font-size: 20px; align-self: start }
td, th { padding: 0.2em 0.6em; text-align: left }
footer { position: fixed; bottom: 0.3em; right: 1em; font-size: 16px; color: #444 }
@media print {
  section { display: flex; flex-flow: column; break-after: page }
  footer { display: none }
}
</style>
<script>window.MathJax = {tex: {inlineMath: [["$$", "$$"]], macros: {MAP: "\\mathrm{MAP}",
T: "^{\\mathsf T}"}}};</script>
<script defer src="mathjax/tex-chtml.js"></script>
</head><body><main>
$slides
</main><footer id="page" aria-live="polite"></footer>
<script>
const slides = document.querySelectorAll("section");
let at = Math.min(Number(location.hash.slice(1)) || 1, slides.length) - 1;
function show() {
  slides.forEach((slide, i) => slide.classList.toggle("shown", i === at));
  document.getElementById("page").textContent = `$${at + 1} / $${slides.length}`;
  history.replaceState(null, "", `#$${at + 1}`);
}
document.onkeydown = (pressed) => {
  const steps = {ArrowRight: 1, PageDown: 1, " ": 1, ArrowLeft: -1, PageUp: -1};
  const step = steps[pressed.key];
  if (!step) return;
  at = Math.max(0, Math.min(slides.length - 1, at + step));
  show();
  pressed.preventDefault();
};
show();
</script></body></html>
""")


def slides_of(notebook: nbformat.NotebookNode) -> Iterator[tuple[str, str]]:
    """Heading and content, in HTML, of each slide of a chapter."""
    before = None  # the heading and the kind of the slide that may still grow, and its content
    for heading, kind, content in parts_of(notebook):
        if kind == "look" and before and before[0] == heading and before[1] in ("shown", "printed"):
            before = (heading, "look", before[2] + content)
            continue
        if before and before[1] != "printed":  # nobody is asked to look at it
            yield before[0], before[2]
        before = (heading, kind, content)
    if before:
        yield before[0], before[2]


def parts_of(notebook: nbformat.NotebookNode) -> Iterator[tuple[str, str, str]]:
    """Heading, kind ("told", "look", "shown" or "printed") and HTML of what a deck takes up."""
    heading, shown = "", True
    for i, cell in enumerate(notebook.cells):
        if cell.cell_type == "code":
            if shown and "solution" not in cell.metadata.get("tags", []):
                yield from ((heading, kind, content) for kind, content in of_code(cell))
            continue
        for part in re.split(r"(?=^#+ )", LINK.sub(r"\1", cell.source), flags=re.M):
            heading = (HEADING.findall(part) or [heading])[0]
            shown = (shown and not part.startswith(LEFT_OUT)) or bool(BACK.match(part))
            told = HEADING.sub("", part)
            if (i == 0 and part) or BACK.match(part):
                brief = told.split("**Limits")[0].split("**Further")[0]
                yield heading, "told", f'<div class="long">{markdown2html(brief)}</div>'
            elif shown:
                for text in SAID.findall(told):
                    kind = "look" if text.startswith("**Look") else "told"
                    yield heading, kind, f'<div class="{kind}">{markdown2html(text)}</div>'


def of_code(cell: nbformat.NotebookNode) -> Iterator[tuple[str, str]]:
    """Kind and HTML of a cell's source, if it is from scratch, and of what it shows and prints."""
    if "from-scratch" in cell.metadata.get("tags", []):
        yield "told", verbatim(cell.source)
    shown = []
    for output in cell.outputs:
        data = output.get("data", {})
        if "image/png" in data:
            alt = html.escape(cell.metadata.get("alt", ""))
            picture = data["image/png"].replace("\n", "")
            shown.append(f'<img alt="{alt}" src="data:image/png;base64,{picture}">')
        elif "<table" in data.get("text/html", ""):
            shown.append(data["text/html"])
    said = "".join(output.text for output in cell.outputs if output.get("name") == "stdout")
    kind = "shown" if shown else "printed"
    if said:
        shown = [*shown[:-1], "".join([*shown[-1:], verbatim(said.rstrip())])]
    yield from ((kind, content) for content in shown)


def verbatim(text: str) -> str:
    """Lines as they are, in letters as large as a slide has room for."""
    lines = text.splitlines()
    size = f"min(22px, {80 / (1.2 * len(lines)):.2f}vh, {88 / (0.62 * max(map(len, lines))):.2f}vw)"
    return f'<pre style="font: {size}/1.2 monospace">{html.escape(text)}</pre>'


def deck(notebook: nbformat.NotebookNode) -> str:
    """A chapter's slides as one page of HTML."""
    slides = list(slides_of(notebook))
    text = "\n".join(
        f"<section><h1>{html.escape(heading)}</h1>\n{content}</section>"
        for heading, content in slides
    )
    return DECK.substitute(title=html.escape(slides[0][0]), slides=text)


def write(notebooks: Path, folder: Path) -> list[Path]:
    """The decks of all notebooks of one folder, written into another."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for path in sorted(notebooks.glob("*.ipynb")):
        written.append(folder / f"{path.stem}.html")
        written[-1].write_text(deck(nbformat.read(path, as_version=4)), encoding="utf-8")
    return written


def main() -> int:
    """Write the decks, and MathJax beside them as the site's environment has it."""
    folder = ROOT / "build" / "slides"
    count = len(write(ROOT / "notebooks", folder))
    (package,) = importlib.util.find_spec("sphinx-mathjax-offline").submodule_search_locations
    shutil.copytree(Path(package, "static", "mathjax"), folder / "mathjax", dirs_exist_ok=True)
    print(f"build/slides: {count} decks; open one and turn pages with the arrows")
    return 0 if count else 1


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    sys.exit(main())
