"""The numbers that the original prints, under its authors' conventions: `make original` runs this.

Under GTSAM 4.2, dynesty 3.0.0 and what these need, in an environment of its own:
``python -m sngr_utils.experiments.authors_digits FILE DRAWS``. Numbers of iSAM2 and of the trigger
hang on no draw. The authors gave their sampler no seed, so SNGR runs with DRAWS seeds of it.
"""

import hashlib
import json
import math
import platform
import sys
from importlib.metadata import version
from pathlib import Path

import gtsam
import numpy as np
from dynesty import NestedSampler
from gtsam.symbol_shorthand import L, X
from scipy.special import ndtri

from sngr_utils.experiments import authors_conventions as authors

TAUS, TAU_SNGR, SNGR_PS, SEED_P = (3.92, 3.96, 4.0), 3.9, authors.PS[:4], 0.3
LIVE, DLOGZ, MOST, JITTER, SLACK = 100, 0.5, 1000, 1e-6, 1e-3
WEAK = 2.0  # m^2: the trace from which a landmark is sampled too


def main(path: Path, draws: int) -> None:
    """Compute everything and write it."""
    found = {
        "command": f"make original DRAWS={draws}",
        "versions": {name: version(name) for name in ("gtsam", "dynesty", "numpy")},
        "python": platform.python_version(),
        "code": fingerprint(),
        "printed": {**baseline(), **by_seed(), **sngr()},
        "draws": [],
    }
    for draw in range(draws):
        if sys.stderr.isatty():
            print(f"draw {draw + 1} of {draws}", file=sys.stderr)
        found["draws"] += [drawn(p, draw) for p in SNGR_PS]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1) + "\n")


def fingerprint() -> str:
    """Hash of the two modules that the numbers come from."""
    texts = [Path(module).read_text() for module in (authors.__file__, __file__)]
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:32]


def counted(one: authors.Outcome, first: int, tau: float) -> dict[str, float | int | None]:
    """Counts and rates of the trigger in one world; None where nothing fired, or none failed."""
    fired = one.fires(first, tau)
    hits, n, failed = (int(each.sum()) for each in (fired & one.failed, fired, one.failed))
    return {
        "triggered": n, "failed": failed, "tp": hits, "fp": n - hits, "fn": failed - hits,
        "precision": hits / n if n else None, "recall": hits / failed if failed else None,
    }  # fmt: skip


def baseline() -> dict[str, float | int | None]:
    """The tables "baseline" and "tau", by their paths in ``paper/printed_values.yaml``."""
    found = {}
    for p in authors.PS:
        runs = [authors.outcome(p, seed) for seed in authors.SEEDS]
        rmse, counts = [run.rmse for run in runs], counted(runs[0], 1, authors.TAU)
        shown = {"rmse": np.mean(rmse), "rmse_std": np.std(rmse), "nees": runs[0].nees}
        shown |= {name: counts[name] for name in ("precision", "recall", "triggered", "failed")}
        found |= {f"baseline/{p}/{name}": value for name, value in shown.items()}
        for tau in TAUS:
            name = {0.0: "clean", SEED_P: f"noisy_p{SEED_P}"}.get(p)
            if name:
                found[f"tau_sensitivity/{tau:.2f}/{name}"] = int(runs[0].fires(1, tau).sum())
    return found


def by_seed() -> dict[str, float | int | None]:
    """The table "perseed"."""
    found = {}
    for seed in authors.SEEDS:
        counts = counted(authors.outcome(SEED_P, seed), 1, authors.TAU)
        del counts["failed"]
        found |= {f"per_seed_p{SEED_P}/{seed}/{name}": value for name, value in counts.items()}
    return found


def sngr() -> dict[str, float | int | None]:
    """Of the table "sngr" what no draw decides: that of the trigger, and what nothing refines."""
    found = {}
    for p in SNGR_PS:
        one = authors.outcome(p, authors.SEEDS[0])
        counts = counted(one, authors.WIDTH - 1, TAU_SNGR)
        shown = {name: counts[name] for name in ("triggered", "precision", "recall")}
        shown["landmark_rmse"] = one.landmark_rmse
        if not counts["triggered"]:
            shown |= {"pose_rmse": one.rmse, "nees": one.nees}
        found |= {f"sngr/{p}/{name}": value for name, value in shown.items()}
        found[f"cost/{p}/triggered"] = counts["triggered"]
    return found


def drawn(p: float, draw: int) -> dict[str, float | int | None]:
    """SNGR in the first world, with one seed of the sampler.

    Raises
    ------
    ValueError : a landmark is so weakly held that the authors sample it too; none is, in this world
    """
    poses, landmarks, odometry, scans = authors.world(p, authors.SEEDS[0])
    graph, marginals, found = authors.estimate(poses, landmarks, odometry, scans)
    traces = [np.trace(marginals.marginalCovariance(L(k))) for k in range(len(landmarks))]
    if max(traces) > WEAK:
        raise ValueError(f"p = {p}: a landmark has a trace of {max(traces):.2f} m^2, above {WEAK}")
    before = authors.judged(poses, landmarks, scans, marginals, found)
    fired = np.flatnonzero(before.fires(authors.WIDTH - 1, TAU_SNGR)).tolist()
    refined, windows = gtsam.Values(found), []
    for t in fired:
        rng = np.random.default_rng([authors.SEEDS[0], draw, t])
        window = refine(authors.window_factors(graph, t), marginals, found, t, rng=rng)
        windows.append(window)
        if window["gain"] >= -SLACK:
            place(refined, t, window.pop("mean"))
    after = authors.judged(poses, landmarks, scans, marginals, refined)
    gains = [window["gain"] for window in windows]
    return {
        "p": p, "draw": draw, "pose_rmse": after.rmse, "nees": after.nees, "refined": len(fired),
        "accepted": int(sum(gain >= -SLACK for gain in gains)),
        "gain_min": min(gains, default=None), "gain_max": max(gains, default=None),
        "peak": fired[int(np.argmax(gains))] if fired else None,
        "heaviest_max": max((window["heaviest"] for window in windows), default=None),
        "ess_share": float(np.median([w["ess_share"] for w in windows])) if fired else None,
        "like_a_gaussian": int(sum(window["like_a_gaussian"] for window in windows)),
    }  # fmt: skip


def place(values: gtsam.Values, t: int, x: np.ndarray) -> None:
    """Put the (9,) x, y and heading of three poses where window t is."""
    for i in range(authors.WIDTH):
        values.update(X(t + i), gtsam.Pose2(*x[3 * i : 3 * i + 3]))


def refine(
    factors: gtsam.NonlinearFactorGraph,
    marginals: gtsam.Marginals,
    found: gtsam.Values,
    t: int,
    *,
    rng: np.random.Generator,
) -> dict:
    """Nested sampling of a window: its mean, gains of that and the heaviest sample [nats], ESS.

    The covariance, which GTSAM gives in the body frame, is used as one of x, y and heading, as the
    authors do. "like_a_gaussian": log evidence within three errors of that of one Gaussian.
    """
    at = [found.atPose2(X(t + i)) for i in range(authors.WIDTH)]
    centre = np.array([number for pose in at for number in (pose.x(), pose.y(), pose.theta())])
    keys = gtsam.KeyVector([X(t + i) for i in range(authors.WIDTH)])
    covariance = marginals.jointMarginalCovariance(keys).fullMatrix()
    root = np.linalg.cholesky(covariance + JITTER * np.eye(len(centre)))
    values = gtsam.Values(found)

    def loglik(x: np.ndarray) -> float:
        place(values, t, x)
        return -0.5 * factors.error(values)

    n, held = len(centre), loglik(centre)
    sampler = NestedSampler(
        loglik, lambda u: centre + root @ ndtri(u), n,
        nlive=LIVE, sample="rwalk", bootstrap=0, walks=max(n, 9), rstate=rng,
    )  # fmt: skip
    sampler.run_nested(dlogz=DLOGZ, maxiter=MOST, print_progress=False)
    results = sampler.results
    weights = np.exp(results.logwt - np.max(results.logwt))
    weights /= weights.sum()
    mean = weights @ results.samples
    off = results.logz[-1] - laplace(lambda z: loglik(centre + root @ z), n)
    return {
        "mean": mean, "gain": loglik(mean) - held,
        "heaviest": float(results.logl[np.argmax(weights)] - held),
        "ess_share": float(1 / np.sum(weights**2) / len(weights)),
        "like_a_gaussian": bool(abs(off) < 3 * results.logzerr[-1]),
    }  # fmt: skip


def laplace(loglik, n: int, step: float = 1e-2) -> float:
    """Log evidence of exp(loglik(z)) under a standard normal z as if the posterior were Gaussian.

    Newton's steps with second differences from z = 0, each halved until it gains.
    """

    def target(z: np.ndarray) -> float:
        return loglik(z) - 0.5 * z @ z

    z, eye = np.zeros(n), step * np.eye(n)
    for _ in range(20):
        here = target(z)
        up, down = (np.array([target(z + sign * e) for e in eye]) for sign in (1, -1))
        slope, curved = (up - down) / (2 * step), np.empty((n, n))
        for i in range(n):
            curved[i, i] = (up[i] - 2 * here + down[i]) / step**2
            for j in range(i):
                both = target(z + eye[i] + eye[j]) - up[i] - up[j] + here
                curved[i, j] = curved[j, i] = both / step**2
        move = np.linalg.solve(-curved, slope)
        while target(z + move) < here and np.linalg.norm(move) > 1e-6:
            move /= 2
        z = z + move
        if np.linalg.norm(move) < 1e-4:
            break
    _, logdet = np.linalg.slogdet(-curved)
    return target(z) - 0.5 * logdet if math.isfinite(logdet) else math.nan


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
