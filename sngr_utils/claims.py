"""What the paper claims: every number and every statement, as ``paper/claims.yaml`` lists them.

An entry names the printed numbers (or says the claim), the key of our results, the rule that
judges, and the notebook cell that shows what decides. It holds no verdict.
"""

import math
from functools import cache
from typing import Literal

from pydantic import BaseModel, ConfigDict
from ruamel.yaml import YAML

from sngr_utils import paths, printed
from sngr_utils.graph import PRESETS


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
    rule: Literal["deterministic", "one_world", "mean_of_five", "std_of_five", "hardware", "clock"]
    trend: Literal["rises", "falls"] | None = None
    ratio: tuple[str, str] | None = None
    per: float = 1.0

    def leaves(self) -> dict[printed.Path, dict[str, str]]:
        """Leaf -> what the placeholders stand for there."""
        found = {path: printed.match(self.printed, path) for path in printed.leaves()}
        return {path: names for path, names in found.items() if names is not None}

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


class Claims(BaseModel):
    """``claims.yaml`` as a whole."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    reading: Literal[tuple(PRESETS)]
    why_this_reading: str
    numbers: list[NumberEntry]
    prose: list[ProseEntry]


@cache
def read() -> Claims:
    """``paper/claims.yaml``, checked."""
    return Claims(**YAML(typ="safe", pure=True).load(paths.CLAIMS))


def needed(preset: str) -> list[str]:
    """Keys that the claims ask of the notebooks, each once, in order."""
    keys = []
    for entry in read().numbers:
        keys += [key(entry.ours, preset, names) for names in entry.leaves().values()]
    for entry in read().prose:
        patterns = [pattern for pattern in (entry.ours, entry.minus) if pattern]
        keys += [key(pattern, preset, {"p": p}) for pattern in patterns for p in entry.p]
    return list(dict.fromkeys(keys))


def key(pattern: str, preset: str, names: dict[str, str]) -> str:
    """Fill in a key; numbers in the shortest form, so that 4.00 gives 4."""

    def short(name):
        return format(float(name), "g") if name.replace(".", "", 1).isdigit() else name

    return pattern.format(preset=preset, **{name: short(part) for name, part in names.items()})
