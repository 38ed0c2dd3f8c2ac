"""Files that are written whole or not at all, whoever else writes them and wherever it ends.

Of several, each one is whole; a kill between two of them leaves the others as they were.
"""

import os
import shutil
import tempfile
from pathlib import Path


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all, in UTF-8; a link in its place is replaced, not followed.

    Raises
    ------
    OSError : the folder cannot be written, or is not there
    """
    write_texts({path: text})


def write_texts(texts: dict[Path, str]) -> None:
    """Write files of one folder, none before all of them are ready to take their places."""
    if not texts:
        return
    folder = next(iter(texts)).parent
    with tempfile.TemporaryDirectory(prefix=".write", dir=folder) as aside:
        for path, text in texts.items():
            Path(aside, path.name).write_text(text, encoding="utf-8")
        for path in texts:
            os.replace(Path(aside, path.name), path)


def copy(source: Path, target: Path) -> None:
    """Put a copy of a file in another's place, whole or not at all; makes the folder if need be."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".write", dir=target.parent) as aside:
        os.replace(shutil.copyfile(source, Path(aside, target.name)), target)
