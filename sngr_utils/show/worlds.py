"""The table and the figure of the study of worlds of every kind, a summary of which 08 shows."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.experiments.every_world import LOST, PEERS
from sngr_utils.publish import report
from sngr_utils.publish.cells import cell, number
from sngr_utils.show import methods, style

LOOKS = {
    False: {"mfc": "none", "mec": style.ESTIMATE},
    True: {"mfc": style.TRIGGERED, "mec": style.TRIGGERED},
}
OVERCONFIDENT = 4.0  # NEES, twice what is due


def cases(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Worlds alike but for their seeds, by name; the preset is named where it is not C."""
    found = {}
    for (kind, preset, p), group in rows.groupby(["kind", "preset", "p"], sort=False):
        found[f"{kind}, p = {p:g}" + (f", preset {preset}" if preset != "C" else "")] = group
    return found


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Errors over the oracle's of the same kind, consistency, and what estimates say of it."""
    lines = []
    for name, group in cases(rows).items():
        final, filtered = group["final"], group["filtered"]
        lost, doubted = final > LOST, group["doubtful"] > 0
        lines.append({
            "worlds": name, "final, median": number(final.median()),
            "mean": number(final.mean()), "worst": number(final.max()),
            "worst, from the truth": number(group["at_truth"].max()),
            "newest pose, median": number(filtered.median()), "mean ": number(filtered.mean()),
            "mean, none likelier": number(group["filtered_likelier"].mean()),
            "known": number(group["known"].mean()),
            "landmarks, median": number(group["landmark_ratio"].median()),
            "NEES": number(group["nees"].mean()),
            "NEES oracle": number(group["oracle_nees"].mean()),
            "lost": cell("{:d} of {:d}", lost.sum(), len(group)),
            "doubted: lost, others":
                cell("{:d}, {:d}", (lost & doubted).sum(), (~lost & doubted).sum()),
            **{f"{methods.shown(peer)}, median": number(group[peer].median()) for peer in PEERS},
        })  # fmt: skip
    return pd.DataFrame(lines)


def sensitivity_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Worst final error over the oracle's with each constant halved and doubled, by kind."""
    lines = []
    kinds = list(dict.fromkeys(rows["kind"]))
    for constant, group in rows.groupby("constant", sort=False):
        worst = group.groupby(["factor", "kind"])["final"].max()
        line = [constant or "none changed"]
        for factor in (0.5, 2.0):
            line += [number(worst[factor if constant else 1.0, kind]) for kind in kinds]
        lines.append(line)
    heads = [f"{name}, {kind}" for name in ("half", "twice") for kind in kinds]
    return pd.DataFrame(lines, columns=["constant", *heads])


def draw(ax: Axes, rows: pd.DataFrame) -> None:
    """A circle per world at the ratio of its final estimate to the oracle's, filled if doubted."""
    named = cases(rows)
    for place, group in enumerate(named.values()):
        for doubted, look in LOOKS.items():
            ratio = group.loc[(group["doubtful"] > 0) == doubted, "final"]
            ax.plot(ratio, np.full(len(ratio), -place), "o", ms=2.8, mew=0.6, **look)
        ax.plot(group["final"].median(), -place, "|", ms=8, mew=1.2, color=style.TRUTH)
    handles, named_by = ax.get_lines()[:3], ("no doubt", "doubts itself", "median")
    ax.axvline(1, color=style.TRUTH, lw=0.6, zorder=1)
    lost = ax.axvline(LOST, color=style.TRUTH, lw=0.8, ls=":", zorder=1)
    above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1)}  # no line of the grid crosses it
    ax.legend([*handles, lost], [*named_by, "lost beyond"], ncols=4, **above)
    ax.set_yticks(-np.arange(len(named)), list(named))
    ax.set(xscale="log", xlabel="pose RMSE over the oracle's")
    ax.grid(axis="y", lw=0.3)


def record(rows: pd.DataFrame, to: report.Report) -> None:
    """Hand on how many worlds were lost, how many of which doubted themselves, or were to be found.

    Lost by the search is a world in which EM from the truth finds a better estimate, which is
    likelier by a nat. Overconfident is an estimate whose NEES is above `OVERCONFIDENT`.
    """
    lost, doubted = rows["final"] > LOST, rows["doubtful"] > 0
    to.value("worlds.n", len(rows), ".0f")
    to.value("worlds.lost", lost.sum(), ".0f")
    to.value("worlds.lost_doubted", (lost & doubted).sum(), ".0f")
    to.value("worlds.others_doubted", (~lost & doubted).sum(), ".0f")
    missed = (rows["at_truth"] <= LOST) & (rows["behind"] > 1.0)
    to.value("worlds.lost_by_search", (lost & missed).sum(), ".0f")
    overconfident = rows["nees"] > OVERCONFIDENT
    to.value("worlds.overconfident", overconfident.sum(), ".0f")
    to.value("worlds.overconfident_doubted", (overconfident & doubted).sum(), ".0f")
    for kind, slips in rows[rows["filtered_right"].notna()].groupby("kind"):
        for name in ("filtered", "filtered_right"):
            key = f"worlds.{kind.replace(' ', '_')}.{name}"
            to.value(key, slips[name].median(), n=len(slips))
    straight = rows[rows["kind"] == "straight"]
    to.value("worlds.straight.likelier_sides", straight["sides_likelier"].mean(), ".2f")
    to.value("worlds.straight.gain", straight["sides_gain"].max(), ".0f")
