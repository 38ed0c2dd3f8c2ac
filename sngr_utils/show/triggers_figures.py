"""The figures of notebook 06."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.show import style
from sngr_utils.show.common import legend_above


def auc_series(
    found: pd.DataFrame, names: Mapping[str, str]
) -> dict[str, tuple[list[str], np.ndarray, np.ndarray, np.ndarray]]:
    """shown name -> cases, AUC, low, high, where there is an AUC; names by detector."""
    series = {}
    for name, shown in names.items():
        mine = found[(found["detector"] == name) & found["auc"].notna()]
        columns = (mine[f"auc{end}"].to_numpy() for end in ("", "_low", "_high"))
        series[shown] = (list(mine["case"]), *columns)
    return series


STATES = {  # state of a window -> colour and marker
    "neither": (style.ESTIMATE, "."),
    "wrong labels, not failed": (style.LANDMARK, "o"),
    "failed": (style.TRUTH, "v"),
}


def draw_p_values(ax: Axes, surprises: dict[str, np.ndarray]) -> None:
    """Histograms of p-values of clean windows: name -> -log10 p; flat if the law is right."""
    for (name, values), colour in zip(
        surprises.items(), (style.PRINTED, style.SAMPLES), strict=True
    ):
        ax.hist(
            10.0**-values, np.linspace(0, 1, 11), density=True, histtype="step", lw=1.4,
            color=colour, label=name,
        )  # fmt: skip
    ax.axhline(1, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(xlabel="p-value of a clean window", ylabel="density", xlim=(0, 1))
    legend_above(ax)


def draw_levels(ax: Axes, clean: pd.DataFrame, names: Mapping[str, str]) -> None:
    """Clean windows that fire, [%], as a map of scores and scenarios; below, those that failed."""
    scenarios = list(dict.fromkeys(clean["scenario"]))
    fired = clean.pivot(index="detector", columns="scenario", values="fired")
    failed = clean.groupby("scenario")["base_rate"].first()
    shares = 100 * np.vstack([fired.loc[list(names), scenarios], failed[scenarios]])
    ax.imshow(shares, cmap="Oranges", vmin=0, vmax=100, aspect="auto")
    for (i, j), share in np.ndenumerate(shares):
        colour = "white" if share > 60 else style.TRUTH
        ax.text(j, i, f"{share:.0f}", ha="center", va="center", color=colour)
    ax.axhline(len(names) - 0.5, color=style.TRUTH, lw=1)
    ax.set_xticks(range(len(scenarios)), scenarios, rotation=30, ha="right")
    ax.set_xlabel("clean scenario; in a field, windows that fire [%]")
    ax.set_yticks(range(len(shares)), [*names.values(), "(windows that failed)"])


def draw_along(axes: Sequence[Axes], rows: pd.DataFrame, panels: dict[str, tuple]) -> None:
    """Scores along one trajectory, one panel each, with wrong labels and failed windows.

    Parameters
    ----------
    rows : windows of one world: window, wrong, failed and the scores
    panels : column -> label of the axis, threshold
    """
    window, wrong = rows["window"].to_numpy(), rows["wrong"].to_numpy() > 0
    failed = rows["failed"].to_numpy()
    for ax, (column, (label, threshold)) in zip(axes, panels.items(), strict=True):
        score = rows[column].to_numpy()
        if column.startswith("chi"):
            ax.set_yscale("symlog", linthresh=1)
        ax.fill_between(
            window, 0, 1, where=wrong, step="mid", transform=ax.get_xaxis_transform(),
            color=style.LANDMARK, alpha=0.25, lw=0, label="wrong labels in the window",
        )  # fmt: skip
        ax.plot(window, score, "o-", color=style.ESTIMATE, ms=2.5, lw=0.7)
        ax.plot(window[failed], score[failed], "v", color=style.TRUTH, ms=3.5, label="failed")
        ax.axhline(threshold, color=style.TRUTH, lw=0.7, ls="--", label="threshold")
        ax.set_ylabel(label)
        ax.margins(y=0.15)
    axes[-1].set_xlabel("window")
    legend_above(axes[0])


def draw_states(ax: Axes, rows: pd.DataFrame, thresholds: tuple[float, float]) -> None:
    """Disagreement [m] against the surprise of the chi-square, by what the window is."""
    failed, wrong = rows["failed"].to_numpy(), rows["contaminated"].to_numpy()
    masks = {"neither": ~failed & ~wrong, "wrong labels, not failed": ~failed & wrong,
             "failed": failed}  # fmt: skip
    for name, (colour, marker) in STATES.items():
        here = rows[masks[name]]
        ax.plot(
            here["chi_square_robust"], here["disagreement"], marker, ms=2.5, mfc="none", mew=0.6,
            color=colour, alpha=0.7, label=name,
        )  # fmt: skip
    ax.axvline(thresholds[0], color=style.TRUTH, lw=0.6, ls="--")
    ax.axhline(thresholds[1], color=style.TRUTH, lw=0.6, ls="--")
    ax.set_xscale("symlog", linthresh=1)
    ax.set_xlim(left=-0.3)
    ax.set_yscale("log")
    ax.set(xlabel=r"chi-square, robust estimate: $-\log_{10} p$", ylabel="disagreement [m]")
    legend_above(ax)


def draw_aucs(ax: Axes, series: dict[str, tuple], title: str, legend: bool) -> None:
    """AUC per case with its interval: name -> cases, AUC, low, high."""
    cases = max((given[0] for given in series.values()), key=len)
    looks = zip(series.items(), style.SEQUENCE, "os^vD<", strict=False)
    for i, ((name, (mine, auc, low, high)), colour, marker) in enumerate(looks):
        x = np.array([cases.index(case) for case in mine]) + 0.07 * (i - 2)
        bars = np.nan_to_num([auc - low, high - auc])
        ax.errorbar(
            x, auc, bars, fmt=marker, color=colour, mfc="none", lw=0.8, capsize=1.5, label=name
        )
    ax.axhline(0.5, color=style.TRUTH, lw=0.6, ls=":")
    ax.set_xticks(range(len(cases)), cases, rotation=35, ha="right")
    ax.set(ylabel=f"AUC, {title}", ylim=(0, 1.03))
    if legend:
        legend_above(ax, ncols=2)
