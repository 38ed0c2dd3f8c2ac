"""A verdict on every claim of the paper, by rule, from what the notebooks hand on.

`results` is what all notebooks hand on: key -> entry as `report.Report.value` and `sample` write
them. A claim whose key is missing there is an error, never left out.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils.publish import claims, printed, rules
from sngr_utils.publish.cells import NONE, text
from sngr_utils.publish.claims import NumberEntry, ProseEntry
from sngr_utils.publish.contradictions import Contradiction, contradictions
from sngr_utils.publish.notebooks import ProjectError

RESAMPLING_SEED = 0  # of the splits behind a mean of five worlds; the same for every claim


@dataclass(frozen=True)
class Row:
    """One claim with its verdict.

    Attributes
    ----------
    id, entry : of this number, and of the entry of ``claims.yaml`` it belongs to
    kind : "number" or "prose"
    printed, ours : as shown; `ours` with the standard error, or the share and its interval
    values : printed value and our mean, for ranges; None where there is none
    n : worlds behind ours, of which some may be undefined
    why : what refutes it, or the interval that decides
    """

    id: str
    entry: str
    kind: str
    where: str
    what: str
    printed: str
    ours: str
    values: tuple[float | None, float | None]
    n: str
    rule: str
    verdict: str
    why: str
    notebook: str
    cell: str


def evaluate(results: dict[str, dict], preset: str | None = None) -> list[Row]:
    """A verdict on every claim under one preset, the reading of ``claims.yaml`` if not given.

    Raises
    ------
    ProjectError : results lack a key that a claim needs, or hold too few worlds
    """
    preset = preset or claims.read().reading
    missing = [key for key in claims.needed(preset) if key not in results]
    if missing:
        raise ProjectError(
            f"paper/claims.yaml needs {missing[0]!r}, which no notebook hands on"
            + (f"; nor are {len(missing) - 1} more: {', '.join(missing[1:8])} ..."
               if len(missing) > 1 else "")
        )  # fmt: skip
    clashes = contradictions(printed.leaves())
    rows = []
    for entry in [*claims.read().numbers, *claims.read().prose]:
        judge = _numbers if isinstance(entry, NumberEntry) else _prose
        try:
            rows += judge(entry, results, preset, clashes)
        except ValueError as error:
            raise ProjectError(f"paper/claims.yaml, claim {entry.id!r}: {error}") from error
    return rows


def _sample(results: dict[str, dict], key: str) -> np.ndarray:
    """(n,) of a sample, NaN where undefined."""
    if "sample" not in results[key]:
        raise ValueError(f"{key!r} must be a sample, one number per world")
    return np.array(results[key]["sample"], dtype=float)


def _value(results: dict[str, dict], key: str) -> float:
    value = results[key]["value"]
    return math.nan if value is None else float(value)


def _numbers(
    entry: NumberEntry, results: dict[str, dict], preset: str, clashes: list[Contradiction]
) -> Iterator[Row]:
    refuted = {path: clash.why for clash in clashes for path in clash.paths}
    has_trend = bool(entry.trend) and _has_trend(entry, results, preset)
    for path, names in entry.leaves().items():
        key, was = claims.key(entry.ours, preset, names), entry.compared(path, names)
        verdict, why = _number_verdict(entry.rule, results, key, was)
        if verdict == rules.NOT and has_trend:
            verdict = rules.TREND
        if path in refuted:
            verdict, why = rules.CANNOT, refuted[path]
        original = printed.leaves()[path]
        shown = text(original.value, f".{original.decimals}f")
        if entry.ratio and was.value is not None:
            shown += f" ({text(was.value, '.3g')})"
        found = _spread(results[key]) if entry.rule == "std_of_five" else results[key]
        ours, n, mean = _ours(found, was.decimals)
        label = "".join(f".{name}{part}" for name, part in names.items())
        yield Row(
            entry.id + label, entry.id, "number", entry.where, entry.what, shown, ours,
            (was.value, mean), n, entry.rule, verdict, why, entry.notebook, entry.cell,
        )  # fmt: skip


def _number_verdict(
    rule: str, results: dict[str, dict], key: str, was: printed.Printed
) -> tuple[str, str]:
    """Verdict of the rule alone, and what decides."""
    if rule == "clock":
        return rules.NO_RATIO, "the clock that other seconds are measured with"
    if rule == "hardware":
        return rules.hardware(_value(results, key), was), "a ratio of wall clocks"
    if rule == "deterministic":
        good, why = rules.deterministic(_value(results, key), was), "rounding"
    elif rule == "one_world":
        sample = _sample(results, key)
        low, high = rules.world_interval(sample)
        ends = ["undefined" if end == -math.inf else text(end, ".3g") for end in (low, high)]
        good, why = rules.one_world(sample, was), f"a further world: {ends[0]} to {ends[1]}"
    else:
        statistic = rule.removesuffix("_of_five")
        rng = np.random.default_rng(RESAMPLING_SEED)
        good = rules.five_worlds(_sample(results, key), was, statistic, rng=rng)
        why = f"{statistic} of five further worlds"
    return (rules.REPRODUCED if good else rules.NOT), why


def _has_trend(entry: NumberEntry, results: dict[str, dict], preset: str) -> bool:
    """The trend between the first and the last level at which the paper prints a number."""
    levels = [
        names for path, names in entry.leaves().items()
        if entry.compared(path, names).value is not None
    ]  # fmt: skip
    ends = (_sample(results, claims.key(entry.ours, preset, levels[i])) for i in (0, -1))
    return rules.trend(*ends, entry.trend)


def _spread(entry: dict) -> dict:
    """A sample's standard deviation in the place of its mean, with the error a Gaussian's has."""
    values = [value for value in entry["sample"] if value is not None]
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else None
    error = spread / math.sqrt(2 * len(values) - 2) if spread is not None else None
    return {**entry, "value": spread, "standard_error": error}


def _ours(entry: dict, decimals: int) -> tuple[str, str, float | None]:
    """What is shown of ours: mean and standard error, number of worlds; and the mean."""
    fmt = f".{decimals}f" if "sample" not in entry or decimals else ".1f"
    shown, error, values = (
        text(entry["value"], fmt),
        entry.get("standard_error"),
        entry.get("sample"),
    )
    if error is not None:
        shown += f" ± {text(error, fmt)}"
    if values is None:
        return shown, str(entry["n"]), entry["value"]
    defined = sum(value is not None for value in values)
    n = str(len(values)) if defined == len(values) else f"{defined} of {len(values)}"
    return shown, n, entry["value"]


def _prose(
    entry: ProseEntry, results: dict[str, dict], preset: str, clashes: list[Contradiction]
) -> Iterator[Row]:
    if entry.rule == "value":
        x, n = _value(results, claims.key(entry.ours, preset, {})), "1"
        verdict = rules.REPRODUCED if _within(entry, np.array(x)) else rules.NOT
        ours = text(x, ".3g")
    elif entry.rule == "rises":
        first, last = (
            _sample(results, claims.key(key, preset, {})) for key in (entry.minus, entry.ours)
        )
        change = (last - first)[np.isfinite(last - first)]
        verdict = rules.REPRODUCED if rules.trend(first, last, "rises") else rules.NOT
        ours, n, _ = _ours(_summary(change), 2)
    else:
        holds = claim_holds(entry, results, preset)
        verdict, n = rules.share(holds, entry.share), str(len(holds))
        ours = f"{int(holds.sum())} of {n}"
        if len(holds):
            ours += " [{:.2f}, {:.2f}]".format(*rules.share_interval(holds))
    why = {clash.relation: clash.why for clash in clashes}.get(entry.contradicted_by, "")
    yield Row(
        entry.id, entry.id, "prose", entry.where, entry.says, NONE, ours, (None, None), n,
        entry.rule, rules.CANNOT if why else verdict, why, entry.notebook, entry.cell,
    )  # fmt: skip


def _summary(change: np.ndarray) -> dict:
    error = float(np.std(change, ddof=1) / math.sqrt(len(change))) if len(change) > 1 else None
    mean = float(change.mean()) if len(change) else None
    return {"value": mean, "standard_error": error, "sample": list(change)}


def claim_holds(entry: ProseEntry, results: dict[str, dict], preset: str) -> np.ndarray:
    """(n,) bool: the worlds where the quantity is defined, and whether the claim holds there.

    With several p it must hold at each at which it is defined.
    """
    levels = []
    for p in entry.p:
        x = _sample(results, claims.key(entry.ours, preset, {"p": p}))
        if entry.minus:
            reference = _sample(results, claims.key(entry.minus, preset, {"p": p}))
            x = (x - reference) / (reference if entry.relative else 1.0)
        levels.append(x)
    x = np.array(levels)
    defined = np.isfinite(x)
    return (_within(entry, x) | ~defined).all(axis=0)[defined.any(axis=0)]


def _within(entry: ProseEntry, x: np.ndarray) -> np.ndarray:
    x = np.abs(x) if entry.magnitude else x
    return (x > entry.above) & (x >= entry.at_least) & (x <= entry.at_most)


def frame(rows: list[Row]) -> pd.DataFrame:
    """One row per claim, as shown in the paper and in the notebook of the audit."""
    columns = ["id", "where", "what", "printed", "ours", "n", "rule", "verdict", "why",
               "notebook", "cell"]  # fmt: skip
    return pd.DataFrame([[getattr(row, name) for name in columns] for row in rows], columns=columns)


def counts(rows: list[Row], kind: str) -> dict[str, int]:
    """Verdict -> number of claims of a kind ("number" or "prose"), all five verdicts."""
    found = Counter(row.verdict for row in rows if row.kind == kind)
    return {verdict: found[verdict] for verdict in rules.VERDICTS}
