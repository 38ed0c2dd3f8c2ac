"""Driver of notebook 09: where a posterior has several places, who notices, who samples them."""

from dataclasses import dataclass
from typing import Annotated

import joblib
import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from sngr_utils.detection.mirror_image import mirror_test
from sngr_utils.experiments import sampler_contest
from sngr_utils.sampling import ancestral_priors
from sngr_utils.sampling.modes import find_modes, ring_starts
from sngr_utils.sampling.reference import N_ANGLES, N_RADII, landmark_reference, polar_grid
from sngr_utils.sampling.targets.ambiguous_window import Window, window_of
from sngr_utils.sampling.targets.landmark import Landmark, landmark_of
from sngr_utils.sampling.weighted_samples import WeightedSamples
from sngr_utils.settings import Positive, Probability, Seed
from sngr_utils.slam import conventions, selected_inverse
from sngr_utils.sngr import trigger, windows
from sngr_utils.world import dead_reckoning, simulation, variations
from sngr_utils.world.scenario import ManyWorlds, Scenario

PRESET = conventions.PRESETS["C"]
SECOND_MASS = 0.05  # of the second mode, from which there are two
MASS_TARGET = 0.05  # error of a mode's mass that is small enough
WINDOW_POSES = windows.WIDTH
ANCHOR_DISTANCE, ANCHOR_RANGE, ANCHOR_SIGMA, ANCHOR_PRIOR = 4.0, 3.0, 0.2, 10.0  # notebook 1, [m]

Counts = Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)]


class Config(ManyWorlds):
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
    n_particles : of each of ten filters, more where their evidences or masses do not agree
    """

    first_seed: Seed = 6000
    n_seeds: Annotated[int, Field(ge=2)] = 10
    poses_seen: Counts = [2, 3, 4, 5, 6, 8]
    poses_sampled: Counts = [2, 3, 8]
    n_sampled: Annotated[int, Field(ge=2)] = 4
    p: Probability = 0.4
    weak: Positive = 10.0
    ranges_per_pose: Counts = [1, 2, 3, 6]
    kl_limit: Positive = 1.0
    gap_limit: Positive = 3.0
    tau: Positive = 3.96
    n_live_landmark: Annotated[int, Field(ge=20)] = 600
    n_live_window: Annotated[int, Field(ge=20)] = 500
    n_particles: Annotated[int, Field(ge=100)] = 6_000

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

    def world(self, seed: int) -> simulation.World:
        """The clean world of a seed."""
        return simulation.simulate(self.part(Scenario), 0.0, rng=np.random.default_rng(seed))

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
        whole = simulation.simulate(scenario, self.p, rng=rng)
        drawn = variations.draw_x0(whole, [xy, xy, theta], rng=rng)
        return window_of(drawn.first(WINDOW_POSES), [xy, xy, theta], self.p, n_ranges)


def two_anchors() -> Landmark:
    """The experiment of notebook 1: two known anchors, a range from each."""
    positions = np.array([[0.0, 0.0], [ANCHOR_DISTANCE, 0.0]])
    return Landmark(positions, np.zeros((4, 4)), np.full(2, ANCHOR_RANGE), ANCHOR_SIGMA,
                    positions.mean(axis=0), ANCHOR_PRIOR)  # fmt: skip


@dataclass(frozen=True)
class View:
    """One landmark's posterior for a figure, on a polar grid of R radii and A angles.

    Attributes
    ----------
    places, log_density : (R, A, 2) [m] and (R, A) [nats]
    positions : (n, 2) of the poses, [m]
    truth : (2,) where the landmark is, [m]
    gaussian : (2,) and (2, 2) of one Gaussian at the MAP; None for a ring, which has no maximum
    """

    places: np.ndarray
    log_density: np.ndarray
    positions: np.ndarray
    truth: np.ndarray
    gaussian: tuple[np.ndarray, np.ndarray] | None


def view(config: Config, label: int, n: int) -> View:
    """A landmark of the first world after n poses."""
    target, gaussian = config.landmark(config.first_seed, label, n), None
    if n > 1:
        modes = find_modes(target, ring_starts(target))
        gaussian = modes.places[0], modes.covariances[0]
    shape = N_RADII, N_ANGLES
    places, _ = polar_grid(target, *shape)
    log_density = target(places) - landmark_reference(target).log_evidence
    return View(
        places.reshape(*shape, 2), log_density.reshape(shape),
        target.positions, config.world(config.first_seed).landmarks[label], gaussian,
    )  # fmt: skip


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
        reference = landmark_reference(target)
        modes = find_modes(target, ring_starts(target))
        masses = np.sort(reference.masses(modes.label(reference.samples), len(modes.places)))
        kl, kl_error = reference.divergence(lambda x, modes=modes: modes.log_gaussian(0, x))
        mean, covariance = reference.mean, reference.covariance
        moments = ancestral_priors.gaussian(mean, covariance, 1.0).log_density
        test = mirror_test(target.positions, target.ranges, target.variances, modes.places[0])
        places.append(modes.places[0])
        rows.append({
            "seed": seed, "n": n, "label": label, "kl": kl, "kl_error": kl_error,
            "kl_moments": reference.divergence(moments)[0],
            "second": masses[-2] if len(masses) > 1 else 0.0,
            "gap": test.gap, "spread": test.spread,
            "landmark_score": trigger.score(modes.covariances[0]),
        })  # fmt: skip
    score = _window_score(config, seed, n, np.array(places))
    return [{**row, "window_score": score} for row in rows]


def _window_score(config: Config, seed: int, n: int, landmarks: np.ndarray) -> float:
    """The paper's score of the last three of n poses; NaN if there are fewer."""
    if n < windows.WIDTH:
        return float("nan")
    part = config.world(seed).first(n)
    s = part.scenario
    return trigger.score(
        selected_inverse.selected_inverse(
            dead_reckoning.dead_reckoning(part.x0_mean, part.odometry), landmarks, part.odometry,
            part.pose_of, part.label_of, x0_mean=part.x0_mean, x0_sigmas=PRESET.x0_sigmas,
            odometry_sigmas=s.odometry_sigmas,
            landmark_prior_sigma=PRESET.landmark_prior_sigma, range_sigma=s.range_sigma,
        ).windows[-1]
    )  # fmt: skip


def landmark_triggers(config: Config, found: pd.DataFrame) -> dict:
    """Trigger -> ((N,) score, higher for more alarm; (N,) bool, whether it fires)."""
    gap, window, own = (
        found[name].to_numpy() for name in ("gap", "window_score", "landmark_score")
    )  # fmt: skip
    return {
        "mirror test": (-gap, gap < config.gap_limit),
        "condition number of the window": (window, window > config.tau),
        "condition number of the landmark": (own, own > config.tau),
    }


def window_triggers(config: Config, found: pd.DataFrame) -> dict:
    """The same for windows, which have no mirror image."""
    window, other = found["window_score"].to_numpy(), found["other_share"].to_numpy()
    return {
        "condition number of the window": (window, window > config.tau),
        "second mode from many starts": (other, other > SECOND_MASS),
    }


def run_samplers(config: Config) -> pd.DataFrame:
    """All methods on the two anchors, on landmarks after their first poses, and on windows.

    Returns
    -------
    one row per case, size (poses, or ranges per pose), seed and method: the errors of
    `sampler_contest.judge`
    """
    seeds, few = config.seeds(config.n_seeds), config.seeds(config.n_sampled)
    jobs = [
        joblib.delayed(_window)(config, seed, m) for m in config.ranges_per_pose for seed in few
    ]
    jobs += [joblib.delayed(_anchors)(config, seed) for seed in seeds]
    jobs += [
        joblib.delayed(_landmark)(config, seed, n) for n in config.poses_sampled for seed in seeds
    ]
    done = joblib.Parallel(n_jobs=config.jobs)(jobs)
    return pd.DataFrame([row for rows in done for row in rows])


def anchor_start(place: str) -> tuple[np.ndarray, np.ndarray]:
    """(2,) start and (2, 2) covariance that a solver reports there, "saddle" or "mode".

    At the saddle the paper's solver stays. The covariance it reports there is that of the
    landmark's own prior, in the direction in which the landmark could be on either side.
    """
    target, height = two_anchors(), np.sqrt(ANCHOR_RANGE**2 - ANCHOR_DISTANCE**2 / 4)
    start = target.centre + np.array([0.0, height if place == "mode" else 0.0])
    return start, target.gauss_newton_covariance(start)


def anchor_runs(config: Config, seed: int, place: str) -> dict[str, WeightedSamples]:
    """Every method on the two anchors, the Gaussian priors about `anchor_start`."""
    rng = np.random.default_rng([seed, 9])
    return sampler_contest.plane_runs(
        two_anchors(), *anchor_start(place), config.n_live_landmark, rng=rng
    )


def anchor_priors(n: int, *, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """(n, 2) draws of each prior on the two anchors, the Gaussian ones about a mode, [m]."""
    priors = {
        name: ancestral_priors.gaussian(*anchor_start("mode"), c)
        for name, c in sampler_contest.SCALES.items()
    }
    priors["ancestral"] = ancestral_priors.ring(two_anchors())
    return {name: prior.draw(n, rng=rng) for name, prior in priors.items()}


def _anchors(config: Config, seed: int) -> list[dict]:
    target = two_anchors()
    modes = find_modes(target, ring_starts(target))
    errors = sampler_contest.judge(landmark_reference(target), modes, lambda x: x)
    rows = []
    for place in ("saddle", "mode"):
        runs = anchor_runs(config, seed, place)
        if place == "mode":  # the other methods do not depend on it
            runs = {name: runs[name] for name in sampler_contest.SCALES}
        head = {"case": f"two anchors, from the {place}", "size": 2, "seed": seed}
        rows += [{**head, "method": name, **errors(run)} for name, run in runs.items()]
    return rows


def _landmark(config: Config, seed: int, n: int) -> list[dict]:
    target, rng = config.landmark(seed, 0, n), np.random.default_rng([seed, 10])
    modes = find_modes(target, ring_starts(target))
    best = modes.places[0], modes.covariances[0]
    runs = sampler_contest.plane_runs(target, *best, config.n_live_landmark, rng=rng)
    errors = sampler_contest.judge(landmark_reference(target), modes, lambda x: x)
    head = {"case": "landmark", "size": n, "seed": seed}
    return [{**head, "method": name, **errors(run)} for name, run in runs.items()]


def _window(config: Config, seed: int, n_ranges: int) -> list[dict]:
    target, rng = config.window(seed, n_ranges), np.random.default_rng([seed, 11])
    truth = sampler_contest.window_truth(target, config.n_particles, rng=rng)
    errors = sampler_contest.judge(*truth, lambda x: target.positions(x)[:, -1])
    runs = sampler_contest.window_runs(target, config.n_live_window, rng=rng)
    head = {"case": "window", "size": n_ranges, "seed": seed}
    return [{**head, "method": name, **errors(run)} for name, run in runs.items()]


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
    target, rng = config.window(seed, n_ranges), np.random.default_rng([seed, 12])
    coarse = 2 * sampler_contest.MASS_ERROR  # enough to tell whether there is a second mode
    reference, modes = sampler_contest.window_truth(target, config.n_particles, coarse, rng=rng)
    own = find_modes(target, ancestral_priors.tree(target).draw(sampler_contest.N_STARTS, rng=rng))
    masses = np.sort(reference.masses(modes.label(reference.samples), len(modes.places)))
    kl, kl_error = reference.divergence(lambda x: modes.log_gaussian(0, x))
    shares = np.exp(own.log_masses - np.logaddexp.reduce(own.log_masses))
    to_poses = pose_jacobian(target, modes.places[0])
    return {
        "seed": seed, "n_ranges": n_ranges, "kl": kl, "kl_error": kl_error,
        "second": masses[-2] if len(masses) > 1 else 0.0, "largest": masses[-1],
        "shortfall": reference.log_evidence - modes.log_masses[0],
        "shortfall_error": reference.log_evidence_error,
        "window_score": trigger.score(to_poses @ modes.covariances[0] @ to_poses.T),
        "other_share": 1 - shares[0],
    }  # fmt: skip


def pose_jacobian(target: Window, noises: np.ndarray) -> np.ndarray:
    """(3n, 3n) derivative of the poses, each in its own frame, by the (3n,) noises."""

    def poses(z):
        start = dead_reckoning.dead_reckoning(target.x0_mean, [z[:3] * target.x0_sigmas])[-1]
        moved = target.odometry + z[3:].reshape(-1, 3) * target.odometry_sigmas
        return dead_reckoning.dead_reckoning(start, moved)

    base, columns, step = poses(noises), [], 1e-6
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    for unit in np.eye(len(noises)):
        change = (poses(noises + step * unit) - base) / step
        x, y = change[:, 0].copy(), change[:, 1].copy()
        change[:, 0], change[:, 1] = cos * x + sin * y, cos * y - sin * x
        columns.append(change.ravel())
    return np.array(columns).T
