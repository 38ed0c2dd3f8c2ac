"""Text files that may hold anything: lines of fields, and numbers that are numbers."""

import csv
import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sngr_utils.world.checks import LARGEST, SMALLEST
from sngr_utils.world.log import LogWarning

LONGEST_LINE = 1_000_000  # characters
LARGEST_FILE = 2**29  # bytes
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)


class Line:
    """A line of a file, which knows where it stands."""

    def __init__(self, path: Path, number: int, text: str, separator: str | None):
        self.path, self.number = path, number
        fields = text.split(separator)
        if separator and '"' in text:
            try:
                (fields,) = csv.reader([text], strict=True, skipinitialspace=True)
            except csv.Error as error:
                raise self.refuse(str(error)) from None
        self.fields = [field.strip() for field in fields]

    def refuse(self, why: str) -> ValueError:
        """The error to raise for this line."""
        return ValueError(f"{self.path}:{self.number}: {why}")

    def numbers(
        self, fields: list[str], most: float = LARGEST, names: list[str] | None = None
    ) -> np.ndarray:
        """Finite numbers within bounds.

        Parameters
        ----------
        names : of the fields, if they have some

        Raises
        ------
        ValueError : a field that is none
        """
        found = np.empty(len(fields))
        for i, field in enumerate(fields):
            what = f"{names[i]}: {_shown(field)}" if names else _shown(field)
            if not NUMBER.fullmatch(field):
                raise self.refuse(f"{what} is not a finite number")
            found[i] = float(field)
            if abs(found[i]) > most:
                raise self.refuse(f"{what} is beyond {most:g}")
        return found

    def sigma(self, field: str, what: str, power: int = 1) -> float:
        """A sigma, from what is its first or second power.

        Raises
        ------
        ValueError : it is not positive
        """
        value = float(self.numbers([field], LARGEST**power, [what])[0])
        if value < SMALLEST**power:
            raise self.refuse(f"{what} is {_shown(field)}: it must be positive")
        return value if power == 1 else math.sqrt(value)


def lines(path: Path, separator: str | None = None) -> Iterator[Line]:
    """The lines of a file that hold something.

    Parameters
    ----------
    separator : of the fields; None for blanks

    Raises
    ------
    ValueError : no such file, or not a text of lines in UTF-8

    Warns
    -----
    LogWarning : the last line has no end
    """
    empty, every = True, _text(path).split("\n")
    if every[-1].strip():
        warnings.warn(
            f"{path}:{len(every)}: this line has no end: the file may have been cut off in it",
            LogWarning,
            stacklevel=2,
        )
    for number, text in enumerate(every, start=1):
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
