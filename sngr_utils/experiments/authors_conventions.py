"""The original's estimate and trigger, from the conventions of its authors' public code.

docs/original_code.md says what these are and where they stand. Imports gtsam and numpy alone: the
printed digits need GTSAM 4.2, which `make original` puts into an environment of its own; this
project's GTSAM ends in other places where labels are wrong, and over many worlds says the same.
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

N_POSES, N_LANDMARKS, WIDTH = 30, 6, 3
TAU, PS, SEEDS = 3.96, (0.0, 0.1, 0.2, 0.3, 0.4), range(5)
X0_SIGMAS, LANDMARK_SIGMA, RANGE_SIGMA = (0.1, 0.1, 0.01), 5.0, 0.1
DRAWN, TOLD = (0.05, 0.05, 0.01), (0.1, 0.1, 0.05)  # sigmas of a step: simulated, and believed


@dataclass(frozen=True)
class Outcome:
    """One world. Errors in m; `scores` and `failed` are (28,), one a window.

    rmse, landmark_rmse : root mean squares over the x and y *components*
    nees : mean of e^T P^-1 e with P in the body frame, as GTSAM gives it
    """

    rmse: float
    landmark_rmse: float
    nees: float
    scores: np.ndarray
    failed: np.ndarray

    def fires(self, first: int, tau: float = TAU) -> np.ndarray:
        """(28,) bool: the windows from `first` on whose score exceeds tau."""
        return (self.scores > tau) & (np.arange(len(self.scores)) >= first)


def world(p: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, list]:
    """True poses (30, 3) and landmarks (6, 2), odometry (29, 3), and per pose (label, range)."""
    angle = np.linspace(0, 2 * np.pi, N_POSES, endpoint=False)
    poses = np.column_stack([5 * np.cos(angle), 5 * np.sin(angle), angle + np.pi / 2])
    landmarks = np.random.default_rng(seed).uniform(-4, 4, (N_LANDMARKS, 2))
    step, heading = np.diff(poses, axis=0), poses[:-1, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    odometry = np.column_stack([
        cos * step[:, 0] + sin * step[:, 1], -sin * step[:, 0] + cos * step[:, 1], step[:, 2],
    ])  # fmt: skip
    odometry += np.random.default_rng(seed + 1).normal(size=step.shape) * DRAWN
    rng, scans = np.random.default_rng(seed + 2), []
    for pose in poses:
        scan = []
        for k, landmark in enumerate(landmarks):
            distance = np.hypot(*(landmark - pose[:2])) + rng.normal(0, RANGE_SIGMA)
            wrong = p > 0 and rng.random() < p
            others = [j for j in range(N_LANDMARKS) if j != k]
            scan.append((int(rng.choice(others)) if wrong else k, distance))
        scans.append(scan)
    return poses, landmarks, odometry, scans


def estimate(poses: np.ndarray, landmarks: np.ndarray, odometry: np.ndarray, scans: list):
    """iSAM2's graph, marginals and estimate; landmarks start, and have a prior, at the truth."""
    diagonal, isotropic = gtsam.noiseModel.Diagonal.Sigmas, gtsam.noiseModel.Isotropic.Sigma
    params = gtsam.ISAM2Params()
    params.setRelinearizeThreshold(0.01)
    params.relinearizeSkip = 1
    isam, sightings = gtsam.ISAM2(params), np.zeros(N_LANDMARKS, dtype=int)
    pose = gtsam.Pose2(*poses[0])
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.push_back(gtsam.PriorFactorPose2(X(0), pose, diagonal(np.array(X0_SIGMAS))))
    start.insert(X(0), pose)
    isam.update(graph, start)
    for t, motion in enumerate(odometry, start=1):
        graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
        move, last = gtsam.Pose2(*motion), isam.calculateEstimate().atPose2(X(t - 1))
        told = diagonal(np.array(TOLD))
        graph.push_back(gtsam.BetweenFactorPose2(X(t - 1), X(t), move, told))
        start.insert(X(t), last.compose(move))
        for k, distance in scans[t]:  # those of pose 0, and each landmark's first two, are lost
            sightings[k] += 1
            if sightings[k] == WIDTH:
                start.insert(L(k), landmarks[k])
                weak = isotropic(2, LANDMARK_SIGMA)
                graph.push_back(gtsam.PriorFactorPoint2(L(k), landmarks[k], weak))
            if sightings[k] >= WIDTH:
                noise = isotropic(1, RANGE_SIGMA)
                graph.push_back(gtsam.RangeFactor2D(X(t), L(k), distance, noise))
        isam.update(graph, start)
    found = isam.calculateEstimate()
    graph = isam.getFactorsUnsafe()
    return graph, gtsam.Marginals(graph, found), found


def outcome(p: float, seed: int) -> Outcome:
    """One world, estimated and judged."""
    poses, landmarks, odometry, scans = world(p, seed)
    return judged(poses, landmarks, scans, *estimate(poses, landmarks, odometry, scans)[1:])


def judged(
    poses: np.ndarray,
    landmarks: np.ndarray,
    scans: list,
    marginals: gtsam.Marginals,
    found: gtsam.Values,
) -> Outcome:
    """Errors of an estimate, and its windows' scores and failures."""
    errors = np.array([found.atPose2(X(t)).translation() for t in range(N_POSES)]) - poses[:, :2]
    at = np.array([found.atPoint2(L(k)) for k in range(N_LANDMARKS)])
    blocks = [marginals.marginalCovariance(X(t))[:2, :2] for t in range(N_POSES)]
    nees = [e @ np.linalg.inv(block) @ e for e, block in zip(errors, blocks, strict=True)]
    scores, failed = [], []
    for t in range(N_POSES - WIDTH + 1):
        window = range(t, t + WIDTH)
        seen = sorted({k for s in window for k, _ in scans[s]})
        keys = gtsam.KeyVector([X(s) for s in window] + [L(k) for k in seen])
        eigenvalues = np.linalg.eigvalsh(marginals.jointMarginalCovariance(keys).fullMatrix())
        scores.append(np.log10(eigenvalues[-1] / eigenvalues[0]))
        failed.append(np.linalg.norm(errors[window], axis=1).mean() > 0.5)
    size = np.sqrt(np.mean(errors**2)), np.sqrt(np.mean((at - landmarks) ** 2))
    return Outcome(*size, float(np.mean(nees)), np.array(scores), np.array(failed))


def window_factors(graph: gtsam.NonlinearFactorGraph, t: int) -> gtsam.NonlinearFactorGraph:
    """The factors that touch a pose of window t; all others are constant when only it moves."""
    inside, here = {X(s) for s in range(t, t + WIDTH)}, gtsam.NonlinearFactorGraph()
    for i in range(graph.size()):
        if inside & set(graph.at(i).keys()):
            here.push_back(graph.at(i))
    return here
