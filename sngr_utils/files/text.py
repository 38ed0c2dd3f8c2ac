"""Text files that may hold anything: lines of fields, and numbers that are numbers."""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

LONGEST_LINE = 10_000  # characters
LARGEST_FILE = 2**29  # bytes
LARGEST, SMALLEST = 1e20, 1e-20  # a number, and a sigma: their squares are numbers too
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


class Line:
    """A line of a file, which knows where it stands."""

    def __init__(self, path: Path, number: int, text: str, separator: str | None):
        self.path, self.number = path, number
        self.fields = [field.strip() for field in text.split(separator)]

    def refuse(self, why: str) -> ValueError:
        """The error to raise for this line."""
        return ValueError(f"{self.path}:{self.number}: {why}")

    def numbers(self, fields: list[str]) -> np.ndarray:
        """Finite numbers.

        Raises
        ------
        ValueError : a field that is none
        """
        found = np.empty(len(fields))
        for i, field in enumerate(fields):
            if not NUMBER.fullmatch(field):
                raise self.refuse(f"{_shown(field)} is not a finite number")
            found[i] = float(field)
            if abs(found[i]) > LARGEST:
                raise self.refuse(f"{_shown(field)} is beyond {LARGEST:g}")
        return found

    def positive(self, field: str, what: str, least: float = SMALLEST) -> float:
        """A number that is not below `least`.

        Raises
        ------
        ValueError : it is
        """
        value = float(self.numbers([field])[0])
        if not value >= least:
            raise self.refuse(f"{what} is {_shown(field)}: it must be positive")
        return value

    def variance(self, field: str, what: str) -> float:
        """The sigma of a variance."""
        return math.sqrt(self.positive(field, what, SMALLEST**2))


def lines(path: Path, separator: str | None = None) -> Iterator[Line]:
    """The lines of a file that hold something.

    Parameters
    ----------
    separator : of the fields; None for blanks

    Raises
    ------
    ValueError : no such file, or not a text of lines in UTF-8
    """
    empty = True
    for number, text in enumerate(_text(path).split("\n"), start=1):
        if len(text) > LONGEST_LINE:
            raise ValueError(f"{path}:{number}: a line of {len(text)} characters")
        if text.strip():
            empty = False
            yield Line(path, number, text, separator)
    if empty:
        raise ValueError(f"{path}: the file is empty")


def _text(path: Path) -> str:
    try:
        if path.exists() and not path.is_file():  # a pipe or a device may have no end
            raise ValueError(f"{path}: not a file")
        if path.exists() and path.stat().st_size > LARGEST_FILE:
            raise ValueError(f"{path}: larger than {LARGEST_FILE >> 20} MB")
        raw = path.read_bytes()
    except (OSError, MemoryError) as error:
        raise ValueError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if b"\0" in raw:
        raise ValueError(f"{path}: not a text in UTF-8 (it holds zero bytes)")
    try:
        return re.sub("\r\n?", "\n", raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise ValueError(f"{path}:{line}: not a text in UTF-8 ({error.reason})") from None


def _shown(field: str) -> str:
    return repr(field if len(field) <= 40 else field[:37] + "...")
