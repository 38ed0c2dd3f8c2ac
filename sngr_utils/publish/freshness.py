"""What a notebook's results depend on, and whether they are made from what is here now.

All by content: the time of a file says nothing after a checkout.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from sngr_utils import paths
from sngr_utils.publish import notebooks
from sngr_utils.publish.dependencies import imported_files
from sngr_utils.publish.files import entries, read_json
from sngr_utils.publish.notebooks import ProjectError

# what reading a file that somebody spoiled may raise
MALFORMED = (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError)
READER = "sngr_utils/experiments/studies.py"  # of the rows that studies have committed
STAMP = "inputs.json"  # what a finished run was made from, and the hashes of its files


def inputs(name: str, params: dict[str, Any]) -> dict[str, str]:
    """Hashes of all that a notebook's results depend on."""
    modules = imported_files(name, notebooks.sources(name, code_only=True))
    reads = READER in map(relative, modules)
    studies = sorted((paths.PAPER / "studies").glob("*.json")) if reads else []
    return {
        "notebook": digest(notebooks.sources(name)),
        "params": digest(params),
        "package": digest([_text(path) for path in modules]),
        "printed_values": digest(_text(paths.PRINTED_VALUES)),
        "lock": digest(_text(paths.LOCK)),
        **({"studies": digest([_text(path) for path in studies])} if studies else {}),
    }


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ProjectError(f"{relative(path)} is not text in UTF-8") from error


def digest(content: Any) -> str:
    """A short hash of anything JSON can hold."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def file_digest(path: Path) -> str:
    """A short hash of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def is_whole_run(folder: Path, wanted: dict[str, str]) -> bool:
    """Whether a folder holds a finished run from the wanted inputs, untouched since."""
    try:
        stamp = read_json(folder / STAMP)
        return stamp["inputs"] == wanted and all(
            file_digest(folder / file) == was for file, was in stamp["files"].items()
        )
    except MALFORMED:
        return False


def is_fresh(name: str, params: dict[str, Any]) -> bool:
    """Whether the published results are there, whole, and made from what is here now."""
    wanted = inputs(name, params)
    try:
        result = read_json(paths.RESULTS / f"{name}.json")
        stamp = result.pop("provenance")
        published = [paths.FIGURES / figure for figure in result["figures"]]
        published.append(paths.EXECUTED / f"{name}.ipynb")
        return (
            stamp["inputs"] == wanted
            and stamp["content"] == digest(result)
            and stamp["files"].keys() >= {relative(path) for path in published}
            and all(_is_whole(paths.ROOT / file, was) for file, was in stamp["files"].items())
        )
    except MALFORMED:
        return False  # missing, damaged, or of an older make


def _is_whole(path: Path, was: str) -> bool:
    """Whether a published file is as it was; without a hash, whether it can be read as its kind.

    Wall clocks have none, so that two builds can be compared with the same ones.
    """
    if was:
        return file_digest(path) == was
    if path.suffix == ".json":
        clocks = entries(read_json(path)).values()
        return all({"value", "format"} <= clock.keys() for clock in clocks)
    return path.read_bytes().startswith((b"%PDF", b"\x89PNG"))


def relative(path: Path) -> str:
    """A path below the checkout, as it is written into results."""
    return path.relative_to(paths.ROOT).as_posix()
