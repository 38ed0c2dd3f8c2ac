"""A verdict on every claim of the paper, by rule, from what the notebooks hand on.

`results` is what all notebooks hand on: key -> entry as `report.Report.value` and `sample` write
them. A claim whose key is missing there is an error, never left out.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sngr_utils.publish import claims, number_tests, prediction, printed, rules
from sngr_utils.publish.cells import NONE, text
from sngr_utils.publish.claims import NumberEntry, ProseEntry
from sngr_utils.publish.contradictions import Contradiction, contradictions
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.publish.number_tests import NumberTest, sample
from sngr_utils.publish.printed import Path


@dataclass(frozen=True)
class Number:
    """One printed number beside ours.

    Attributes
    ----------
    ours : median of our worlds (mean or standard deviation where the paper prints one)
    accepted : where a further world, or a statistic of five, may lie; taken by itself
    covered : share of its natural range that this interval is; None where there is none
    rank : of the printed value among our worlds and itself, from below; "" where it has none
    """

    id: str
    printed: str
    ours: str
    n: str
    accepted: str = NONE
    covered: float | None = None
    rank: str = ""


@dataclass(frozen=True)
class Row:
    """One test, of a number, a series of numbers or a claim in words, with its verdict.

    Attributes
    ----------
    id, entry : of this row, and of the entry of ``claims.yaml`` it belongs to
    kind : "number" or "prose"
    printed, ours : as shown; of a series all values
    share : share of the natural range that the test accepts, None where nothing is tested
    why : what refutes it, or what decides
    numbers : the printed numbers that it judges
    """

    id: str
    entry: str
    kind: str
    where: str
    what: str
    printed: str
    ours: str
    n: str
    rule: str
    verdict: str
    why: str
    notebook: str
    cell: str
    share: float | None = None
    numbers: tuple[Number, ...] = ()


def evaluate(results: dict[str, dict], preset: str | None = None) -> list[Row]:
    """A verdict on every claim under one preset, the reading of ``claims.yaml`` if not given.

    Raises
    ------
    ProjectError : results lack a key that a claim needs, or hold too few worlds
    """
    preset = preset or claims.read().reading
    check(results, preset)
    clashes = contradictions(printed.leaves())
    rows = []
    for entry in [*claims.read().numbers, *claims.read().prose]:
        judge = _numbers if isinstance(entry, NumberEntry) else _prose
        try:
            rows += judge(entry, results, preset, clashes)
        except ValueError as error:
            raise ProjectError(f"paper/claims.yaml, claim {entry.id!r}: {error}") from error
    return rows


def check(results: dict[str, dict], preset: str) -> None:
    """Find the first keys that the claims need and nothing hands on; raises ProjectError."""
    missing = [key for key in claims.needed(preset) if key not in results]
    if missing:
        raise ProjectError(
            f"paper/claims.yaml needs {missing[0]!r}, which no notebook hands on"
            + (f"; nor are {len(missing) - 1} more: {', '.join(missing[1:8])} ..."
               if len(missing) > 1 else "")
        )  # fmt: skip


def _value(results: dict[str, dict], key: str) -> float:
    value = results[key]["value"]
    return math.nan if value is None else float(value)


def _numbers(
    entry: NumberEntry, results: dict[str, dict], preset: str, clashes: list[Contradiction]
) -> Iterator[Row]:
    refuted = {path: clash.why for clash in clashes for path in clash.paths}
    tested, follows = number_tests.counted(entry, refuted)
    for path in entry.leaves():
        aside = (
            (rules.CANNOT, refuted[path]) if path in refuted
            else (rules.FOLLOWS, follows[path]) if path in follows
            else None
        )  # fmt: skip
        if aside:
            yield _row(entry, [_alone(entry, path, results, preset)], *aside)
    if entry.rule in number_tests.KINDS:
        for test in number_tests.tests(entry, results, preset, tested):
            verdict, why, share = _tested(test, results, preset)
            yield _row(entry, _described(test), verdict, why, share)
        return
    for path in tested:
        verdict, why, share = _without_worlds(entry, path, results, preset)
        yield _row(entry, [_alone(entry, path, results, preset)], verdict, why, share)


def _row(
    entry: NumberEntry, numbers: list[Number], verdict: str, why: str, share: float | None = None
) -> Row:
    whole = len(numbers) > 1 or len(entry.leaves()) == 1
    return Row(
        entry.id if whole else numbers[0].id, entry.id, "number", entry.where, entry.what,
        ", ".join(one.printed for one in numbers), ", ".join(one.ours for one in numbers),
        numbers[0].n, entry.rule, verdict, why, entry.notebook, entry.cell, share, tuple(numbers),
    )  # fmt: skip


def _tested(
    test: NumberTest, results: dict[str, dict], preset: str
) -> tuple[str, str, float | None]:
    """Verdict, what decides, and the share of the natural range that is accepted."""
    if test.powerless:
        return rules.UNTESTABLE, "too few worlds define it", None
    share = test.share
    if share > rules.MAX_SHARE:
        return rules.UNTESTABLE, f"{share:.0%} of what could be would be accepted", share
    why = {"one": "a further world", "values": "further worlds"}.get(
        test.cloud.of, f"{test.cloud.of} of five further worlds"
    )
    if test.accepts(test.values[None])[0]:
        return rules.REPRODUCED, why, share
    return (rules.TREND if _has_trend(test, results, preset) else rules.NOT), why, share


def _without_worlds(
    entry: NumberEntry, path: Path, results: dict[str, dict], preset: str
) -> tuple[str, str, float | None]:
    """The same for a number that no sample of worlds stands against."""
    if entry.rule == "clock":
        return rules.NO_RATIO, "the clock that other seconds are measured with", None
    names = entry.leaves()[path]
    was = entry.compared(path, names)
    ours, natural = _value(results, claims.key(entry.ours, preset, names)), entry.natural()
    if entry.rule == "deterministic":
        verdict = rules.REPRODUCED if rules.deterministic(ours, was) else rules.NOT
        return verdict, "rounding", natural.covered(ours, ours, was.decimals)
    low, high = (ours / rules.SAME_RATIO, ours * rules.SAME_RATIO)
    share = natural.covered(low * was.value / was.high, high * was.value / was.low, None)
    return rules.hardware(ours, was), "a ratio of wall clocks", share


def _has_trend(test: NumberTest, results: dict[str, dict], preset: str) -> bool:
    """The trend between the first and the last level at which the paper prints a number."""
    levels = [names for names, was in zip(test.leaves.values(), test.was, strict=True)
              if was.value is not None]  # fmt: skip
    if not test.entry.trend or len(levels) < 2:
        return False
    ends = (sample(results, claims.key(test.entry.ours, preset, levels[i])) for i in (0, -1))
    return rules.trend(*ends, test.entry.trend)


def _described(test: NumberTest) -> list[Number]:
    """The numbers of a test, each with its own interval and rank."""
    found = []
    intervals = test.intervals()
    for i, (names, was) in enumerate(zip(test.leaves.values(), test.was, strict=True)):
        worlds, (low, high) = (
            test.cloud.worlds[:, min(i, len(intervals) - 1)],
            intervals[min(i, len(intervals) - 1)],
        )
        known = worlds[np.isfinite(worlds)]
        statistic = {"mean": np.mean, "std": prediction.spread}.get(test.cloud.of, np.median)
        fmt, undefined = f".{max(was.decimals, 2)}f" if was.decimals else ".3g", math.isnan(low)
        one = Number(
            test.entry.id + _label(names), text(was.value, f".{was.decimals}f"),
            text(float(statistic(known)), fmt) if len(known) else NONE, _n(worlds),
            NONE if undefined else f"{text(low, fmt)} to {text(high, fmt)}",
            None if undefined else test.cloud.natural.covered(low, high, was.decimals),
        )  # fmt: skip
        if test.cloud.of in ("one", "values") and was.value is not None:
            one = replace(one, rank=_rank(was.value, known))
        found.append(one)
    return found


def _rank(value: float, worlds: np.ndarray) -> str:
    """Rank of a value among n worlds and itself, from below: all it may be where some are equal."""
    first = int(np.sum(worlds < value)) + 1
    last = first + int(np.sum(worlds == value))
    shown = str(first) if first == last else f"{first}-{last}"
    return f"{shown} of {len(worlds) + 1}"


def _alone(entry: NumberEntry, path: Path, results: dict[str, dict], preset: str) -> Number:
    """A number that no interval stands beside."""
    names = entry.leaves()[path]
    original, was = printed.leaves()[path], entry.compared(path, names)
    shown = text(original.value, f".{original.decimals}f")
    if entry.ratio and was.value is not None:
        shown += f" ({text(was.value, '.3g')})"
    found, fmt = results[claims.key(entry.ours, preset, names)], f".{was.decimals}f"
    if "sample" not in found:
        return Number(entry.id + _label(names), shown, text(found["value"], fmt), str(found["n"]))
    worlds = np.array(found["sample"], dtype=float)
    known = worlds[np.isfinite(worlds)]
    middle = text(float(np.median(known)), fmt if was.decimals else ".3g") if len(known) else NONE
    return Number(entry.id + _label(names), shown, middle, _n(worlds))


def _label(names: dict[str, str]) -> str:
    return "".join(f".{name}{part}" for name, part in names.items())


def _n(worlds: np.ndarray) -> str:
    defined = int(np.isfinite(worlds).sum())
    return str(len(worlds)) if defined == len(worlds) else f"{defined} of {len(worlds)}"


def _prose(
    entry: ProseEntry, results: dict[str, dict], preset: str, clashes: list[Contradiction]
) -> Iterator[Row]:
    if entry.rule == "value":
        x, n = _value(results, claims.key(entry.ours, preset, {})), "1"
        verdict = rules.REPRODUCED if _within(entry, np.array(x)) else rules.NOT
        ours = text(x, ".3g")
    elif entry.rule == "rises":
        first, last = (
            sample(results, claims.key(key, preset, {})) for key in (entry.minus, entry.ours)
        )
        verdict = rules.REPRODUCED if rules.trend(first, last, "rises") else rules.NOT
        change = (last - first)[np.isfinite(last - first)]
        ours, n = f"up in {np.sum(change > 0)}, down in {np.sum(change < 0)}", str(len(change))
    else:
        holds = claim_holds(entry, results, preset)
        verdict, n = rules.share(holds, entry.share), str(len(holds))
        ours = f"{int(holds.sum())} of {n}"
        if len(holds):
            ours += " [{:.2f}, {:.2f}]".format(*rules.share_interval(holds))
    why = {clash.relation: clash.why for clash in clashes}.get(entry.contradicted_by, "")
    yield Row(
        entry.id, entry.id, "prose", entry.where, entry.says, NONE, ours, n, entry.rule,
        rules.CANNOT if why else verdict, why, entry.notebook, entry.cell,
    )  # fmt: skip


def claim_holds(entry: ProseEntry, results: dict[str, dict], preset: str) -> np.ndarray:
    """(n,) bool: the worlds where the quantity is defined, and whether the claim holds there.

    With several p it must hold at each at which it is defined.
    """
    levels = []
    for p in entry.p:
        x = sample(results, claims.key(entry.ours, preset, {"p": p}))
        if entry.minus:
            reference = sample(results, claims.key(entry.minus, preset, {"p": p}))
            x = (x - reference) / (reference if entry.relative else 1.0)
        levels.append(x)
    x = np.array(levels)
    defined = np.isfinite(x)
    return (_within(entry, x) | ~defined).all(axis=0)[defined.any(axis=0)]


def _within(entry: ProseEntry, x: np.ndarray) -> np.ndarray:
    x = np.abs(x) if entry.magnitude else x
    return (x > entry.above) & (x >= entry.at_least) & (x <= entry.at_most)


def counts(rows: list[Row], kind: str) -> dict[str, int]:
    """Verdict -> number of rows of a kind ("number" or "prose"), all verdicts."""
    found = Counter(row.verdict for row in rows if row.kind == kind)
    return {verdict: found[verdict] for verdict in rules.VERDICTS}
