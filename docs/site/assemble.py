"""Lay out what the site is made of below build/site-source, in the folders of the repository.

The README is the first page, each notebook a chapter with its stored outputs, each room of the
library a page, and the verdicts a table that can be sorted. Links between them stay as they are
written, for the pages lie to each other as the files do.
"""

import argparse
import html
import json
import os
import re
import shutil
from pathlib import Path

import api
import glossary
import nbformat

from sngr_utils import paths
from sngr_utils.publish import claims, notebooks, trace

HERE = Path(__file__).resolve().parent
DOCS = HERE.parent
SOURCE = paths.BUILD / "site-source"
EXTRA = SOURCE / "extra"  # what is copied into the site as it is
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!\w+:|#)([^)\s#]+)(#[^)\s]*)?\)")
FILM = re.compile(r"^Film: \[(.*)\]\(\.\./(figures/\w+\.html)\)$")
PARTS = {
    "Start here": ["notebooks/00_*"],
    "The paper": ["notebooks/0[1-5]_*", "verdicts.md"],
    "Beyond": ["notebooks/0[6-9]_*", "notebooks/[1-9]*"],
    "Look up": ["docs/*.md", "docs/*/*.md", "CONTRIBUTING.md"],
    "The library": ["api/*"],
}
PDFS = {"sngr.pdf": "the paper (PDF)", "supplement.pdf": "its supplement (PDF)"}


def main() -> None:
    """Make the folder anew, so that no page outlives its file."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    for path in sorted(paths.NOTEBOOKS.glob("*.ipynb")):
        write(f"notebooks/{path.name}", chapter(path))
    for path in [paths.ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")]:
        if HERE not in path.parents:
            text = linked(path.read_text(encoding="utf-8"), path.parent)
            name = path.relative_to(paths.ROOT)
            write(name, glossary.with_anchors(text) if path.stem == "glossary" else text)
    for name, text in api.pages().items():
        write(f"api/{name}.rst", text)
    write("verdicts.md", verdicts())
    readme = linked(paths.README.read_text(encoding="utf-8"), paths.ROOT)
    write("index.md", to_their_cells(readme) + downloads() + contents())


def write(name: str | Path, text: str) -> None:
    """A file of the source, with the folder it stands in."""
    path = SOURCE / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def linked(text: str, folder: Path) -> str:
    """Markdown that stands in `folder`, with links that lead somewhere on the site.

    A module leads to its place in the API, a folder nowhere, a film to the site's own, a picture
    or another file to a copy of it.
    """

    def target(match: re.Match) -> str:
        words, address, anchor = match.groups()
        path = Path(os.path.normpath(folder / address))
        name = path.relative_to(paths.ROOT)
        if path.suffix == ".py" and paths.PACKAGE in path.parents:
            parts = [part for part in name.with_suffix("").parts if part != "__init__"]
            return f"[{words}](#{'.'.join(parts)})"
        if path.is_dir():
            return words
        if path.suffix == ".html":  # a film, which a chapter has brought
            return f'<a href="{address}">{words}</a>'
        if path == paths.README:
            address = f"{address.removesuffix(path.name)}index.md"
        if path.suffix in {".md", ".ipynb"}:
            place = re.sub(r"[^\w-]", "", anchor or "").lower()  # Jupyter keeps dots and capitals
            return f"[{words}]({address}{place and '#' + place})"
        copy(name)
        return f"[{words}](<path:{address}>)"

    for picture in re.findall(r"!\[[^\]]*\]\((?!\w+:)([^)\s]+)\)", text):
        copy(Path(os.path.normpath(folder / picture)).relative_to(paths.ROOT))
    return LINK.sub(target, text)


def with_player(output: dict) -> None:
    """In place of a link to a film, the film; it lies in the site as it is in the repository."""
    link = FILM.match(output.get("data", {}).get("text/markdown", ""))
    if link:
        title, name = link.groups()
        target = EXTRA / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(paths.ROOT / name, target)
        player = (
            f'<iframe class="film" src="../{name}" title="Film: {html.escape(title)}"></iframe>'
        )
        output.data = nbformat.from_dict({"text/html": player})


def copy(name: Path) -> None:
    """A file that is shown or can be downloaded."""
    (SOURCE / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(paths.ROOT / name, SOURCE / name)


def chapter(path: Path) -> str:
    """A notebook for the site: solutions fold, figures say what they show, cells can be linked."""
    notebook, cells, heading, number = nbformat.read(path, as_version=4), [], "", 0
    anchors = anchors_of(path.stem)
    for cell in notebook.cells:
        tags = cell.metadata.get("tags", [])
        if cell.cell_type == "markdown":
            heading = ([heading, *re.findall(r"^#+ (.*)$", cell.source, re.M)])[-1]
            cell.source = linked(cell.source, path.parent)
        number += cell.cell_type == "code"
        ids = [tag for tag in tags if tag.startswith("claim-")]
        for name in ids + anchors.pop(number, []) * (cell.cell_type == "code"):
            cells.append(nbformat.v4.new_markdown_cell(f'<span id="{name}"></span>'))
        for output in cell.get("outputs", []):
            with_player(output)
        if "solution" in tags:
            cell.metadata.tags = [*tags, "hide-cell"]
            prompts = {"code_prompt_show": "Solution", "code_prompt_hide": "Solution"}
            cell.metadata.mystnb = prompts
        if any("image/png" in output.get("data", {}) for output in cell.get("outputs", [])):
            alt = cell.metadata.get("alt", f'Figure of the section "{heading}"')
            cell.metadata["mystnb"] = cell.metadata.get("mystnb", {}) | {"image": {"alt": alt}}
        cells.append(cell)
    cells[0].source = with_downloads(cells[0].source, path)
    notebook.cells = cells
    return nbformat.writes(notebook)


def anchors_of(name: str) -> dict[int, list[str]]:
    """Number of a code cell -> the anchors of the figures and tables that it hands on."""
    anchors = {}
    for (kind, what), cell in trace.handed_on(name).items():
        if kind in ("figure", "table"):
            anchors.setdefault(cell.number, []).append(f"{kind}-{what}")
    return anchors


def to_their_cells(text: str) -> str:
    """The first page, each picture a link to the cell of a notebook that draws it."""

    drawn = "|".join(notebooks.names())
    picture = rf"(!\[[^\]]*\]\(figures/({drawn})_(\w+)\.png\))"
    return re.sub(picture, r'<a href="notebooks/\2.html#figure-\3">\1</a>', text)


def with_downloads(first: str, path: Path) -> str:
    """The first cell, with links to the notebook as it is and without solutions if that is built.

    They lie outside of the source, which knows one file of a name.
    """
    offered = {path: "this notebook", paths.BUILD / "student" / path.name: "without its solutions"}
    links = []
    for original, words in offered.items():
        if original.exists():
            name = Path("downloads", original.parent.name, path.name)
            write(name, original.read_text(encoding="utf-8"))
            links.append(f"[{words}](<path:/{name}>)")
    title, rest = first.split("\n", 1)
    return f"{title}\n\nDownload {', '.join(links)}\n{rest}"


def downloads() -> str:
    """The PDFs, if they are built."""
    links = []
    for name, words in PDFS.items():
        if (paths.PAPER / name).exists():
            copy(Path("paper", name))
            links.append(f"[{words}](<path:paper/{name}>)")
    return f"\nDownload {' and '.join(links)}.\n" if links else ""


def contents() -> str:
    """What the side bar lists, in the order of reading."""
    text = ""
    for part, patterns in PARTS.items():
        pages = [path for pattern in patterns for path in sorted(SOURCE.glob(pattern))]
        names = [path.relative_to(SOURCE).with_suffix("").as_posix() for path in pages]
        if names:
            lines = "\n".join(names)
            text += f"\n```{{toctree}}\n:hidden:\n:caption: {part}\n\n{lines}\n```\n"
    return text


def verdicts() -> str:
    """Every claim of ``paper/verdicts.json`` as one row, under our reading and the two others."""
    presets = json.loads(paths.VERDICTS.read_text(encoding="utf-8"))
    reading = claims.read().reading
    others = [name for name in presets if name != reading]
    heads = ["claim", "what", "rule", "printed", "ours", "share of the natural range that passes",
             f"verdict ({reading})", *others]  # fmt: skip
    rows = []
    for claim, record in presets[reading].items():
        cells = record.split(" | ")
        rest = [presets[name][claim].split(" | ")[-1] for name in others]
        rows.append([claim, *cells, *rest])
    buttons = "".join(f'<th scope="col"><button>{head}</button></th>' for head in heads)
    lines = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows)
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    text = (HERE / "verdicts.md").read_text(encoding="utf-8")
    return (
        f'{text}\n<div class="wide" tabindex="0" role="region" aria-label="Verdicts">\n'
        f'<table class="dataframe sortable">\n<thead><tr>{buttons}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table>\n</div>\n"
    )


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
