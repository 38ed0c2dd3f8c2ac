"""The tables of notebook 06, and what it records; `triggers_figures` has its figures."""

from collections.abc import Callable

import pandas as pd

from sngr_utils.detection import scores
from sngr_utils.publish import report
from sngr_utils.publish.cells import Cell, cell, mean_error, number, with_interval

t = number

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


def interval(row: pd.Series, column: str, fmt: str = ".2f", scale: float = 1.0) -> Cell:
    """ "value [low, high]" of a column of a summary."""
    return with_interval(*(scale * row[f"{column}{end}"] for end in ("", "_low", "_high")), fmt)


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
        rows.append([scenario, preset, *(mean_error(100 * x, ".1f") for _, x in by_estimate)])
    heads = ["clean scenario", "preset", "as iSAM2 leaves it [%]", "settled by batch [%]"]
    return pd.DataFrame(rows, columns=heads)


def case_table(found: pd.DataFrame, column: str) -> pd.DataFrame:
    """One column of a summary with its intervals: detectors down, cases across, base rates."""
    cases = list(dict.fromkeys(found["case"]))
    base = found.groupby("case")["base_rate"].first()
    rows = [["base rate", *(t(base[case]) for case in cases)]]
    for name in NAMES:
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
        alarms = cell("{:.0f} to {:.0f}", *levels.loc[name])
        rows.append([NAMES[name], auc, t(bursts[name]), contamination, mcc, alarms])
    heads = ["score", "AUC failed", "in bursts", "AUC wrong labels", "MCC failed",
             "false alarms [%]"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def best_of(summary: pd.DataFrame) -> Callable[[pd.Series, str], bool]:
    """For `cells.show`: the best of each column of `summary_table`, the fewest false alarms."""
    *rates, alarms = summary.columns[1:]
    best = {head: pd.Series([each.numbers[0] for each in summary[head]]).max() for head in rates}
    least = min(each.numbers[1] for each in summary[alarms])

    def mark(row: pd.Series, head: str) -> bool:
        if head == alarms:
            return row[head].numbers[1] == least
        return head in best and row[head].numbers[0] == best[head]

    return mark


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


# What the paper's text quotes: case or scenario -> detectors.
QUOTED = {
    "auc.failed": {
        "all p": ("condition", "chi_square", "either", "disagreement"),
        "p = 0.05": ("disagreement", "oracle"),
    },
    "auc.contaminated": {"all p": ("condition", "chi_square", "chi_square_robust")},
    "mcc": {"all p": ("condition", "disagreement")},
    "level": {
        "radius 3 m": ("condition",), "radius 10 m": ("condition",), "100 poses": ("chi_square",)
    },
}  # fmt: skip


def record(
    failed: pd.DataFrame, contaminated: pd.DataFrame, decided: pd.DataFrame,
    clean: pd.DataFrame, to: report.Report,
) -> None:  # fmt: skip
    """Hand on what the paper's text quotes. Standard errors are those of the intervals."""
    percent = clean.assign(**{c: 100 * clean[c] for c in ("fired", "fired_low", "fired_high")})
    for name, table, where, column, fmt in (
        ("auc.failed", failed, "case", "auc", ".2f"),
        ("auc.contaminated", contaminated, "case", "auc", ".2f"),
        ("mcc", decided, "case", "mcc", ".2f"),
        ("level", percent, "scenario", "fired", ".1f"),
    ):
        for _, row in table.iterrows():
            if row["detector"] in QUOTED[name].get(row[where], ()):
                key = f"triggers.{name}.{row['detector']}.{slug(row[where])}"
                error = (row[f"{column}_high"] - row[f"{column}_low"]) / (2 * 1.96)
                to.value(key, row[column], fmt, "", error, int(row["worlds"]))
    for _, row in clean[clean["scenario"] == "100 poses"].head(1).iterrows():
        failed_here, n = 100 * row["base_rate"], int(row["worlds"])
        to.value("triggers.level.failed.100_poses", failed_here, ".0f", n=n, within=5)
    lawful = percent.loc[percent["detector"] == "chi_square_robust", "fired"]
    to.value("triggers.level.lowest", lawful.min(), ".1f", within=1)
    to.value("triggers.level.highest", lawful.max(), ".1f", within=1)
    limit = 100 * clean.loc[clean["detector"] == "at_limit", "false_alarms"]
    to.value("triggers.level.at_limit.highest", limit.max(), ".1f", within=1)
    to.value("triggers.level.scenarios", len(lawful), ".0f")


def slug(name: str) -> str:
    """ "p = 0.3" -> "p0.3": a case or scenario as part of a key."""
    return name.replace(" = ", "").replace(" ", "_")
