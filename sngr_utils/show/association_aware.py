"""The tables and figures of notebook 08, and what it records."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from scipy.stats import false_discovery_control

from sngr_utils.association_aware import Config
from sngr_utils.experiments import estimators, online_variants
from sngr_utils.experiments.estimators import BATCH
from sngr_utils.metrics import summaries
from sngr_utils.publish import report
from sngr_utils.publish.cells import cell, number
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
             "NEES online", "NEES oracle", "filtered RMSE [m]", "p, estimated"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def test_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Each peer's pose RMSE over ours on the same world: median, worlds where above, p-value.

    The sign test, two-sided, which skewed differences do not mislead. The p-values are adjusted
    for all tests of the table, to control the false discovery rate; the levels of p are looks at
    the same worlds, so they are not independent.

    Source: Benjamini & Hochberg, JRSS B 57, 1995.
    """
    levels = [p for p in dict.fromkeys(runs.loc[runs["method"] == "huber", "p"]) if p > 0]
    peers = [m for m in estimators.METHODS if m != "oracle"]
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
        rmse, ratio = group["pose_rmse"], group["ratio"]
        rows.append([
            methods.shown(method), t(rmse.mean()), t(rmse.max()), t(ratio.median()),
            t(ratio.max()), cell("{:d} of {:d}", (ratio > estimators.LOST).sum(), len(group)),
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


# what `draw_summary` shows by a line of its own; all others are one grey band
NAMED = ("sngr", "isam2", "least_squares", "dead_reckoning", "huber", "fastslam",
         "max_mixture_all", "em", "em_exclusive", online_variants.NAME)  # fmt: skip
FORGETTING = "seven that forget"  # redescending losses, switches, max-mixture with a null


def draw_frame(ax: Axes, frame) -> None:
    """What is believed at one pose (`online_variants.Frame`), and the ranges of that pose.

    A line goes from the pose to the landmark that a range is credited to: green if that is its
    label's, orange if it was swapped; red and dotted to its label's if it is not associated.
    """
    for cloud in frame.clouds.values():
        ax.plot(*cloud.T, ".", ms=0.8, color=style.PRIOR, alpha=0.4)
    ax.plot(*frame.truth.T, "-", lw=2.5, color="0.8")
    ax.plot(*frame.plain.T, ":", color=style.ESTIMATE)
    ax.plot(*frame.poses.T, "-", color=style.TRUTH, lw=0.9)
    ax.plot(*frame.true_landmarks.T, "+", ms=6, mew=0.6, color=style.TRUTH)
    ax.plot(*frame.landmarks.T, "^", mfc="none", ms=5, color=style.LANDMARK)
    here = frame.poses[-1]
    for label, used in zip(frame.label_of, frame.used, strict=True):
        colour, dash, end = style.SAMPLES, "-", frame.landmarks[used]
        if used < 0:
            colour, dash, end = style.TRIGGERED, ":", frame.true_landmarks[label]
        elif used != label:
            colour = style.LANDMARK
        ax.plot(*np.array([here, end]).T, dash, color=colour, lw=0.7)
    ax.plot(*here, "o", color=style.TRUTH)
    ax.set(xlim=(-7.5, 7.5), ylim=(-7.5, 7.5), aspect="equal", xticks=[], yticks=[])
    ax.set_title(f"pose {len(frame.poses) - 1}")


def film_legend() -> list[Line2D]:
    """What the marks of `draw_frame` mean."""
    looks = {
        "true path": {"lw": 2.5, "color": "0.8"},
        "ours": {"color": style.TRUTH},
        "plain iSAM2": {"ls": ":", "color": style.ESTIMATE},
        "landmark": {"ls": "", "marker": "+", "color": style.TRUTH},
        "ours, started": {"ls": "", "marker": "^", "mfc": "none", "color": style.LANDMARK},
        "posterior of one that waits": {"ls": "", "marker": ".", "color": style.PRIOR},
        "range, label kept": {"color": style.SAMPLES},
        "swapped": {"color": style.LANDMARK},
        "credited to none": {"ls": ":", "color": style.TRIGGERED},
    }
    return [Line2D([], [], label=label, **look) for label, look in looks.items()]


def draw_summary(ax: Axes, series: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Ratio of the pose RMSE to the oracle's against p, key -> (P,) p and (P, 3) median, low, high.

    One is as good as knowing the associations. The legend is in the order of the last points.
    """
    grey = [series[key] for key in series if key not in NAMED]
    handles = {}
    for p, values in grey:
        ax.plot(p, values[:, 0], color=style.PRINTED, lw=0.7)
        handles[FORGETTING] = Line2D([], [], color=style.PRINTED, lw=0.7), values[-1, 0]
    for key, (p, values) in series.items():
        if key in NAMED:
            look = methods.METHODS[key]
            mean, low, high = values.T
            # an interval that reaches zero has no lower end on a log axis
            bars = np.array([mean - np.maximum(low, 0.6 * mean), high - mean])
            bar = ax.errorbar(p, mean, bars, ls=look.dash, color=look.colour, lw=look.width,
                              zorder=2 + look.width, elinewidth=0.6, marker=look.marker, ms=3.5,
                              mfc="none")  # fmt: skip
            handles[look.name] = bar, mean[-1]
    ax.axhline(1, color=style.TRUTH, lw=0.6, zorder=1)
    ax.set(yscale="log", xlabel="share of wrong associations p", yticks=[1, 2, 5, 10, 20, 50])
    ax.set(ylabel="pose RMSE over the oracle's")
    ax.set_ylim(bottom=0.9)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    order = sorted(handles, key=lambda name: -handles[name][1])
    ax.legend([handles[name][0] for name in order], order, loc="lower center", ncols=3,
              bbox_to_anchor=(0.45, 1), fontsize=6.5, columnspacing=1)  # fmt: skip


def draw_posteriors(ax: Axes, panel) -> None:
    """A landmark's posterior after a few poses: (P, 2) places, poses, landmark, mass of a mode."""
    cloud, positions, landmark, mass = panel
    ax.plot(*cloud.T, ".", ms=0.8, color=style.PRIOR, alpha=0.5)
    ax.plot(*positions.T, "o-", color=style.TRUTH, ms=2.5)
    ax.plot(*landmark, "+", ms=8, color=style.TRUTH)
    ax.set(xlim=(-2, 12), ylim=(-6, 8), aspect="equal", xticks=[], yticks=[])
    ax.set_title(f"{len(positions)} poses: first mode {mass:.2f}")


# What the paper's text quotes: of ours, level -> (column, format); of the others, level -> methods.
ASKED, NESTED = ("landmark questions", ".1f"), ("nested", ".2f")
OURS = {
    0.0: (("ratio", ".3f"), ASKED, NESTED),
    0.1: (NESTED,),
    0.2: (("ratio", ".3f"),),
    0.4: (("ratio", ".3f"), ("nees", ".2f"), ASKED, ("graph", ".3f")),
    0.5: (("ratio", ".3f"), NESTED),
}
OTHERS = {
    0.4: ("cauchy", "em", "em_exclusive", "fastslam", "huber", "isam2", "max_mixture_all",
          "switchable"),
    0.5: ("em", "em_exclusive", "max_mixture_all"),
}  # fmt: skip


def record(config: Config, runs: pd.DataFrame, slips: pd.DataFrame, to: report.Report) -> None:
    """Hand on the numbers that the paper's text quotes."""
    to.value("online.n_seeds", config.n_seeds, ".0f")
    to.value("online.n_ablation", config.n_ablation, ".0f")
    to.value("online.n_slip", config.n_slip, ".0f")
    n_windows = windows.n_windows(config.n_poses)
    ours = runs[runs["method"] == online_variants.NAME]
    for p, rows in ours.groupby("p", sort=False):
        rows = rows.assign(nested=sampled(rows), graph=rows["graph_rmse"] / rows["oracle_rmse"])
        for name, fmt in OURS.get(p, ()):
            to.sample(f"online.p{p:g}.{name.replace(' ', '_')}", rows[name].astype(float), fmt)
        if NESTED in OURS.get(p, ()):
            to.sample(f"online.p{p:g}.windows", 100 * rows["nested"] / n_windows, ".1f", "%")
    for (method, p), rows in runs.groupby(["method", "p"]):
        if method in OTHERS.get(p, ()):
            to.sample(f"online.{method}.p{p:g}.ratio", rows["ratio"])
        if (method, p) == ("oracle", 0.4):
            to.sample("online.oracle.p0.4.nees", rows["nees"])
    to.value("online.worst", ours["ratio"].max(), n=len(ours), within=0.2)
    batch = runs[runs["method"] == estimators.BATCH]
    to.value("online.batch.largest_mean", batch.groupby("p")["ratio"].mean().max(), ".3f",
             within=0.05)  # fmt: skip
    for method in ("online", "trusting"):
        rows = slips[slips["method"] == method]
        to.sample(f"online.slip.{method}.ratio", rows["ratio"])
        to.sample(f"online.slip.{method}.rmse", rows["pose_rmse"], unit="m")
    lost = (slips.loc[slips["method"] == online_variants.NAME, "ratio"] > estimators.LOST).sum()
    to.value("online.slip.online.lost", lost, ".0f", n=config.n_slip, within=2)
