"""Results as files: JSON that diffs well."""

import json
import re
from pathlib import Path

from sngr_utils.whole_file import write_text

NUMBER = r"(?:-?[\d.]+(?:e[+-]?\d+)?|null)"
ON_ONE_LINE = re.compile(
    rf'\[\s*(?:{NUMBER},?\s*)+\]|\{{\s*"value": {NUMBER},\s*"format": "[^"{{}}]*"\s*\}}'
)


def write_json(path: Path, content: dict) -> None:
    """Write JSON that diffs well, with all digits; lists of numbers and short entries on a line."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    text = ON_ONE_LINE.sub(lambda found: " ".join(found[0].split()), text)
    write_text(path, text + "\n")


def read_json(path: Path) -> dict:
    """What `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))


def entries(result: dict) -> dict[str, dict]:
    """All that a notebook's JSON hands on under a key: its values, and its samples if any."""
    return {**result["values"], **result.get("samples", {})}
