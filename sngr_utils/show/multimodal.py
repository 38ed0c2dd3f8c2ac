"""The tables and figures of notebook 09, and what it records."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from sngr_utils.experiments import multimodality, sampler_contest
from sngr_utils.experiments.multimodality import SECOND_MASS
from sngr_utils.metrics import cluster_bootstrap, precision_recall
from sngr_utils.metrics.standard_error import standard_error
from sngr_utils.multimodal import Config
from sngr_utils.publish import report
from sngr_utils.publish.cells import cell, number
from sngr_utils.show import style
from sngr_utils.show.common import draw_ellipse, legend_above

t = number
MASS_TARGET = 0.05  # error of a mode's mass that is small enough
FEW_POSES = 3  # poses after which a landmark usually still has two places


def landmarks_table(landmarks: pd.DataFrame, config: Config) -> pd.DataFrame:
    """By number of poses: how often one Gaussian is wrong, and what there is instead."""
    rows = []
    for n, found in landmarks.groupby("n"):
        two, wrong = found["second"] >= SECOND_MASS, found["kl"] > config.kl_limit
        rows.append([
            n, len(found), t(wrong.mean(), ".0%"),
            t((found["kl_moments"] > config.kl_limit).mean(), ".0%"), t(two.mean(), ".0%"),
            t(found["kl"].median()), t(found["spread"].median()),
            t((found["gap"] < config.gap_limit).mean(), ".0%"),
        ])  # fmt: skip
    heads = ["poses", "landmarks", "KL > limit", "same, moments", "two modes", "median KL [nats]",
             "median spread [m]", "mirror test fires"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def windows_table(found: pd.DataFrame, config: Config) -> pd.DataFrame:
    """By ranges per pose: how often one Gaussian is wrong in an ambiguous window."""
    rows = []
    for m, part in found.groupby("n_ranges"):
        two, wrong = part["second"] >= SECOND_MASS, part["kl"] > config.kl_limit
        rows.append([
            m, len(part), t(wrong.mean(), ".0%"), t(two.mean(), ".0%"),
            t(part["largest"].median()), t(part["shortfall"].median()), t(part["shortfall"].max()),
            t(part["shortfall_error"].max()),
        ])  # fmt: skip
    heads = ["ranges per pose", "windows", "KL > limit", "two modes", "median mass of the first",
             "evidence missed, median [nats]", "same, most", "error of the reference"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def detection_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Counts of every trigger, and its areas under the ROC curve."""
    return pd.DataFrame({
        "of a": rows["case"], "trigger": rows["trigger"], "found": rows["found"],
        "missed": rows["missed"], "false alarms": rows["false"], "silent, rightly": rows["silent"],
        "AUC": rows["auc"].map(t), "AUC, same size": rows["auc_within"].map(t),
    })  # fmt: skip


def samplers_table(runs: pd.DataFrame, case: str) -> pd.DataFrame:
    """Methods of one case: errors of masses and evidence, and likelihood calls."""
    mine, rows = runs[runs["case"] == case], []
    for (size, method), part in mine.groupby(["size", "method"], sort=False):
        small = (part["mass_error"] <= MASS_TARGET).sum()
        rows.append([
            size, method, t(part["mass_error"].mean(), ".3f"), t(part["mass_error"].max()),
            cell("{:d} of {:d}", small, len(part)),
            t(part["evidence_error"].mean()), t(part["calls"].mean() / 1000, ".0f"),
        ])  # fmt: skip
    heads = ["size", "method", "mass error", "worst", "within the target",
             "evidence error [nats]", "1000 calls"]  # fmt: skip
    return pd.DataFrame(rows, columns=heads)


def groups(runs: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The runs on landmarks that few poses saw, that more did, and on windows; none empty."""
    landmark, few = runs["case"] == "landmark", runs["size"] <= FEW_POSES
    kinds = {
        "landmark, few poses": landmark & few,
        "landmark, more poses": landmark & ~few,
        "window": runs["case"] == "window",
    }
    return {name: runs[kind] for name, kind in kinds.items() if kind.any()}


def mass_errors(runs: pd.DataFrame) -> dict[str, dict[str, np.ndarray]]:
    """Group -> method -> (n,) errors of the masses, for the figure."""
    return {
        name: {
            m: found.loc[found["method"] == m, "mass_error"].to_numpy()
            for m in sampler_contest.METHODS
        }
        for name, found in groups(runs).items()
    }


def summary_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Per method and group: mean (largest) error of the masses, and 1000 likelihood calls."""
    columns = {}
    for name, found in groups(runs).items():
        short = name.replace("landmark, ", "")
        by_method = found.groupby("method")
        errors, calls = by_method["mass_error"], by_method["calls"].mean() / 1000
        mean, most = errors.mean(), errors.max()
        columns[short] = [
            cell("{:.2f} ({:.2f})", mean[m], most[m]) for m in sampler_contest.METHODS
        ]
        columns[f"calls, {short}"] = [t(calls[m], ".0f") for m in sampler_contest.METHODS]
    return pd.DataFrame({"method": sampler_contest.METHODS, **columns})


def detection_rows(config: Config, landmarks: pd.DataFrame, found: pd.DataFrame) -> pd.DataFrame:
    """Every trigger against "one Gaussian is wrong by more than kl_limit".

    Returns
    -------
    one row per case and trigger: found, missed, false, silent (counts), auc over all cases with
    a score, auc_within (pairs of the same number of poses, or of ranges, only)
    """
    of_landmarks = multimodality.landmark_triggers(landmarks, config.tau, config.gap_limit)
    of_windows = multimodality.window_triggers(found, config.tau)
    rows = []
    for case, frame, triggers, size in (
        ("landmark", landmarks, of_landmarks, "n"), ("window", found, of_windows, "n_ranges"),
    ):  # fmt: skip
        wrong = (frame["kl"] > config.kl_limit).to_numpy()
        for name, (score, fires) in triggers.items():
            counts, known = precision_recall.detection(fires, wrong), ~np.isnan(score)
            scored = np.clip(score[known], -1e9, 1e9), wrong[known]
            within, _ = cluster_bootstrap.within_auc(
                *scored, frame[size].to_numpy()[known], rng=np.random.default_rng(0)
            )
            rows.append({
                "case": case, "trigger": name, "found": counts.true_positives,
                "missed": counts.false_negatives, "false": counts.false_positives,
                "silent": counts.true_negatives, "auc": precision_recall.roc_auc(*scored),
                "auc_within": within.value,
            })  # fmt: skip
    return pd.DataFrame(rows)


# What the paper's text quotes, by the parts of a key: of posteriors, triggers and samplers.
SHARES = {
    "landmark": {2: ("wrong", "two"), 3: ("wrong", "two"), 4: ("wrong", "two"),
                 5: ("wrong", "two"), 8: ("wrong",)},
    "window": dict.fromkeys((1, 2, 3, 6), ("two",)),
}  # fmt: skip
TRIGGERS = {
    "landmark.mirror": ("found", "missed", "false", "auc", "auc_within"),
    "landmark.condition": ("found", "auc", "auc_within"),
    "landmark.condition_landmark": ("auc_within",),
    "window.condition": ("auc",),
    "window.second": ("auc",),
}
SAMPLERS = {"c = 50": "c50", "ancestral": "ancestral", "ancestral, reweighted": "reweighted",
            "many starts": "starts"}  # fmt: skip


def record(
    config: Config, landmarks: pd.DataFrame, found: pd.DataFrame, runs: pd.DataFrame,
    to: report.Report,
) -> None:  # fmt: skip
    """Hand on the numbers that the paper's text quotes."""
    to.value("multimodal.n_seeds", config.n_seeds, ".0f")
    to.value("multimodal.n_landmarks", len(landmarks), ".0f")
    for case, frame, size in (("landmark", landmarks, "n"), ("window", found, "n_ranges")):
        for value, rows in frame.groupby(size):
            flags = {"wrong": rows["kl"] > config.kl_limit, "two": rows["second"] >= SECOND_MASS}
            for name in SHARES[case].get(value, ()):
                share, n = flags[name].mean(), len(rows)
                error = 100 * np.sqrt(max(share * (1 - share), 0.25 / n) / n)
                key = f"multimodal.{case}.{value}.{name}"
                to.value(key, 100 * share, ".0f", "%", n=n, within=3 * error)
    worst = found["shortfall"].max()
    to.value("multimodal.window.shortfall", worst, ".1f", "nats", n=len(found), within=0.5)
    for row in detection_rows(config, landmarks, found).itertuples():
        here = f"{row.case}.{row.trigger.split()[0]}"
        here += "_landmark" if row.trigger.endswith("landmark") else ""
        total = row.found + row.missed + row.false + row.silent
        for name in TRIGGERS[here]:
            fmt, within = (".2f", 0.05) if name.startswith("auc") else (".0f", 4)
            key = f"multimodal.{here}.{name}"
            to.value(key, getattr(row, name), fmt, n=total, within=within)
    _record_samplers(runs, to)


def _record_samplers(runs: pd.DataFrame, to: report.Report) -> None:
    for (case, method), rows in runs[runs["method"].isin(SAMPLERS)].groupby(["case", "method"]):
        place, name = case.replace(", from the ", "_").replace(" ", "_"), SAMPLERS[method]
        here, errors = f"multimodal.{place}.{name}", rows["mass_error"]
        if case in ("landmark", "window"):
            within = (errors <= MASS_TARGET).sum()
            to.value(f"{here}.within", within, ".0f", n=len(rows), within=3)
            if name == "ancestral":
                to.value(f"{here}.runs", len(rows), ".0f")
        elif name in ("c50", "ancestral"):
            to.value(f"{here}.mass_error", errors.mean(), ".3f", error=standard_error(errors),
                     n=len(rows))  # fmt: skip


def record_strong(strong: pd.DataFrame, to: report.Report) -> None:
    """Hand on what windows with the paper's own odometry hold."""
    two = int((strong["second"] >= SECOND_MASS).sum())
    to.value("multimodal.strong.two", two, ".0f", n=len(strong), within=2)
    to.value("multimodal.strong.windows", len(strong), ".0f")


WHITE_TO_GREEN = LinearSegmentedColormap.from_list("", ["white", style.SAMPLES])
LEAST, FAR = 1e-3, 1e3  # what a logarithmic axis shows for less, and for a gap of more
MARKERS = "os^vDP"  # beside the colours, for grey print
COLOURS = [style.ESTIMATE, style.TRIGGERED, style.LANDMARK, style.SAMPLES, style.PRIOR]


def draw_posterior(ax: Axes, view) -> None:
    """Posterior of a landmark (a `multimodality.View`), the poses, two sigma of one Gaussian.

    The shade is the root of the density, so that a light mode is seen beside a heavy one.
    """
    places = np.concatenate([view.places, view.places[:, :1]], axis=1)
    shade = np.exp(0.5 * (view.log_density - view.log_density.max()))
    shade = np.concatenate([shade, shade[:, :1]], axis=1)
    ax.pcolormesh(places[..., 0], places[..., 1], shade, cmap=WHITE_TO_GREEN, shading="gouraud",
                  rasterized=True)  # fmt: skip
    if view.gaussian is not None:
        draw_ellipse(ax, *view.gaussian, style.ESTIMATE)
    ax.plot(*view.positions.T, ".", color=style.PRINTED)
    ax.plot(*view.truth, "+", color=style.TRUTH, ms=6)
    # the ring of the first range, which holds both places
    reach = 1.2 * np.linalg.norm(view.truth - view.positions[0]) + 1
    x, y = np.array([-reach, reach]) + view.positions[0][:, None]
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=x, ylim=y)


def draw_divergences(ax: Axes, found: pd.DataFrame, kl_limit: float, fires: np.ndarray) -> None:
    """KL of one Gaussian, a dot per case, beside the number of poses; filled where it fires."""
    rank = found.groupby("n")["kl"].rank(pct=True).to_numpy()
    across, height = found["n"].to_numpy() + 0.7 * (rank - 0.5), np.maximum(found["kl"], LEAST)
    for flag, face, name in ((True, style.TRIGGERED, "fires"), (False, "none", "is silent")):
        here = fires == flag
        ax.plot(across[here], height[here], "o", ms=2.5, mew=0.5, color=style.TRIGGERED, mfc=face,
                label=f"mirror test {name}")  # fmt: skip
    ax.axhline(kl_limit, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(
        yscale="log", ylabel="KL(posterior ‖ one Gaussian) [nats]", xticks=sorted(set(found["n"])),
        xlabel="poses that saw the landmark",
    )  # fmt: skip
    legend_above(ax, 2)


def draw_gaps(ax: Axes, found: pd.DataFrame, config: Config) -> None:
    """KL of one Gaussian against the gap of the mirror test, a dot per case, by number of poses."""
    gap = np.minimum(found["gap"], FAR)
    looks = zip(sorted(set(found["n"])), style.SEQUENCE, MARKERS, strict=False)
    for n, colour, marker in looks:
        here = found["n"] == n
        ax.plot(gap[here], np.maximum(found["kl"][here], LEAST), marker, ms=3, mew=0.5,
                mfc="none", color=colour, label=f"{n} poses")  # fmt: skip
    ax.axhline(config.kl_limit, color=style.TRUTH, lw=0.6, ls=":")
    ax.axvline(config.gap_limit, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(xscale="symlog", yscale="log", xlabel="gap of the mirror test [nats]")
    ax.set(ylabel="KL(posterior ‖ one Gaussian) [nats]", xticks=[0, 1, 10, 100, 1000])
    ax.set_xlim(min(gap.min(), 0) - 0.5, 1.5 * FAR)
    ax.xaxis.set_major_formatter("{x:g}")
    legend_above(ax, 3)


def draw_look(ax: Axes, prior: np.ndarray, samples: np.ndarray, weights: np.ndarray) -> None:
    """Draws (N, 2) of a prior, and the weighted samples that nested sampling found in it, [m]."""
    ax.plot(*prior.T, ".", ms=1.5, color=style.PRIOR, alpha=0.6, label="prior", zorder=1)
    kept = weights > 0.02 * weights.max()
    ax.scatter(*samples[kept].T, s=8 * weights[kept] / weights.max(), color=style.SAMPLES, lw=0,
               alpha=0.5, label="posterior found", zorder=2)  # fmt: skip
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-5, 9), ylim=(-7, 7))


def draw_mass_errors(
    ax: Axes, errors: Mapping[str, Mapping[str, np.ndarray]], target: float
) -> None:  # fmt: skip
    """Largest error of a mode's mass, a dot per run: case -> method -> (n,), target dotted."""
    methods = list(next(iter(errors.values())))
    for i, (case, by_method) in enumerate(errors.items()):
        for k, method in enumerate(methods):
            values = np.maximum(by_method.get(method, np.zeros(0)), LEAST)
            place = k + 0.18 * (i - 0.5 * (len(errors) - 1))
            ax.plot(np.full(len(values), place), values, MARKERS[i], ms=2.5, mew=0,
                    alpha=0.6, color=COLOURS[i], label=case if k == 0 else None)  # fmt: skip
    ax.axhline(target, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(yscale="log", ylabel="largest error of a mode's mass", xticks=range(len(methods)),
           xticklabels=[method.replace(", ", ",\n") for method in methods])  # fmt: skip
    legend_above(ax, 2)
