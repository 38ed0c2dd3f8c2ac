"""The tables and series of notebook 06, from the data frames of its driver."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from sngr_utils import report
from sngr_utils.detection import scores
from sngr_utils.metrics import standard_error

t = report.text

NAMES = {
    "condition": "condition number",
    "eigenvalue": "largest eigenvalue",
    "chi_square": "chi-square",
    "either": "either of these two",
    "chi_square_robust": "chi-square, robust estimate",
    "mirror": "mirror image",
    "disagreement": "disagreement",
    "disagreement_sigmas": "disagreement in sigmas",
    "oracle": "disagreement with the oracle",
}


def interval(row: pd.Series, column: str, fmt: str = ".2f", scale: float = 1.0) -> str:
    """ "value [low, high]"; without brackets where there is no interval."""
    value, low, high = (scale * row[f"{column}{end}"] for end in ("", "_low", "_high"))
    return t(value, fmt) if np.isnan(low) else f"{t(value, fmt)} [{t(low, fmt)}, {t(high, fmt)}]"


def scores_table() -> pd.DataFrame:
    """What every score asks."""
    rows = [[NAMES[name], meaning] for name, meaning in scores.SCORES.items()]
    return pd.DataFrame(rows, columns=["score", "what it asks"])


def level_table(clean: pd.DataFrame) -> pd.DataFrame:
    """Clean windows that fire, [%], and those that failed for all that.

    The last column counts the windows that did not fail only.
    """
    shown = [name for name in scores.SCORES if name != "eigenvalue"]
    rows = []
    for scenario, group in clean.groupby("scenario", sort=False):
        by_name = group.set_index("detector")
        cells = [interval(by_name.loc[name], "fired", ".1f", 100) for name in shown]
        cells.append(interval(by_name.loc["at_limit"], "false_alarms", ".1f", 100))
        rows.append([scenario, t(100 * group["base_rate"].iloc[0], ".1f"), *cells])
    heads = ["clean scenario", "failed [%]", *(NAMES[name] for name in shown),
             "disagreement > 0.5 m, not failed"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def null_table(null: pd.DataFrame) -> pd.DataFrame:
    """Clean windows where the chi-square fires, [%]: presets down, estimates across."""
    rows = []
    for (scenario, preset), group in null.groupby(["scenario", "preset"], sort=False):
        by_estimate = group.groupby("estimate", sort=False)["fired"]
        cells = [
            f"{t(100 * x.mean(), '.1f')} ± {t(100 * standard_error.standard_error(x), '.1f')}"
            for _, x in by_estimate
        ]
        rows.append([scenario, preset, *cells])
    heads = ["clean scenario", "preset", "as iSAM2 leaves it [%]", "settled by batch [%]"]
    return pd.DataFrame(rows, columns=heads)


def calibration_table(found: pd.DataFrame) -> pd.DataFrame:
    """Thresholds from clean worlds, and how well these fix them."""
    rows = [
        [
            NAMES[row["detector"]],
            t(row["threshold"], ".3g"),
            f"{t(row['low'], '.3g')} to {t(row['high'], '.3g')}",
            f"{t(row['worlds_low'], '.3g')} to {t(row['worlds_high'], '.3g')}",
        ]
        for _, row in found.iterrows()
    ]
    heads = ["score", "threshold", "if windows were independent", "worlds drawn"]
    return pd.DataFrame(rows, columns=heads)


def case_table(
    found: pd.DataFrame, column: str, names: Sequence[str] = tuple(NAMES)
) -> pd.DataFrame:
    """One column of a summary with its intervals: detectors down, cases across, base rates."""
    cases = list(dict.fromkeys(found["case"]))
    base = found.groupby("case")["base_rate"].first()
    rows = [["base rate", *(t(base[case]) for case in cases)]]
    for name in names:
        mine = found[found["detector"] == name].set_index("case")
        if len(mine):
            rows.append([NAMES[name], *(interval(mine.loc[case], column) for case in cases)])
    return pd.DataFrame(rows, columns=["score", *cases])


def summary_table(
    failed: pd.DataFrame, wrong: pd.DataFrame, decided: pd.DataFrame, clean: pd.DataFrame,
    case: str,
) -> pd.DataFrame:  # fmt: skip
    """One line per detector: AUC against failure and contamination, MCC, false alarms."""
    columns = (failed, "auc"), (wrong, "auc"), (decided, "mcc")
    found = [frame[frame["case"] == case].set_index("detector")[name] for frame, name in columns]
    bursts = failed[failed["case"].str.startswith("burst")].groupby("detector")["auc"].min()
    levels = 100 * clean.groupby("detector")["fired"].agg(["min", "max"])
    rows = []
    for name in scores.SCORES:
        auc, contamination, mcc = (t(column[name]) for column in found)
        least, most = (t(levels.loc[name, end], ".0f") for end in ("min", "max"))
        rows.append([NAMES[name], auc, t(bursts[name]), contamination, mcc, f"{least} to {most}"])
    heads = ["score", "AUC failed", "in bursts", "AUC wrong labels", "MCC failed",
             "false alarms [%]"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def claims_table(found: pd.DataFrame, tau: float) -> pd.DataFrame:
    """Three rules at every p: how often they fire, and how right they are."""
    rules = {
        "condition": f"condition number > {tau:g}", "calibrated": "condition number, calibrated",
        "chi_square": "chi-square",
        "disagreement": "disagreement > 0.5 m",
    }  # fmt: skip
    rows = []
    for case, group in found.groupby("case", sort=False):
        for _, row in group.iterrows():
            rows.append([
                case, t(row["base_rate"]), rules[row["detector"]], t(100 * row["silent"], ".0f"),
                interval(row, "fired"), interval(row, "precision"), interval(row, "recall"),
                interval(row, "mcc"),
            ])  # fmt: skip
    heads = ["wrong labels", "base rate", "rule", "silent worlds [%]", "fires", "precision",
             "recall", "MCC"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def shifted_table(ranked: pd.DataFrame, decided: pd.DataFrame) -> pd.DataFrame:
    """AUC against failure per scenario, and MCC of the disagreement at the failure limit."""
    names, rows = list(dict.fromkeys(ranked["detector"])), []
    mcc = decided.set_index("scenario")
    for scenario, group in ranked.groupby("scenario", sort=False):
        cells = [interval(row, "auc") for _, row in group.iterrows()]
        base = t(group["base_rate"].iloc[0])
        rows.append([scenario, base, *cells, interval(mcc.loc[scenario], "mcc")])
    heads = ["scenario", "base rate", *(NAMES[name] for name in names), "MCC at 0.5 m"]
    return pd.DataFrame(rows, columns=heads)


def auc_series(
    found: pd.DataFrame, names: Sequence[str]
) -> dict[str, tuple[list[str], np.ndarray, np.ndarray, np.ndarray]]:
    """name -> cases, AUC, low, high, where there is an AUC."""
    series = {}
    for name in names:
        mine = found[(found["detector"] == name) & found["auc"].notna()]
        columns = (mine[f"auc{end}"].to_numpy() for end in ("", "_low", "_high"))
        series[NAMES[name]] = (list(mine["case"]), *columns)
    return series
