"""What one entry of ``claims.yaml`` makes of its printed numbers: tests, each counted once.

A test is a number, or a series of them, held against our worlds. It can also be asked what it
would have said of other numbers: drawn at random, shuffled, of a fresh world (see `controls`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from sngr_utils.publish import claims, printed
from sngr_utils.publish.claims import NumberEntry
from sngr_utils.publish.prediction import FIVE, MIN_WORLDS, Cloud, Natural
from sngr_utils.publish.printed import Path, Printed

DRAWS = 500  # random numbers behind the share that a series' test accepts: within 0.03 (95 %)
DRAWS_SEED, SPLITS_SEED = 1, 0  # the same for every claim
FRESH_FIVES = 20  # choices of five of our worlds that take the place of the paper's five
KINDS = {"one_world": "one", "mean_of_five": "mean", "std_of_five": "std", "five_worlds": "values"}


@dataclass(frozen=True)
class NumberTest:
    """Printed numbers that one test judges, and our worlds.

    Attributes
    ----------
    leaves : path -> what the placeholders stand for, of the numbers that are judged together
    was : the same as compared: printed, magnitude or ratio
    cloud : our worlds at the same levels
    """

    entry: NumberEntry
    leaves: dict[Path, dict[str, str]]
    was: tuple[Printed, ...]
    cloud: Cloud

    @property
    def values(self) -> np.ndarray:
        """(m,) as compared, NaN for a dash."""
        return np.array([math.nan if one.value is None else one.value for one in self.was])

    @property
    def powerless(self) -> bool:
        """Whether too few of our worlds define a single number for any verdict."""
        defined = np.isfinite(self.cloud.worlds).sum(axis=0)
        return len(self.was) == 1 and defined[0] < MIN_WORLDS

    def intervals(self) -> list[tuple[float, float]]:
        """For each level by itself, what would have been accepted; one for all of five worlds."""
        return self.cloud.intervals(rng=_splits())

    def accepts(self, candidates: np.ndarray) -> np.ndarray:
        """(c,) whether the test would have accepted (c, m) other numbers."""
        return self.cloud.accepts(candidates, rng=_splits())

    @cached_property
    def share(self) -> float:
        """Share of the natural range that is accepted: how often numbers drawn from it pass."""
        if len(self.was) == 1:
            ((low, high),) = self.intervals()
            return self.cloud.natural.covered(low, high, self.was[0].decimals)
        rng = np.random.default_rng(DRAWS_SEED)
        drawn = self.rounded(self.cloud.natural.draw((DRAWS, len(self.was)), rng=rng))
        return float(self.accepts(np.where(np.isnan(self.values), math.nan, drawn)).mean())

    def rounded(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers (..., m) as the paper would print them."""
        columns = [np.round(numbers[..., i], one.decimals) for i, one in enumerate(self.was)]
        return np.stack(columns, axis=-1)

    def shuffled(self) -> float:
        """Share of all orders of its numbers that pass; NaN where the order says nothing."""
        if len(self.was) == 1 or self.cloud.of == "values":
            return math.nan
        return float(self.accepts(np.array(list(permutations(self.values)))).mean())

    def fresh(self) -> float:
        """How often our own worlds are accepted: one (or five) taken out, judged by the others."""
        worlds, of, rng = self.cloud.worlds, self.cloud.of, np.random.default_rng(DRAWS_SEED)
        n = len(worlds)
        if of == "one":
            left_out = [[i] for i in range(n) if np.isfinite(worlds[i]).any()]
        else:
            left_out = [rng.permutation(n)[:FIVE] for _ in range(FRESH_FIVES)]
        passed = []
        for out in left_out:
            given = worlds[out]
            if of in ("mean", "std"):
                given = given.mean(axis=0) if of == "mean" else given.std(axis=0, ddof=1)
            elif of == "values":
                given = given[: len(self.was), 0]
            rest = Cloud(np.delete(worlds, out, axis=0), self.cloud.natural, of)
            passed.append(rest.accepts(self.rounded(given.reshape(1, -1)), rng=_splits())[0])
        return float(np.mean(passed))


def _splits() -> np.random.Generator:
    return np.random.default_rng(SPLITS_SEED)


def tests(
    entry: NumberEntry, results: dict[str, dict], preset: str, leaves: list[Path]
) -> Iterator:
    """The tests of an entry with one of the rules of `KINDS`, over the `leaves` that count."""
    names = {path: entry.leaves()[path] for path in leaves}
    natural, of = entry.natural(), KINDS[entry.rule]
    if not leaves:
        return
    was = tuple(entry.compared(path, names[path]) for path in leaves)
    keys = [claims.key(entry.ours, preset, part) for part in names.values()]
    if of == "values":
        keys = keys[:1]
    yield NumberTest(entry, names, was, _cloud(results, keys, was, natural, of))


def _cloud(
    results: dict[str, dict], keys: list[str], was: tuple[Printed, ...], natural: Natural, of: str
) -> Cloud:
    columns = [sample(results, key) for key in keys]
    sizes = {len(column) for column in columns}
    if min(sizes) < MIN_WORLDS:
        raise ValueError(f"{min(sizes)} worlds: a verdict needs at least {MIN_WORLDS}")
    if len(sizes) > 1:
        raise ValueError(f"{sorted(sizes)} worlds: a series needs the same ones at each level")
    if of in ("one", "values"):
        columns = [np.round(x, one.decimals) for x, one in zip(columns, was, strict=False)]
    worlds = np.stack(columns, axis=1)
    if of in ("mean", "std") and np.isnan(worlds).any():
        raise ValueError(f"a {of} of five worlds needs a defined value in every world")
    return Cloud(worlds, natural, of)


def sample(results: dict[str, dict], key: str) -> np.ndarray:
    """(n,) of a sample, NaN where undefined.

    Raises
    ------
    ValueError : not a sample
    """
    if "sample" not in results[key]:
        raise ValueError(f"{key!r} must be a sample, one number per world")
    return np.array(results[key]["sample"], dtype=float)


def counted(entry: NumberEntry, refuted: dict[Path, str]) -> tuple[list[Path], dict[Path, str]]:
    """Leaves that are tested; and those that follow from others -> from which."""
    follows = {
        path: rule.follows
        for rule in claims.read().counted_once
        for path in printed.matching(rule.printed).keys() & entry.leaves().keys()
    }
    rest = [path for path in entry.leaves() if path not in refuted and path not in follows]
    return rest, {path: why for path, why in follows.items() if path not in refuted}
