"""The baseline as the original's authors run it: printed beside what comes out, and many worlds."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.metrics.cluster_bootstrap import Interval
from sngr_utils.publish import authors, authors_worlds, cells, printed
from sngr_utils.show import style
from sngr_utils.show.style import WRONG_LABEL

QUANTITIES = {"rmse": ("RMSE [m]", 2), "nees": ("NEES", 2), "triggered": ("windows that fire", 0)}
WORLDS = {
    "silent": "worlds in which it is silent",
    "base_rate": "windows that failed: base rate",
    "precision": "precision",
    "base_there": "base rate of the worlds where it fires",
    "gain": "gain of the precision over that",
    "recall": "recall",
    "auc": "area under the ROC curve, within a world",
}


def printed_table() -> pd.DataFrame:
    """Printed numbers of the baseline beside those of GTSAM 4.2 under the authors' conventions."""
    ours, leaves = authors.values(authors.read()), printed.leaves()
    levels = sorted({path[1] for path in ours if path[0] == "baseline"})
    lines = []
    for level in levels:
        line = [level]
        for name, (_, decimals) in QUANTITIES.items():
            path, fmt = ("baseline", level, name), f".{decimals}f"
            pair = leaves[path].value, ours[path][0]
            line.append(cells.cell(f"{{:{fmt}}} | {{:{fmt}}}", *pair))
        lines.append(line)
    heads = [f"{name}: printed | comes out" for name, _ in QUANTITIES.values()]
    return pd.DataFrame(lines, columns=["p", *heads])


def worlds_table(levels: Sequence[float]) -> pd.DataFrame:
    """What the trigger says over the worlds of the study, with 95 % intervals."""
    levels = _studied(levels)
    found = [authors_worlds.measures(p) for p in levels]
    lines = [[shown, *(_cell(each[name]) for each in found)] for name, shown in WORLDS.items()]
    return pd.DataFrame(lines, columns=["", *(f"p = {p:g}" for p in levels)])


def _studied(levels: Sequence[float]) -> list[float]:
    """Those of the levels that the study has, or all that it has: it is of no parameter here."""
    known = authors_worlds.levels()
    return [p for p in levels if p in known] or known


def _cell(each: Interval) -> cells.Cell:
    return cells.with_interval(each.value, each.low, each.high)


def draw_worlds(axes: Sequence[Axes], levels: Sequence[float]) -> None:
    """Three panels against p: precision and base rates, recall, share of silent worlds."""
    levels = _studied(levels)
    found = {p: authors_worlds.measures(p) for p in levels}
    lines = [
        (axes[0], "precision", style.TRIGGERED, "o", "precision"),
        (axes[0], "base_there", style.ESTIMATE, "s", "base rate where it fires"),
        (axes[0], "base_rate", style.TRUTH, "^", "base rate, all worlds"),
        (axes[1], "recall", style.TRIGGERED, "o", "recall"),
        (axes[2], "silent", style.TRIGGERED, "o", "silent worlds"),
    ]
    for ax, name, colour, marker, label in lines:
        # on clean data few windows fail and few fire
        at = [p for p in levels if p > 0 or name == "silent"]
        shown = [found[p][name] for p in at]
        values = np.array([each.value for each in shown])
        errors = np.abs(np.array([[each.low, each.high] for each in shown]).T - values)
        ax.errorbar(at, values, errors, color=colour, marker=marker, mfc="none", ms=5, lw=0.8,
                    capsize=2, label=label)  # fmt: skip
    ends = min(levels) - 0.03, max(levels) + 0.03
    named = "share of windows, from 0.6", "recall", "share of worlds"
    for ax, label in zip(axes, named, strict=True):
        ax.set(xlabel=WRONG_LABEL, ylabel=label, xlim=ends, ylim=(0, 1.02))
    axes[0].set_ylim(0.6, 1.02)
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1), borderpad=0.1)
