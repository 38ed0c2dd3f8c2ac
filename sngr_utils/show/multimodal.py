"""The tables and figures of notebook 09, and what it records."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Ellipse

from sngr_utils.experiments import multimodality, sampler_contest
from sngr_utils.experiments.multimodality import SECOND_MASS
from sngr_utils.metrics import cluster_bootstrap, precision_recall
from sngr_utils.metrics.standard_error import standard_error
from sngr_utils.multimodal import Config
from sngr_utils.publish import report
from sngr_utils.publish.cells import text
from sngr_utils.show import style
from sngr_utils.show.common import legend_above

t = text
MASS_TARGET = 0.05  # error of a mode's mass that is small enough
FEW_POSES = 3  # poses after which a landmark usually still has two places


def landmarks_table(landmarks: pd.DataFrame, config: Config) -> pd.DataFrame:
    """By number of poses: how often one Gaussian is wrong, and what there is instead."""
    rows = []
    for n, found in landmarks.groupby("n"):
        two, wrong = found["second"] >= SECOND_MASS, found["kl"] > config.kl_limit
        rows.append([
            f"{n}", f"{len(found)}", f"{wrong.mean():.0%}",
            f"{(found['kl_moments'] > config.kl_limit).mean():.0%}", f"{two.mean():.0%}",
            t(found["kl"].median(), ".2f"), t(found["spread"].median(), ".2f"),
            f"{(found['gap'] < config.gap_limit).mean():.0%}",
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
            f"{m}", f"{len(part)}", f"{wrong.mean():.0%}", f"{two.mean():.0%}",
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
        "best Youden": rows["youden"].map(t),
    })  # fmt: skip


def samplers_table(runs: pd.DataFrame, case: str) -> pd.DataFrame:
    """Methods of one case: errors of masses, divergence, evidence, and likelihood calls."""
    mine, rows = runs[runs["case"] == case], []
    for (size, method), part in mine.groupby(["size", "method"], sort=False):
        small = (part["mass_error"] <= MASS_TARGET).sum()
        rows.append([
            f"{size}", method, t(part["mass_error"].mean(), ".3f"), t(part["mass_error"].max()),
            f"{small} of {len(part)}", t(part["divergence"].mean()),
            t(part["evidence_error"].mean()), f"{part['calls'].mean() / 1000:.0f}",
        ])  # fmt: skip
    heads = ["size", "method", "mass error", "worst", "within the target", "KL in cells [nats]",
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
        cells = [f"{t(errors.mean()[m])} ({t(errors.max()[m])})" for m in sampler_contest.METHODS]
        columns[short] = cells
        columns[f"calls, {short}"] = [f"{calls[m]:.0f}" for m in sampler_contest.METHODS]
    return pd.DataFrame({"method": sampler_contest.METHODS, **columns})


def detection_rows(config: Config, landmarks: pd.DataFrame, found: pd.DataFrame) -> pd.DataFrame:
    """Every trigger against "one Gaussian is wrong by more than kl_limit".

    Returns
    -------
    one row per case and trigger: found, missed, false, silent (counts), auc over all cases with
    a score, auc_within (pairs of the same number of poses, or of ranges, only), youden (best
    sum of the true rates less 1, whatever the threshold)
    """
    rows = []
    for case, frame, triggers, size in (
        (
            "landmark",
            landmarks,
            multimodality.landmark_triggers(landmarks, config.tau, config.gap_limit),
            "n",
        ),
        ("window", found, multimodality.window_triggers(found, config.tau), "n_ranges"),
    ):
        wrong = (frame["kl"] > config.kl_limit).to_numpy()
        for name, (score, fires) in triggers.items():
            counts, known = precision_recall.detection(fires, wrong), ~np.isnan(score)
            scored = np.clip(score[known], -1e9, 1e9), wrong[known]
            false_rate, true_rate = (
                precision_recall.roc_curve(*scored)
                if len(set(scored[1])) == 2
                else (np.zeros(1),) * 2
            )
            within, _ = cluster_bootstrap.within_auc(
                *scored, frame[size].to_numpy()[known], rng=np.random.default_rng(0)
            )
            rows.append({
                "case": case, "trigger": name, "found": counts.true_positives,
                "missed": counts.false_negatives, "false": counts.false_positives,
                "silent": counts.true_negatives, "auc": precision_recall.roc_auc(*scored),
                "auc_within": within.value, "youden": float((true_rate - false_rate).max()),
            })  # fmt: skip
    return pd.DataFrame(rows)


def record(
    config: Config, landmarks: pd.DataFrame, found: pd.DataFrame, runs: pd.DataFrame,
    to: report.Report,
) -> None:  # fmt: skip
    """Hand on the numbers that the paper's text quotes."""
    to.value("multimodal.n_seeds", config.n_seeds, ".0f")
    to.value("multimodal.n_landmarks", len(landmarks), ".0f")
    to.value("multimodal.n_windows", len(found), ".0f")

    def share(key, flags):
        error = 100 * np.sqrt(
            max(flags.mean() * (1 - flags.mean()), 0.25 / len(flags)) / len(flags)
        )
        to.value(key, 100 * flags.mean(), ".0f", "%", n=len(flags), within=3 * error)

    for case, frame, size in (("landmark", landmarks, "n"), ("window", found, "n_ranges")):
        for value, rows in frame.groupby(size):
            share(f"multimodal.{case}.{value}.wrong", rows["kl"] > config.kl_limit)
            share(f"multimodal.{case}.{value}.two", rows["second"] >= SECOND_MASS)
    worst = found["shortfall"].max()
    to.value("multimodal.window.shortfall", worst, ".1f", "nats", n=len(found), within=0.5)
    for row in detection_rows(config, landmarks, found).itertuples():
        here = f"multimodal.{row.case}.{row.trigger.split()[0]}"
        here += "_landmark" if row.trigger.endswith("landmark") else ""
        total = row.found + row.missed + row.false + row.silent
        for name in ("found", "missed", "false"):
            to.value(f"{here}.{name}", getattr(row, name), ".0f", n=total, within=4)
        for name in ("auc", "auc_within"):
            to.value(f"{here}.{name}", getattr(row, name), n=total, within=0.05)
    short = ("gaussian", "c1", "c50", "ancestral", "reweighted", "starts")
    names = dict(zip(sampler_contest.METHODS, short, strict=True))
    for (case, method), rows in runs.groupby(["case", "method"], sort=False):
        here = f"multimodal.{case.replace(', from the ', '_').replace(' ', '_')}.{names[method]}"
        errors = rows["mass_error"]
        to.value(f"{here}.mass_error", errors.mean(), ".3f", error=standard_error(errors),
                 n=len(rows))  # fmt: skip
        to.value(f"{here}.worst", errors.max(), ".2f", n=len(rows), within=0.1)
        to.value(f"{here}.within", (errors <= MASS_TARGET).sum(), ".0f", n=len(rows), within=3)
        to.value(f"{here}.runs", len(rows), ".0f")
        calls = rows["calls"].mean() / 1000
        to.value(f"{here}.calls", calls, ".0f", n=len(rows), within=0.3 * calls)


def record_strong(strong: pd.DataFrame, to: report.Report) -> None:
    """Hand on what windows with the paper's own odometry hold."""
    two = int((strong["second"] >= SECOND_MASS).sum())
    to.value("multimodal.strong.two", two, ".0f", n=len(strong), within=2)
    to.value("multimodal.strong.windows", len(strong), ".0f")
    largest = strong["kl"].median()
    to.value("multimodal.strong.kl", largest, unit="nats", n=len(strong), within=0.2)


WHITE_TO_GREEN = LinearSegmentedColormap.from_list("", ["white", style.SAMPLES])
LEAST = 1e-3  # what a logarithmic axis shows for less
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
        variances, axes = np.linalg.eigh(view.gaussian[1])
        width, height = 4 * np.sqrt(variances)
        angle = np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))
        ax.add_patch(Ellipse(view.gaussian[0], width, height, angle=angle, fill=False,
                             color=style.ESTIMATE))  # fmt: skip
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
            ax.plot(np.full(len(values), place), values, "o", ms=2.5, mew=0, alpha=0.6,
                    color=COLOURS[i], label=case if k == 0 else None)  # fmt: skip
    ax.axhline(target, color=style.TRUTH, lw=0.6, ls=":")
    ax.set(yscale="log", ylabel="largest error of a mode's mass", xticks=range(len(methods)),
           xticklabels=[method.replace(" ", "\n") for method in methods])  # fmt: skip
    legend_above(ax, 2)
