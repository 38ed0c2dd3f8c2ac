"""Tables keep their numbers until they are shown: in a notebook, or by `latex` in the paper."""

import html
import math
import string
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from IPython.display import HTML

from sngr_utils.metrics.cluster_bootstrap import FEW
from sngr_utils.metrics.standard_error import standard_deviation, standard_error

NONE = "–"  # what a table shows where there is nothing to show


def text(value: float | None, fmt: str = ".2f") -> str:
    """A number as it is printed: a proper minus sign, no "-0.00", a dash for None and NaN."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    shown = format(value, fmt)
    if shown.startswith("-"):
        shown = shown[1:] if float(shown) == 0 else "−" + shown[1:]
    return shown


class _Formatter(string.Formatter):
    """`str.format` whose numbers are printed by `text`."""

    def format_field(self, value, format_spec):
        return text(value, format_spec)


@dataclass(frozen=True)
class Cell:
    """Numbers in a cell of a table, and how it shows them.

    Attributes
    ----------
    form : as `str.format` takes it, e.g. "{:.2f} ± {:.2f}"
    numbers : what fills it, in its order
    """

    form: str
    numbers: tuple[float | None, ...]

    def __str__(self) -> str:
        return _Formatter().format(self.form, *self.numbers)

    @property
    def formats(self) -> list[str]:
        """The format of each number."""
        parts = string.Formatter().parse(self.form)
        return [spec for _, field, spec, _ in parts if field is not None]


def cell(form: str, *numbers: float | None) -> Cell:
    """A cell of several numbers: ``cell("{:.1f} to {:.1f}", low, high)``."""
    return Cell(form, numbers)


def number(value: float | None, fmt: str = ".2f") -> Cell:
    """A cell of one number."""
    return Cell(f"{{:{fmt}}}", (value,))


def mean_std(values: Sequence[float]) -> Cell:
    """ "mean ± std" of at least two numbers (sample standard deviation)."""
    return with_error(float(np.mean(values)), standard_deviation(values))


def mean_error(values: Sequence[float], fmt: str = ".2f") -> Cell:
    """ "mean ± standard error" of at least two numbers."""
    return with_error(float(np.mean(values)), standard_error(values), fmt)


def with_error(value: float, error: float, fmt: str = ".2f") -> Cell:
    """ "value ± error" """
    return cell(f"{{:{fmt}}} ± {{:{fmt.removeprefix('+')}}}", value, error)


def with_interval(value: float, low: float, high: float, fmt: str = ".2f") -> Cell:
    """ "value [low, high]"; without brackets where there is no interval."""
    each = f"{{:{fmt}}}"
    return (
        cell(each, value) if math.isnan(low) else cell(f"{each} [{each}, {each}]", value, low, high)
    )


def interval(row: pd.Series, fmt: str = ".2f") -> Cell | str:
    """ "mean [low, high] (n)", or median; no interval of few worlds, n where some are left out."""
    if row["n"] == 0:
        return NONE
    ends = (row["low"], row["high"]) if row["n"] >= FEW else (math.nan, math.nan)
    shown = with_interval(row["median"] if "median" in row else row["mean"], *ends, fmt)
    if not row["missing"]:
        return shown
    return cell(shown.form + " ({:d})", *shown.numbers, int(row["n"]))


def show(frame: pd.DataFrame, mark: Callable[[pd.Series, str], bool] | None = None) -> HTML:
    """A table for display in a notebook, without its row numbers.

    Parameters
    ----------
    mark : of a row and the name of a column, whether the cell is the one to look at; it is bold
    """
    if mark is None:
        return HTML(frame.to_html(index=False, border=0))
    shown = [
        [f"<strong>{text}</strong>" if mark(row, name) else text
         for name, text in row.map(str).map(html.escape).items()]
        for _, row in frame.astype(object).iterrows()
    ]  # fmt: skip
    marked = pd.DataFrame(shown, columns=frame.columns).rename(columns=html.escape)
    return HTML(marked.to_html(index=False, border=0, escape=False))


def at(column: str | tuple | None, *rows: str | int) -> Callable[[pd.Series, object], bool]:
    """A mark for `show`: the cells of a column in the rows that begin with these words.

    Parameters
    ----------
    column : its head; None for the whole row but its first cell
    rows : the first cell of each, or its number from 0 where two begin alike; all if there is none
    """

    def mark(row: pd.Series, name: object) -> bool:
        first = name == row.index[0]
        told = not rows or row.name in rows or str(row.iloc[0]) in rows
        return told and not first and column in (None, name)

    return mark


def to_json(content: object) -> dict | int | str:
    """A cell as JSON can hold it: its numbers and their form, a count, or words."""
    if isinstance(content, Cell):
        return {"form": content.form, "numbers": [_or_null(x) for x in content.numbers]}
    return int(content) if isinstance(content, int | np.integer) else str(content)


def from_json(written: dict | int | str) -> Cell | int | str:
    """What `to_json` wrote."""
    return (
        Cell(written["form"], tuple(written["numbers"])) if isinstance(written, dict) else written
    )


def entries(tables: dict[str, dict]) -> dict[str, dict]:
    """Every number of every table with its format, by table, row, column and place in the cell."""
    found = {}
    for name, table in tables.items():
        for i, row in enumerate(table["rows"], start=1):
            for j, content in enumerate(map(from_json, row), start=1):
                if isinstance(content, str):
                    continue
                shown = content if isinstance(content, Cell) else number(content, "d")
                for k, (value, fmt) in enumerate(zip(shown.numbers, shown.formats, strict=True)):
                    key = f"tab_{name}.row{i}.column{j}" + (f".{k + 1}" if k else "")
                    found[key] = {"value": value, "format": fmt}
    return found


def _or_null(value: float | None) -> float | int | None:
    if value is None or math.isnan(value):
        return None
    return int(value) if isinstance(value, int | np.integer) else float(value)
