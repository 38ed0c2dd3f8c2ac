"""What the documents point at is there, and the glossary can be read by a program."""

import re

import pytest
from helpers import read_notebook

from sngr_utils import paths

DOCS = sorted((paths.ROOT / "docs").rglob("*.md"))


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for link in re.findall(r"\]\(([^)#]+)\)", path.read_text(encoding="utf-8")):
        assert "://" in link or (path.parent / link).exists(), link


def test_a_section_that_is_named_is_in_its_notebook():
    text = (paths.ROOT / "docs/teaching/README.md").read_text(encoding="utf-8")
    named = re.findall(r"\[([^\]]+)\]\(\.\./\.\./notebooks/(\w+)\.ipynb\)", text)
    assert len(named) > 20
    for section, name in named:
        cells = [c.source for c in read_notebook(name).cells if c.cell_type == "markdown"]
        headings = re.findall(r"^#+ (?:\d+\. )?(.*)$", "\n".join(cells), re.MULTILINE)
        assert section in headings, (section, name)


def test_the_glossary_is_one_sentence_a_term_in_order():
    text = (paths.ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    entries = re.findall(r"^\*\*([^*]+)\*\*(?: \(([^)]*)\))?: (.+)$", text, re.MULTILINE)
    assert len(entries) == text.count("\n**") >= 60
    terms = [term for term, _, _ in entries]
    assert terms == sorted(set(terms), key=str.lower)
    for _, _, meaning in entries:
        assert meaning.endswith(".")
        assert ". " not in meaning


def test_a_letter_has_one_meaning():
    text = (paths.ROOT / "docs/notation.md").read_text(encoding="utf-8")
    signs = [row.split("|")[1].strip() for row in text.splitlines() if row.startswith("| ")][1:]
    letters = [sign for cell in signs for sign in cell.split(", ")]
    assert len(letters) == len(set(letters)) > 30


def test_the_quiz_has_fifteen_questions_and_answers():
    text = (paths.ROOT / "docs/teaching/quiz.md").read_text(encoding="utf-8")
    parts = re.split(r"^\*\*(\d+)\.\*\* ", text, flags=re.MULTILINE)
    assert parts[1::2] == [str(number) for number in range(1, 16)]
    for part in parts[2::2]:
        assert part.count("<details>") == part.count("</details>") == 1


def test_each_message_of_the_page_of_help_is_one_that_is_given():
    text = (paths.ROOT / "docs/help.md").read_text(encoding="utf-8")
    heads = re.findall(r"^- (`.+?`(?:, `.+?`)*):(?: |$)", text, re.MULTILINE)
    told = [message for head in heads for message in re.findall(r"`(.+?)`", head)]
    assert len(told) > 20
    assert len(heads) == text.count("\n- `")
    folders = [*paths.PACKAGE.rglob("*.py"), *(paths.ROOT / "scripts").glob("*.*")]
    sources = [*folders, paths.ROOT / "conftest.py"]
    given = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    given = re.sub(r'"\s*\n\s*f?"', "", given)  # a string that goes on in the next line
    for message in told:
        for part in message.removeprefix("error: ").split("…"):
            assert part.strip(" :") in given, message
