"""All that the notebooks hand on, gathered from the files of a folder."""

import os
from pathlib import Path

from sngr_utils import paths
from sngr_utils.publish import notebooks
from sngr_utils.publish.files import entries, read_json
from sngr_utils.publish.notebooks import ProjectError


def results_in(folder: Path) -> dict[str, dict]:
    """All entries of all notebooks, wall clocks too, from the JSON files of a folder.

    Raises
    ------
    ProjectError : a file is damaged
    """
    merged: dict[str, dict] = {}
    for name in notebooks.names():
        for path in (folder / f"{name}.json", folder / f"{name}.timings.json"):
            if path.exists():
                try:
                    merged |= entries_in(path)
                except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
                    where = os.path.relpath(path, paths.ROOT)
                    raise ProjectError(f"{where} is damaged: {error!r}") from error
    return merged


def entries_in(path: Path) -> dict[str, dict]:
    """Key -> entry of one file, as a notebook saves it or as the reference keeps it."""
    content = read_json(path)
    found = entries(content) if "values" in content else content
    if not all("value" in entry for entry in found.values()):
        raise ValueError("an entry has no value")
    return found
