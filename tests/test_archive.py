"""What an archive is told of the project is what CITATION.cff and the licences say."""

import json
import re

import pytest

from sngr_utils import paths
from sngr_utils.publish.parameters import read_yaml


@pytest.fixture(scope="module")
def citation():
    return read_yaml(paths.CITATION)


def test_the_metadata_of_archives_follow_the_citation(citation):
    zenodo, codemeta = (
        json.loads((paths.ROOT / name).read_text(encoding="utf-8"))
        for name in (".zenodo.json", "codemeta.json")
    )
    authors = [author["name"] for author in citation["authors"]]
    assert zenodo["title"] == codemeta["name"] == citation["title"]
    assert zenodo["version"] == codemeta["version"] == citation["version"]
    assert zenodo["publication_date"] == codemeta["datePublished"] == str(citation["date-released"])
    assert [each["name"] for each in zenodo["creators"]] == authors
    assert [each["name"] for each in codemeta["author"]] == authors
    assert zenodo["license"] == citation["license"] == codemeta["license"].split("/")[-1]
    assert zenodo["keywords"] == codemeta["keywords"]
    (paper,) = citation["references"]
    assert codemeta["referencePublication"]["name"] == paper["title"]


def test_each_licence_names_what_it_covers():
    code, text = ((paths.ROOT / name).read_text() for name in ("LICENSE", "LICENSE-text"))
    assert code.startswith("MIT License")
    assert "creativecommons.org/licenses/by/4.0" in text
    named = re.findall(r"(\w[\w.]*)/", text.split("are licensed")[0])
    assert named
    assert all((paths.ROOT / name).is_dir() for name in named)


def test_its_lock_has_hashes_and_no_address():
    text = (paths.ROOT / "scripts/archive.lock").read_text(encoding="utf-8")
    assert "://" not in text
    packages = re.findall(r"^(\S+==\S+)", text, re.M)
    assert len(packages) > 5
    blocks = re.split(r"^(?=\S+==)", text, flags=re.M)[1:]
    assert all("--hash=sha256:" in block for block in blocks)


def test_the_archive_adds_no_other_version_of_what_is_locked():
    locked, more = (
        dict(re.findall(r"^(\S+?)==([^\s;]+)", (paths.ROOT / name).read_text(), re.M))
        for name in ("environment.lock", "scripts/archive.lock")
    )
    assert {name: more[name] for name in more.keys() & locked} == {
        name: locked[name] for name in more.keys() & locked
    }
