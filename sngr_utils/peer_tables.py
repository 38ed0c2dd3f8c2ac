"""The tables and series of notebook 07, from the table of `estimators.compare`."""

import numpy as np
import pandas as pd

from sngr_utils import report, style
from sngr_utils.audit_tables import interval
from sngr_utils.experiments import estimators
from sngr_utils.metrics import summaries

LOST = 1.5  # times the oracle's RMSE, above which a run counts as lost
t = report.text


def from_grid(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs from the grid, and of the methods that bring their own start."""
    return runs[runs["start"].isin(["grid", "none"])]


def by_method(runs: pd.DataFrame, value: str, fmt: str = ".2f") -> pd.DataFrame:
    """Mean and 95 % interval of a column from the grid, methods down and p across."""
    table = summaries.summary(from_grid(runs), value, by=["method", "p"])
    rows = [
        [style.method_name(method), *(interval(row, fmt) for _, row in group.iterrows())]
        for method, group in table.groupby("method", sort=False)
    ]
    return pd.DataFrame(rows, columns=["method", *(f"p = {p:g}" for p in table["p"].unique())])


def start_table(runs: pd.DataFrame) -> pd.DataFrame:
    """How many runs are lost from either start, at the levels that have both."""
    other = runs[runs["start"] == "first_poses"]
    levels, starts = list(dict.fromkeys(other["p"])), ("grid", "first_poses")
    by = runs.assign(lost=runs["ratio"] > LOST).groupby(["method", "p", "start"])["lost"]
    lost, n = by.sum(), by.size()
    rows = [
        [
            style.method_name(method),
            *(f"{lost[method, p, s]} of {n[method, p, s]}" for p in levels for s in starts),
        ]
        for method in dict.fromkeys(other["method"])
    ]
    heads = [(f"p = {p:g}", style.method_name(start)) for p in levels for start in starts]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "method"), *heads]))


def test_table(runs: pd.DataFrame, best: str) -> pd.DataFrame:
    """Every method against the best one and the oracle, at each p above zero.

    The ratio to the oracle is the worst of all worlds; the difference from `best` is paired, in
    millimetres, with the p-value of Wilcoxon's signed-rank test. On clean data some methods agree
    to rounding, and a test of that tells nothing.
    """
    chosen = from_grid(runs[runs["p"] > 0])
    levels = list(dict.fromkeys(chosen["p"]))
    rows = []
    for method in dict.fromkeys(chosen["method"]):
        cells = [style.method_name(method)]
        mine = chosen[chosen["method"] == method]
        worst = mine.groupby("p", sort=False)["ratio"].max()
        if method == best:
            cells += [cell for p in levels for cell in (t(worst[p]), report.NONE, report.NONE)]
        else:
            tests = estimators.paired(runs, method, best).set_index("p")
            for p in levels:
                found = 1e3 * tests.loc[p, "mean"], tests.loc[p, "p_value"]
                cells += [t(worst[p]), t(found[0], ".0f"), t(found[1], ".2g")]
        rows.append(cells)
    inner = ("worst ratio", "difference [mm]", "p-value")
    heads = [(f"p = {p:g}", name) for p in levels for name in inner]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "method"), *heads]))


def time_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Median CPU time per world, from the grid, without the grid itself, [ms]."""
    times = 1e3 * from_grid(runs).groupby("method", sort=False)["seconds"].median()
    rows = [[style.method_name(method), t(value, ".0f")] for method, value in times.items()]
    return pd.DataFrame(rows, columns=["method", "CPU time [ms]"])


def ratio_series(runs: pd.DataFrame) -> dict[float, tuple[list[str], np.ndarray]]:
    """p -> names and (M, 3) mean, low, high of the ratio to the oracle, from the grid."""
    table = summaries.summary(from_grid(runs), "ratio", by=["p", "method"])
    return {
        p: (
            [style.method_name(m) for m in group["method"]],
            group[["mean", "low", "high"]].to_numpy(),
        )
        for p, group in table.groupby("p", sort=False)
    }
