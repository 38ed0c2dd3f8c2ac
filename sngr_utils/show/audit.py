"""The tables of notebook 05; see `audit_figures` for its figures, `audit_values` for the rest."""

import numpy as np
import pandas as pd

from sngr_utils.experiments.window_studies import WindowStudies
from sngr_utils.metrics import standard_error, summaries
from sngr_utils.publish.cells import NONE, Cell, cell, interval, mean_error, number, with_error
from sngr_utils.show import methods

t = number

WIDTHS = ("as printed", "with the whole likelihood", "and the prior divided out")
SEPARATORS = {"conditional": "neighbours held", "marginal": "neighbours integrated out"}


def by_preset(
    frame: pd.DataFrame, value: str, fmt: str = ".2f", printed: dict | None = None
) -> pd.DataFrame:
    """Mean and 95 % interval of a column, p down and presets across, beside printed values."""
    table = summaries.summary(frame, value)
    return pd.DataFrame([
        {"p": f"{p:g}"}
        | ({} if printed is None else {"printed": t(printed.get(p), fmt)})
        | {row["preset"]: interval(row, fmt) for _, row in group.iterrows()}
        for p, group in table.groupby("p", sort=False)
    ])


def detection_table(detections: pd.DataFrame, runs: pd.DataFrame, tau: float) -> pd.DataFrame:
    """Triggers, precision, how far it is above the base rate of the same worlds, recall, MCC."""
    at = detections[np.isclose(detections["tau"], tau)].reset_index(drop=True)
    at = at.assign(above=summaries.precision_over_base(at, runs))
    names = {"triggered": ".1f", "precision": ".2f", "above": ".3f", "recall": ".2f", "mcc": ".2f"}
    columns = {name: summaries.summary(at, name) for name in names}
    rates = summaries.summary(runs, "base_rate")
    rows = []
    for i, row in rates.iterrows():
        shown = [interval(columns[name].loc[i], fmt) for name, fmt in names.items()]
        rows.append([row["preset"], f"{row['p']:g}", *shown[:2], t(row["mean"]), *shown[2:]])
    heads = ["preset", "p", "triggered", "precision", "base rate", "above base rate, paired",
             "recall", "MCC"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def silent_table(detections: pd.DataFrame) -> pd.DataFrame:
    """Share of clean worlds in which nothing fires, and the most that fire, per threshold."""
    rows = []
    for tau, at in detections[detections["p"] == 0].groupby("tau"):
        rows.append({"tau": t(tau)})
        for preset, fired in at.groupby("preset")["triggered"]:
            silent = cell("{:d} of {:d} ({:d})", (fired == 0).sum(), len(fired), fired.max())
            rows[-1][f"{preset}: silent worlds (most triggers)"] = silent
    return pd.DataFrame(rows)


def words_table(detections: pd.DataFrame, tau: float) -> pd.DataFrame:
    """In how many worlds the trigger is silent on clean data, and blind at the least p."""
    at = detections[np.isclose(detections["tau"], tau)]
    least = at.loc[at["p"] > 0, "p"].min()
    rows = []
    for preset, group in at.groupby("preset", sort=False):
        clean, noisy = group[group["p"] == 0], group[(group["p"] == least) & (group["recall"] >= 0)]
        silent, blind = clean["triggered"] == 0, noisy["recall"] == 0
        rows.append({
            "preset": preset,
            "silent on clean data": cell("{:d} of {:d}", silent.sum(), len(silent)),
            f"blind at p = {least:g}": cell("{:d} of {:d}", blind.sum(), len(blind)),
        })  # fmt: skip
    return pd.DataFrame(rows)


def auc_table(rows: pd.DataFrame) -> pd.DataFrame:
    """`isam2_over_worlds.auc_rows` as it is shown."""
    within = rows.assign(missing=0, mean=rows["within"], n=rows["worlds"])
    return pd.DataFrame({
        "preset": rows["preset"],
        "p": rows["p"].map("{:g}".format),
        "pooled AUC": rows["pooled"].map(t),
        "AUC within worlds": within.apply(interval, axis=1),
        "worlds": rows["worlds"],
        "average precision": rows["average_precision"].map(t),
        "base rate": rows["base_rate"].map(t),
    })


def units_table(scores: pd.DataFrame) -> pd.DataFrame:
    """What the score becomes in centimetres, and how constant its smaller eigenvalue is."""
    rows = []
    for preset, found in scores.query("eligible").groupby("preset", sort=False):
        shift, low = found["score_cm"] - found["score"], found["log_lambda_min"]
        correlation = np.corrcoef(found["score"], found["log_lambda_max"])[0, 1]
        rows.append({
            "preset": preset,
            "score in cm less in m": cell("{:.3f} to {:.3f}", shift.min(), shift.max()),
            "log10 smallest eigenvalue": with_error(low.mean(), low.std(), ".3f"),
            "correlation of score and log10 largest": t(correlation, ".4f"),
        })
    return pd.DataFrame(rows)


def _millimetres(group: pd.DataFrame, after: str, before: str, fmt: str) -> Cell | str:
    """Median change of the pose RMSE with its interval."""
    change = 1e3 * (group[f"{after}_pose_rmse"] - group[f"{before}_pose_rmse"])
    return interval(summaries.median_and_interval(change), fmt)


def _accepted(group: pd.DataFrame) -> Cell:
    """Share of the windows that fired, [%]"""
    return t(100 * group["accepted"].sum() / max(group["triggered"].sum(), 1), ".0f")


def gains_table(refined: pd.DataFrame) -> pd.DataFrame:
    """What refinement does, per preset and p.

    Gains are medians, over worlds where anything fires, of each world's least, median and
    largest; so is the change of the RMSE, over all worlds, also those where nothing fires, beside
    the worlds in which it falls and rises and the p-value of the sign test.
    """
    rows = []
    for (preset, p), group in refined.groupby(["preset", "p"], sort=False):
        change = group["sngr_pose_rmse"] - group["base_pose_rmse"]
        less, more, p_value = summaries.sign_test(change.to_numpy())
        rows.append({
            "preset": preset, "p": f"{p:g}",
            "refined, mean": t(group["triggered"].mean(), ".1f"),
            "accepted [%]": _accepted(group),
            "least gain [nats]": t(group["gain_min"].median(), ".3f"),
            "median gain [nats]": t(group["gain_median"].median(), ".3f"),
            "largest gain [nats]": t(group["gain_max"].median()),
            "RMSE change [mm]": _millimetres(group, "sngr", "base", ".1f"),
            "better / worse": cell("{:d} / {:d}", less, more),
            "p-value": t(p_value, ".2g"),
        })  # fmt: skip
    return pd.DataFrame(rows)


def corrected_table(table: pd.DataFrame) -> pd.DataFrame:
    """The paper's SNGR and both corrected versions on the same worlds."""
    return pd.DataFrame([
        {
            "p": f"{p:g}", "preset": preset, "version": variant,
            "accepted [%]": _accepted(group),
            "median gain [nats]": t(group["gain_median"].median(), ".3f"),
            "largest gain [nats]": t(group["gain_max"].median(), ".3f"),
            "settling: RMSE change [mm]":
                NONE if variant == "paper" else _millimetres(group, "base", "isam2", ".0f"),
            "refining: RMSE change [mm]": _millimetres(group, "sngr", "base", ".1f"),
            "NEES": t(group["sngr_nees"].median(), ".1f"),
        }
        for (p, preset, variant), group in table.groupby(["p", "preset", "variant"])
    ])  # fmt: skip


def widths_table(widths: pd.DataFrame) -> pd.DataFrame:
    """Sampled standard deviation over the conditional and the marginal one; errors over worlds."""
    rows = []
    for reading, group in widths.groupby("reading", sort=False):
        worlds = group.groupby("seed")[["over_conditional", "over_marginal"]].mean()
        rows.append({
            "target": reading,
            "over conditional": mean_error(worlds["over_conditional"], ".3f"),
            "predicted, Gaussian": t(group["predicted_conditional"].mean(), ".3f"),
            "over marginal": mean_error(worlds["over_marginal"], ".3f"),
        })
    return pd.DataFrame(rows)


def ratios_table(ratios: pd.DataFrame) -> pd.DataFrame:
    """Marginal over conditional standard deviation: median and largest over windows."""
    names = {"geometric mean": "geometric_mean", "widest direction": "largest_direction"}
    return pd.DataFrame([
        {"preset": preset}
        | {
            f"{head}: median (largest)": cell("{:.1f} ({:.1f})", group[name].median(),
                                              group[name].max())
            for head, name in names.items()
        }
        for preset, group in ratios.groupby("preset")
    ])  # fmt: skip


def convergence_table(gains: pd.DataFrame) -> pd.DataFrame:
    """Median attainable gain of a window, [nats], as the estimate is settled more and more."""
    heads = {base: base if base == "batch" else f"{base} more updates" for base in gains["base"]}
    medians = gains.groupby(["preset", "base"])["gain"].median().unstack()[list(heads)]
    return medians.map(lambda gain: t(gain, ".3f")).rename(columns=heads).reset_index()


def gaussianity_table(found: pd.DataFrame) -> pd.DataFrame:
    """Importance sampling less Laplace evidence, [nats]."""
    rows = []
    for (separators, preset), group in found.groupby(["separators", "preset"]):
        used = group.dropna()
        size = used["difference"].abs()
        rows.append({
            "separators": separators, "preset": preset, "windows": len(group),
            "left out": len(group) - len(used),
            "mean [nats]": t(used["difference"].mean(), ".4f"), "largest": t(size.max(), ".3f"),
            "standard error": t(used["error"].mean(), ".4f"),
            "beyond 3 errors": (size > 3 * used["error"]).sum(),
            "more than one mode": (group["modes"] > 1).sum(),
        })  # fmt: skip
    return pd.DataFrame(rows)


def sampler_table(studies: WindowStudies) -> pd.DataFrame:
    """What the sampler samples, in seven checks: what it should find, and what it finds."""
    widths = studies.widths.groupby("reading", sort=False)
    rows = [
        (f"sampled width over the conditional one: {name}",
         t(group["predicted_conditional"].mean(), ".3f"),
         mean_error(group.groupby("seed")["over_conditional"].mean(), ".3f"))
        for name, (_, group) in zip(WIDTHS, widths, strict=True)
    ]  # fmt: skip
    wider = studies.ratios["largest_direction"]
    rows.append(("marginal width over the conditional one, widest direction: median (largest)",
                 NONE, cell("{:.0f} ({:.0f})", wider.median(), wider.max())))  # fmt: skip
    shares = 100 * studies.ess.query("scale == 1").groupby(["kind", "seed"])["ess_share"].mean()
    rows.append((
        "effective sample size [%]: of an exact Gaussian, of a window",
        *(mean_error(shares[kind], ".1f") for kind in ("Gaussian", "window")),
    ))
    for separators, group in studies.gaussianity.groupby("separators"):
        near = (group["difference"].abs() <= 3 * group["error"]).sum()
        rows.append((
            f"windows whose evidence is one Gaussian's, {SEPARATORS[separators]}",
            t(len(group), "d"),
            t(near, "d"),
        ))
    return pd.DataFrame(rows, columns=["what", "expected", "found"])


def nees_table(nees: pd.DataFrame) -> pd.DataFrame:
    """NEES on clean data: mean of the x0 prior, frame of P, preset."""
    table = summaries.summary(nees, "nees", by=["x0_mean", "frame", "preset"])
    return pd.DataFrame([
        {"x0 prior centred on": mean, "frame of P": frame}
        | {row["preset"]: interval(row) for _, row in group.iterrows()}
        for (mean, frame), group in table.groupby(["x0_mean", "frame"], sort=False)
    ])


def robust_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Mean pose RMSE with its interval, and landmark RMSE, per method and start, [m]."""
    most = runs["p"].max()
    poses = summaries.summary(runs, "pose_rmse", by=["start", "method", "p"])
    last = runs[runs["p"] == most].groupby(["start", "method"])["landmark_rmse"].mean()
    return pd.DataFrame([
        {"method": methods.shown(method), "start": start.replace("_", " ")}
        | {f"p = {row['p']:g}": interval(row) for _, row in group.iterrows()}
        | {f"landmarks, p = {most:g}": t(last[start, method])}
        for (start, method), group in poses.groupby(["start", "method"], sort=False)
    ])


def readings_table(readings: pd.DataFrame) -> pd.DataFrame:
    """Mean of every reading with its standard error, and its range: over worlds, or over runs."""
    if "seed" in readings:
        readings = readings.drop(columns=["window", "preset"]).groupby("seed").mean()
    return pd.DataFrame([
        {"reading": name,
         "ours": cell("{:.4g} ± {:.2g}", x.mean(), standard_error.standard_error(x)),
         "range": cell("{:.4g} to {:.4g}", x.min(), x.max())}
        for name, x in readings.items()
    ])  # fmt: skip
