"""What an archive is told of the project is what CITATION.cff and the licences say."""

import hashlib
import importlib.util
import json
import re
import tarfile
import tomllib

import pytest

from sngr_utils import paths
from sngr_utils.publish import notebooks
from sngr_utils.publish.notebooks import ProjectError
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
    assert codemeta["referencePublication"]["id"] == f"https://doi.org/{paper['doi']}"
    assert [each["identifier"] for each in zenodo["related_identifiers"]] == [paper["doi"]]
    assert f"doi    = {{{paper['doi']}}}" in (paths.PAPER / "references.bib").read_text()
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text())["project"]
    assert citation["version"] == project["version"]
    pythons = re.findall(r"3\.\d+", codemeta["runtimePlatform"])
    assert project["requires-python"] == f">={pythons[0]},<3.{int(pythons[1][2:]) + 1}"


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


@pytest.fixture(scope="module")
def results_from():
    place = paths.ROOT / "scripts/results_from.py"
    spec = importlib.util.spec_from_file_location("results_from", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def archive_of(folder, content):
    """A tarball in which each notebook's results have this content."""
    for name in notebooks.names():
        path = folder / f"build/results/{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    with tarfile.open(folder / "a.tar.gz", "w:gz") as opened:
        opened.add(folder / "build", "build")
    return (folder / "a.tar.gz").read_bytes()


FOREIGN = '{"provenance": {"inputs": 1}}'


@pytest.mark.parametrize(
    ("broken", "why"),
    [
        (lambda folder: b"", "is not an archive of results: file could not be opened"),
        (lambda folder: b"no archive\n", "is not an archive of results: file could not be opened"),
        (lambda folder: archive_of(folder, FOREIGN)[:200], "is not an archive of results: Comp"),
        (lambda folder: archive_of(folder, FOREIGN), "was made from other inputs"),
        (lambda folder: archive_of(folder, "{}"), "was made from other inputs"),
        (lambda folder: archive_of(folder, '{"provenance": 3}'), "was made from other inputs"),
        (lambda folder: archive_of(folder, "no JSON"), "was made from other inputs"),
    ],
)
def test_what_is_no_archive_of_ours_is_refused_in_one_line(tmp_path, results_from, broken, why):
    tarball = tmp_path / "sngr.tar.gz"
    tarball.write_bytes(broken(tmp_path))
    tarball.with_name("sngr.tar.gz.sha256").write_bytes(b"\xff\xfe")
    with pytest.raises(ProjectError, match="is not what"):
        results_from.main(tarball)
    digest = hashlib.sha256(tarball.read_bytes()).hexdigest()
    tarball.with_name("sngr.tar.gz.sha256").write_text(f"{digest}  sngr.tar.gz\n")
    with pytest.raises(ProjectError, match=why) as error:
        results_from.main(tarball)
    assert str(tarball) in str(error.value)
    assert "\n" not in str(error.value)
