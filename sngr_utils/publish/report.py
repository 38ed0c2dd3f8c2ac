"""Results on their way from a notebook to the paper.

A notebook collects values, tables and figures in a `Report` and saves it as JSON; `latex`
turns the JSON of all notebooks into what the LaTeX source reads. No digit that a run produced
is typed by hand anywhere. Wall-clock figures, which no two runs share, go to a file of their
own, ``<notebook>.timings.json``.
"""

import math
import re
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
from IPython.display import HTML, Markdown
from matplotlib.figure import Figure
from ruamel.yaml import YAML

from sngr_utils import paths
from sngr_utils.metrics.standard_error import standard_error
from sngr_utils.publish import cells
from sngr_utils.publish.files import write_json
from sngr_utils.publish.film import Film, player
from sngr_utils.whole_file import write_text

TIMING = "_timing"  # end of the name of a figure that shows wall clocks

STANDARD_ERRORS = 3  # within which another run reproduces a mean
ROUNDING = 1e-9  # relative to a value, or to 1: an error below it is none


@cache
def printed_values() -> dict:
    """The numbers the paper prints (``paper/printed_values.yaml``)."""
    return YAML(typ="safe", pure=True).load(paths.PRINTED_VALUES)


def versions() -> str:
    """The versions a result depends on most."""
    return ", ".join(f"{name} {version(name)}" for name in ("gtsam", "dynesty", "numpy"))


class Report:
    """Collects what one notebook hands on.

    Parameters
    ----------
    notebook : name of the notebook, e.g. "01_bimodal"; the stem of every figure and file
    output_dir : folder to write to, created if missing. papermill passes its own; opened by
        hand, a notebook writes below ``build/``
    """

    def __init__(self, notebook: str, output_dir: str | Path):
        self.notebook = notebook
        self.output_dir = Path(output_dir)
        self.output_dir.mkdir(parents=True, exist_ok=True)
        self._results = {
            "notebook": notebook, "values": {}, "samples": {}, "tables": {}, "figures": []
        }  # fmt: skip
        self._timings = {"notebook": notebook, "values": {}, "tables": {}}

    def value(
        self,
        key: str,
        value: float,
        fmt: str = ".2f",
        unit: str = "",
        error: float | None = None,
        n: int = 1,
        timing: bool = False,
        within: float | None = None,
    ) -> None:
        """Hand on one number.

        Parameters
        ----------
        key : what the paper asks for with ``\\res{key}``, e.g. "baseline.rmse.p0.3"
        fmt : how the paper prints it
        error : its standard error where it is stochastic; printed with it
        n : sample size behind it
        timing : whether it is a wall-clock figure
        within : how far another run may deviate and still reproduce it (`make verify`), in its
            unit. If not given, see `tolerance`
        """
        entry = {"value": _or_null(value), "format": fmt, "unit": unit, "n": int(n)}
        if error is not None:
            entry["standard_error"] = _or_null(error)
        own = {"kind": "absolute", "size": within}
        entry["tolerance"] = tolerance(entry) if within is None else own
        (self._timings if timing else self._results)["values"][key] = entry

    def sample(self, key: str, values: Sequence[float], fmt: str = ".2f", unit: str = "") -> None:
        """Hand on one number per world, with their mean and its standard error.

        Parameters
        ----------
        key : as in `value`; the paper may print it as mean and standard error
        values : (n,) one per world, in the order of the seeds; NaN where undefined. Mean and
            error are those of the defined ones, n counts all
        """
        defined = [value for value in values if not math.isnan(value)]
        entry = {
            "value": _or_null(np.mean(defined)) if defined else None,
            "format": fmt, "unit": unit, "n": len(values),
            "standard_error": _or_null(standard_error(defined)) if defined else None,
            "sample": [_or_null(value) for value in values],
        }  # fmt: skip
        entry["tolerance"] = tolerance(entry)
        self._results["samples"][key] = entry

    def table(
        self, name: str, frame: pd.DataFrame, timing: bool = False,
        mark: Callable[[pd.Series, str], bool] | None = None,
    ) -> HTML:  # fmt: skip
        """Hand on a whole table, its numbers with all digits; returns it, for display.

        What `cells.show` marks is marked in the notebook only.
        """
        columns = [list(c) if isinstance(c, tuple) else [c] for c in frame.columns]
        rows = [[cells.to_json(cell) for cell in row] for row in frame.to_numpy(dtype=object)]
        entry = {"columns": columns, "rows": rows}
        (self._timings if timing else self._results)["tables"][name] = entry
        return cells.show(frame, mark)

    def supplement(self, name: str, frame: pd.DataFrame, timing: bool = False) -> Markdown:
        """Hand on a table that is too long for a lesson; returns where it can be read."""
        self.table(name, frame, timing)
        rows, columns = frame.shape
        return Markdown(
            f"The whole table, {rows} rows of {columns} columns, is *{name}* of the supplement"
            f" (`make why TABLE={name}`)."
        )

    def figure(self, fig: Figure, name: str, png: bool = False, timing: bool = False) -> None:
        """Save a figure as ``<notebook>_<name>.pdf``, and as PNG too if the README shows it.

        With `timing` it shows wall clocks, which no two runs share: its name ends in
        ``_timing``, and it is not committed.
        """
        stem = f"{self.notebook}_{name}" + (TIMING if timing else "")
        fig.savefig(self.output_dir / f"{stem}.pdf", metadata={"CreationDate": None})
        self._results["figures"].append(f"{stem}.pdf")
        if png:
            fig.savefig(self.output_dir / f"{stem}.png", dpi=200)
            self._results["figures"].append(f"{stem}.png")

    def film(self, name: str, shown: Film) -> Markdown:
        """Hand on a film as ``<notebook>_<name>.html``; returns a link to it."""
        file = f"{self.notebook}_{name}.html"
        write_text(self.output_dir / file, player(shown))
        self._results["figures"].append(file)
        return Markdown(f"Film: [{shown.title}](../figures/{file})")

    def save(self) -> None:
        """Write ``<notebook>.json`` and, if there are any, ``<notebook>.timings.json``."""
        write_json(self.output_dir / f"{self.notebook}.json", self._results)
        if self._timings["values"] or self._timings["tables"]:
            write_json(self.output_dir / f"{self.notebook}.timings.json", self._timings)


def tolerance(entry: dict) -> dict:
    """Kind and size of the deviation that still reproduces a value.

    Three standard errors where it has one that shows in the printed digits. Else half a unit of
    the last printed digit, and exactly for whole numbers and for formats without fixed digits:
    worlds that are all alike leave a standard error of zero or of rounding, which no rerun meets.
    """
    digits = _printed_digits(entry)
    spread = STANDARD_ERRORS * (entry.get("standard_error") or 0)
    if spread > max(digits["size"], ROUNDING * max(1.0, abs(entry["value"] or 0))):
        return {"kind": "standard errors", "size": STANDARD_ERRORS}
    return digits


def _printed_digits(entry: dict) -> dict:
    """The tolerance of a value of which only the printed digits count."""
    value, printed = entry["value"], re.search(r"\.(\d)([fg%])", entry["format"])
    whole = value is None or float(value).is_integer()
    if printed is None or (printed[0] == ".0f" and whole):
        return {"kind": "exact", "size": 0}
    decimals = int(printed[1])
    if printed[2] == "g":  # significant digits
        decimals -= 1 + (math.floor(math.log10(abs(value))) if value else 0)
    decimals += 2 * (printed[2] == "%")
    return {"kind": "absolute", "size": 0.5 * 10.0**-decimals}


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
