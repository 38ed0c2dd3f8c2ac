"""The online estimator in worlds of every kind, beside an oracle that knows what it must find out.

A kind is what a person who brings data may meet: clutter, a sensor that does not reach, straight
roads, slips, noise that is not as stated. The oracle is least squares that is told the true
sources, which ranges are clutter, the true noise, and which steps have slipped. Batch peers come
through the same door as the estimator: they get the same log.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from sngr_utils.experiments import estimators
from sngr_utils.experiments.kinds_of_worlds import MISLED, STREAM, draw
from sngr_utils.experiments.online_variants import run_unwarned
from sngr_utils.metrics import rmse_and_nees
from sngr_utils.online import estimator, rivals
from sngr_utils.online.belief import Belief
from sngr_utils.robust import mirrors
from sngr_utils.robust.em import SoftEstimate
from sngr_utils.slam import chain_problem, chain_solver, landmark_starts
from sngr_utils.slam.chain_solver import CERES
from sngr_utils.slam.conventions import PRESETS, Conventions
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world import dead_reckoning
from sngr_utils.world.log import Log
from sngr_utils.world.simulation import World

ASTRAY = 1.0  # m, from its place: a landmark on the wrong side
KNOWN_SLIP = 100.0  # m and rad, sigma that the oracle gives to a step that slipped
SURE = 1e-6  # share of wrong labels where all are right
LOST = 1.35  # times the oracle's error, above which a final estimate counts as lost
PEERS = ("cauchy", "gnc_tls", "em_exclusive")


def rows(kind: str, preset: str, p: float, seed: int) -> list[dict]:
    """One world: errors over the oracle's, consistency, and what the result says of itself.

    Of the columns, `at_truth` and `at_mode` are the errors of EM from the truth and from what was
    found, told which steps have slipped, and `behind` is by how many nats the first is likelier.
    `filtered_right` is of the same estimator with every label right, and known to be: what a slip
    costs until it can be seen. NaN where nothing slips.
    """
    world, sound = draw(kind, p, seed)
    conventions = PRESETS[preset]
    log, truth = world.log(conventions.x0_sigmas), world.poses[:, :2]
    told, unmissed = (sound, world) if kind in MISLED else (world, sound)
    informed = partial(informed_em, log, slipped(world, unmissed), conventions)
    likelier = [np.full(2, np.nan)]

    def watch(belief: Belief) -> None:
        likelier.append(newest_if_likelier(belief, world, informed, conventions))

    rng = np.random.default_rng([seed, STREAM, 1])
    found = run_unwarned(log, conventions, estimator.Settings(), watch, rng=rng)
    best, filtered = oracle(told, sound, conventions, from_grid=kind == "circle")
    at_truth = informed((world.poses, world.landmarks))
    least, newest = (rmse_and_nees.rmse(each[:, :2], truth) for each in (best.poses, filtered))
    final = {
        "final": found.poses,
        **_peers(log, conventions),
        "at_truth": at_truth.found.poses,
        "at_mode": informed((found.poses, found.landmarks)).found.poses,
    }
    held = found.filtered[:, :2]
    driven = {"filtered": held, "filtered_likelier": np.where(np.isnan(likelier), held, likelier)}
    driven["filtered_right"] = held * np.nan
    if slipped(world, unmissed).any():
        right = replace(world, label_of=world.source_of).log(conventions.x0_sigmas)
        rng = np.random.default_rng([seed, STREAM, 1])
        sure = estimator.Settings(p=SURE)
        driven["filtered_right"] = run_unwarned(right, conventions, sure, rng=rng).filtered[:, :2]
    consistency = partial(estimators.expected_nees, world, conventions)
    row = {
        "kind": kind, "preset": preset, "p": p, "seed": seed,
        **{name: rmse_and_nees.rmse(of[:, :2], truth) / least for name, of in final.items()},
        **{name: rmse_and_nees.rmse(of, truth) / newest for name, of in driven.items()},
        "nees": consistency(found.poses, found.position_covariances),
        "oracle_nees": consistency(best.poses, best.position_covariances),
        "behind": found.cost - at_truth.cost,
        **_sides(at_truth.found),
        **_landmarks(world, conventions, found, best),
        "doubtful": int(found.diagnosis.doubtful),
        "reasons": "; ".join(found.diagnosis.reasons),
    }  # fmt: skip
    return [row]


def _sides(at_truth: SoftEstimate) -> dict:
    """Choices of sides that are open beside the true one, how many are likelier, and by how much.

    NaN where there is no other; what is likeliest is likelier by so many nats, negative if it is
    less likely.
    """
    costs = [one.cost for one in mirrors.turned(at_truth)]
    return {
        "sides": len(costs),
        "sides_likelier": float(np.mean(np.array(costs) < 0)) if costs else float("nan"),
        "sides_gain": -min(costs) if costs else float("nan"),
    }


def _peers(log: Log, conventions: Conventions) -> dict[str, np.ndarray]:
    """(T, 3) poses of each of `PEERS`, from dead reckoning and a grid; EM admits clutter."""
    poses = dead_reckoning.dead_reckoning(log.x0_mean, log.odometry)
    start = poses, landmark_starts.start_landmarks(log, poses, "grid")
    return {
        peer: estimators.batch(log, conventions, peer, start, clutter=True).poses for peer in PEERS
    }


def _landmarks(world: World, conventions: Conventions, found, best) -> dict:
    """Of landmarks that are called known: share, errors over the oracle's, NEES, wrong side."""
    known = ~found.in_doubt
    errors, theirs = (one.landmarks[known] - world.landmarks[known] for one in (found, best))
    told = {"known": float(known.mean()), "astray": int((np.hypot(*errors.T) > ASTRAY).sum())}
    if not known.any():
        return {**told, "landmark_ratio": float("nan"), "landmark_nees": float("nan")}
    turned = np.vstack([world.poses[0], np.pad(world.landmarks[known], ((0, 0), (0, 1)))])
    moved = dead_reckoning.rigid_covariances(turned, conventions.x0_sigmas)[1:]
    covariances = found.landmark_covariances[known]
    expected = np.trace(np.linalg.solve(covariances, moved), axis1=1, axis2=2).mean()
    return {
        **told,
        "landmark_ratio": float(np.sqrt(np.sum(errors**2) / np.sum(theirs**2))),
        "landmark_nees": rmse_and_nees.nees(errors, covariances) + float(expected),
    }


def slipped(world: World, sound: World) -> np.ndarray:
    """(T-1,) bool, steps of which the odometry is not that of the sound world."""
    return (world.odometry != sound.odometry).any(axis=1)


def informed_em(
    log: Log, missed: np.ndarray, conventions: Conventions, start: tuple[np.ndarray, np.ndarray]
) -> rivals.Rival:
    """EM of the estimator's model from (n, 3) poses and (K, 2) landmarks; it knows what slipped.

    Where it is likelier from the truth than what was found, the search has failed; where it ends
    at the same place, or is less likely, the data mislead.

    Parameters
    ----------
    missed : (T-1,) bool, see `slipped`; of the log, the first n poses count
    """
    part = log.first(len(start[0]))
    told = part.odometry_covariances
    part = rivals.distrusting(part, missed[: len(told)])
    return rivals.rival(part, told, rivals.by_em(part, conventions, start, 1.0))


def newest_if_likelier(
    belief: Belief, world: World, informed: Callable, conventions: Conventions
) -> np.ndarray:
    """(2,) newest position by EM from the truth if that is likelier by a nat, else NaN, [m].

    What an estimator of the same model would have said on its way that overlooks nothing.

    Parameters
    ----------
    informed : `informed_em` of the log of the world, from a start
    """
    log, told, poses, _ = belief.whole()
    ours = rivals.by_em(log, conventions, (poses, belief.landmarks), 1.0)
    best = informed((world.poses[: belief.n_poses], world.landmarks))
    likelier = best.cost < rivals.rival(log, told, ours).cost - rivals.BETTER
    return best.found.poses[-1, :2] if likelier else np.full(2, np.nan)


def oracle(
    world: World, sound: World, conventions: Conventions, from_grid: bool
) -> tuple[chain_solver.Estimate, np.ndarray]:
    """Least squares that knows sources, noise and slips; and (T, 2) positions when newest, [m].

    Parameters
    ----------
    sound : what `world` was made from, with the noise that there is
    from_grid : landmarks start on a grid, where their weak priors are; else at the truth
    """
    known = world.keep(world.source_of >= 0)
    known = replace(known, label_of=known.source_of, scenario=sound.scenario)
    log = known.log(conventions.x0_sigmas)
    wide = log.odometry_covariances.copy()
    wide[slipped(world, sound)] = KNOWN_SLIP**2 * np.eye(3)
    log = log.with_covariances(wide)
    landmarks, start = world.landmarks, world.poses
    if from_grid:
        start = dead_reckoning.dead_reckoning(log.x0_mean, log.odometry)
        landmarks = landmark_starts.start_landmarks(log, start, "grid")
    best = _least_squares(log, conventions, start, landmarks)
    newest = [log.x0_mean[:2]]
    for t in range(2, log.n_poses + 1):
        part = _least_squares(log.first(t), conventions, best.poses[:t], landmarks)
        newest.append(part.poses[-1, :2])
    return best, np.array(newest)


def _least_squares(
    log: Log, conventions: Conventions, poses: np.ndarray, landmarks: np.ndarray
) -> chain_solver.Estimate:
    chain = chain_problem.of_log(log, landmarks, conventions.landmark_prior_sigma)
    return chain_solver.solve(chain, poses, landmarks, LEAST_SQUARES, CERES)
