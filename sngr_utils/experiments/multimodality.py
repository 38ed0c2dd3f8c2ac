"""Where a posterior has several places: landmarks and windows of many worlds, one row each.

All of it is under the preset that is our reading of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils.detection.mirror_image import mirror_test
from sngr_utils.experiments import sampler_contest
from sngr_utils.experiments.many_worlds import map_rows, map_worlds
from sngr_utils.sampling import ancestral_priors
from sngr_utils.sampling.modes import find_modes, ring_starts
from sngr_utils.sampling.reference import N_ANGLES, N_RADII, landmark_reference, polar_grid
from sngr_utils.sampling.targets.ambiguous_window import Window, window_of
from sngr_utils.sampling.targets.landmark import Landmark, landmark_of
from sngr_utils.settings import READING
from sngr_utils.slam import conventions, selected_inverse
from sngr_utils.sngr import trigger, windows
from sngr_utils.world import dead_reckoning, simulation, variations
from sngr_utils.world.scenario import Scenario

PRESET = conventions.PRESETS[READING]
SECOND_MASS = 0.05  # of the second mode, from which there are two


def clean_world(scenario: Scenario, seed: int) -> simulation.World:
    """The world of a seed without wrong labels."""
    return simulation.simulate(scenario, 0.0, rng=np.random.default_rng(seed))


def world_landmark(scenario: Scenario, seed: int, label: int, n: int) -> Landmark:
    """Posterior of a landmark of a clean world after its first n poses."""
    sigma = PRESET.landmark_prior_sigma
    return landmark_of(clean_world(scenario, seed), PRESET.x0_sigmas, sigma, label, n)


@dataclass(frozen=True)
class WindowKind:
    """Windows of three poses with weak odometry and ambiguous ranges.

    Attributes
    ----------
    scenario : of the world that they begin
    p : probability of a wrong association
    weak : factor on the odometry's sigmas
    n_particles : of each of the ten filters that the reference is made of, more where they disagree
    """

    scenario: Scenario
    p: float
    weak: float
    n_particles: int

    def window(self, seed: int, n_ranges: int) -> Window:
        """Posterior of the window of a seed whose poses keep `n_ranges` ranges each.

        The prior on the first pose is as wide as one step of the weak odometry.
        """
        s = self.scenario
        xy, theta = self.weak * s.odometry_sigma_xy, self.weak * s.odometry_sigma_theta
        loose = {"odometry_sigma_xy": xy, "odometry_sigma_theta": theta}
        rng = np.random.default_rng(seed)
        whole = simulation.simulate(s.model_copy(update=loose), self.p, rng=rng)
        drawn = variations.draw_x0(whole, [xy, xy, theta], rng=rng)
        return window_of(drawn.first(windows.WIDTH), [xy, xy, theta], self.p, n_ranges)


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


def view(scenario: Scenario, seed: int, label: int, n: int) -> View:
    """A landmark of a world after n poses."""
    target, gaussian = world_landmark(scenario, seed, label, n), None
    if n > 1:
        modes = find_modes(target, ring_starts(target))
        gaussian = modes.places[0], modes.covariances[0]
    shape = N_RADII, N_ANGLES
    places, _ = polar_grid(target, *shape)
    log_density = target(places) - landmark_reference(target).log_evidence
    return View(
        places.reshape(*shape, 2), log_density.reshape(shape),
        target.positions, clean_world(scenario, seed).landmarks[label], gaussian,
    )  # fmt: skip


def run_landmarks(
    scenario: Scenario, poses: Sequence[int], seeds: Sequence[int], jobs: int
) -> pd.DataFrame:
    """Every landmark of every world after its first poses: one Gaussian, and what the tests say.

    Returns
    -------
    one row per seed, n and label: kl of the Gaussian at the MAP and kl_error, kl_moments (of the
    Gaussian with the posterior's own mean and covariance), second (mass of the second mode), gap
    and spread of the mirror test, landmark_score (log10 condition number of the landmark's
    covariance), window_score (the paper's, of the last three poses; NaN before there are three)
    """
    cases = [(scenario, seed, n) for seed in seeds for n in poses]
    return pd.DataFrame(map_rows(_landmark_rows, cases, jobs))


def _landmark_rows(scenario: Scenario, seed: int, n: int) -> list[dict]:
    rows, places = [], []
    for label in range(scenario.n_landmarks):
        target = world_landmark(scenario, seed, label, n)
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
    score = _window_score(scenario, seed, n, np.array(places))
    return [{**row, "window_score": score} for row in rows]


def _window_score(scenario: Scenario, seed: int, n: int, landmarks: np.ndarray) -> float:
    """The paper's score of the last three of n poses; NaN if there are fewer."""
    if n < windows.WIDTH:
        return float("nan")
    part = clean_world(scenario, seed).first(n)
    poses = dead_reckoning.dead_reckoning(part.x0_mean, part.odometry)
    covariance = selected_inverse.covariance_at(poses, landmarks, part, PRESET)
    return trigger.score(covariance.windows[-1])


def landmark_triggers(found: pd.DataFrame, tau: float, gap_limit: float) -> dict:
    """Trigger -> ((N,) score, higher for more alarm; (N,) bool, whether it fires)."""
    gap, window, own = (
        found[name].to_numpy() for name in ("gap", "window_score", "landmark_score")
    )  # fmt: skip
    return {
        "mirror test": (-gap, gap < gap_limit),
        "condition number of the window": (window, window > tau),
        "condition number of the landmark": (own, own > tau),
    }


def window_triggers(found: pd.DataFrame, tau: float) -> dict:
    """The same for windows, which have no mirror image."""
    window, other = found["window_score"].to_numpy(), found["other_share"].to_numpy()
    return {
        "condition number of the window": (window, window > tau),
        "second mode from many starts": (other, other > SECOND_MASS),
    }


def run_landmark_samplers(
    scenario: Scenario, n_live: int, poses: Sequence[int], seeds: Sequence[int], jobs: int
) -> pd.DataFrame:
    """All methods on the first landmark of worlds after few poses; see `two_anchors.run`."""
    cases = [(scenario, n_live, seed, n) for n in poses for seed in seeds]
    return pd.DataFrame(map_rows(_landmark, cases, jobs))


def run_window_samplers(
    kind: WindowKind, n_live: int, n_ranges: Sequence[int], seeds: Sequence[int], jobs: int
) -> pd.DataFrame:
    """All methods on every window; see `two_anchors.run`."""
    cases = [(kind, n_live, seed, m) for m in n_ranges for seed in seeds]
    return pd.DataFrame(map_rows(_window, cases, jobs))


def _landmark(scenario: Scenario, n_live: int, seed: int, n: int) -> list[dict]:
    target = world_landmark(scenario, seed, 0, n)
    rng = np.random.default_rng([seed, 10])
    modes = find_modes(target, ring_starts(target))
    best = modes.places[0], modes.covariances[0]
    runs = sampler_contest.plane_runs(target, *best, n_live, rng=rng)
    errors = sampler_contest.judge(landmark_reference(target), modes)
    head = {"case": "landmark", "size": n, "seed": seed}
    return [{**head, "method": name, **errors(run)} for name, run in runs.items()]


def _window(kind: WindowKind, n_live: int, seed: int, n_ranges: int) -> list[dict]:
    target, rng = kind.window(seed, n_ranges), np.random.default_rng([seed, 11])
    truth = sampler_contest.window_truth(target, kind.n_particles, rng=rng)
    errors = sampler_contest.judge(*truth)
    runs = sampler_contest.window_runs(target, n_live, rng=rng)
    head = {"case": "window", "size": n_ranges, "seed": seed}
    return [{**head, "method": name, **errors(run)} for name, run in runs.items()]


def run_windows(
    kind: WindowKind, n_ranges: Sequence[int], seeds: Sequence[int], jobs: int
) -> pd.DataFrame:
    """Every window: what a single Gaussian at the MAP misses, and what the triggers say.

    Returns
    -------
    one row per seed and n_ranges: kl and kl_error, second (mass of the second mode), largest
    (mass of the first), shortfall of the Gaussian's evidence [nats] and its error, window_score
    (the paper's), other_share (Laplace mass outside the first mode, from many starts)
    """
    cases = [(kind, seed, m) for m in n_ranges for seed in seeds]
    return pd.DataFrame(map_worlds(_window_row, cases, jobs))


def _window_row(kind: WindowKind, seed: int, n_ranges: int) -> dict:
    target, rng = kind.window(seed, n_ranges), np.random.default_rng([seed, 12])
    coarse = 2 * sampler_contest.MASS_ERROR  # enough to tell whether there is a second mode
    truth = sampler_contest.window_truth(target, kind.n_particles, coarse, rng=rng)
    reference, modes = truth
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
