"""The glossary's definitions where its terms are met: in the margin, and on hovering.

In each chapter the first mention of a term links to the glossary and shows the definition when
the pointer rests on it; the first mention in the book has it in the margin as well.
"""

import re

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

PAGE = "docs/glossary"
ENTRY = re.compile(
    r"^(?:<span id=\"[\w-]+\"></span>)?\*\*([^*]+)\*\*(?: \(([^)]*)\))?: (.+)$", re.M
)
# Where a link would be in the way: code, headings, other links.
LEFT_ALONE = (
    nodes.literal, nodes.title, nodes.reference, addnodes.pending_xref, nodes.math,
    nodes.FixedTextElement,
)  # fmt: skip


def anchor(term: str) -> str:
    """Where a term stands on the glossary's page."""
    return "term-" + nodes.make_id(term)


def with_anchors(text: str) -> str:
    """The glossary, with a place to link to before each term."""
    return ENTRY.sub(lambda entry: f'<span id="{anchor(entry[1])}"></span>{entry[0]}', text)


class Glossary:
    """The terms of the book, and which of them it has mentioned so far."""

    def __init__(self, text: str):
        entries = ENTRY.findall(text)
        self.meaning = {term: meaning for term, _, meaning in entries}
        self.term = {name: term for term, other, _ in entries for name in (term, other) if name}
        self.mentioned: set[str] = set()
        names = sorted(self.term, key=len, reverse=True)
        any_case = [name if name != name.lower() else f"(?i:{re.escape(name)})" for name in names]
        self.pattern = re.compile(rf"\b({'|'.join(any_case)})(?=s?\b)")
        self.by_lower = {name.lower(): term for name, term in self.term.items()}

    def mark(self, app: Sphinx, doctree: nodes.document) -> None:
        """Link and explain the first mentions of a chapter, which Sphinx has just read."""
        if not app.env.docname.startswith("notebooks/"):
            return
        to_glossary = app.builder.get_relative_uri(app.env.docname, PAGE)
        here: set[str] = set()
        for text in list(doctree.findall(nodes.Text)):
            paragraph = text.parent
            while not isinstance(paragraph, (nodes.paragraph, nodes.document, *LEFT_ALONE)):
                paragraph = paragraph.parent
            if isinstance(paragraph, nodes.paragraph):
                self.mark_text(text, paragraph, to_glossary, here)

    def mark_text(self, text, paragraph, to_glossary: str, here: set[str]) -> None:
        """The same for one piece of text; what it mentions joins `here`."""
        parts, end = [], 0
        for match in self.pattern.finditer(text):
            term = self.by_lower[match[0].lower()]
            if term not in here:
                here.add(term)
                uri, meaning = f"{to_glossary}#{anchor(term)}", self.meaning[term]
                link = nodes.reference(
                    "", match[0], refuri=uri, reftitle=meaning, internal=True, classes=["term"]
                )
                parts += [nodes.Text(text[end : match.start()]), link]
                end = match.end()
                if term not in self.mentioned:
                    self.mentioned.add(term)
                    beside(paragraph, term, meaning)
        text.parent.replace(text, [*parts, nodes.Text(text[end:])])


def beside(paragraph: nodes.paragraph, term: str, meaning: str) -> None:
    """Put a definition into the margin beside a paragraph, or beside the list that it is in."""
    block = paragraph
    while not isinstance(block.parent, (nodes.section, nodes.document, nodes.container)):
        block = block.parent
    told = nodes.paragraph("", "", nodes.strong("", term), nodes.Text(f": {meaning}"))
    note = nodes.sidebar("", told, classes=["margin"])
    block.parent.insert(block.parent.index(block), note)


def setup(app: Sphinx) -> dict:
    """Called by Sphinx; without a glossary there is nothing to do."""
    path = app.srcdir / f"{PAGE}.md"
    if path.exists():
        app.connect("doctree-read", Glossary(path.read_text(encoding="utf-8")).mark)
    return {"parallel_read_safe": False}
