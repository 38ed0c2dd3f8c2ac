"""Results as files: JSON that diffs well, and files that are replaced whole or not at all."""

import json
import os
import re
import shutil
from pathlib import Path

NUMBER = r"(?:-?[\d.]+(?:e[+-]?\d+)?|null)"
ON_ONE_LINE = re.compile(
    rf'\[\s*(?:{NUMBER},?\s*)+\]|\{{\s*"value": {NUMBER},\s*"format": "[^"{{}}]*"\s*\}}'
)


def write_json(path: Path, content: dict) -> None:
    """Write JSON that diffs well, with all digits; lists of numbers and short entries on a line."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    text = ON_ONE_LINE.sub(lambda found: " ".join(found[0].split()), text)
    write_text(path, text + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all; a link in its place is replaced, not followed."""
    partial = _partial(path)
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)


def _partial(path: Path) -> Path:
    """Where a file is written before it takes its place: never what a link there leads to."""
    partial = path.with_name(path.name + ".partial")
    partial.unlink(missing_ok=True)
    return partial


def read_json(path: Path) -> dict:
    """What `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))


def entries(result: dict) -> dict[str, dict]:
    """All that a notebook's JSON hands on under a key: its values, and its samples if any."""
    return {**result["values"], **result.get("samples", {})}


def replace(source: Path, target: Path) -> None:
    """Put a copy of a file in another's place, whole or not at all."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = _partial(target)
    shutil.copyfile(source, partial)
    os.replace(partial, target)
