"""The bibliography: every entry is cited, every citation has an entry, a DOI has its form."""

import re

import pytest
from helpers import paper_text

from sngr_utils import paths

BIB = (paths.PAPER / "references.bib").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^@\w+\{(\w+),\n(.*?)^\}", BIB, re.MULTILINE | re.DOTALL))
DOIS = re.findall(r"^\s*doi\s*=\s*(.*)$", BIB, re.MULTILINE)


def cited(text):
    """Keys of all citations."""
    return {key for group in re.findall(r"\\cite\{([^}]*)\}", text) for key in group.split(",")}


def test_every_entry_is_cited_and_every_citation_has_an_entry():
    assert len(ENTRIES) == BIB.count("\n@") > 40
    assert cited(paper_text()) == set(ENTRIES)


@pytest.mark.parametrize("line", DOIS)
def test_a_doi_has_its_form(line):
    """ISO 26324: a directory's prefix and a suffix; no address before it, nothing twice."""
    assert re.fullmatch(r"\{10\.\d{4,9}/[^\s{}\\]+\},", line), line
    assert DOIS.count(line) == 1


def test_most_entries_have_a_doi():
    assert len(DOIS) > 0.8 * len(ENTRIES)


@pytest.mark.parametrize("key", ENTRIES)
def test_an_entry_can_be_found_or_says_that_it_has_no_address(key):
    """A DOI, else an address, else the number of a book, else that none is known."""
    assert re.search(r"^\s*(doi|url|isbn)\s*= |no DOI known", ENTRIES[key], re.MULTILINE)


@pytest.mark.parametrize("key", ENTRIES)
def test_an_entry_says_who_what_and_when(key):
    fields = set(re.findall(r"(?:^|, )\s*(\w+)\s*= ", ENTRIES[key], re.MULTILINE))
    assert {"author", "title", "year"} <= fields


def test_the_paper_under_test_stands_with_the_address_of_its_code():
    """As far as either is known: its number in the arXiv, and where its authors say the code is."""
    assert "arXiv:2604.22065" in ENTRIES["sngr"]
    assert "https://github.com/anushkakulk/sngr-slam" in ENTRIES["sngr"]
