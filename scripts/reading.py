"""How long the notebooks take to read, and whether that is within the limits.

Words at 200 a minute, and 2.8 s for each number in a table. A table has at most 6 columns and 8
rows, and one with numbers marks the cell that matters. The limits are in pyproject.toml,
[tool.reading]: lower them when a notebook has become shorter.
"""

import argparse
import json
import re
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORDS_A_MINUTE = 200
SECONDS_A_NUMBER = 2.8
COLUMNS, ROWS = 6, 8  # of a table that a lesson may show
NO_PROSE = re.compile(r"\]\(.*?\)|<.*?>|\$+[^$]*\$+")  # addresses, tags, formulas
WORD = re.compile(r"[^\W\d_][\w'’-]*")
NUMBER = re.compile(r"\d+(?:[.,]\d+)*(?:e[+−-]?\d+)?")


@dataclass(frozen=True)
class Load:
    """What a reader of one notebook meets.

    Attributes
    ----------
    large : tables beyond 6 columns or 8 rows
    unmarked : tables with numbers of which no cell is marked
    """

    words: int
    tables: int
    large: int
    unmarked: int
    numbers: int

    @property
    def minutes(self) -> float:
        return self.words / WORDS_A_MINUTE + self.numbers * SECONDS_A_NUMBER / 60


def load_of(notebook: dict) -> Load:
    """Words of the text cells, and the tables among the stored outputs."""
    text = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "markdown"]
    words = sum(len(WORD.findall(NO_PROSE.sub(" ", cell))) for cell in text)
    outputs = [o for c in notebook["cells"] for o in c.get("outputs", [])]
    shown = "\n".join("".join(o.get("data", {}).get("text/html", "")) for o in outputs)
    tables = [table_of(text) for text in re.findall(r"<table.*?</table>", shown, re.DOTALL)]
    large = sum(len(rows) > ROWS or len(rows[0]) > COLUMNS for rows in tables)
    cells = [[cell for row in rows for cell in row] for rows in tables]
    unmarked = sum(
        any(re.match("−?[0-9]", cell) for cell in table) and "<strong>" not in "".join(table)
        for table in cells
    )
    numbers = sum(len(NUMBER.findall(cell)) for table in cells for cell in table)
    return Load(words, len(tables), large, unmarked, numbers)


def table_of(text: str) -> list[list[str]]:
    """The cells of a table in HTML, row by row, without its head."""
    rows = [re.findall(r"<td.*?>(.*?)</td>", row, re.DOTALL) for row in text.split("<tr")]
    return [row for row in rows if row]


def report(loads: dict[str, Load], minutes: dict[str, float]) -> tuple[str, list[str]]:
    """The table for all notebooks, and a sentence for each limit that is exceeded.

    Parameters
    ----------
    minutes : limit by notebook, and "all"
    """
    lines = [f"{'':25}  words  tables  large  unmarked  numbers  minutes  limit"]
    whole = Load(*(sum(getattr(load, name) for load in loads.values())
                   for name in ("words", "tables", "large", "unmarked", "numbers")))  # fmt: skip
    faults = []
    for name, load in [*loads.items(), ("all", whole)]:
        lines.append(
            f"{name:25} {load.words:6} {load.tables:7} {load.large:6} {load.unmarked:9}"
            f" {load.numbers:9} {load.minutes:8.1f} {minutes.get(name, 0):6g}"
        )
        if load.minutes > minutes.get(name, 0):
            faults.append(f"{name}: {load.minutes:.1f} minutes, {minutes.get(name, 0):g} allowed")
        if name in loads and load.large + load.unmarked:
            faults.append(f"{name}: {load.large} tables are large, {load.unmarked} without a mark")
    return "\n".join(lines), faults


def main() -> int:
    """Print the table; 1 if a notebook takes longer than its limit."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    loads = {
        path.stem: load_of(json.loads(path.read_text(encoding="utf-8")))
        for path in sorted((ROOT / "notebooks").glob("*.ipynb"))
    }
    table, faults = report(loads, project["tool"]["reading"]["minutes"])
    print(table)
    for fault in faults:
        print(f"reading of {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    sys.exit(main())
