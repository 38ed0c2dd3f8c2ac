"""Driver of notebook 09: where a posterior has several places, who notices, who samples them."""

from dataclasses import dataclass, replace
from typing import Annotated

import joblib
import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from sngr_utils import (
    ancestral,
    brute_force,
    chain,
    graph,
    many_starts,
    metrics,
    nested,
    report,
    variations,
    windows,
    world,
)
from sngr_utils.landmark_target import Landmark, landmark_of
from sngr_utils.mirror import mirror_test
from sngr_utils.window_target import Window, window_of
from sngr_utils.world import Positive, Probability, Scenario, Seed

PRESET = graph.PRESETS["C"]
METHODS = ["one Gaussian", "c = 1", "c = 50", "ancestral", "many starts"]
SCALES = {"c = 1": 1.0, "c = 50": 50.0}  # of the Gaussian priors, the paper's
SECOND_MASS = 0.05  # of the second mode, from which there are two
WINDOW_POSES = windows.WIDTH
PLANE_WALKS, WINDOW_WALKS = 25, 50  # steps that leave no bias to be seen at this size
N_STARTS, PLANE_DRAWS, WINDOW_DRAWS = 32, 4_000, 20_000
ANCHOR_DISTANCE, ANCHOR_RANGE, ANCHOR_SIGMA, ANCHOR_PRIOR = 4.0, 3.0, 0.2, 10.0  # notebook 1, [m]

Counts = Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)]


class Config(Scenario):
    """Parameters of the study. Worlds are those of seeds first_seed, first_seed + 1, ...

    n_seeds : worlds
    poses_seen : numbers of poses after which a landmark is looked at
    poses_sampled : those after which samplers are compared
    n_sampled : worlds whose windows are sampled, the costly part
    p : probability of a wrong association in the windows
    weak : factor on the odometry's sigmas in the windows
    ranges_per_pose : numbers of ranges that each pose of a window keeps
    kl_limit : divergence of one Gaussian above which it is called wrong, [nats]
    gap_limit : the mirror test fires if the gap is below this, [nats]; 3 is an image of 5 % mass
    tau : threshold of the paper's score
    n_live_landmark, n_live_window : live points
    n_particles : of each of ten filters
    jobs : processes; results do not depend on it
    """

    first_seed: Seed = 100
    n_seeds: Annotated[int, Field(ge=2)] = 12
    poses_seen: Counts = [2, 3, 4, 5, 6, 7, 8]
    poses_sampled: Counts = [2, 3, 4, 8]
    n_sampled: Annotated[int, Field(ge=2)] = 4
    p: Probability = 0.4
    weak: Positive = 10.0
    ranges_per_pose: Counts = [1, 2, 3, 6]
    kl_limit: Positive = 1.0
    gap_limit: Positive = 3.0
    tau: Positive = 3.96
    n_live_landmark: Annotated[int, Field(ge=20)] = 500
    n_live_window: Annotated[int, Field(ge=20)] = 500
    n_particles: Annotated[int, Field(ge=100)] = 6_000
    jobs: Annotated[int, Field(ge=1)] = 2

    @model_validator(mode="after")
    def _consistent(self):
        if max(self.poses_seen + self.poses_sampled) > self.n_poses:
            raise ValueError(f"poses_seen is {self.poses_seen}: there are {self.n_poses} poses")
        if max(self.ranges_per_pose) > self.n_landmarks:
            raise ValueError(
                f"ranges_per_pose is {self.ranges_per_pose}: a pose sees {self.n_landmarks}"
            )
        if self.n_sampled > self.n_seeds:
            raise ValueError(f"n_sampled is {self.n_sampled}: it must not exceed n_seeds")
        return self

    def seeds(self, n: int) -> list[int]:
        return list(range(self.first_seed, self.first_seed + n))

    def world(self, seed: int) -> world.World:
        """The clean world of a seed."""
        return world.simulate(self.part(Scenario), 0.0, rng=np.random.default_rng(seed))

    def landmark(self, seed: int, label: int, n: int) -> Landmark:
        """Posterior of a landmark of a clean world after its first n poses."""
        sigma = PRESET.landmark_prior_sigma
        return landmark_of(self.world(seed), PRESET.x0_sigmas, sigma, label, n)

    def window(self, seed: int, n_ranges: int) -> Window:
        """Posterior of three poses with weak odometry and ambiguous ranges.

        The prior on the first pose is as wide as one step of the weak odometry.
        """
        xy, theta = self.weak * self.odometry_sigma_xy, self.weak * self.odometry_sigma_theta
        weak = {"odometry_sigma_xy": xy, "odometry_sigma_theta": theta}
        rng = np.random.default_rng(seed)
        scenario = self.part(Scenario).model_copy(update=weak)
        whole = world.simulate(scenario, self.p, rng=rng)
        drawn = variations.draw_x0(whole, [xy, xy, theta], rng=rng)
        return window_of(first_poses(drawn, WINDOW_POSES), [xy, xy, theta], self.p, n_ranges)


def first_poses(the_world: world.World, n: int) -> world.World:
    """The first n poses of a world, and their ranges."""
    kept = the_world.pose_of < n
    parts = {name: getattr(the_world, name)[kept]
             for name in ("pose_of", "label_of", "source_of", "ranges")}  # fmt: skip
    return replace(
        the_world, poses=the_world.poses[:n], odometry=the_world.odometry[: n - 1], **parts
    )


def two_anchors() -> Landmark:
    """The experiment of notebook 1: two known anchors, a range from each."""
    positions = np.array([[0.0, 0.0], [ANCHOR_DISTANCE, 0.0]])
    return Landmark(positions, np.zeros((4, 4)), np.full(2, ANCHOR_RANGE), ANCHOR_SIGMA,
                    positions.mean(axis=0), ANCHOR_PRIOR)  # fmt: skip


# --- a landmark, range by range -------------------------------------------------------------


@dataclass(frozen=True)
class View:
    """One landmark's posterior for a figure.

    Attributes
    ----------
    target, reference, modes : the posterior, its quadrature, its maxima
    truth : (2,) where the landmark is, [m]
    """

    target: Landmark
    reference: brute_force.Reference
    modes: many_starts.Modes
    truth: np.ndarray


def views(config: Config, label: int, poses_seen: list[int]) -> dict[int, View]:
    """A landmark of the first world after so many poses."""
    truth, found = config.world(config.first_seed).landmarks[label], {}
    for n in poses_seen:
        target = config.landmark(config.first_seed, label, n)
        modes = many_starts.find_modes(target, many_starts.ring_starts(target))
        found[n] = View(target, brute_force.landmark_reference(target), modes, truth)
    return found


def run_landmarks(config: Config) -> pd.DataFrame:
    """Every landmark of every world after its first poses: one Gaussian, and what the tests say.

    Returns
    -------
    one row per seed, n and label: kl of the Gaussian at the MAP and kl_error, kl_moments (of the
    Gaussian with the posterior's own mean and covariance), second (mass of the second mode), gap
    and spread of the mirror test, landmark_score (log10 condition number of the landmark's
    covariance), window_score (the paper's, of the last three poses; NaN before there are three)
    """
    one = joblib.delayed(_landmark_rows)
    done = joblib.Parallel(n_jobs=config.jobs)(
        one(config, seed, n) for seed in config.seeds(config.n_seeds) for n in config.poses_seen
    )
    return pd.DataFrame([row for rows in done for row in rows])


def _landmark_rows(config: Config, seed: int, n: int) -> list[dict]:
    rows, places = [], []
    for label in range(config.n_landmarks):
        target = config.landmark(seed, label, n)
        reference = brute_force.landmark_reference(target)
        modes = many_starts.find_modes(target, many_starts.ring_starts(target))
        masses = np.sort(reference.masses(modes.label(reference.points), len(modes.places)))
        kl, kl_error = reference.divergence(lambda x, modes=modes: modes.log_gaussian(0, x))
        mean, covariance = reference.moments
        moments = ancestral.gaussian(mean, covariance, 1.0).log_density
        test = mirror_test(target.positions, target.ranges, target.variances, modes.places[0])
        places.append(modes.places[0])
        rows.append({
            "seed": seed, "n": n, "label": label, "kl": kl, "kl_error": kl_error,
            "kl_moments": reference.divergence(moments)[0],
            "second": masses[-2] if len(masses) > 1 else 0.0,
            "gap": test.gap, "spread": test.spread,
            "landmark_score": windows.score(modes.covariances[0]),
        })  # fmt: skip
    score = _window_score(config, seed, n, np.array(places))
    return [{**row, "window_score": score} for row in rows]


def _window_score(config: Config, seed: int, n: int, landmarks: np.ndarray) -> float:
    """The paper's score of the last three of n poses; NaN if there are fewer."""
    if n < windows.WIDTH:
        return float("nan")
    part = first_poses(config.world(seed), n)
    s = part.scenario
    return windows.score(
        chain.selected_inverse(
            world.dead_reckoning(part.x0_mean, part.odometry), landmarks, part.odometry,
            part.pose_of, part.label_of, x0_mean=part.x0_mean, x0_sigmas=PRESET.x0_sigmas,
            odometry_sigmas=[s.odometry_sigma_xy, s.odometry_sigma_xy, s.odometry_sigma_theta],
            landmark_prior_sigma=PRESET.landmark_prior_sigma, range_sigma=s.range_sigma,
        ).windows[-1]
    )  # fmt: skip


def fired(config: Config, found: pd.DataFrame) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Trigger -> ((N,) score, higher for more alarm; (N,) bool, whether it fires)."""
    gap = found["gap"].to_numpy()
    scores = {
        "mirror test": (-gap, gap < config.gap_limit),
        "condition number, window": (
            found["window_score"].to_numpy(), (found["window_score"] > config.tau).to_numpy()
        ),
        "condition number, landmark": (
            found["landmark_score"].to_numpy(), (found["landmark_score"] > config.tau).to_numpy()
        ),
    }  # fmt: skip
    return scores


# --- samplers -------------------------------------------------------------------------------


def run_samplers(config: Config) -> pd.DataFrame:
    """All methods on the two anchors, on landmarks after their first poses, and on windows.

    Returns
    -------
    one row per case ("two anchors", "landmark", "window"), size (poses, or ranges per pose),
    seed and method: mass_error (largest over the modes), divergence (of the samples, over 16
    cells of the plane) [nats], evidence_error [nats], calls
    """
    seeds, few = config.seeds(config.n_seeds), config.seeds(config.n_sampled)
    tasks = [
        joblib.delayed(_window)(config, seed, m) for m in config.ranges_per_pose for seed in few
    ]
    tasks += [joblib.delayed(_anchors)(config, seed) for seed in seeds]
    tasks += [
        joblib.delayed(_landmark)(config, seed, n) for n in config.poses_sampled for seed in seeds
    ]
    done = joblib.Parallel(n_jobs=config.jobs)(tasks)
    return pd.DataFrame([row for rows in done for row in rows])


def plane_runs(
    config: Config, target: Landmark, start: np.ndarray, covariance: np.ndarray, seed: int
) -> dict[str, nested.NestedRun]:
    """Every method on a landmark, the Gaussians being N(start, c covariance)."""
    rng = np.random.default_rng([seed, 9])
    settings = nested.SamplerSettings(n_live=config.n_live_landmark, min_walks=PLANE_WALKS)
    modes = many_starts.find_modes(target, many_starts.ring_starts(target))
    priors = {name: ancestral.gaussian(start, covariance, c) for name, c in SCALES.items()}
    priors["ancestral"] = ancestral.ring(target)
    return {
        "one Gaussian": many_starts.laplace_draws(modes, PLANE_DRAWS, rng=rng),
        **{
            name: ancestral.sample(target, prior, settings, rng=rng)
            for name, prior in priors.items()
        },
        "many starts": many_starts.mixture_draws(target, modes, PLANE_DRAWS, rng=rng),
    }


def anchor_runs(config: Config, seed: int, place: str) -> dict[str, nested.NestedRun]:
    """Every method on the two anchors, the Gaussians about the "saddle" or a "mode".

    The saddle is where the paper's solver stays, and its covariance there is the prior's along
    the direction in which the landmark could be on either side.
    """
    target, height = two_anchors(), np.sqrt(ANCHOR_RANGE**2 - ANCHOR_DISTANCE**2 / 4)
    start = target.centre + np.array([0.0, height if place == "mode" else 0.0])
    return plane_runs(config, target, start, target.gauss_newton_covariance(start), seed)


def _anchors(config: Config, seed: int) -> list[dict]:
    target = two_anchors()
    modes = many_starts.find_modes(target, many_starts.ring_starts(target))
    judge = _judge(brute_force.landmark_reference(target), modes, lambda x: x)
    rows = []
    for place in ("saddle", "mode"):
        runs = anchor_runs(config, seed, place)
        if place == "mode":  # the others do not depend on it
            runs = {name: runs[name] for name in SCALES}
        head = {"case": f"two anchors, from the {place}", "size": 2, "seed": seed}
        rows += [{**head, "method": name, **judge(run)} for name, run in runs.items()]
    return rows


def _landmark(config: Config, seed: int, n: int) -> list[dict]:
    target = config.landmark(seed, 0, n)
    modes = many_starts.find_modes(target, many_starts.ring_starts(target))
    runs = plane_runs(config, target, modes.places[0], modes.covariances[0], seed)
    judge = _judge(brute_force.landmark_reference(target), modes, lambda x: x)
    head = {"case": "landmark", "size": n, "seed": seed}
    return [{**head, "method": name, **judge(run)} for name, run in runs.items()]


def _window(config: Config, seed: int, n_ranges: int) -> list[dict]:
    target, rng = config.window(seed, n_ranges), np.random.default_rng([seed, 10])
    reference, modes, tree = _window_modes(config, target, rng)
    settings = nested.SamplerSettings(n_live=config.n_live_window, min_walks=WINDOW_WALKS)
    own = many_starts.find_modes(target, tree.draw(N_STARTS, rng=rng))
    runs = {"one Gaussian": many_starts.laplace_draws(own, PLANE_DRAWS, rng=rng)}
    priors = {
        name: ancestral.gaussian(own.places[0], own.covariances[0], c) for name, c in SCALES.items()
    }
    for name, prior in {**priors, "ancestral": tree}.items():
        runs[name] = ancestral.sample(target, prior, settings, rng=rng)
    runs["many starts"] = many_starts.mixture_draws(target, own, WINDOW_DRAWS, rng=rng)
    judge = _judge(reference, modes, lambda x: target.positions(x)[:, -1])
    head = {"case": "window", "size": n_ranges, "seed": seed}
    return [{**head, "method": name, **judge(run)} for name, run in runs.items()]


def _judge(reference: brute_force.Reference, modes: many_starts.Modes, plane):
    """run -> its errors against a reference; `plane` takes (N, d) points to (N, 2) places."""
    exact = reference.masses(modes.label(reference.points), len(modes.places))
    parts = brute_force.cells(plane(reference.points), reference.weights)

    def judge(run: nested.NestedRun) -> dict[str, float]:
        masses = np.bincount(modes.label(run.samples), run.weights, minlength=len(exact))
        return {
            "mass_error": float(abs(masses - exact).max()),
            "divergence": parts.divergence(plane(run.samples), run.weights),
            "evidence_error": run.log_evidence - reference.log_evidence,
            "calls": run.calls,
        }

    return judge


def _window_modes(
    config: Config, target: Window, rng: np.random.Generator
) -> tuple[brute_force.Reference, many_starts.Modes, ancestral.Prior]:
    """Reference, all modes (from prior draws and from posterior draws), and the tree."""
    tree = ancestral.tree(target)
    reference = brute_force.window_reference(target, config.n_particles, rng=rng)
    drawn = reference.points[rng.choice(len(reference.points), N_STARTS, p=reference.weights)]
    starts = np.concatenate([tree.draw(N_STARTS, rng=rng), drawn])
    return reference, many_starts.find_modes(target, starts), tree


def run_windows(config: Config) -> pd.DataFrame:
    """Every window: what a single Gaussian at the MAP misses, and what the triggers say.

    Returns
    -------
    one row per seed and n_ranges: kl and kl_error, second (mass of the second mode), largest
    (mass of the first), shortfall of the Gaussian's evidence [nats] and its error, window_score
    (the paper's), other_share (Laplace mass outside the first mode, from many starts)
    """
    one = joblib.delayed(_window_row)
    rows = joblib.Parallel(n_jobs=config.jobs)(
        one(config, seed, m)
        for m in config.ranges_per_pose
        for seed in config.seeds(config.n_seeds)
    )
    return pd.DataFrame(rows)


def _window_row(config: Config, seed: int, n_ranges: int) -> dict:
    target, rng = config.window(seed, n_ranges), np.random.default_rng([seed, 11])
    reference, modes, tree = _window_modes(config, target, rng)
    own = many_starts.find_modes(target, tree.draw(N_STARTS, rng=rng))
    masses = np.sort(reference.masses(modes.label(reference.points), len(modes.places)))
    kl, kl_error = reference.divergence(lambda x: modes.log_gaussian(0, x))
    shares = np.exp(own.log_masses - np.logaddexp.reduce(own.log_masses))
    to_poses = pose_jacobian(target, modes.places[0])
    return {
        "seed": seed, "n_ranges": n_ranges, "kl": kl, "kl_error": kl_error,
        "second": masses[-2] if len(masses) > 1 else 0.0, "largest": masses[-1],
        "shortfall": reference.log_evidence - modes.log_masses[0],
        "shortfall_error": reference.log_evidence_error,
        "window_score": windows.score(to_poses @ modes.covariances[0] @ to_poses.T),
        "other_share": 1 - shares[0],
    }  # fmt: skip


def pose_jacobian(target: Window, noises: np.ndarray) -> np.ndarray:
    """(3n, 3n) derivative of the poses, each in its own frame, by the (3n,) noises."""

    def poses(z):
        start = world.dead_reckoning(target.x0_mean, [z[:3] * target.x0_sigmas])[-1]
        moved = target.odometry + z[3:].reshape(-1, 3) * target.odometry_sigmas
        return world.dead_reckoning(start, moved)

    base, columns, step = poses(noises), [], 1e-6
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    for unit in np.eye(len(noises)):
        change = (poses(noises + step * unit) - base) / step
        x, y = change[:, 0].copy(), change[:, 1].copy()
        change[:, 0], change[:, 1] = cos * x + sin * y, cos * y - sin * x
        columns.append(change.ravel())
    return np.array(columns).T


# --- what is handed on ----------------------------------------------------------------------


def detection_rows(
    config: Config, landmarks: pd.DataFrame, found: pd.DataFrame
) -> list[dict]:  # fmt: skip
    """Counts and AUC of every trigger against "one Gaussian is wrong by more than kl_limit"."""
    window_score = found["window_score"].to_numpy()
    other = found["other_share"].to_numpy()
    of_windows = {
        "condition number, window": (window_score, window_score > config.tau),
        "many starts": (other, other > SECOND_MASS),
    }
    rows = []
    for case, frame, triggers in (
        ("landmark", landmarks, fired(config, landmarks)),
        ("window", found, of_windows),
    ):
        wrong = (frame["kl"] > config.kl_limit).to_numpy()
        for name, (score, fires) in triggers.items():
            counts, known = metrics.detection(fires, wrong), np.isfinite(score) | np.isinf(score)
            rows.append({
                "case": case, "trigger": name, "counts": counts,
                "auc": metrics.roc_auc(np.clip(score[known], -1e9, 1e9), wrong[known]),
                "n_auc": int(known.sum()),
            })  # fmt: skip
    return rows


def record(
    config: Config, landmarks: pd.DataFrame, found: pd.DataFrame, runs: pd.DataFrame,
    to: report.Report,
) -> None:  # fmt: skip
    """Hand on the numbers that the paper's text quotes."""
    to.value("multimodal.n_seeds", config.n_seeds, ".0f")
    for n, rows in landmarks.groupby("n"):
        wrong, two = rows["kl"] > config.kl_limit, rows["second"] >= SECOND_MASS
        to.value(f"multimodal.landmark.n{n}.wrong", 100 * wrong.mean(), ".0f", r"%", n=len(rows))
        to.value(f"multimodal.landmark.n{n}.two", 100 * two.mean(), ".0f", r"%", n=len(rows))
    for m, rows in found.groupby("n_ranges"):
        two = rows["second"] >= SECOND_MASS
        here = f"multimodal.window.m{m}"
        to.value(f"{here}.two", 100 * two.mean(), ".0f", "%", n=len(rows))
        to.value(f"{here}.shortfall", rows["shortfall"].max(), ".1f", "nats", n=len(rows))
    for row in detection_rows(config, landmarks, found):
        here = f"multimodal.{row['case']}.{row['trigger'].replace(', ', '_').replace(' ', '_')}"
        to.value(f"{here}.auc", row["auc"], n=row["n_auc"])
        to.value(f"{here}.missed", row["counts"].false_negatives, ".0f", n=row["counts"].total)
        to.value(f"{here}.found", row["counts"].true_positives, ".0f", n=row["counts"].total)
    for (case, method), rows in runs.groupby(["case", "method"], sort=False):
        here = f"multimodal.{case}.{method}".replace(", from the ", "_").replace(" ", "_")
        here = here.replace("_=_", "")
        to.value(f"{here}.mass_error", rows["mass_error"].mean(), ".3f", n=len(rows))
        to.value(f"{here}.worst", rows["mass_error"].max(), ".2f", n=len(rows))
