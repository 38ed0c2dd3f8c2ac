"""Write build/archive: the results as a tarball that is an RO-Crate, its checksum, and metadata.

After `make results`. The crate says of each notebook what it was made from and what it made;
`scripts/results_from.py` takes the tarball in place of executing. `metadata.yaml` is what ReScience
asks of a replication.
"""

import argparse
import hashlib
import shutil
import tempfile
from pathlib import Path

import packed
from ruamel.yaml import YAML

from sngr_utils import paths
from sngr_utils.publish import claims, judge, links, notebooks, results
from sngr_utils.publish.files import read_json
from sngr_utils.publish.parameters import read_yaml
from sngr_utils.whole_file import write_text

ARCHIVE = paths.BUILD / "archive"
TARBALL = "sngr-results.tar.gz"
LICENSES = {
    "code": ("https://spdx.org/licenses/MIT", "MIT License"),
    "text": ("https://creativecommons.org/licenses/by/4.0/", "Creative Commons Attribution 4.0"),
}
KINDS = {
    ".json": "application/json", ".ipynb": "application/x-ipynb+json", ".pdf": "application/pdf",
    ".png": "image/png", ".html": "text/html", ".yaml": "application/yaml",
    ".tex": "text/x-tex", "": "text/plain",
}  # fmt: skip


def main() -> None:
    """Make the folder anew, and read back what was written."""
    shutil.rmtree(ARCHIVE, ignore_errors=True)
    ARCHIVE.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as folder:
        crate().write(folder)
        check(Path(folder))
        files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in Path(folder).rglob("*") if path.is_file()
        }  # fmt: skip
    packed.write(files, ARCHIVE / TARBALL)
    digest = hashlib.sha256((ARCHIVE / TARBALL).read_bytes()).hexdigest()
    write_text(ARCHIVE / f"{TARBALL}.sha256", f"{digest}  {TARBALL}\n")
    with open(ARCHIVE / "metadata.yaml", "w", encoding="utf-8") as file:
        YAML().dump(replication(), file)
    print(f"build/archive/{TARBALL}: {len(files)} files, sha256 {digest}")


def crate():
    """The files of all notebooks, and of each notebook the action that made its files."""
    from rocrate.model.contextentity import ContextEntity
    from rocrate.rocrate import ROCrate

    citation, made = read_yaml(paths.CITATION), ROCrate()
    made.name, made.description = citation["title"], describe()
    made.datePublished = made.root_dataset["dateModified"] = str(citation["date-released"])
    code, text = (
        made.add(ContextEntity(made, url, {"@type": "CreativeWork", "name": name}))
        for url, name in LICENSES.values()
    )
    made.license = text
    software = made.add(ContextEntity(made, "#sngr_utils", {
        "@type": "SoftwareSourceCode", "name": "sngr_utils", "version": citation["version"],
        "license": code, "identifier": links.commit() or "unknown",
    }))  # fmt: skip
    for name in ("LICENSE", "LICENSE-text", "paper/generated/appendix.tex"):
        add(made, paths.ROOT / name)
    for name in notebooks.names():
        stamp = read_json(paths.RESULTS / f"{name}.json")["provenance"]
        used = add(made, paths.PARAMS / f"{name}.yaml")
        outputs = [paths.RESULTS / f"{name}.json", *map(paths.ROOT.joinpath, stamp["files"])]
        made.add(ContextEntity(made, f"#{name}", {
            "@type": "CreateAction", "name": f"notebook {name}, executed", "instrument": software,
            "object": used, "result": [add(made, path) for path in outputs],
            "description": f"made from {stamp['inputs']}",
        }))  # fmt: skip
    return made


def add(made, path: Path):
    """A file of the checkout, under the name it has there."""
    kind, content = KINDS[path.suffix], path.read_bytes()
    properties = {
        "name": path.name, "encodingFormat": kind, "contentSize": str(len(content)),
        "sha256": hashlib.sha256(content).hexdigest(),
    }  # fmt: skip
    return made.add_file(path, path.relative_to(paths.ROOT).as_posix(), properties=properties)


def check(folder: Path) -> None:
    """Read a crate back: what the specification asks of its root, and every file whole.

    Raises
    ------
    ValueError : what is missing, or is not what its hash says
    """
    from rocrate.rocrate import ROCrate

    read = ROCrate(folder)
    for needed in ("name", "description", "datePublished", "license"):
        if not read.root_dataset.get(needed):
            raise ValueError(f"the crate's root has no {needed}")
    named = {entity.id: entity for entity in read.data_entities}
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    if there - {"ro-crate-metadata.json"} != named.keys():
        raise ValueError(f"files and their names differ: {sorted(there ^ named.keys())[:5]}")
    for name, entity in named.items():
        if hashlib.sha256((folder / name).read_bytes()).hexdigest() != entity["sha256"]:
            raise ValueError(f"{name} is not what its hash says")


def describe() -> str:
    """One sentence with the counts of the verdicts."""
    reading = claims.read().reading
    found = judge.counts(judge.evaluate(results.results_in(paths.RESULTS)), "number")
    told = ", ".join(f"{count} {verdict}" for verdict, count in found.items() if count)
    return (
        f"Executed notebooks, their numbers and figures. Printed numbers, preset {reading}: {told}."
    )


def replication() -> dict:
    """What ReScience C asks of a replication; empty is what is known only once it is submitted."""
    citation = read_yaml(paths.CITATION)
    (original,) = citation["references"]
    return {
        "title": f"[Re] {original['title']}",
        "authors": [{"name": each["name"], "orcid": "", "email": "", "affiliations": []}
                    for each in citation["authors"]],
        "abstract": describe(),
        "keywords": ["SLAM", "range-only", "nested sampling", "factor graphs"],
        "type": "replication", "domain": "robotics", "language": "Python",
        "replication": {
            "cite": "; ".join(f"{who['family-names']}, {who['given-names']}"
                              for who in original["authors"]) + f": {original['title']}",
            "bib": "sngr", "url": "", "doi": original.get("doi", ""),
        },
        "code": {"url": links.repository(), "doi": "", "commit": links.commit()},
        "data": {"url": "", "doi": "", "file": TARBALL},
        "dates": {"received": "", "accepted": "", "published": ""},
    }  # fmt: skip


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
