"""Tarballs that are the same, byte for byte, whenever and wherever they are made."""

import gzip
import io
import os
import tarfile
from pathlib import Path

DATED = 1735689600  # the Makefile's SOURCE_DATE_EPOCH


def write(files: dict[str, bytes], target: Path) -> None:
    """Write name -> content as a ``.tar.gz``, whole or not at all."""
    partial = target.with_name(target.name + ".partial")
    with (
        open(partial, "wb") as raw,
        gzip.GzipFile(filename="", fileobj=raw, mode="wb", mtime=DATED) as zipped,
        tarfile.open(fileobj=zipped, mode="w") as tarball,
    ):
        for name, content in sorted(files.items()):
            entry = tarfile.TarInfo(name)
            entry.size, entry.mtime = len(content), DATED
            tarball.addfile(entry, io.BytesIO(content))
    os.replace(partial, target)
