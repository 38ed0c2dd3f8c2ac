"""Compare a re-run of everything with the committed reference, value by value.

``make verify`` runs all notebooks aside and calls ``compare``; ``make reference`` calls ``adopt``
after a deliberate change. Each value brings its own tolerance (see `report.Report.value`); of a
table's numbers the printed digits count.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from sngr_utils import paths
from sngr_utils.publish import cells, notebooks, report, results, verdict_tables
from sngr_utils.publish.files import entries, read_json, write_json


@dataclass(frozen=True)
class Comparison:
    """One value, now and in the reference; None where one of the two does not have it.

    `deviation` is in units of the tolerance's own kind: standard errors, or the value's unit.
    """

    key: str
    reference: float | None
    now: float | None
    kind: str
    allowed: float
    deviation: float

    @property
    def holds(self) -> bool:
        # a hair of slack, so that a difference equal to the tolerance is not lost to rounding
        return self.deviation <= self.allowed * (1 + 1e-9)


def compare_values(reference: dict[str, dict], now: dict[str, dict]) -> list[Comparison]:
    """Compare two mappings of key -> entry as `report.Report.value` and `sample` write them.

    A key that only one of them has is a breach, and so is a value that only one knows, or a
    sample of another size. The tolerance is the reference's; of a sample the mean is compared.
    """
    rows = []
    for key in sorted(reference.keys() | now.keys()):
        old, new = reference.get(key, {}), now.get(key, {})
        before, after = old.get("value"), new.get("value")
        both = key in reference and key in now and _size(old) == _size(new)
        tolerance = _tolerance(old)
        if both and before == after:
            deviation = 0.0
        elif not both or before is None or after is None:
            deviation = math.inf
        else:
            deviation = abs(after - before)
            if tolerance["kind"] == "standard errors":
                deviation /= old["standard_error"]
        rows.append(Comparison(key, before, after, tolerance["kind"], tolerance["size"], deviation))
    return rows


def _tolerance(entry: dict) -> dict:
    """The one it declares; the printed digits of a table's cell, and where there is no error."""
    if "format" not in entry:
        return {"kind": "exact", "size": 0}
    declared = entry.get("tolerance") or report.tolerance(entry)
    if declared["kind"] == "standard errors" and not (entry.get("standard_error") or 0) > 0:
        return report.tolerance({**entry, "standard_error": None})
    return declared


def _size(entry: dict) -> int | None:
    return len(entry["sample"]) if "sample" in entry else None


def table(rows: list[Comparison]) -> str:
    """What was compared, largest use of its tolerance first, as text."""

    def use(row):
        return row.deviation / row.allowed if row.allowed else math.inf * (row.deviation > 0 or -1)

    frame = pd.DataFrame([
        {
            "value": row.key,
            "reference": row.reference,
            "now": row.now,
            "deviation": f"{row.deviation:.3g}",
            "allowed": f"{row.allowed:.3g}",
            "kind": row.kind,
            "verdict": "ok" if row.holds else "BREACH",
        }
        for row in sorted(rows, key=use, reverse=True)
    ])
    return frame.to_string(index=False)


def handed_on(result: dict) -> dict[str, dict]:
    """All numbers in a notebook's JSON: those under a key of their own, and those of its tables."""
    return {**entries(result), **cells.entries(result["tables"])}


def compare_run(name: str, folder: Path) -> list[Comparison]:
    """All numbers of a run of a notebook in `folder` with the reference."""
    path = paths.REFERENCE / f"{name}.json"
    now = handed_on(read_json(folder / f"{name}.json"))
    return compare_values(read_json(path) if path.exists() else {}, now)


def compare(folder: Path) -> int:
    """Compare the results below `folder` with the reference, print the table, return breaches."""
    rows = [row for name in notebooks.names() for row in compare_run(name, folder / name)]
    breaches = sum(not row.holds for row in rows)
    print(table(rows))
    print(f"{len(rows)} values compared, {breaches} outside their tolerance")
    return breaches


def adopt() -> None:
    """Make the published results the reference, with their verdicts, which the README counts.

    Wall clocks are not compared, but a few verdicts rest on a ratio of them: they come along.
    """
    found = results.results_in(paths.RESULTS)
    verdicts = verdict_tables.judged(found)
    verdict_tables.update_readme(verdicts)
    verdict_tables.write_record(verdicts)
    paths.REFERENCE.mkdir(exist_ok=True)
    for name in notebooks.names():
        for kind, gather in (("", handed_on), (".timings", entries)):
            source = paths.RESULTS / f"{name}{kind}.json"
            if source.exists() or not kind:
                write_json(paths.REFERENCE / source.name, gather(read_json(source)))
