"""The tables and figures of notebook 08, and what it records."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from scipy.stats import false_discovery_control

from sngr_utils.association_aware import SLOW, Config
from sngr_utils.experiments import estimators, online_variants
from sngr_utils.experiments.estimators import BATCH
from sngr_utils.metrics import summaries
from sngr_utils.publish import report
from sngr_utils.publish.cells import Cell, cell, interval, number
from sngr_utils.show import methods, style
from sngr_utils.sngr import windows

t = number


def summary_series(runs: pd.DataFrame) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Key of a method -> (P,) p and (P, 3) median, low, high of the ratio to the oracle."""
    table = summaries.medians(runs[runs["method"] != "oracle"], "ratio", by=["method", "p"])
    return {
        method: (group["p"].to_numpy(), group[["median", "low", "high"]].to_numpy())
        for method, group in table.groupby("method", sort=False)
    }  # fmt: skip


# how alike is compared with alike: column of the runs -> name
KINDS = {
    "filtered": "newest pose, on the way", "graph": "all poses, before the final EM",
    "ratio": "all poses, final", "landmark_ratio": "landmarks, final",
}  # fmt: skip


def goal_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Per p: our errors over the oracle's of the same kind, and batch EM's, medians over worlds."""
    rows, by = [], runs.set_index(["method", "p"]).sort_index()
    for p in dict.fromkeys(runs["p"]):
        ours, batch = (by.loc[(method, p)] for method in (online_variants.NAME, BATCH))
        middle = [*(ours[kind].median() for kind in KINDS), batch["ratio"].median()]
        rows.append([f"{p:g}", *map(t, middle)])
    return pd.DataFrame(rows, columns=["p", *KINDS.values(), "EM in batch, final"])


def detail_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Per p: the worst worlds, median errors in metres, the mean NEES, and p as estimated."""
    rows, by = [], runs.set_index(["method", "p"]).sort_index()
    for p in dict.fromkeys(runs["p"]):
        ours, batch, oracle = (by.loc[(m, p)] for m in (online_variants.NAME, BATCH, "oracle"))
        metres = (
            oracle["pose_rmse"], ours["pose_rmse"], ours["filtered_rmse"],
            oracle["landmark_rmse"], ours["landmark_rmse"],
        )  # fmt: skip
        rows.append([
            f"{p:g}", t(ours["ratio"].max()), t(batch["ratio"].max()),
            *(t(values.median(), ".3f") for values in metres),
            t(ours["nees"].mean()), t(oracle["nees"].mean()), t(ours["p_found"].mean()),
        ])  # fmt: skip
    heads = [
        "p", "worst ratio", "worst of EM", "oracle [m]", "ours [m]", "newest pose [m]",
        "oracle, landmarks [m]", "ours, landmarks [m]", "NEES", "NEES oracle", "p, estimated",
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def test_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Each peer's pose RMSE over ours on the same world: median, worlds where above, p-value.

    The sign test, two-sided, which skewed differences do not mislead. The p-values are adjusted
    for all tests of the table, to control the false discovery rate; the levels of p are looks at
    the same worlds, so they are not independent.

    Source: Benjamini & Hochberg, JRSS B 57, 1995.
    """
    levels = [p for p in dict.fromkeys(runs.loc[runs["method"] == "huber", "p"]) if p > 0]
    peers = [m for m in estimators.METHODS if m not in ("oracle", *SLOW)]
    chosen = runs[runs["p"].isin(levels)]
    ours = chosen[chosen["method"] == online_variants.NAME].set_index(["p", "seed"])["pose_rmse"]
    chosen = chosen.join(ours.rename("ours"), on=["p", "seed"])
    middle = (
        (chosen["pose_rmse"] / chosen["ours"]).groupby([chosen["method"], chosen["p"]]).median()
    )
    tests = [estimators.paired(chosen, m, online_variants.NAME).set_index("p") for m in peers]
    found = np.array([test.loc[levels, "p_value"] for test in tests])
    adjusted, rows = false_discovery_control(found, axis=None), []
    for method, test, values in zip(peers, tests, adjusted.reshape(found.shape), strict=True):
        cells = []
        for p, value in zip(levels, values, strict=True):
            worse = f"{test.loc[p, 'more']:.0f} of {test.loc[p, 'n']:.0f}"
            cells += [t(middle[method, p]), worse, t(value, ".1g")]
        rows.append([methods.shown(method), *cells])
    heads = [(f"p = {p:g}", name) for p in levels for name in ("over ours", "worse in", "p-value")]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "method"), *heads]))


def counts_table(runs: pd.DataFrame, n_windows: int) -> pd.DataFrame:
    """How often who was asked, and what else was done, per p: means over worlds."""
    ours = runs[runs["method"] == online_variants.NAME]
    rows = []
    for p, group in ours.groupby("p", sort=False):
        mean = group[list(online_variants.COUNTS)].mean()
        share = 100 * sampled(group).mean() / n_windows
        rows.append([
            f"{p:g}", t(mean["mirror waits"], ".1f"), t(mean["landmark questions"], ".1f"),
            t(mean["position questions"], ".1f"), t(sampled(group).mean()), t(share, ".1f"),
            t(mean["landmark restarts"], ".1f"),
            t(mean["batch restarts"], ".1f"), t(mean["swapped"], ".0f"),
            t(mean["dropped"], ".1f"), t(group["miscredited"].mean(), ".1f"),
        ])  # fmt: skip
    heads = [
        ("", "p"), ("mirror test", "delays"), ("many starts", "landmark"), ("many starts", "robot"),
        ("nested sampling", "runs"), ("nested sampling", "% of windows"),
        ("landmarks", "taken out"), ("EM", "adopted"), ("ranges", "swapped"),
        ("ranges", "to no landmark"), ("ranges", "to a wrong one"),
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(heads))


def sampled(runs: pd.DataFrame) -> pd.Series:
    """Runs of nested sampling in every run of the online estimator, for whatever reason."""
    return (runs["landmark samples"] + runs["position samples"]).astype(float)


def ablation_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Every variant, with and without the nets of EM: ratio to the oracle, median and worst."""
    by = runs.groupby(["method", "p", "nets"])["ratio"]
    columns = [(p, nets) for p in dict.fromkeys(runs["p"]) for nets in (True, False)]
    rows = []
    for name in online_variants.PARTS:
        groups = [by.get_group((name, *column)) for column in columns]
        cells = ((_median(ratio), t(ratio.max())) for ratio in groups)
        rows.append([name, *(one for pair in cells for one in pair)])
    words = {True: "with both nets", False: "without"}
    heads = [
        (f"p = {p:g}, {words[nets]}", what) for p, nets in columns for what in ("median", "worst")
    ]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "variant"), *heads]))


def _median(values: pd.Series, fmt: str = ".2f") -> Cell | str:
    """Median over worlds with its 95 % interval."""
    return interval(summaries.median_and_interval(values), fmt)


def slip_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Odometry that slips: errors and ratio to the oracle, medians over worlds; runs lost."""
    rows = []
    for method, group in runs.groupby("method", sort=False):
        rows.append([
            methods.shown(method), _median(group["pose_rmse"]), t(group["pose_rmse"].max()),
            t(group["landmark_rmse"].median()), _median(group["ratio"]),
            cell("{:d} of {:d}", (group["ratio"] > estimators.LOST).sum(), len(group)),
        ])  # fmt: skip
    heads = ["method", "RMSE [m]", "worst [m]", "landmarks [m]", "over the oracle's", "lost"]
    return pd.DataFrame(rows, columns=heads)


def time_table(runs: pd.DataFrame) -> pd.DataFrame:
    """CPU time of a whole online run per p, median and longest, [s]."""
    ours = runs[runs["method"] == online_variants.NAME]
    rows = [
        [f"{p:g}", t(group["seconds"].median()), t(group["seconds"].max())]
        for p, group in ours.groupby("p", sort=False)
    ]
    return pd.DataFrame(rows, columns=["p", "median [s]", "longest [s]"])


ZOOM = 0.95, 1.3  # of the ratio, where what works is compared


def draw_summary(
    axes: tuple[Axes, Axes], series: dict[str, tuple[np.ndarray, np.ndarray]], fig: Figure
) -> None:
    """Ratio of the pose RMSE to the oracle's against p, key -> (P,) p and (P, 3) median, low, high.

    One is as good as knowing the associations. All methods on a logarithmic axis, and `ZOOM`.
    """
    for ax in axes:
        for key, (p, values) in series.items():
            look = methods.METHODS[key]
            middle, low, high = values.T
            # an interval that reaches zero has no lower end on a log axis
            bars = np.array([middle - np.maximum(low, 0.6 * middle), high - middle])
            ax.errorbar(p, middle, bars, ls=look.dash, color=look.colour, lw=look.width,
                        zorder=2 + look.width, elinewidth=0.4, marker=look.marker, ms=3.5,
                        mfc="none", label=look.name)  # fmt: skip
        ax.axhline(1, color=style.TRUTH, lw=0.6, zorder=1)
        ax.set(xlabel=style.WRONG_LABEL)
    axes[0].set(yscale="log", yticks=[1, 2, 5, 10, 20, 50], ylabel="pose RMSE over the oracle's")
    axes[0].set_ylim(bottom=0.9)
    axes[0].yaxis.set_major_formatter("{x:g}")
    axes[0].yaxis.set_minor_formatter(NullFormatter())
    axes[1].set(ylim=ZOOM)
    axes[0].set_title("all")
    axes[1].set_title("the same near one")
    handles, names = axes[0].get_legend_handles_labels()
    fig.legend(handles, names, loc="outside lower center", ncols=5)


def draw_kinds(ax: Axes, runs: pd.DataFrame) -> None:
    """Ours and batch EM over the oracle, like against like: a dot per world, the median a bar.

    Parameters
    ----------
    runs : of one p
    """
    for i, name in enumerate((online_variants.NAME, BATCH)):
        rows, look = runs[runs["method"] == name], methods.METHODS[name]
        for k, kind in enumerate(KINDS):
            values = np.sort(rows[kind].dropna().to_numpy())
            if len(values):
                place = k + 0.4 * i - 0.2 + 0.24 * (np.arange(len(values)) / len(values) - 0.5)
                ax.plot(place, values, "o", ms=2.2, mew=0, color=look.colour, alpha=0.6)
                ax.plot([place[0], place[-1]], [np.median(values)] * 2, color=look.colour, lw=2,
                        label=look.name if k == 0 else None)  # fmt: skip
    ax.axhline(1, color=style.TRUTH, lw=0.6, zorder=1)
    ax.set(yscale="log", yticks=[1, 1.5, 2, 3, 5], xticks=range(len(KINDS)))
    ax.set(ylabel="error over the oracle's of the same kind")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.set_xticklabels([name.replace(", ", "\n") for name in KINDS.values()])
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)


def draw_ablation(axes: list[Axes], runs: pd.DataFrame) -> None:
    """Ratio to the oracle of each variant, with and without the nets of EM: a dot per world."""
    names = list(online_variants.PARTS)
    for ax, nets in zip(axes, (True, False), strict=True):
        rows = runs[(runs["nets"] == nets) & runs["method"].isin(names)]
        place = [-names.index(name) for name in rows["method"]]
        ax.plot(rows["ratio"], place, "o", ms=2.8, mfc="none", mew=0.6, color=style.ESTIMATE)
        middle = rows.groupby("method")["ratio"].median()
        ax.plot(middle[names], -np.arange(len(names)), "|", ms=11, mew=1.5, color=style.TRUTH)
        ax.axvline(1, color=style.TRUTH, lw=0.6, zorder=1)
        ax.set(xlabel="pose RMSE over the oracle's", xscale="log", xlim=(0.5, 100))
        ax.set_title("with the safety nets" if nets else "without them")
        ax.grid(axis="y", lw=0.3)
    shown = ["whole method" if name == online_variants.NAME else name for name in names]
    axes[0].set_yticks(-np.arange(len(names)), shown)
    axes[1].set_yticks(-np.arange(len(names)), [])


ASKED, NESTED = ("landmark questions", ".1f"), ("nested", ".2f")
OURS = {  # what the paper's text quotes beside the `KINDS`, level -> (column, format)
    0.0: (ASKED, NESTED), 0.1: (NESTED,), 0.4: (("nees", ".2f"), ASKED), 0.5: (NESTED,),
}  # fmt: skip


def record(
    config: Config, runs: pd.DataFrame, ablation: pd.DataFrame, slips: pd.DataFrame,
    to: report.Report,
) -> None:  # fmt: skip
    """Hand on one number per world of each method and level, and what the paper's text quotes."""
    to.value("online.n_seeds", config.n_seeds, ".0f")
    to.value("online.n_ablation", ablation["seed"].nunique(), ".0f")
    to.value("online.n_slip", config.n_slip, ".0f")
    n_windows = windows.n_windows(config.n_poses)
    ours = runs[runs["method"] == online_variants.NAME]
    for p, rows in ours.groupby("p", sort=False):
        rows = rows.assign(nested=sampled(rows))
        for name, fmt in (*((kind, ".3f") for kind in KINDS), *OURS.get(p, ())):
            to.sample(f"online.p{p:g}.{name.replace(' ', '_')}", rows[name].astype(float), fmt)
        if NESTED in OURS.get(p, ()):
            to.sample(f"online.p{p:g}.windows", 100 * rows["nested"] / n_windows, ".1f", "%")
    for (method, p), rows in runs[~runs["method"].isin([online_variants.NAME, "oracle"])].groupby([
        "method",
        "p",
    ]):
        for name in ("ratio", "landmark_ratio", "filtered") if method == BATCH else ("ratio",):
            if rows[name].notna().all():
                to.sample(f"online.{method}.p{p:g}.{name}", rows[name])
    to.sample("online.oracle.p0.4.nees", runs.query("method == 'oracle' and p == 0.4")["nees"])
    for (name, p, nets), rows in ablation.groupby(["method", "p", "nets"]):
        here = f"online.ablation.p{p:g}.{name.replace(' ', '_')}"
        to.sample(f"{here}.{'nets' if nets else 'bare'}", rows["ratio"])
    to.value("online.worst", ours["ratio"].max(), n=len(ours), within=0.2)
    batch = runs[runs["method"] == estimators.BATCH]
    to.value("online.batch.largest_mean", batch.groupby("p")["ratio"].mean().max(), ".3f",
             within=0.05)  # fmt: skip
    for method, rows in slips[slips["method"] != "oracle"].groupby("method"):
        to.sample(f"online.slip.{method}.ratio", rows["ratio"])
        to.sample(f"online.slip.{method}.rmse", rows["pose_rmse"], unit="m")
    lost = (slips.loc[slips["method"] == online_variants.NAME, "ratio"] > estimators.LOST).sum()
    to.value("online.slip.online.lost", lost, ".0f", n=config.n_slip, within=2)
