"""The tables and figures of notebook 04 and of the bench, and what they record.

More than 300 lines: the notebook and ``make bench`` show the same tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.cost import Config, compare_engines, grow, likelihood_seconds
from sngr_utils.experiments import bench
from sngr_utils.experiments.bench import WINDOW_LOOP, Performance, comparable, ratio
from sngr_utils.metrics import standard_error
from sngr_utils.publish import cells, report
from sngr_utils.show import style
from sngr_utils.show.common import draw_printed, legend_above
from sngr_utils.show.presets import beside_printed

if TYPE_CHECKING:
    from sngr_utils.experiments.growth import Growth
    from sngr_utils.experiments.refinement_cost import ClosureCost, Cost

t = cells.number


def two_mode_table(modes: dict[int, tuple[np.ndarray, np.ndarray]]) -> pd.DataFrame:
    """The fast path on the two-mode landmark of notebook 01, as `engine_bench.two_modes` ran it."""
    rows = []
    for n_starts, (masses, small) in modes.items():
        right, runs = np.abs(masses - 0.5) < 0.1, len(masses)
        counts = (cells.cell("{:d} of {:d}", n.sum(), runs) for n in (right, small & ~right))
        rows.append([n_starts, *counts, cells.mean_std(masses)])
    columns = ["starts", "right", "wrong, k-hat small", "mass of the upper mode"]
    return pd.DataFrame(rows, columns=columns)


def saving_series(costs: dict[float, Cost]) -> dict[str, tuple[list[int], list[float]]]:
    """Windows that fire and the saving, ours in calls and as printed, where anything fires."""
    ours = [(int(cost.fired.sum()), cost.saving_calls) for cost in costs.values()]
    printed = [report.printed_values()["cost"].get(p, {}) for p in costs]
    was = [(row["triggered"], row["saving"]) for row in printed if row.get("saving")]
    return {
        name: ([n for n, _ in pairs], [saving for _, saving in pairs])
        for name, pairs in (("ours", ours), ("printed", was))
    }


COST = {
    "triggered": ("triggered", "d"),
    "isam2": ("iSAM2 [s]", ".3f"),
    "refine": ("refine [s]", ".2f"),
    "exhaustive": ("exhaustive [s]", ".2f"),
    "saving": ("saving in time", ".1f"),
    "calls": ("saving in calls", ".1f"),
}


def cost_table(presets: dict[str, dict[float, Cost]]) -> pd.DataFrame:
    """tab:cost, printed beside ours: wall clocks (ours from one run on one machine) and savings."""
    ours = {name: {p: _costs(cost) for p, cost in costs.items()} for name, costs in presets.items()}
    return beside_printed(COST, report.printed_values()["cost"], ours)


def _costs(cost: Cost) -> dict[str, float]:
    return {
        "triggered": int(cost.fired.sum()),
        "isam2": cost.isam2_seconds,
        "refine": float(cost.seconds[cost.fired].sum()),
        "exhaustive": cost.exhaustive(cost.seconds),
        "saving": cost.saving_seconds,
        "calls": cost.saving_calls,
    }


def closure_table(closure: ClosureCost) -> pd.DataFrame:
    """Time per likelihood call with its quartiles over batches, and ratios to the quickest."""
    rows = []
    for name, n, seconds in (
        ("closure, one by one", closure.all_factors, closure.seconds_loop),
        ("closure, one call", closure.all_factors, closure.seconds_all),
        ("touching factors, one call", closure.window_factors, closure.seconds_window),
    ):
        dearer = cells.with_interval(*ratio(seconds, closure.seconds_window), ".1f")
        dearer = t(1.0, ".1f") if seconds is closure.seconds_window else dearer
        rows.append([name, n, _with_quartiles(1e6 * seconds, ".0f"), dearer])
    columns = ["likelihood", "factors", "µs per call [quartiles]", "ratio [95 %]"]
    return pd.DataFrame(rows, columns=columns)


def _with_quartiles(values: np.ndarray, fmt: str) -> cells.Cell:
    return cells.with_interval(float(values.mean()), *np.quantile(values, [0.25, 0.75]), fmt)


def all_windows_table(rows: pd.DataFrame) -> pd.DataFrame:
    """The study of all windows: calls, the saving by all and by every third, dynesty's log Z."""
    from sngr_utils.experiments.refinement_cost import EVERY

    table = []
    for p, one in rows.groupby("p"):
        calls, fired = one["calls"].to_numpy(float), one["fired"].to_numpy(bool)
        selected, others = calls[fired], calls[~fired]
        by_third = selected.sum() + len(others) * others[::EVERY].mean()
        mean, reach = one["error"].mean(), 1.96 * standard_error.standard_error(one["error"])
        table.append([
            t(p, "g"), int(fired.sum()), t(selected.mean(), ".0f"), t(others.mean(), ".0f"),
            t(calls.sum() / selected.sum()), t(by_third / selected.sum()),
            cells.with_interval(mean, mean - reach, mean + reach),
        ])  # fmt: skip
    heads = ["p", "that fire", "calls of one", "of another", "saving", "by every third",
             "log Z less the reference [95 %]"]  # fmt: skip
    return pd.DataFrame(table, columns=heads)


def record(
    config: Config, costs: dict[float, Cost], closure: ClosureCost, to: report.Report
) -> None:
    """Hand the costs to the paper, times apart from the rest."""
    to.value("cost.seed", config.seed, ".0f")
    to.value("cost.tau", config.tau)
    first = min(costs)
    to.value("cost.p_first", first, "g")
    to.value("cost.saving_calls", costs[first].saving_calls, ".1f")
    windows = sum(len(cost.calls) for cost in costs.values())
    calls = sum(cost.exhaustive(cost.calls) for cost in costs.values()) / windows
    n = sum(int(np.isfinite(cost.calls).sum()) for cost in costs.values())
    to.value("cost.calls_per_window", calls, ".0f", n=n, within=50)
    to.value("closure.all_factors", closure.all_factors, ".0f")
    to.value("closure.window_factors", closure.window_factors, ".0f")
    isam2 = np.array([cost.isam2_seconds for cost in costs.values()])
    seconds = np.array([cost.exhaustive(cost.seconds) / len(cost.calls) for cost in costs.values()])
    _record_ratio("cost.window_over_isam2", seconds, isam2, to)
    _record_ratio("cost.likelihood_share", 100 * calls * closure.seconds_window, seconds, to)
    for key, seconds in (("loop", closure.seconds_loop), ("call", closure.seconds_all)):
        _record_ratio(f"closure.{key}_over_window", seconds, closure.seconds_window, to)
    to.value("cost.isam2_seconds", isam2.mean(), ".3f", "s", timing=True)


def _record_ratio(key: str, slow: np.ndarray, fast: np.ndarray, to: report.Report) -> None:
    """Hand on a quotient of times with the error that their repeats show, if there are any."""
    times, low, high = ratio(slow, fast)
    error = None if np.isnan(high) else (high - low) / (2 * 1.96)
    fmt = ".1f" if times < 10 or (error is not None and error < 1) else ".0f"
    to.value(key, times, fmt, error=error, timing=True)


def record_engines(
    performances: dict[str, Performance],
    grown: Growth,
    fast: tuple[np.ndarray, np.ndarray],
    to: report.Report,
) -> None:
    """Hand the comparison of the engines to the paper; `fast` is that of `exhaustive_fast`."""
    names = dict(zip((
        "closure_loop", "window_loop", "one_call", "nested_few", "nested", "fast",
    ), performances, strict=True))  # fmt: skip
    for key in ("nested", "fast"):
        faster = performances[names[key]].seconds
        _record_ratio(f"engine.{key}.ratio", performances[WINDOW_LOOP].seconds, faster, to)
    slower = performances[names["closure_loop"]].seconds
    _record_ratio("engine.closure_loop.ratio", slower, performances[WINDOW_LOOP].seconds, to)
    for key in ("window_loop", "nested_few", "nested"):
        errors = performances[names[key]].errors
        error = standard_error.standard_error(errors)
        to.value(f"engine.{key}.bias", errors.mean(), ".3f", "nats", error, len(errors))
    rms = float(np.sqrt(np.mean(performances["fast path"].errors ** 2)))
    to.value("engine.fast.rms", rms, ".3f", "nats", n=len(performances["fast path"].errors),
             within=0.005)  # fmt: skip
    _record_ratio("engine.fast_all_over_isam2", *fast, to)
    inverse, together, anew = (
        grown.seconds[f"marginals, {how}"]
        for how in ("selected inverse", "GTSAM", "GTSAM, asked anew for each window")
    )
    known = np.isfinite(together)
    to.value("growth.shortest", grown.lengths[0], ".0f")
    to.value("growth.longest_compared", grown.lengths[known][-1], ".0f")
    to.value("growth.longest", grown.lengths[-1], ".0f")
    for name, other in (("together", together), ("anew", anew)):
        to.value(f"growth.{name}.first", other[0] / inverse[0], ".0f", timing=True)
        last = (other / inverse)[known][-1]
        order = 10.0 ** np.floor(np.log10(last)) if last > 1000 else last  # three windows' worth
        to.value(f"growth.{name}.last", order, ".0f", timing=True)
    to.value("growth.slope", grown.slope("marginals, selected inverse"), timing=True)
    slope = grown.slope("marginals, GTSAM, asked anew for each window")
    to.value("growth.anew_slope", slope, timing=True)


def speed_table(
    performances: dict[str, Performance], per_call: float, peers: Sequence[str] = ()
) -> pd.DataFrame:
    """CPU time of a window with its quartiles, beside its calls alone, and ratios where they hold.

    A ratio stands where both find the same number, see `bench.comparable`.

    Parameters
    ----------
    per_call : CPU time of one whole compiled likelihood, [s]; a sampler that ends a call early,
        where the sum has passed its limit, needs less
    peers : names of other people's samplers; the quickest comparable one gets a column
    """
    sound = [name for name in peers if comparable(performances[name])]
    best = min(sound, key=lambda name: performances[name].seconds.mean(), default=None)
    rows = []
    for name, p in performances.items():
        milliseconds, calls = 1e3 * p.seconds, p.calls.mean()
        fmt = ".0f" if milliseconds.mean() > 50 else ".1f"
        rows.append({
            "engine": name,
            "ratio [95 %]": _ratio(performances, name, WINDOW_LOOP),
            **({f"over {best}": _ratio(performances, name, best)} if best else {}),
            "ms per window [quartiles]": _with_quartiles(milliseconds, fmt),
            "calls alone [ms]": t(1e3 * calls * per_call, ".1f"),
            "calls": t(calls, ".0f"),
            "ESS per s": t(p.ess.sum() / p.seconds.sum(), ".0f"),
        })  # fmt: skip
    return pd.DataFrame(rows)


def times_faster(
    performances: dict[str, Performance], name: str, to: str = WINDOW_LOOP
) -> tuple[float, float, float]:
    """How many times faster one contender is than another, with its interval; see `bench.ratio`."""
    return ratio(performances[to].seconds, performances[name].seconds)


def _ratio(performances: dict[str, Performance], name: str, to: str) -> cells.Cell | str:
    if name == to:
        return t(1.0, ".1f")
    if not comparable(performances[name]):
        return cells.NONE
    faster = times_faster(performances, name, to)
    return cells.with_interval(*faster, ".1f" if faster[0] < 10 else ".0f")


def accuracy_table(performances: dict[str, Performance]) -> pd.DataFrame:
    """What each engine gets wrong: bias of log Z, spread, mean, variances."""
    rows = []
    for name, p in performances.items():
        rows.append([
            name,
            len(p.errors),
            cells.mean_error(p.errors, "+.3f"),
            t(float(np.sqrt(np.mean(p.errors**2))), ".3f"),
            t(float(np.sqrt(np.mean(p.mean_errors**2))), ".2f"),
            t(float(np.exp(np.mean(np.log(p.variance_ratios)))), ".2f"),
        ])
    columns = ["engine", "runs", "bias of log Z", "rms", "error of the mean", "variance ratio"]
    return pd.DataFrame(rows, columns=columns)


def growth_table(grown: Growth) -> pd.DataFrame:
    """CPU time at every length, and the fitted slope of each row."""
    rows = [
        [name, *(t(1e3 * s, ".3g") for s in seconds), t(grown.slope(name))]
        for name, seconds in grown.seconds.items()
    ]
    return pd.DataFrame(rows, columns=["ms", *(f"{n:,}" for n in grown.lengths), "slope"])


def draw_saving(
    ax: Axes, series: dict[str, tuple[Sequence[int], Sequence[float]]], total: int
) -> None:
    """Saving against the number of windows that fire, "ours" and "printed", with total / n."""
    n = np.arange(1, total + 1)
    ax.plot(n, total / n, "-", color=style.TRUTH, lw=0.6, label=f"{total} / n")
    ax.plot(*series["ours"], "o", color=style.SAMPLES, label="ours")
    draw_printed(ax, *series["printed"])
    ax.set(xlabel="windows that fire, n", ylabel="exhaustive / selective", ylim=(0, 10))
    ax.legend()


def draw_engines(
    axes: Sequence[Axes], performances: dict[str, Performance], per_call: float
) -> None:
    """CPU time of a window per engine with quartiles, log scale, beside the bias of its log Z.

    A short stroke is the time of the likelihood calls alone. The grey band is what a bias may be
    for a ratio to stand; filled are engines whose interval lies within it and is narrow enough.
    """
    y, (left, right) = np.arange(len(performances))[::-1], axes
    limits = [1e3 * p.calls.mean() * per_call for p in performances.values()]
    left.plot(limits, y, "|", color=style.TRUTH, ms=7, label="likelihood calls alone, compiled")
    right.axvspan(-bench.MOST_BIAS, bench.MOST_BIAS, color=style.PRINTED, alpha=0.3, lw=0)
    for at, p in zip(y, performances.values(), strict=True):
        look = {"color": style.SAMPLES, "mfc": style.SAMPLES if comparable(p) else "none"}
        left.plot(1e3 * np.quantile(p.seconds, [0.25, 0.75]), [at, at], lw=3, alpha=0.4, **look)
        left.plot(1e3 * p.seconds.mean(), at, "o", ms=4, **look)
        reach = 1.96 * standard_error.standard_error(p.errors)
        right.errorbar(p.errors.mean(), at, xerr=reach, fmt="o", ms=4, lw=0.8, **look)
    left.set(xscale="log", xlabel="CPU time per window [ms], quartiles", ylim=(-0.6, len(y) - 0.4))
    left.set_yticks(y, list(performances))
    right.set(xlabel="bias of log Z [nats], 95 %", ylim=left.get_ylim(), yticks=[])
    legend_above(left)


def draw_growth(ax: Axes, lengths: np.ndarray, seconds: dict[str, np.ndarray],
                slopes: dict[str, float]) -> None:  # fmt: skip
    """CPU time [s] against the number of poses, log-log, one line per method with its slope."""
    colours = (style.ESTIMATE, style.PRINTED, style.TRIGGERED, style.LANDMARK, style.SAMPLES)
    for (name, values), colour, marker in zip(seconds.items(), colours, "os^vD", strict=True):
        label = f"{name}: slope {slopes[name]:.2f}"
        ax.loglog(lengths, values, marker=marker, color=colour, label=label)
    ax.set(xlabel="poses", ylabel="CPU time [s]")
    ax.legend(loc="lower center", bbox_to_anchor=(0.45, 1.0), ncols=1)


def print_bench(config: Config) -> None:
    """What ``make bench`` prints: speed and accuracy of the engines, growth of the marginals."""
    performances = compare_engines(config, with_peers=True)
    peers = [name for name in performances if name in bench.PEERS]
    print(speed_table(performances, likelihood_seconds(config), peers).to_string(index=False))
    if not peers:
        print("no other people's samplers are installed: pip install 'sngr_utils[peers]'")
    print()
    print(accuracy_table(performances).to_string(index=False))
    print()
    print(growth_table(grow(config)).to_string(index=False))
