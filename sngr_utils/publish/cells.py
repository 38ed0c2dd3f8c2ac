"""Numbers as table cells."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from IPython.display import HTML

from sngr_utils.metrics.cluster_bootstrap import FEW
from sngr_utils.metrics.standard_error import standard_deviation

NONE = "–"  # what a table shows where there is nothing to show


def text(value: float | None, fmt: str = ".2f") -> str:
    """A number as a table cell: a proper minus sign, no "-0.00", a dash for None and NaN."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    shown = format(value, fmt)
    if shown.startswith("-"):
        shown = shown[1:] if float(shown) == 0 else "−" + shown[1:]
    return shown


def mean_std(values: Sequence[float], fmt: str = ".2f") -> str:
    """ "mean ± std" of at least two numbers (sample standard deviation)."""
    return f"{text(float(np.mean(values)), fmt)} ± {text(standard_deviation(values), fmt)}"


def show(frame: pd.DataFrame) -> HTML:
    """A table of preformatted cells for display in a notebook, without its row numbers."""
    return HTML(frame.to_html(index=False, border=0))


def interval(row: pd.Series, fmt: str = ".2f") -> str:
    """ "mean [low, high] (n)", or median; no interval of few worlds, n where some are left out."""
    if row["n"] == 0:
        return NONE
    shown = text(row["median"] if "median" in row else row["mean"], fmt)
    if row["n"] >= FEW and not math.isnan(row["low"]):
        shown += f" [{text(row['low'], fmt)}, {text(row['high'], fmt)}]"
    return shown + (f" ({int(row['n'])})" if row["missing"] else "")
