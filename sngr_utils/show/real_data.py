"""The tables and figures of notebook 10."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sngr_utils.experiments.real_stretch import Stretch
from sngr_utils.files import plaza
from sngr_utils.metrics.alignment import rigid
from sngr_utils.publish import cells
from sngr_utils.show import style
from sngr_utils.show.common import legend_above
from sngr_utils.show.methods import METHODS, Method, shown

GROWN = Method("association-aware, batch", style.SAMPLES, "--", "o", 1.0)
ONLINE = METHODS["online"]
STUDIED, PEERS = ("least_squares", "huber", "cauchy"), ("gnc_tls", "em")  # that are drawn
NAMES = {"growing_map": GROWN.name, "online": ONLINE.name, "isam": "iSAM",
         "gnc_tls_superlinear": "GNC-TLS, superlinear"}  # fmt: skip
KINDS = {
    "no labels": "no labels", "shuffled": "labels shuffled", "clutter": "60 % clutter",
    "stretched": "ranges 20 % too long", "cut": "half of the odometry lost",
}  # fmt: skip


def name_of(method: str) -> str:
    """What a method of the real-data studies is called."""
    return NAMES.get(method) or shown(method)


# --- figures --------------------------------------------------------------------------------


def draw_paths(ax: Axes, truth: np.ndarray, paths: Mapping[str, np.ndarray]) -> None:
    """A true path (T, 2) and paths that are aligned with it: name -> (T, 2), [m]."""
    ax.plot(*truth.T, color=style.TRUTH, lw=0.6, label="GPS")
    colours = (style.TRIGGERED, style.ESTIMATE, style.SAMPLES)
    for (name, path), colour in zip(paths.items(), colours, strict=False):
        ax.plot(*path.T, color=colour, lw=0.7, label=name)
    _metres(ax)
    legend_above(ax)


def draw_scale(
    ax: Axes, scales: np.ndarray, costs: np.ndarray, found: Mapping, true: float
) -> None:
    """Cost of a drive over the range scale, with what was found and what the GPS says."""
    ax.plot(scales, costs - costs.min(), "o-", color=style.ESTIMATE, label="least cost")
    low, high = (found["scale"] + sign * found["scale_sigma"] for sign in (-2, 2))
    ax.axvspan(low, high, color=style.SAMPLES, alpha=0.25, lw=0, label="found, ± 2 σ")
    ax.axvline(true, color=style.TRUTH, ls="--", lw=0.8, label="by GPS")
    ax.set(xlabel="range scale", ylabel="cost above the least [nats]", title=found["set"])


def draw_map(
    ax: Axes, truth: np.ndarray, radios: np.ndarray, path: np.ndarray, places: np.ndarray
) -> None:
    """An estimated path (T, 2) and radios (K, 2) over the true ones, aligned by the path, [m]."""
    rotation, shift = rigid(path, truth)
    ax.plot(*truth.T, color=style.TRUTH, lw=0.6, label="GPS")
    ax.plot(*(path @ rotation.T + shift).T, color=style.ESTIMATE, lw=0.8, label="estimate")
    ax.plot(*radios.T, **style.TRUE_LANDMARK, label="radios")
    ax.plot(*(places @ rotation.T + shift).T, **style.FOUND_LANDMARK, label="radios, found")
    _metres(ax)
    legend_above(ax, ncols=2)


def draw_gaps(ax: Axes, gaps: pd.DataFrame) -> None:
    """How much less likely the second-best map is (column gap, [nats]), over poses driven."""
    looks = zip(gaps.groupby("set"), style.SEQUENCE[1:], ("o-", "s--"), strict=False)
    for (name, rows), colour, line in looks:
        ax.plot(rows["poses"], rows["gap"], line, color=colour, label=name)
    ax.axhline(3, color=style.TRIGGERED, lw=0.6, ls=":", label="3 nats: 1 in 20")
    ax.set_yscale("symlog", linthresh=1)
    ax.set(xlabel="poses driven", ylabel="second-best map worse by [nats]")
    ax.set_ylim(-0.5, 3 * gaps["gap"].max())
    legend_above(ax)


def draw_mirrors(ax: Axes, name: str, gaps: pd.DataFrame) -> None:
    """How much worse the mirror image of each radio is, [nats], over poses driven."""
    looks = zip(gaps.groupby("radio"), style.SEQUENCE, ("-", "--", "-.", ":"), strict=False)
    for (radio, rows), colour, dash in looks:
        gap = rows["gap"].replace(np.inf, np.nan)  # no second place, and nothing to draw
        ax.plot(rows["poses"], gap, dash, color=colour, label=f"radio {radio + 1}")
    ax.set_yscale("symlog", linthresh=1)
    ax.set(xlabel="poses driven", ylabel="mirror image worse by [nats]", title=name)


def draw_levels(
    axes: Sequence[Axes], batch: pd.DataFrame, peers: pd.DataFrame, online: pd.DataFrame
) -> None:
    """Median aligned RMSE over the share of wrong labels, a panel for each set.

    Parameters
    ----------
    batch, peers, online : rows of the three studies with labels: set, method, p, and rmse or final
    """
    tables = {**dict.fromkeys(STUDIED, batch), **dict.fromkeys(PEERS, peers)}
    lines = {key: (METHODS[key], table) for key, table in tables.items()}
    lines |= {"growing_map": (GROWN, batch), "online": (ONLINE, online)}
    for ax, name in zip(axes, plaza.SETS, strict=True):
        for key, (look, table) in lines.items():
            mine = table[(table["set"] == name) & (table["method"] == key)]
            level = mine.groupby("p")["final" if key == "online" else "rmse"].median()
            ax.plot(level.index, level, look.dash, marker=look.marker, color=look.colour,
                    lw=look.width, label=look.name)  # fmt: skip
        ax.set_yscale("log")
        ax.set(xlabel=style.WRONG_LABEL, ylabel="aligned RMSE [m]", title=name)


def _metres(ax: Axes) -> None:
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")


# --- tables ---------------------------------------------------------------------------------


def level_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Median RMSE over seeds, a row for each method and a column for each set and p."""
    heads = [(name, p) for name in plaza.SETS for p in sorted(rows["p"].unique())]
    medians = rows.groupby(["method", "set", "p"])["rmse"].median()
    return pd.DataFrame([
        {"method": name_of(method)}
        | {f"{name}, p = {p:g}": cells.number(medians.get((method, name, p))) for name, p in heads}
        for method in dict.fromkeys(rows["method"])
    ])


def peers_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Aligned RMSE of other people's estimators, see `level_table`, and CPU time by the pose."""
    table = level_table(rows)
    spent = rows.groupby("method", sort=False)["pose_ms"].median()
    return table.assign(**{"a pose [ms]": [cells.number(value, ".1f") for value in spent]})


def measures_table(batch: pd.DataFrame, online: pd.DataFrame) -> pd.DataFrame:
    """Whole drives by the measures of the field; medians over seeds.

    Parameters
    ----------
    batch, online : rows of the two studies with labels, of our own estimators
    """
    columns = {
        "rmse": (".3f", "aligned RMSE [m]"), "over_oracle": (".2f", "over the oracle's"),
        "incremental": (".3f", "change in 10 m [m]"), "nees": (".1f", "NEES"),
        "precision": (".3f", "right"), "recall": (".3f", "of all"),
        "share_wrong": (".2f", "p, estimated"), "missed_steps": (".0f", "steps missed"),
    }  # fmt: skip
    rows = pd.concat([batch, online.rename(columns={"final": "rmse", "right": "precision"})])
    rows = rows.assign(over_oracle=rows["rmse"] / rows["oracle"])
    return pd.DataFrame([
        {
            "method": name_of(method), "set": name, "p": cells.number(p, ".1f"),
            "seeds": len(mine), **_medians(mine, columns),
        }
        for (method, name, p), mine in rows.groupby(["method", "set", "p"])
    ])  # fmt: skip


def _medians(rows: pd.DataFrame, columns: Mapping[str, tuple[str, str]]) -> dict[str, cells.Cell]:
    """Heading -> median; `columns` has format and heading of each column."""
    return {
        head: cells.number(float(rows[key].median()), fmt) for key, (fmt, head) in columns.items()
    }


def scale_table(found: Sequence[Mapping], true: Mapping[str, float]) -> pd.DataFrame:
    """Range scale found without the truth, beside what ranges and GPS give together."""
    return pd.DataFrame([
        {
            "set": f["set"], "scale found": cells.with_error(f["scale"], f["scale_sigma"], ".4f"),
            "by GPS": cells.number(true[f["set"]], ".4f"),
            "apart [σ]": cells.number((f["scale"] - true[f["set"]]) / f["scale_sigma"], "+.1f"),
            "σ of a range found [m]": cells.number(f["range_sigma"]),
        }
        for f in found
    ])  # fmt: skip


def provoked_table(batch: pd.DataFrame, online: pd.DataFrame) -> pd.DataFrame:
    """Runs without labels and with failures provoked: error, and whether they doubt themselves."""
    rows = []
    for kind, told in KINDS.items():
        for name in plaza.SETS:
            row = [told, name]
            for table, key in ((batch, "rmse"), (online, "final")):
                mine = table[(table["kind"] == kind) & (table["set"] == name)]
                row += _error_and_doubt(mine, key)
            rows.append(row)
    heads = ["what is done", "set", "batch [m]", "doubts itself", "online [m]", "doubts itself "]
    return pd.DataFrame(rows, columns=heads)


def _error_and_doubt(rows: pd.DataFrame, key: str) -> list:
    if not len(rows):
        return [cells.NONE, cells.NONE]
    return [cells.number(float(rows[key].iloc[0])), "yes" if rows["doubtful"].iloc[0] else "no"]


def online_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Online: errors at the end and while driving, there beside the oracle; CPU time of a step.

    Medians over seeds.
    """
    columns = {
        "final": (".3f", "final [m]"), "filtered_beside": (".3f", "while driving [m]"),
        "filtered_oracle": (".3f", "the oracle's [m]"), "step_ms": (".1f", "step [ms]"),
        "step_ms_95": (".0f", "95 % [ms]"), "step_ms_gain": ("+.1f", "gain [ms]"),
    }  # fmt: skip
    return pd.DataFrame([
        {
            "set": name, "seeds": len(mine), **_medians(mine, columns),
            "doubtful": f"{int(mine['doubtful'].sum())} of {len(mine)}",
        }
        for name, mine in rows.groupby("set")
    ])  # fmt: skip


def asked_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Who was asked how often on a whole drive, and what the path is worth."""
    firsts = rows.groupby(["method", "p", "set"], sort=False, as_index=False).first()
    return pd.DataFrame([
        {
            "variant": name_of(one["method"]), "p": cells.number(one["p"], ".1f"),
            "set": one["set"], "delays by mirror test": int(one["mirror_waits"]),
            "many starts": int(one["landmark_questions"]),
            "nested sampling": int(one["landmark_samples"]),
            "final [m]": cells.number(one["final"], ".3f"),
        }
        for _, one in firsts.iterrows()
    ])  # fmt: skip


def goats_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Ranges held out, which nothing has seen; and beacons, with what their covariances say."""
    return pd.DataFrame([
        {
            "dive": row["set"], "held out": int(row["held_out"]),
            "median [m]": cells.with_error(row["median"], row["median_error"]),
            "with Huber's loss [m]": cells.number(row["median_huber"]),
            "nine tenths [m]": cells.number(row["ninth_decile"], ".1f"),
            "beacons from survey [σ] [m]":
                cells.with_interval(
                    row["beacons_rmse"], row["beacon_sigma_least"], row["beacon_sigma_most"], ".1f"
                ),
        }
        for _, row in rows.iterrows()
    ])  # fmt: skip


def stretch_table(stretch: Stretch, rmse: Mapping[str, float]) -> pd.DataFrame:
    """What the run here is worth: quantity and value."""
    used = stretch.found.used >= 0
    right = (stretch.found.used == stretch.sources)[used]
    rows = [[f"aligned RMSE, {name} [m]", cells.number(value)] for name, value in rmse.items()]
    rows += [
        ["share of ranges used", cells.number(float(used.mean()), ".3f")],
        ["of these credited rightly", cells.number(float(right.mean()), ".3f")],
        ["share of wrong labels, estimated", cells.number(stretch.found.p)],
        ["nested sampling asked", int(stretch.found.counts["landmark samples"]
                                      + stretch.found.counts["position samples"])],
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=["quantity", "value"])


def time_table(seconds: np.ndarray) -> pd.DataFrame:
    """CPU time of a step, in thirds of the stretch, [ms]."""
    thirds = np.array_split(1e3 * seconds, 3)
    return pd.DataFrame({
        "third": ["first", "second", "last"],
        "median [ms]": [cells.number(float(np.median(third)), ".1f") for third in thirds],
        "longest [ms]": [cells.number(float(third.max()), ".0f") for third in thirds],
    })
