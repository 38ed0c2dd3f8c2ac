"""The tables and figures of notebook 05, and what it records.

More than 300 lines, for the notebook has twenty tables.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from sngr_utils.audit import NOOP_P, Config
from sngr_utils.experiments import isam2_over_worlds
from sngr_utils.experiments.window_studies import WindowStudies
from sngr_utils.metrics import standard_error, summaries
from sngr_utils.publish import report
from sngr_utils.publish.cells import NONE, interval, text
from sngr_utils.show import methods, style
from sngr_utils.show.common import legend_above
from sngr_utils.show.style import WRONG_LABEL

t = text


def by_preset(
    frame: pd.DataFrame, value: str, fmt: str = ".2f", printed: dict | None = None
) -> pd.DataFrame:
    """Mean and 95 % interval of a column, p down and presets across, beside printed values."""
    table = summaries.summary(frame, value)
    presets, rows = list(dict.fromkeys(table["preset"])), []
    for p, group in table.groupby("p", sort=False):
        cells = [interval(row, fmt) for _, row in group.iterrows()]
        rows.append([f"{p:g}", *([t(printed.get(p), fmt)] if printed is not None else []), *cells])
    heads = ["p", *(["printed"] if printed is not None else []), *presets]
    return pd.DataFrame(rows, columns=heads)


def detection_table(detections: pd.DataFrame, runs: pd.DataFrame, tau: float) -> pd.DataFrame:
    """Triggers, precision, how far it is above the base rate of the same worlds, recall, MCC."""
    at = detections[np.isclose(detections["tau"], tau)].reset_index(drop=True)
    at = at.assign(above=summaries.precision_over_base(at, runs))
    names = {"triggered": ".1f", "precision": ".2f", "above": ".3f", "recall": ".2f", "mcc": ".2f"}
    columns = {name: summaries.summary(at, name) for name in names}
    rates = summaries.summary(runs, "base_rate")
    rows = []
    for i, row in rates.iterrows():
        cells = [interval(columns[name].loc[i], fmt) for name, fmt in names.items()]
        rows.append([row["preset"], f"{row['p']:g}", *cells[:2], t(row["mean"]), *cells[2:]])
    heads = ["preset", "p", "triggered", "precision", "base rate", "above base rate, paired",
             "recall", "MCC"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def silent_table(detections: pd.DataFrame) -> pd.DataFrame:
    """Share of clean worlds in which nothing fires, and the most that fire, per threshold."""
    clean = detections[detections["p"] == 0]
    rows = []
    for tau, at in clean.groupby("tau"):
        cells = []
        for _, group in at.groupby("preset"):
            silent = int((group["triggered"] == 0).sum())
            cells.append(f"{silent} of {len(group)} ({group['triggered'].max()})")
        rows.append([t(tau), *cells])
    heads = [
        "tau",
        *(f"{name}: silent worlds (most triggers)" for name in sorted(set(clean["preset"]))),
    ]
    return pd.DataFrame(rows, columns=heads)


def auc_table(rows: pd.DataFrame) -> pd.DataFrame:
    """`isam2_over_worlds.auc_rows` as text."""
    shown = [
        [
            row["preset"], f"{row['p']:g}", t(row["pooled"]),
            interval(row.rename({"within": "mean", "worlds": "n"})),
            str(row["worlds"]), t(row["average_precision"]), t(row["base_rate"]),
        ]
        for _, row in rows.assign(missing=0).iterrows()
    ]  # fmt: skip
    heads = ["preset", "p", "pooled AUC", "AUC within worlds", "worlds", "average precision",
             "base rate"]  # fmt: skip
    return pd.DataFrame(shown, columns=heads)


def units_table(scores: pd.DataFrame) -> pd.DataFrame:
    """What the score becomes in centimetres, and how constant its smaller eigenvalue is."""
    rows = []
    for preset, found in scores.query("eligible").groupby("preset", sort=False):
        shift = found["score_cm"] - found["score"]
        low = found["log_lambda_min"]
        correlation = np.corrcoef(found["score"], found["log_lambda_max"])[0, 1]
        rows.append([
            preset, f"{t(shift.min(), '.3f')} to {t(shift.max(), '.3f')}",
            f"{t(low.mean(), '.3f')} ± {t(low.std(), '.3f')}", t(correlation, ".4f"),
        ])  # fmt: skip
    heads = ["preset", "score in cm less in m", "log10 smallest eigenvalue",
             "correlation of score and log10 largest"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def gains_table(refined: pd.DataFrame) -> pd.DataFrame:
    """What refinement does, per preset and p.

    Gains are medians, over worlds where anything fires, of each world's least, median and
    largest; so is the change of the RMSE, over all worlds, also those where nothing fires, beside
    the worlds in which it falls and rises and the p-value of the sign test.
    """
    rows = []
    for (preset, p), group in refined.groupby(["preset", "p"], sort=False):
        change = 1e3 * (group["sngr_pose_rmse"] - group["base_pose_rmse"])
        less, more, p_value = summaries.sign_test(1e-3 * change.to_numpy())
        share = group["accepted"].sum() / max(group["triggered"].sum(), 1)
        rows.append([
            preset, f"{p:g}", t(group["triggered"].mean(), ".1f"), t(100 * share, ".0f"),
            t(group["gain_min"].median(), ".3f"), t(group["gain_median"].median(), ".3f"),
            t(group["gain_max"].median(), ".2f"),
            interval(summaries.median_and_interval(change), ".1f"),
            f"{less} / {more}", t(p_value, ".2g"),
        ])  # fmt: skip
    heads = ["preset", "p", "refined, mean", "accepted [%]", "least gain [nats]",
             "median gain [nats]", "largest gain [nats]", "RMSE change [mm]",
             "better / worse", "p-value"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def corrected_table(table: pd.DataFrame) -> pd.DataFrame:
    """The paper's SNGR and both corrected versions on the same worlds."""
    rows = []
    for (p, preset, variant), group in table.groupby(["p", "preset", "variant"]):
        settled = 1e3 * (group["base_pose_rmse"] - group["isam2_pose_rmse"])
        refined = 1e3 * (group["sngr_pose_rmse"] - group["base_pose_rmse"])
        share = group["accepted"].sum() / max(group["triggered"].sum(), 1)
        rows.append([
            f"{p:g}", preset, variant, t(100 * share, ".0f"),
            t(group["gain_median"].median(), ".3f"), t(group["gain_max"].median(), ".3f"),
            interval(summaries.median_and_interval(settled), ".0f") if variant != "paper" else NONE,
            interval(summaries.median_and_interval(refined), ".1f"),
            t(group["sngr_nees"].median(), ".1f"),
        ])  # fmt: skip
    heads = ["p", "preset", "version", "accepted [%]", "median gain [nats]", "largest gain [nats]",
             "settling: RMSE change [mm]", "refining: RMSE change [mm]", "NEES"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def widths_table(widths: pd.DataFrame) -> pd.DataFrame:
    """Sampled standard deviation over the conditional and the marginal one; errors over worlds."""
    rows = []
    for reading, group in widths.groupby("reading", sort=False):
        worlds = group.groupby("seed")[["over_conditional", "over_marginal"]].mean()
        cells = [mean_and_error(worlds[name], ".3f") for name in worlds]
        rows.append([reading, cells[0], t(group["predicted_conditional"].mean(), ".3f"), cells[1]])
    heads = ["target", "over conditional", "predicted, Gaussian", "over marginal"]
    return pd.DataFrame(rows, columns=heads)


def ratios_table(ratios: pd.DataFrame) -> pd.DataFrame:
    """Marginal over conditional standard deviation: median and largest over windows."""
    rows = [
        [preset, *(f"{t(group[name].median(), '.1f')} ({t(group[name].max(), '.1f')})"
                   for name in ("geometric_mean", "largest_direction"))]
        for preset, group in ratios.groupby("preset")
    ]  # fmt: skip
    heads = ["preset", "geometric mean: median (largest)", "widest direction: median (largest)"]
    return pd.DataFrame(rows, columns=heads)


def convergence_table(gains: pd.DataFrame) -> pd.DataFrame:
    """Median attainable gain of a window, [nats], as the estimate is settled more and more."""
    bases = list(dict.fromkeys(gains["base"]))
    rows = []
    for preset, group in gains.groupby("preset"):
        medians = group.groupby("base")["gain"].median()
        rows.append([preset, *(t(medians[base], ".3f") for base in bases)])
    heads = ["preset", *(f"{base} more updates" if base != "batch" else base for base in bases)]
    return pd.DataFrame(rows, columns=heads)


def gaussianity_table(found: pd.DataFrame) -> pd.DataFrame:
    """Importance sampling less Laplace evidence, [nats]."""
    rows = []
    for (separators, preset), group in found.groupby(["separators", "preset"]):
        used = group.dropna()
        beyond = int((used["difference"].abs() > 3 * used["error"]).sum())
        rows.append([
            separators, preset, str(len(group)), str(len(group) - len(used)),
            t(used["difference"].mean(), ".4f"), t(used["difference"].abs().max(), ".3f"),
            t(used["error"].mean(), ".4f"), str(beyond), str(int((group["modes"] > 1).sum())),
        ])  # fmt: skip
    heads = ["separators", "preset", "windows", "left out", "mean [nats]", "largest",
             "standard error", "beyond 3 errors", "more than one mode"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def ess_table(ess: pd.DataFrame) -> pd.DataFrame:
    """ESS shares of windows and of exact Gaussians of the same covariances; errors over worlds."""
    worlds = ess.groupby(["scale", "kind", "seed"])["ess_share"].mean()
    rows = [
        [
            f"{scale:g}",
            *(mean_and_error(worlds[scale, kind], ".3f") for kind in ("Gaussian", "window")),
        ]
        for scale in worlds.index.unique("scale")
    ]
    return pd.DataFrame(rows, columns=["c", "exact Gaussian", "window"])


def evidence_table(checks: pd.DataFrame) -> pd.DataFrame:
    """Nested sampling of the corrected target less importance sampling, [nats]."""
    rows = []
    for (separators, d), group in checks.groupby(["separators", "dimension"]):
        in_errors = group["in_errors"].abs()
        rows.append([
            separators, str(d), str(len(group)), mean_and_error(group["difference"], ".3f"),
            t(in_errors.max(), ".1f"), str(int((in_errors > 3).sum())),
            t(float(np.exp(np.log(group["sd_ratio"]).mean()))),
        ])  # fmt: skip
    heads = ["separators", "d", "windows", "mean difference [nats]", "largest, in errors",
             "beyond 3 errors", "sd ratio"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def mean_and_error(values: pd.Series, fmt: str = ".2f") -> str:
    """ "mean ± standard error" """
    return f"{t(float(values.mean()), fmt)} ± {t(standard_error.standard_error(values), fmt)}"


def nees_table(nees: pd.DataFrame) -> pd.DataFrame:
    """NEES on clean data: mean of the x0 prior, frame of P, preset."""
    table = summaries.summary(nees, "nees", by=["x0_mean", "frame", "preset"])
    rows = [
        [mean, frame, *(interval(row) for _, row in group.iterrows())]
        for (mean, frame), group in table.groupby(["x0_mean", "frame"], sort=False)
    ]
    return pd.DataFrame(
        rows, columns=["x0 prior centred on", "frame of P", *dict.fromkeys(table["preset"])]
    )


def robust_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Mean pose RMSE with its interval, and landmark RMSE, per method and start, [m]."""
    levels = list(dict.fromkeys(runs["p"]))
    poses = summaries.summary(runs, "pose_rmse", by=["start", "method", "p"])
    last = runs[runs["p"] == levels[-1]].groupby(["start", "method"])["landmark_rmse"].mean()
    rows = []
    for (start, method), group in poses.groupby(["start", "method"], sort=False):
        cells = [interval(row) for _, row in group.iterrows()]
        rows.append([
            methods.shown(method),
            start.replace("_", " "),
            *cells,
            t(last[start, method]),
        ])
    heads = ["method", "start", *(f"p = {p:g}" for p in levels), f"landmarks, p = {levels[-1]:g}"]
    return pd.DataFrame(rows, columns=heads)


def readings_table(readings: pd.DataFrame) -> pd.DataFrame:
    """Mean of every reading with its standard error, and its range: over worlds, or over runs."""
    if "seed" in readings:
        readings = readings.drop(columns=["window", "preset"]).groupby("seed").mean()
    rows = [
        [name, f"{t(x.mean(), '.4g')} ± {t(standard_error.standard_error(x), '.2g')}",
         f"{t(x.min(), '.4g')} to {t(x.max(), '.4g')}"]
        for name, x in readings.items()
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=["reading", "ours", "range"])


def curve_series(frame: pd.DataFrame, value: str) -> dict[str, tuple[np.ndarray, ...]]:
    """preset -> p, mean, low, high for `common.draw_intervals`."""
    table = summaries.summary(frame, value)
    return {
        preset: tuple(group[name].to_numpy() for name in ("p", "mean", "low", "high"))
        for preset, group in table.groupby("preset", sort=False)
    }


def robust_series(runs: pd.DataFrame, start: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """key of a method -> p and mean pose RMSE [m], from one start, beside dead reckoning."""
    chosen = runs[runs["start"].isin([start, "none"])]
    means = chosen.groupby(["method", "p"], sort=False)["pose_rmse"].mean()
    return {
        method: (group.index.get_level_values("p").to_numpy(), group.to_numpy())
        for method, group in means.groupby(level="method", sort=False)
    }


def record(
    config: Config,
    sweep: isam2_over_worlds.Sweep,
    refined: pd.DataFrame,
    gaussian_ess: pd.DataFrame,
    to: report.Report,
) -> None:
    """Hand on one number per world for every claim (``paper/claims.yaml``)."""
    to.value("audit.n_seeds", config.n_seeds, ".0f")
    for (preset, p), rows in sweep.runs.groupby(["preset", "p"], sort=False):
        here = f"audit.{preset}.p{p:g}"
        for name in ("pose_rmse", "nees", "failed", "base_rate"):
            to.sample(f"{here}.{name}", rows[name].astype(float))
    for (preset, p, tau), rows in sweep.detections.groupby(["preset", "p", "tau"], sort=False):
        here = f"audit.{preset}.p{p:g}.tau{tau:g}"
        for name in ("triggered", "precision", "recall", "tp", "fp", "fn"):
            to.sample(f"{here}.{name}", rows[name].astype(float))
        to.sample(f"{here}.precision_over_base", summaries.precision_over_base(rows, sweep.runs))
    medians = sweep.scores.groupby(["preset", "p", "seed"], sort=False)["score"].median()
    for (preset, p), values in medians.groupby(level=["preset", "p"], sort=False):
        to.sample(f"audit.{preset}.p{p:g}.median_score", values)
    kept = ("sngr_pose_rmse", "sngr_landmark_rmse", "sngr_nees", "saving", "gain_min", "gain_max",
            "gain_peak_window", "ess_share")  # fmt: skip
    for (preset, p), rows in refined.groupby(["preset", "p"], sort=False):
        for name in kept:
            to.sample(f"audit.{preset}.p{p:g}.{name}", rows[name].astype(float))
        if p == NOOP_P:
            to.sample(f"audit.{preset}.noop", rows["noop"].astype(float))
    for preset, rows in gaussian_ess.groupby("preset", sort=False):
        key = f"audit.{preset}.p{config.p_windows:g}.gaussian_ess_share"
        to.sample(key, rows["ess_share"])


def record_findings(
    studies: WindowStudies, nees: pd.DataFrame, robust_runs: pd.DataFrame, to: report.Report
) -> None:
    """Hand on the numbers that the paper's text quotes; errors are those over worlds."""

    def sample(key, values, fmt=".2f", unit=""):
        values = np.asarray(values, dtype=float)
        error = standard_error.standard_error(values)
        to.value(key, float(values.mean()), fmt, unit, error, len(values))

    for reading, rows in studies.widths.groupby("reading"):
        by_world = rows.groupby("seed")
        sample(f"widths.{reading}.conditional", by_world["over_conditional"].mean(), ".3f")
        sample(f"widths.{reading}.marginal", by_world["over_marginal"].mean(), ".3f")
    largest = studies.ratios["largest_direction"]
    to.value("widths.largest_direction", largest.max(), ".0f", n=len(largest))
    for separators, rows in studies.gaussianity.groupby("separators"):
        near = rows["difference"].abs() <= 3 * rows["error"]
        to.value(f"gaussian.{separators}.windows", len(rows), ".0f")
        to.value(f"gaussian.{separators}.near", near.sum(), ".0f", within=6)
        to.value(f"gaussian.{separators}.largest", rows["difference"].abs().max(), ".3f", "nats",
                 n=len(rows), within=0.05)  # fmt: skip
    for separators, rows in studies.evidence.groupby("separators"):
        sample(f"evidence.{separators}.bias", rows["difference"], ".2f", "nats")
        to.value(f"evidence.{separators}.largest", rows["in_errors"].abs().max(), ".1f",
                 n=len(rows), within=1.5)  # fmt: skip
    shares = studies.ess.groupby(["kind", "scale", "seed"])["ess_share"].mean()
    for (kind, scale), values in shares.groupby(level=["kind", "scale"]):
        sample(f"ess.{kind}.c{scale:g}", 100 * values, ".1f", "%")
    for (preset, mean), rows in nees.query("frame == 'world'").groupby(["preset", "x0_mean"]):
        sample(f"nees.{preset}.{mean}", rows["nees"])
    for (method, start, p), rows in robust_runs.groupby(["method", "start", "p"]):
        sample(f"robust.{method}.{start}.p{p:g}", rows["pose_rmse"], unit="m")


def draw_detection_curves(axes: Sequence[Axes], curves: dict[str, tuple]) -> None:
    """ROC (left) and precision-recall curves (right); dotted: what firing at random gives."""
    looks = zip(curves.items(), style.SEQUENCE, strict=False)
    for (name, (roc, precision_recall, base_rate)), colour in looks:
        axes[0].plot(*roc, color=colour, label=name)
        axes[1].plot(*precision_recall, color=colour)
        axes[1].axhline(base_rate, color=colour, lw=0.6, ls=":")
    axes[0].plot([0, 1], [0, 1], ":", color=style.TRUTH, lw=0.6)
    axes[0].set(xlabel="false positive rate", ylabel="true positive rate", aspect="equal")
    axes[1].set(xlabel="recall", ylabel="precision", ylim=(0, 1.02))
    legend_above(axes[0], ncols=2)


def draw_robust(ax: Axes, series: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Mean pose RMSE [m] against p, log scale: key of a method -> (p, rmse)."""
    for key, (p, rmse) in series.items():
        look = methods.METHODS[key]
        ax.semilogy(p, rmse, look.dash, marker=look.marker, mfc="none", color=look.colour,
                    label=look.name)  # fmt: skip
    ax.set(xlabel=WRONG_LABEL, ylabel="pose RMSE [m]")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    legend_above(ax, ncols=3)
