"""The numbers the paper prints, with the digits it prints them to.

`report.printed_values` has the same numbers as floats, in which 4.00 and 4 are one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from functools import cache

from ruamel.yaml import YAML

from sngr_utils import paths

SLACK = 1e-9  # so that a difference of exactly half a digit is not lost to binary rounding

Path = tuple[str, ...]


@dataclass(frozen=True)
class Printed:
    """A printed number and what it may have been before rounding; all None for a dash.

    Attributes
    ----------
    value : as printed
    low, high : the numbers that round to it
    decimals : digits after the point
    """

    value: float | None
    low: float | None
    high: float | None
    decimals: int

    def allows(self, low: float, high: float | None = None) -> bool:
        """Whether a number, or one from `low` to `high`, may have been printed like this."""
        if self.value is None:
            return False
        high = low if high is None else high
        return low <= self.high + SLACK and high >= self.low - SLACK

    def magnitude(self) -> "Printed":
        """The same without its sign, for a quantity whose sign is a matter of chance."""
        if self.value is None or self.value >= 0:
            return self
        return Printed(-self.value, -self.high, -self.low, self.decimals)


def number(text: str) -> Printed:
    """A scalar of the YAML: "4.00" is 4, known to half a hundredth; "null" is a dash.

    Raises
    ------
    ValueError : not a number
    """
    if text == "null":
        return Printed(None, None, None, 0)
    try:
        exact = Decimal(text)
    except ArithmeticError as error:
        raise ValueError(f"{text!r} is not a number") from error
    if not exact.is_finite():
        raise ValueError(f"{text!r} is not a number")
    half = 0.5 * 10.0 ** exact.as_tuple().exponent
    value = float(exact)
    return Printed(value, value - half, value + half, max(0, -exact.as_tuple().exponent))


def ratio(over: Printed, under: Printed, per: float = 1.0) -> Printed:
    """over / (per * under), with all it may have been; a dash where nothing is divided by.

    For positive numbers.
    """
    if not under.value or over.value is None:
        return Printed(None, None, None, 1)
    value = over.value / under.value / per
    low, high = over.low / under.high / per, over.high / under.low / per
    return Printed(value, low, high, 1)


@cache
def leaves() -> dict[Path, Printed]:
    """Every number of ``paper/printed_values.yaml`` by its path, in the order of the file.

    Raises
    ------
    ValueError : not a number, naming its path; or nothing there
    """
    tree, found = YAML(typ="base", pure=True).load(paths.PRINTED_VALUES), {}
    if not isinstance(tree, dict):
        raise ValueError("it must hold 'table: numbers' lines")
    for path, text in _walk(tree, ()):
        try:
            found[path] = number(text)
        except ValueError as error:
            raise ValueError(f"{'/'.join(path)}: {error}") from error
    return found


def _walk(tree: dict | list | str, path: Path) -> Iterator[tuple[Path, str]]:
    if isinstance(tree, str):
        yield path, tree
        return
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for name, below in items:
        yield from _walk(below, (*path, str(name)))


def match(pattern: str, path: Path) -> dict[str, str] | None:
    """What the placeholders of "baseline/{p}/rmse" stand for in a path; None if it differs."""
    parts = pattern.split("/")
    if len(parts) != len(path):
        return None
    found = {}
    for part, name in zip(parts, path, strict=True):
        if part.startswith("{"):
            found[part[1:-1]] = name
        elif part != name:
            return None
    return found


@cache
def matching(pattern: str) -> dict[Path, dict[str, str]]:
    """Every leaf of a pattern -> what its placeholders stand for there."""
    found = {path: match(pattern, path) for path in leaves()}
    return {path: names for path, names in found.items() if names is not None}
