"""What the trigger and the refinement do over many worlds, as the original's authors run them."""

import math

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.experiments import authors_conventions as authors
from sngr_utils.experiments.authors_conventions import WIDTH
from sngr_utils.experiments.authors_digits import JITTER
from sngr_utils.metrics.precision_recall import detection
from sngr_utils.slam.levenberg_marquardt import optimise

TAU_CLEAN, TAU_SNGR = 3.92, 3.9  # the least that is printed as silent; that of the table "sngr"
FIRST = WIDTH - 1  # window that may fire, as the paper has it
STEPS, STILL = 50, 1e-9


def rows(seed: int) -> list[dict]:
    """One world at every p: its errors, the trigger, and what refining gains and changes.

    Counts are of the 26 windows that may fire. The posterior of a window is as good as a Gaussian
    (`authors_digits` asks nested sampling), so its mean is its mode here: SNGR without a sampler's
    noise, with which every window passes the gate.

    won, pairs : pairs of a failed window and another, and how many of them the score ranks rightly
    left : nats that the graph's log-likelihood still gains by batch optimisation
    """
    return [_row(p, seed) for p in authors.PS]


def _row(p: float, seed: int) -> dict:
    poses, landmarks, odometry, scans = authors.world(p, seed)
    graph, marginals, found = authors.estimate(poses, landmarks, odometry, scans)
    one = authors.judged(poses, landmarks, scans, marginals, found)
    counts = detection(one.fires(FIRST)[FIRST:], one.failed[FIRST:])
    gap = one.scores[FIRST:][one.failed[FIRST:], None] - one.scores[FIRST:][~one.failed[FIRST:]]
    refined, gains = gtsam.Values(found), []
    for t in np.flatnonzero(one.fires(FIRST, TAU_SNGR)).tolist():
        mode, gain = settled(authors.window_factors(graph, t), marginals, found, t)
        for s in range(t, t + WIDTH):
            refined.update(X(s), mode.atPose2(X(s)))
        gains.append(gain)
    after = authors.judged(poses, landmarks, scans, marginals, refined)
    return {
        "p": p, "seed": seed, "rmse": float(one.rmse), "landmark_rmse": float(one.landmark_rmse),
        "nees": one.nees, "score": float(np.median(one.scores)),
        "fired": counts.triggered, "hits": counts.true_positives, "failed": counts.failed,
        "windows": counts.total, "won": float(np.sum(gap > 0) + 0.5 * np.sum(gap == 0)),
        "pairs": gap.size, "fired_clean": int(one.fires(FIRST, TAU_CLEAN).sum()),
        "refined": len(gains), "gain_min": min(gains, default=math.nan),
        "gain_max": max(gains, default=math.nan), "refined_rmse": float(after.rmse),
        "refined_nees": after.nees, "left": left(graph, found),
    }  # fmt: skip


def settled(
    factors: gtsam.NonlinearFactorGraph, marginals: gtsam.Marginals, found: gtsam.Values, t: int
) -> tuple[gtsam.Values, float]:
    """The most probable poses of window t in what is sampled there, all else held; their gain.

    Gauss-Newton on half of GTSAM's error and the prior N(MAP, Sigma), each step halved until the
    target gains. The gain is that of the log-likelihood [nats].
    """
    keys = [X(s) for s in range(t, t + WIDTH)]
    covariance = marginals.jointMarginalCovariance(gtsam.KeyVector(keys)).fullMatrix()
    whiten = np.linalg.inv(np.linalg.cholesky(covariance + JITTER * np.eye(len(covariance))))
    ordering = gtsam.Ordering()
    for key in [*keys, *sorted(set(factors.keyVector()) - set(keys))]:
        ordering.push_back(key)
    centre, at = _flat(found, keys), gtsam.Values(found)

    def cost(values: gtsam.Values) -> float:
        away = whiten @ (_flat(values, keys) - centre)
        return 0.5 * factors.error(values) + 0.5 * away @ away

    for _ in range(STEPS):
        jacobian, right = factors.linearize(at).jacobian(ordering)
        turned = _turned(at, keys)
        lines = np.vstack([jacobian[:, : len(centre)] / math.sqrt(2), whiten @ turned])
        away = whiten @ (centre - _flat(at, keys))
        step = np.linalg.lstsq(lines, np.concatenate([right / math.sqrt(2), away]), rcond=None)[0]
        here, moved = cost(at), _moved(at, keys, step)
        while cost(moved) > here and np.linalg.norm(step) > STILL:
            step /= 2
            moved = _moved(at, keys, step)
        if cost(moved) > here:
            break
        at = moved
        if np.linalg.norm(step) < STILL:
            break
    return at, 0.5 * (factors.error(found) - factors.error(at))


def _flat(values: gtsam.Values, keys: list[int]) -> np.ndarray:
    """(9,) x, y and heading of each pose."""
    poses = [values.atPose2(key) for key in keys]
    return np.array([number for pose in poses for number in (pose.x(), pose.y(), pose.theta())])


def _turned(values: gtsam.Values, keys: list[int]) -> np.ndarray:
    """(9, 9): how x, y and heading change with steps in the frames of the poses."""
    turned = np.eye(3 * len(keys))
    for i, key in enumerate(keys):
        turned[3 * i : 3 * i + 2, 3 * i : 3 * i + 2] = values.atPose2(key).rotation().matrix()
    return turned


def _moved(values: gtsam.Values, keys: list[int], step: np.ndarray) -> gtsam.Values:
    """`values` after a step (9,) in the frames of the poses."""
    moved = gtsam.Values(values)
    for i, key in enumerate(keys):
        moved.update(key, values.atPose2(key).retract(step[3 * i : 3 * i + 3]))
    return moved


def left(graph: gtsam.NonlinearFactorGraph, found: gtsam.Values) -> float:
    """What Levenberg and Marquardt still gain from an estimate, in nats of its log-likelihood."""
    return 0.5 * (graph.error(found) - graph.error(optimise(graph, found)))
