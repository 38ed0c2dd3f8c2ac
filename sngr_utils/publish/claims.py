"""What the paper claims: every number and every statement, as ``paper/claims.yaml`` lists them.

An entry names the printed numbers (or says the claim), the key of our results, the rule that
judges, and the notebook cell that shows what decides. It holds no verdict.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from sngr_utils import paths
from sngr_utils.publish import printed
from sngr_utils.publish.contradictions import contradictions
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.publish.parameters import read_yaml
from sngr_utils.publish.prediction import Natural
from sngr_utils.settings import PRESET_NAMES


class Entry(BaseModel):
    """What both kinds of entries of ``claims.yaml`` have; see the comments there."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    id: str
    where: str
    ours: str
    magnitude: bool = False
    notebook: str
    cell: str


class NumberEntry(Entry):
    """Leaves of ``printed_values.yaml`` that one rule judges: a column or a series."""

    printed: str
    what: str
    rule: Literal[
        "deterministic",
        "one_world",
        "mean_of_five",
        "std_of_five",
        "five_worlds",
        "hardware",
        "clock",
    ]
    range: str | None = None
    silent: float | None = None
    trend: Literal["rises", "falls"] | None = None
    ratio: tuple[str, str] | None = None
    per: float = 1.0

    def leaves(self) -> dict[printed.Path, dict[str, str]]:
        """Leaf -> what the placeholders stand for there."""
        return printed.matching(self.printed)

    def natural(self) -> Natural:
        """What its numbers could have been."""
        return read().ranges[self.range]

    def compared(self, path: printed.Path, names: dict[str, str]) -> printed.Printed:
        """The number that is compared: the printed one, its magnitude, or a ratio."""
        numbers = printed.leaves()
        if self.ratio:
            ends = (numbers[tuple(end.format(**names).split("/"))] for end in self.ratio)
            return printed.ratio(*ends, self.per)
        return numbers[path].magnitude() if self.magnitude else numbers[path]


class ProseEntry(Entry):
    """A claim in words, with the quantity and the threshold that decide it."""

    says: str
    rule: Literal["share", "value", "rises"]
    minus: str | None = None
    p: list[str] = [""]
    relative: bool = False
    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    share: float | None = None
    contradicted_by: str | None = None

    @model_validator(mode="after")
    def _rule_has_what_it_needs(self) -> "ProseEntry":
        bounded = (self.above, self.at_least, self.at_most) != (-math.inf, -math.inf, math.inf)
        needs = {"share": ("share", self.share), "rises": ("minus", self.minus)}
        if self.rule in needs and needs[self.rule][1] is None:
            raise ValueError(f"the rule {self.rule!r} needs {needs[self.rule][0]!r}")
        if bounded == (self.rule == "rises"):
            raise ValueError(f"the rule {self.rule!r} {'has no' if bounded else 'needs a'} bound")
        return self


class CountedOnce(BaseModel):
    """Printed numbers that follow from others, and from which."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    printed: str
    follows: str


class Claims(BaseModel):
    """``claims.yaml`` as a whole."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    reading: Literal[PRESET_NAMES]
    why_this_reading: str
    headline: list[str]
    ranges: dict[str, Natural]
    counted_once: list[CountedOnce]
    numbers: list[NumberEntry]
    prose: list[ProseEntry]

    @model_validator(mode="after")
    def _headline_is_of_claims(self) -> "Claims":
        known = {entry.id for entry in [*self.numbers, *self.prose]}
        if unknown := [name for name in self.headline if name not in known]:
            raise ValueError(f"headline: {unknown[0]!r} is the id of no claim")
        return self

    @model_validator(mode="after")
    def _ranges_are_declared(self) -> "Claims":
        for entry in self.numbers:
            if entry.rule != "clock" and entry.range not in self.ranges:
                raise ValueError(f"{entry.id}: range {entry.range!r} is not declared")
        return self


@cache
def read() -> Claims:
    """``paper/claims.yaml``, checked.

    Raises
    ------
    ProjectError : missing, not YAML, or not of this form; names the claim and its key
    """
    content = read_yaml(paths.CLAIMS)
    try:
        return Claims.model_validate(content)
    except ValidationError as error:
        raise ProjectError(f"paper/claims.yaml{_first_of(error, content)}") from error


def _first_of(error: ValidationError, content: Any) -> str:
    """The first thing that is wrong, with the id of its claim if it is in one."""
    first = error.errors()[0]
    place = first["loc"]
    entry = content[place[0]][place[1]] if len(place) > 1 else None
    claim = f", claim {entry.get('id')!r}" if isinstance(entry, dict) else ""
    shown = ".".join(str(part) for part in (place[2:] if claim else place))
    return claim + "".join(f": {part}" for part in (shown, first["msg"]) if part)


def check() -> None:
    """Find what is wrong with the claims as far as that needs no results.

    Raises
    ------
    ProjectError : ``claims.yaml`` or ``printed_values.yaml`` is missing or broken, or a claim
        asks for a printed number that is not there
    """
    read_yaml(paths.PRINTED_VALUES)
    with _named("paper/printed_values.yaml"):
        contradictions(printed.leaves())
    for entry in [*read().numbers, *read().prose]:
        with _named(f"paper/claims.yaml, claim {entry.id!r}"):
            keys = _keys(entry, read().reading)
            for leaf in entry.leaves().items() if isinstance(entry, NumberEntry) else ():
                entry.compared(*leaf)
            if not keys:
                raise KeyError(entry.printed)


@contextmanager
def _named(where: str) -> Iterator[None]:
    try:
        yield
    except LookupError as error:
        raise ProjectError(f"{where}: {error} is not among the printed numbers") from error
    except (ValueError, TypeError) as error:
        raise ProjectError(f"{where}: {error}") from error


def needed(preset: str) -> list[str]:
    """Keys that the claims ask of the notebooks, each once, in order."""
    entries = [*read().numbers, *read().prose]
    return list(dict.fromkeys(key for entry in entries for key in _keys(entry, preset)))


def _keys(entry: Entry, preset: str) -> list[str]:
    if isinstance(entry, NumberEntry):
        return [key(entry.ours, preset, names) for names in entry.leaves().values()]
    patterns = [pattern for pattern in (entry.ours, entry.minus) if pattern]
    return [key(pattern, preset, {"p": p}) for pattern in patterns for p in entry.p]


def key(pattern: str, preset: str, names: dict[str, str]) -> str:
    """Fill in a key; numbers in the shortest form, so that 4.00 gives 4."""

    def short(name):
        return format(float(name), "g") if name.replace(".", "", 1).isdigit() else name

    return pattern.format(preset=preset, **{name: short(part) for name, part in names.items()})


def resting_on(name: str) -> list[str]:
    """Ids of the claims, with their level where they have some, that a key judges."""
    reading, found = read().reading, []
    for entry in [*read().numbers, *read().prose]:
        if isinstance(entry, ProseEntry):
            found += [entry.id] * (name in _keys(entry, reading))
            continue
        for names in entry.leaves().values():
            label = "".join(f".{part}{value}" for part, value in names.items())
            found += [entry.id + label] * (key(entry.ours, reading, names) == name)
    return found
