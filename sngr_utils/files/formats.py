"""Which reader a path is for."""

import os
from pathlib import Path

from sngr_utils.files import nsfg, plaza, pyfg, tables
from sngr_utils.files.recording import Recording

READERS = {".pyfg": pyfg.read, ".fg": nsfg.read, ".mat": plaza.read}


def read(path: Path) -> Recording:
    """The recording in a file, by its suffix, or in the tables of a folder.

    Raises
    ------
    ValueError : one line that names the file, what is wrong with it, and where
    """
    if path.is_dir():
        return tables.read(path)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        known = ", ".join(READERS)
        what = "neither one of" if os.path.lexists(path) else "not there, and neither one of"
        raise ValueError(f"{path}: {what} {known} nor a folder of tables")
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    return READERS[suffix](path)
