"""The tables and figures of notebook 07, and what it records."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from sngr_utils.experiments import estimators
from sngr_utils.metrics import summaries
from sngr_utils.peers import Config
from sngr_utils.publish import report
from sngr_utils.publish.cells import NONE, cell, interval, number, with_interval
from sngr_utils.show import methods, style

t = number


def from_grid(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs from the grid, and of the methods that bring their own start."""
    return runs[runs["start"].isin(["grid", "none"])]


def by_method(runs: pd.DataFrame, value: str, fmt: str = ".2f") -> pd.DataFrame:
    """Median and 95 % interval of a column from the grid, methods down and p across."""
    table = summaries.medians(from_grid(runs), value, by=["method", "p"])
    rows = [
        [methods.shown(method), *(interval(row, fmt) for _, row in group.iterrows())]
        for method, group in table.groupby("method", sort=False)
    ]
    return pd.DataFrame(rows, columns=["method", *(f"p = {p:g}" for p in table["p"].unique())])


def medians_of(runs: pd.DataFrame, value: str, names: list[str]) -> pd.DataFrame:
    """Medians of a column from the grid for a few methods, p across: what a lesson shows."""
    middle = from_grid(runs).groupby(["method", "p"])[value].median().unstack()
    rows = [[methods.shown(name), *map(t, middle.loc[name])] for name in names]
    return pd.DataFrame(rows, columns=["method", *(f"p = {p:g}" for p in middle.columns)])


def start_table(runs: pd.DataFrame) -> pd.DataFrame:
    """How many runs are lost from either start, at the levels that have both."""
    other = runs[runs["start"] == "first_poses"]
    levels, starts = list(dict.fromkeys(other["p"])), ("grid", "first_poses")
    by = runs.assign(lost=runs["ratio"] > estimators.LOST).groupby(["method", "p", "start"])["lost"]
    lost, n = by.sum(), by.size()
    columns = [(p, start) for p in levels for start in starts]
    rows = [
        [methods.shown(m), *(cell("{:d} of {:d}", lost[m, *at], n[m, *at]) for at in columns)]
        for m in dict.fromkeys(other["method"])
    ]
    heads = [(f"p = {p:g}", methods.shown(start)) for p, start in columns]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "method"), *heads]))


def test_table(runs: pd.DataFrame, best: str) -> pd.DataFrame:
    """Every method against the best one and the oracle, at each p above zero.

    The ratio to the oracle is the worst of all worlds; the difference from `best` is the median
    of the paired ones, in millimetres, with the worlds in which the method is worse, and the
    p-value of the sign test. On clean data some methods agree to rounding, and a test of that
    tells nothing.
    """
    chosen = from_grid(runs[runs["p"] > 0])
    levels = list(dict.fromkeys(chosen["p"]))
    rows = []
    for method in dict.fromkeys(chosen["method"]):
        cells = [methods.shown(method)]
        mine = chosen[chosen["method"] == method]
        worst = mine.groupby("p", sort=False)["ratio"].max()
        if method == best:
            cells += [cell for p in levels for cell in (t(worst[p]), *[NONE] * 3)]
        else:
            tests = estimators.paired(runs, method, best).set_index("p")
            for p in levels:
                found = tests.loc[p]
                cells += [
                    t(worst[p]),
                    t(1e3 * found["median"], ".0f"),
                    f"{found['more']:.0f} of {found['n']:.0f}",
                    t(found["p_value"], ".2g"),
                ]
        rows.append(cells)
    inner = ("worst ratio", "difference [mm]", "worse in", "p-value")
    heads = [(f"p = {p:g}", name) for p in levels for name in inner]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "method"), *heads]))


def time_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Median CPU time per world with its quartiles, from the grid, without the grid itself."""
    seconds = from_grid(runs).groupby("method", sort=False)["seconds"]
    times = 1e3 * seconds.quantile([0.5, 0.25, 0.75])
    rows = [
        [methods.shown(method), with_interval(*three, ".0f")]
        for method, three in times.groupby("method", sort=False)
    ]
    return pd.DataFrame(rows, columns=["method", "CPU time [ms], quartiles"])


def ratio_series(runs: pd.DataFrame, value: str) -> dict[float, tuple[list[str], np.ndarray]]:
    """p -> names and (M, 3) median, low, high of a ratio to the oracle's, from the grid."""
    table = summaries.medians(from_grid(runs).dropna(subset=value), value, by=["p", "method"])
    return {
        p: (
            [methods.shown(m) for m in group["method"]],
            group[["median", "low", "high"]].to_numpy(),
        )
        for p, group in table.groupby("p", sort=False)
    }


MARKERS = "osD^v<>xP"


def draw_curves(ax: Axes, x: np.ndarray, curves: dict[str, np.ndarray], **labels: str) -> None:
    """Curves (key of a method -> (N,)) over x."""
    for key, values in curves.items():
        look = methods.METHODS[key]
        ax.plot(x, values, look.dash, color=look.colour, label=look.name)
    ax.set(**labels)


def legend_right(ax: Axes) -> None:
    """A legend beside the panel, for panels that share it."""
    ax.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def draw_pull(
    ax: Axes, ranges: np.ndarray, n_wrong: int, x: np.ndarray, costs: dict[str, np.ndarray]
) -> None:
    """Costs (name -> (N,)) of a distance, each over its own range, and the ranges they come from.

    The last `n_wrong` of the (M,) ranges are another landmark's, [m].
    """
    draw_curves(ax, x, costs, xlabel="distance to the landmark [m]", ylabel="cost, scaled")
    for given, colour in ((ranges[:-n_wrong], style.TRUTH), (ranges[-n_wrong:], style.TRIGGERED)):
        ax.plot(given, np.full(len(given), -0.06), "|", color=colour, ms=6)
    ax.margins(y=0.03)


def draw_ratios(
    ax: Axes, series: dict[float, tuple[list[str], np.ndarray]], of: str = "pose"
) -> None:
    """Ratio to the oracle, p -> names and (M, 3) median, low, high: a row per method, log scale."""
    for i, (p, (names, values)) in enumerate(series.items()):
        rows = -np.arange(len(names)) + 0.18 * ((len(series) - 1) / 2 - i)
        middle, low, high = values.T
        bars = np.array([middle - np.maximum(low, 0.5 * middle), high - middle])
        ax.errorbar(
            middle, rows, xerr=bars, fmt=MARKERS[i], color=style.SEQUENCE[i], ms=2.5, lw=0.8,
            label=f"p = {p:g}",
        )  # fmt: skip
    ax.set_yticks(-np.arange(len(names)), names)
    _ratio_axis(ax, f"{of} RMSE over the oracle's")
    ax.legend(loc="lower center", bbox_to_anchor=(0.4, 1), ncols=len(series))


def _ratio_axis(ax: Axes, label: str) -> None:
    ax.axvline(1, color=style.TRUTH, lw=0.6)
    ax.set(xscale="log", xlabel=label, xticks=[1, 2, 5, 10, 20])
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.grid(axis="y", lw=0.3)


def draw_starts(ax: Axes, runs: pd.DataFrame) -> None:
    """Ratio to the oracle from either start at the first level that has both, a dot per world."""
    other = runs[runs["start"] == "first_poses"]
    at = runs[runs["p"] == other["p"].iloc[0]]
    names = list(dict.fromkeys(other["method"]))
    for start, marker, colour, shift in (
        ("grid", "o", style.ESTIMATE, 0.18), ("first_poses", "x", style.TRIGGERED, -0.18),
    ):  # fmt: skip
        rows = at[at["start"] == start]
        place = [shift - names.index(m) for m in rows["method"]]
        ax.plot(rows["ratio"], place, marker, ms=2.8, mfc="none", mew=0.6, color=colour,
                label=f"start: {methods.shown(start)}")  # fmt: skip
    ax.axvline(estimators.LOST, color=style.TRUTH, lw=0.6, ls=":")
    ax.set_yticks(-np.arange(len(names)), [methods.shown(m) for m in names])
    _ratio_axis(ax, "pose RMSE over the oracle's, a mark per world")
    ax.legend(loc="lower center", bbox_to_anchor=(0.4, 1), ncols=2)


def draw_weights(ax: Axes, weights: np.ndarray, wrong: np.ndarray) -> None:
    """Weight of each of (M,) ranges in each of R rounds, (R, M); orange if its label is wrong."""
    for flag, colour, name in (
        (False, style.TRUTH, "label right"), (True, style.TRIGGERED, "label wrong"),
    ):  # fmt: skip
        lines = ax.plot(weights[:, wrong == flag], color=colour, lw=0.7, alpha=0.7)
        for line in lines[:1]:
            line.set_label(name)
    ax.set(xlabel="round", ylabel="weight of a range", ylim=(-0.05, 1.2))
    ax.legend(loc="upper center", ncols=2)  # above the largest weight, which is one


# whose share of lost runs the paper's text quotes
LOST = {
    "grid": ("gnc_tls", "max_mixture_all", "em"),
    "first_poses": ("gnc_tls", "max_mixture_all", "em", "em_exclusive"),
}


def record(config: Config, runs: pd.DataFrame, to: report.Report) -> None:
    """Hand on one number per world of each method, start and level, and what the text quotes."""
    to.value("peers.n_seeds", config.n_seeds, ".0f")
    for (method, start, p), rows in runs.groupby(["method", "start", "p"], sort=False):
        here = f"peers.{method}.{start}.p{p:g}"
        columns = ("ratio",) if start == "first_poses" else ("ratio", "landmark_ratio", "nees")
        for name in columns:
            if rows[name].notna().any():  # odometry alone has no landmarks
                to.sample(f"{here}.{name}", rows[name])
        if p < max(config.p_levels):
            continue
        if method in LOST.get(start, ()):
            lost = 100 * (rows["ratio"] > estimators.LOST).mean()
            to.value(f"{here}.lost", lost, ".0f", "%", n=len(rows), within=200 / len(rows))
        if (method, start) == ("em_exclusive", "grid"):
            to.value(f"{here}.worst", rows["ratio"].max(), n=len(rows), within=0.5)
