"""Take results from an archive in place of executing: ``results_from.py TARBALL``.

The tarball's hash must be the one that is written beside it, its results must be made from what is
in this checkout, and one of the five longest notebooks, drawn at random, is executed and must give
them again. Only then are they published. No run is left in build/runs: tests execute all the same.
"""

import argparse
import hashlib
import random
import re
import sys
import tarfile
import tempfile
import zlib
from pathlib import Path

from sngr_utils import paths, whole_file
from sngr_utils.publish import notebooks, run, verify
from sngr_utils.publish.files import read_json
from sngr_utils.publish.freshness import inputs
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.publish.parameters import read_params

LONGEST = 5
PLACES = re.compile(r"(build/results|build/executed|figures)/\w[\w.-]*")


def main(tarball: Path) -> None:
    """Check the hash and the inputs, run one notebook, publish."""
    check_hash(tarball)
    with tempfile.TemporaryDirectory() as folder:
        files = unpack(tarball, Path(folder))
        for name in notebooks.names():
            if made_from(Path(folder, f"build/results/{name}.json")) != here(name):
                raise ProjectError(f"{tarball}: {name} was made from other inputs than are here")
        name = random.SystemRandom().choice(longest())
        run.run_aside(name)
        compare(name, Path(folder))
        for file in sorted(files, key=is_stamp):  # results last: they say that all is there
            whole_file.copy(Path(folder, file), paths.ROOT / file)
    print(f"{len(files)} files are published; {name} was executed and gives the same")


def made_from(results: Path) -> dict | None:
    """The inputs that results say they were made from; None if they do not say."""
    try:
        return read_json(results)["provenance"]["inputs"]
    except (ValueError, KeyError, TypeError):
        return None


def here(name: str) -> dict:
    """What a notebook's results would be made from in this checkout."""
    return inputs(name, read_params(name))


def is_stamp(file: str) -> bool:
    """Whether a file is the results of a notebook, which the others are hashed in."""
    return file.startswith("build/results/") and not file.endswith(".timings.json")


def check_hash(tarball: Path) -> None:
    """Refuse a tarball that is not the one its checksum was written for."""
    beside = tarball.with_name(f"{tarball.name}.sha256")
    for path in (tarball, beside):
        if not path.is_file():
            raise ProjectError(f"{path} is missing")
    digest = hashlib.sha256(tarball.read_bytes()).hexdigest()
    if beside.read_bytes().split()[:1] != [digest.encode()]:
        raise ProjectError(f"{tarball} is not what {beside.name} says: its sha256 is {digest}")


def unpack(tarball: Path, folder: Path) -> list[str]:
    """The names of the results, figures and executed notebooks; nothing else is unpacked."""
    try:
        with tarfile.open(tarball) as opened:
            chosen = [each for each in opened if each.isfile() and PLACES.fullmatch(each.name)]
            opened.extractall(folder, members=chosen, filter="data")
    except (tarfile.TarError, EOFError, OSError, zlib.error) as error:
        why = (str(error).splitlines() or [type(error).__name__])[0].rstrip(":")
        raise ProjectError(f"{tarball} is not an archive of results: {why}") from error
    for name in notebooks.names():
        if not (folder / f"build/results/{name}.json").is_file():
            raise ProjectError(f"{tarball} has no results of {name}")
    return [each.name for each in chosen]


def longest() -> list[str]:
    """The five notebooks that take longest."""
    return sorted(notebooks.names(), key=notebooks.length)[:LONGEST]


def compare(name: str, folder: Path) -> None:
    """Refuse results that a run does not give again, within the tolerance of each value."""
    then = verify.handed_on(read_json(folder / f"build/results/{name}.json"))
    now = verify.handed_on(read_json(paths.BUILD / "verify" / name / f"{name}.json"))
    rows = verify.compare_values(then, now)
    if breaches := [row.key for row in rows if not row.holds]:
        raise ProjectError(
            f"{name}, executed, differs from the archive in {len(breaches)} of {len(rows)} values: "
            + ", ".join(breaches[:5])
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tarball", type=Path)
    try:
        main(parser.parse_args().tarball)
    except ProjectError as error:
        sys.exit(f"error: {error}")
