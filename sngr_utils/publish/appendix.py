"""The artifact appendix: for each claim the command, the expected value, its tolerance, minutes."""

from itertools import groupby
from operator import attrgetter

from sngr_utils.publish import claims, latex, report, rules, verified
from sngr_utils.publish.cells import NONE, text
from sngr_utils.publish.claims import Entry, NumberEntry
from sngr_utils.publish.judge import Row

ROWS = 20  # of a tabular, which does not break over pages
HEADS = ("claim", "KEY", "expected", "tolerance")
CLOCK = "a clock: not compared"


def latex_text(rows: list[Row], results: dict[str, dict], clocks: set[str]) -> str:
    """A paragraph for each notebook: how to run it, and what its claims are expected to give.

    Parameters
    ----------
    rows : of the verdicts
    results : key -> entry, as all notebooks hand them on
    clocks : keys of wall clocks
    """
    entries = {entry.id: entry for entry in [*claims.read().numbers, *claims.read().prose]}
    told = [row for row in rows if row.verdict not in (rules.FOLLOWS, rules.CANNOT)]
    minutes, parts, by_notebook = verified.minutes(), [], attrgetter("notebook")
    for notebook, group in groupby(sorted(told, key=by_notebook), by_notebook):
        took = f"{60 * minutes[notebook]:.0f} s" if notebook in minutes else "not timed"
        name = notebook.translate(latex.LATEX_CELL)
        parts.append(f"\\paragraph{{{name}}}\\texttt{{make run/{name}}}, {took}.")
        parts.append("\\par\\nopagebreak\n")
        lines = [_line(row, entries[row.entry], results, clocks) for row in group]
        for first in range(0, len(lines), ROWS):
            page = lines[first : first + ROWS]
            table = {"columns": [[head] for head in HEADS], "rows": page, "align": "llll"}
            parts.append(f"\\noindent{{\\scriptsize {latex.latex_table(table)}}}\\par\n")
    return HEAD + "\n".join(parts)


HEAD = r"""Of the keys below \texttt{make why KEY=\ldots} prints the cell that computes them, its
parameters and the value; \texttt{make verify} executes everything again and compares each value
with its tolerance. Left out is what follows from other claims, or cannot hold. The verdict on each
claim is in the table of all claims.

"""


def _line(row: Row, entry: Entry, results: dict[str, dict], clocks: set[str]) -> list[str]:
    """A claim, its first key, and what it is expected to be; of a series the first value."""
    keys = _keys(entry)
    found = results[keys[0]]
    more = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
    allowed = CLOCK if keys[0] in clocks else _tolerance(found)
    return [row.id, keys[0] + more, text(found["value"], found["format"]), allowed]


def _keys(entry: Entry) -> list[str]:
    """The keys of our values that an entry judges, under our reading."""
    number = isinstance(entry, NumberEntry)
    names = entry.leaves().values() if number else ({"p": p} for p in entry.p)
    return [claims.key(entry.ours, claims.read().reading, each) for each in names]


def _tolerance(found: dict) -> str:
    """How far another run may deviate, in the unit of the value."""
    allowed = found.get("tolerance") or report.tolerance(found)
    if allowed["kind"] == "exact":
        return "exact"
    size = allowed["size"]
    if allowed["kind"] == "standard errors":
        size *= found["standard_error"]
    return f"± {size:.2g}" if found["value"] is not None else NONE
