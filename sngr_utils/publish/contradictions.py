"""Where the numbers of the paper contradict each other.

Computed from the printed values alone, each of which may be anything that rounds to it: what can
be explained by rounding is not a contradiction.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from sngr_utils.publish.printed import SLACK, Path, Printed, ratio

N_WINDOWS = 28
MAX_TRIGGERS = 26  # the first two windows may not fire
MODE = (2.0, math.sqrt(5.0))  # m: anchors at (0, 0) and (4, 0), range 3 (section "Bimodal")


@dataclass(frozen=True)
class Contradiction:
    """Printed numbers that cannot all hold.

    Attributes
    ----------
    paths : the leaves concerned: the result where one number follows from others, all where
        none does
    relation : name of what is violated; a claim in prose may rest on it
    why : in words
    """

    paths: tuple[Path, ...]
    relation: str
    why: str


def contradictions(numbers: dict[Path, Printed]) -> list[Contradiction]:
    """Every relation between printed numbers that no values before rounding can satisfy."""
    checks = (_bimodal, _per_seed, _baseline, _sngr, _repeated, _thresholds, _cost, _gains)
    return [clash for check in checks for clash in check(numbers)]


def _rows(numbers: dict[Path, Printed], table: str) -> Iterator[tuple[str, dict[str, Printed]]]:
    """The rows of a table: label, and column -> number."""
    rows: dict[str, dict[str, Printed]] = {}
    for path, printed in numbers.items():
        if path[0] == table and path[1][0].isdigit():
            rows.setdefault(path[1], {})[path[2]] = printed
    yield from rows.items()


def _bimodal(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    b = {path[1:]: printed for path, printed in numbers.items() if path[0] == "bimodal"}
    low = b["loglik_ns",].low - b["loglik_map",].high
    high = b["loglik_ns",].high - b["loglik_map",].low
    if not b["delta_logp",].allows(low, high):
        yield Contradiction((("bimodal", "delta_logp"),), "gain", "not the difference printed")
    for point, error in (("map", "error_from_mode_map"), ("ns_best", "error_from_mode_ns")):
        x, y = b[point, "0"], b[point, "1"]
        sides = [_distances(x, MODE[0]), _distances(y, math.copysign(MODE[1], y.value))]
        low, high = (math.hypot(*(side[i] for side in sides)) for i in (0, 1))
        if not b[error,].allows(low, high):
            why = f"the printed point lies {low:.4f} m or more from the mode"
            yield Contradiction((("bimodal", error),), "distance", why)


def _distances(printed: Printed, to: float) -> tuple[float, float]:
    """Least and largest distance of a printed coordinate from a number."""
    ends = abs(printed.low - to), abs(printed.high - to)
    return (0.0 if printed.low <= to <= printed.high else min(ends)), max(ends)


def _share(printed: Printed, part: float, whole: float) -> bool:
    """Whether a share is part / whole, and a dash where there is no whole."""
    return printed.allows(part / whole) if whole else printed.value is None


def _per_seed(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    table = "per_seed_p0.3"
    for seed, row in _rows(numbers, table):
        tp, fp, fn = (row[name].value for name in ("tp", "fp", "fn"))
        if row["triggered"].value != tp + fp:
            paths_ = tuple((table, seed, name) for name in ("triggered", "tp", "fp"))
            why = f"{row['triggered'].value:g} triggers, but TP + FP = {tp + fp:g}"
            yield Contradiction(paths_, "counts", why)
        for name, whole in (("precision", tp + fp), ("recall", tp + fn)):
            if not _share(row[name], tp, whole):
                why = f"the counts give {tp:g}/{whole:g}"
                yield Contradiction(((table, seed, name),), name, why)


def _baseline(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    for p, row in _rows(numbers, "baseline"):
        yield from _detection("baseline", p, row, row["failed"].value)
    precise = {p: row["precision"] for p, row in _rows(numbers, "baseline") if float(p) >= 0.2}
    below = [p for p, printed in precise.items() if not printed.allows(1.0)]
    if below:
        yield Contradiction((), "precision one", f"the table has less than 1 at p = {below[0]}")


def _sngr(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    # the same worlds and the same iSAM2 as in the baseline, so the same windows have failed
    for p, row in _rows(numbers, "sngr"):
        yield from _detection("sngr", p, row, numbers["baseline", p, "failed"].value)


def _detection(table: str, p: str, row: dict, failed: float) -> Iterator[Contradiction]:
    """Precision and recall must be shares of whole windows, with the same true positives."""
    fired, precision, recall = row["triggered"].value, row["precision"], row["recall"]
    if fired > MAX_TRIGGERS:
        yield Contradiction(((table, p, "triggered"),), "eligible", "more than may fire")
    tp = round(fired * precision.value) if fired and precision.value is not None else 0
    for name, printed, whole in (("precision", precision, fired), ("recall", recall, failed)):
        if not _share(printed, tp, whole):
            yield Contradiction(((table, p, name),), name, f"the row gives {tp}/{whole:g}")


def _repeated(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    """Numbers that stand in two tables."""
    pairs = [(("tau_sensitivity", "3.96", "noisy_p0.3"), ("baseline", "0.3", "triggered"))]
    for name in ("triggered", "precision", "recall"):
        pairs.append((("per_seed_p0.3", "0", name), ("baseline", "0.3", name)))
    for p, _ in _rows(numbers, "cost"):
        pairs.append((("cost", p, "triggered"), ("sngr", p, "triggered")))
    for pair in pairs:
        if numbers[pair[0]].value != numbers[pair[1]].value:
            yield Contradiction(pair, "repeated", "two tables disagree")


def _thresholds(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    """A higher threshold cannot fire more often; tau is the silent one with the most recall."""
    clean, noisy = {3.9: ("sngr", "0.0", "triggered")}, {3.9: ("sngr", "0.3", "triggered")}
    for tau, _ in _rows(numbers, "tau_sensitivity"):
        clean[float(tau)] = ("tau_sensitivity", tau, "clean")
        noisy[float(tau)] = ("tau_sensitivity", tau, "noisy_p0.3")
    for series in (clean, noisy):
        taus = sorted(series)
        for lower, higher in pairwise(taus):
            pair = series[lower], series[higher]
            if numbers[pair[0]].value < numbers[pair[1]].value:
                yield Contradiction(pair, "monotone", "more triggers above a higher threshold")
    silent = [tau for tau in clean if numbers[clean[tau]].value == 0]
    # of two sets of alarms, one within the other, at most this many of the larger are false
    false = N_WINDOWS - numbers["baseline", "0.3", "failed"].value
    hits = {tau: numbers[noisy[tau]].value for tau in silent}
    better = [tau for tau in silent if hits[tau] - false > hits.get(3.96, math.inf)]
    if better and max(silent) > 3.96:
        why = (
            f"{better[0]:g} is as silent and recalls more, {max(silent):g} is as silent and larger"
        )
        yield Contradiction((), "choice of tau", why)


def _cost(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    ends = [numbers["cost", "seconds_per_window", end] for end in ("0", "1")]
    savings = {p: row["saving"].value or 0.0 for p, row in _rows(numbers, "cost")}
    if max(savings, key=savings.get) == "0.0":
        why = f"the table has {max(savings.values()):g} at p = 0, without noise in the labels"
        yield Contradiction((), "moderate noise", why)
    for p, row in _rows(numbers, "cost"):
        saving = ratio(row["exhaustive"], row["refine"])
        if (saving.value is None) != (row["saving"].value is None) or (
            saving.value is not None and not row["saving"].allows(saving.low, saving.high)
        ):
            why = f"{row['exhaustive'].value:g} / {row['refine'].value:g} seconds"
            yield Contradiction((("cost", p, "saving"),), "saving", why)
        for name, windows in (("refine", row["triggered"].value), ("exhaustive", N_WINDOWS)):
            low, high = row[name].low, row[name].high
            if high < ends[0].low * windows - SLACK or low > ends[1].high * windows + SLACK:
                why = f"{row[name].value:g} s for {windows:g} windows"
                yield Contradiction((("cost", p, name),), "seconds per window", why)


def _gains(numbers: dict[Path, Printed]) -> Iterator[Contradiction]:
    ends = (
        ("diagnostics_p0.2", "delta_logp_range", "1"),
        ("diagnostics_p0.2", "delta_logp_max_in_conclusion"),
    )
    first, second = (numbers[path] for path in ends)
    if not first.allows(second.low, second.high):
        yield Contradiction(ends, "largest gain", "two values of the same maximum")
