"""What notebook 05 hands on: one number per world for every claim, and what the text quotes."""

import numpy as np
import pandas as pd

from sngr_utils.audit import NOOP_P, Config
from sngr_utils.experiments import isam2_over_worlds
from sngr_utils.experiments.window_studies import WindowStudies
from sngr_utils.metrics import standard_error, summaries
from sngr_utils.publish import report

# What the claims ask of every preset: threshold -> column -> levels of p; and of refinement.
MOST = (0.0, 0.1, 0.2, 0.3)
EVERY_P = (*MOST, 0.4)
DETECTED = {
    3.9: dict.fromkeys(("triggered", "precision", "recall"), MOST),
    3.92: {"triggered": (0.0, 0.3), "recall": (0.3,)},
    3.96: {
        **dict.fromkeys(("triggered", "precision", "recall"), EVERY_P),
        **dict.fromkeys(("tp", "fp", "fn", "precision_over_base"), (0.3,)),
    },
    4.0: {"triggered": (0.0, 0.3)},
}
ROBUST = ("cauchy", "dead_reckoning", "gnc_tls", "huber", "least_squares", "oracle")
REFINED = {
    **dict.fromkeys(("sngr_pose_rmse", "sngr_landmark_rmse", "sngr_nees", "saving"), MOST),
    **dict.fromkeys(("gain_min", "gain_peak_window", "ess_share"), (0.2,)),
    "gain_max": (0.0, 0.2),
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
        for name in ("pose_rmse", "nees", "failed"):
            to.sample(f"audit.{preset}.p{p:g}.{name}", rows[name].astype(float))
    for (preset, p, tau), rows in sweep.detections.groupby(["preset", "p", "tau"], sort=False):
        over = summaries.precision_over_base(rows, sweep.runs).to_numpy()
        for name, levels in DETECTED.get(tau, {}).items():
            if p in levels:
                values = rows.assign(precision_over_base=over)[name].astype(float)
                to.sample(f"audit.{preset}.p{p:g}.tau{tau:g}.{name}", values)
    medians = sweep.scores.groupby(["preset", "p", "seed"], sort=False)["score"].median()
    for (preset, p), values in medians.groupby(level=["preset", "p"], sort=False):
        if p <= 0.1:
            to.sample(f"audit.{preset}.p{p:g}.median_score", values)
    for (preset, p), rows in refined.groupby(["preset", "p"], sort=False):
        for name, levels in REFINED.items():
            if p in levels:
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
        by_world = rows.groupby("seed")["over_conditional"].mean()
        sample(f"widths.{reading}.conditional", by_world, ".3f")
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
    for mean, rows in nees.query("frame == 'world' and preset == 'C'").groupby("x0_mean"):
        sample(f"nees.C.{mean}", rows["nees"])
    most = robust_runs.query("p == p.max() and start != 'first_poses'")
    for (method, start, p), rows in most.groupby(["method", "start", "p"]):
        if method in ROBUST:
            sample(f"robust.{method}.{start}.p{p:g}", rows["pose_rmse"], unit="m")
