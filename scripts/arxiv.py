"""Write build/arxiv.tar.gz: all that the typeset documents read, and typeset it alone.

After `make pdf`, whose recorder files say what was read. The documents lie at the root of the
tarball, with their bibliographies made.
"""

import argparse
import os
import re
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

import packed

from sngr_utils.publish import links

ROOT = Path(__file__).resolve().parents[1]
PAPER, TYPESET = ROOT / "paper", ROOT / "build/paper"
TARBALL = ROOT / "build/arxiv.tar.gz"
TYPESETS = 3  # runs of LaTeX, for references of references
UNDEFINED = re.compile(r"(Reference|Citation) .* undefined|undefined references")


def main() -> None:
    """Collect, pack, unpack elsewhere and typeset there."""
    documents = [Path(file).stem for file in links.DOCUMENTS]
    files = {name: content for each in documents for name, content in read_by(each).items()}
    packed.write(files, TARBALL)
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(TARBALL) as tarball:
            tarball.extractall(folder, filter="data")
        for document in [document for _ in range(TYPESETS) for document in documents]:
            typeset(document, Path(folder))
        for document in documents:
            log, ours = (
                (where / f"{document}.log").read_text("utf-8", "replace")
                for where in (Path(folder), TYPESET)
            )
            if UNDEFINED.search(log) or pages(log) != pages(ours):
                sys.exit(f"error: {document} of {TARBALL.name} is not what 'make pdf' has made")
            print(f"{document}: {pages(log)} pages, typeset from the tarball alone")
    print(f"{TARBALL.relative_to(ROOT)} is written: {len(files)} files")


def read_by(document: str) -> dict[str, bytes]:
    """Name in the tarball -> content, of all files of the checkout that a document reads."""
    try:
        recorded = (TYPESET / f"{document}.fls").read_text(encoding="utf-8")
    except OSError:
        sys.exit(f"error: build/paper/{document}.fls is missing: run 'make pdf'")
    files = {}
    for line in sorted(set(re.findall(r"^INPUT (.+)$", recorded, re.M))):
        path = Path(os.path.normpath(PAPER / line))
        if path.is_relative_to(PAPER):
            files[path.relative_to(PAPER).as_posix()] = path.read_bytes()
        elif path.is_relative_to(ROOT / "figures"):
            files[path.relative_to(ROOT).as_posix()] = path.read_bytes()
        elif path.parent == TYPESET and path.suffix == ".bbl":
            files[path.name] = path.read_bytes()
        elif path.parent == TYPESET and path.suffix == ".aux" and path.stem != document:
            files[path.name] = path.read_bytes()  # labels of another document
    for name, content in files.items():
        if name.endswith(".tex"):
            content = content.replace(b"../figures/", b"figures/")
            files[name] = content.replace(b"../build/paper/", b"")
    return files


def typeset(document: str, folder: Path) -> None:
    """LaTeX as arXiv runs it: no shell, no bibliography program, nothing of the user's."""
    own = {name: value for name, value in os.environ.items() if "TEX" not in name}
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", f"{document}.tex"]
    done = subprocess.run(command, cwd=folder, env=own, capture_output=True)
    if done.returncode:
        shown = done.stdout.decode("utf-8", "replace")[-600:]
        sys.exit(f"error: {document} of {TARBALL.name} cannot be typeset alone: {shown}")


def pages(log: str) -> str:
    """As LaTeX says at the end; its lines are broken."""
    return re.search(r"\((\d+)pages?", "".join(log.split()))[1]


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
