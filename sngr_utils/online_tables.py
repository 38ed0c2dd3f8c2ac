"""The tables and series of notebook 08, from the data frames of `online_study`."""

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control

from sngr_utils import report, style
from sngr_utils.experiments import estimators, online_variants
from sngr_utils.experiments.estimators import BATCH
from sngr_utils.metrics import summaries

LOST = 1.5  # times the oracle's RMSE, above which a run counts as lost
t = report.text


def summary_series(
    runs: pd.DataFrame, names: dict[str, str]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Name -> (P,) p and (P, 3) mean, low, high of the ratio to the oracle.

    Parameters
    ----------
    names : what to call some of the methods
    """
    table = summaries.summary(runs[runs["method"] != "oracle"], "ratio", by=["method", "p"])
    return {
        names.get(method, style.method_name(method)): (
            group["p"].to_numpy(), group[["mean", "low", "high"]].to_numpy()
        )
        for method, group in table.groupby("method", sort=False)
    }  # fmt: skip


def goal_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Ours, online and batch, and the oracle, per p: ratio mean and worst, NEES, errors."""
    rows = []
    by = runs.set_index(["method", "p"]).sort_index()
    for p in dict.fromkeys(runs["p"]):
        ours, batch, oracle = (by.loc[(m, p)] for m in (online_variants.NAME, BATCH, "oracle"))
        rows.append([
            f"{p:g}", t(oracle["pose_rmse"].mean(), ".3f"), t(ours["ratio"].mean(), ".3f"),
            t(ours["ratio"].max()), t((ours["graph_rmse"] / ours["oracle_rmse"]).mean()),
            t(batch["ratio"].mean(), ".3f"), t(batch["ratio"].max()),
            t(ours["nees"].mean()), t(oracle["nees"].mean()),
            t(ours["filtered_rmse"].mean(), ".3f"), t(ours["p_found"].mean()),
        ])  # fmt: skip
    heads = ["p", "oracle RMSE [m]", "online: ratio", "worst", "its graph", "batch: ratio", "worst",
             "NEES online", "NEES oracle", "filtered RMSE [m]", "p found"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def test_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Each peer's mean ratio at each p, with the p-value of its paired difference from ours.

    Wilcoxon's signed-rank test on the pose RMSE of the same worlds, two-sided. The p-values are
    adjusted for all tests of the table, to control the false discovery rate.

    Source: Benjamini & Hochberg, JRSS B 57, 1995.
    """
    levels = [p for p in dict.fromkeys(runs.loc[runs["method"] == "huber", "p"]) if p > 0]
    peers = [m for m in estimators.METHODS if m != "oracle"]
    chosen = runs[runs["p"].isin(levels)]
    means = chosen.groupby(["method", "p"])["ratio"].mean()
    tests = [estimators.paired(chosen, m, online_variants.NAME).set_index("p") for m in peers]
    found = np.array([test.loc[levels, "p_value"] for test in tests])
    adjusted, rows = false_discovery_control(found, axis=None), []
    for method, values in zip(peers, adjusted.reshape(found.shape), strict=True):
        cells = [
            cell
            for p, value in zip(levels, values, strict=True)
            for cell in (t(means[method, p]), t(value, ".1g"))
        ]
        rows.append([style.method_name(method), *cells])
    heads = [(f"p = {p:g}", name) for p in levels for name in ("ratio", "p-value")]
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
        ("", "p"), ("mirror test", "waits"), ("many starts", "landmark"), ("many starts", "robot"),
        ("nested sampling", "runs"), ("nested sampling", "% of windows"),
        ("landmarks", "taken out"), ("EM", "adopted"), ("ranges", "swapped"),
        ("ranges", "to none"), ("ranges", "wrongly"),
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples(heads))


def sampled(runs: pd.DataFrame) -> pd.Series:
    """Runs of nested sampling in every run of the online estimator, for whatever reason."""
    return (runs["landmark samples"] + runs["position samples"]).astype(float)


def ablation_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Ratio to the oracle (mean, worst) of every variant, with and without the nets of EM."""
    by = runs[runs["method"] != "oracle"].groupby(["method", "p", "nets"])["ratio"]
    mean, worst = by.mean(), by.max()
    columns = [(p, nets) for p in dict.fromkeys(runs["p"]) for nets in (True, False)]
    rows = [
        [name, *(t(of[name, p, nets]) for p, nets in columns for of in (mean, worst))]
        for name in online_variants.PARTS
    ]
    words = {True: "with both nets", False: "without"}
    heads = [
        (f"p = {p:g}, {words[nets]}", what) for p, nets in columns for what in ("ratio", "worst")
    ]
    return pd.DataFrame(rows, columns=pd.MultiIndex.from_tuples([("", "variant"), *heads]))


def slip_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Odometry that slips: RMSE, ratio to the oracle, runs that are lost."""
    rows = []
    for method, group in runs.groupby("method", sort=False):
        lost = int((group["ratio"] > LOST).sum())
        rows.append([
            style.method_name(method), t(group["pose_rmse"].mean()), t(group["pose_rmse"].max()),
            t(group["ratio"].median()), t(group["ratio"].max()), f"{lost} of {len(group)}",
        ])  # fmt: skip
    heads = ["method", "RMSE [m]", "worst [m]", "median ratio", "worst ratio", "lost"]
    return pd.DataFrame(rows, columns=heads)


def time_table(runs: pd.DataFrame) -> pd.DataFrame:
    """CPU time of a whole online run per p, median and longest, [s]."""
    ours = runs[runs["method"] == online_variants.NAME]
    rows = [
        [f"{p:g}", t(group["seconds"].median()), t(group["seconds"].max())]
        for p, group in ours.groupby("p", sort=False)
    ]
    return pd.DataFrame(rows, columns=["p", "median [s]", "longest [s]"])
