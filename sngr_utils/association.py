"""Which landmark did each range come from: posterior, mutual exclusion, and EM over the batch.

A range is credited to a landmark, rightly with probability 1 - p, else it came from any other
landmark alike. Given distances that posterior is a softmax, range by range; if the ranges of one
scan come from different landmarks, it is a sum over all matchings of the scan. EM alternates it
with a weighted least-squares estimate and so estimates poses, landmarks and p together.
"""

from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from scipy import linalg, special

from sngr_utils import robust
from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam import landmark_starts, solution
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import range_factor, sure_factors
from sngr_utils.world import dead_reckoning, simulation

MOST_LANDMARKS = 14  # of mutual exclusion: time and memory grow with 2^K
WIDEST = 6.0  # range sigmas that the annealed one starts with: a landmark start errs that much
COOLING = 0.7  # per iteration
NEGLIGIBLE = 1e-3  # responsibilities below it make no factor
ITERATIONS, SETTLED = 60, 1e-4  # of EM: at most, and when no position moves more, [m]
LEAST = -50.0  # log weight, against a range's largest, below which all weights are alike
MOST_MISSING = 0.9  # of the information in any direction, see `position_covariances`


@dataclass(frozen=True)
class SoftEstimate:
    """What EM found. M ranges, K landmarks.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN where none was started
    weights : (M, K+1) posterior of each range's source, the last column "none of these"
    p : share of wrong labels, estimated
    the_world, sure : what it was found from
    """

    poses: np.ndarray
    landmarks: np.ndarray
    weights: np.ndarray
    p: float
    the_world: simulation.World
    sure: gtsam.NonlinearFactorGraph

    @property
    def responsibilities(self) -> np.ndarray:
        """(M, K) posterior that a range came from a landmark"""
        return self.weights[:, :-1]

    @cached_property
    def position_covariances(self) -> np.ndarray:
        """(T, 2, 2) in the world frame, [m^2], with what the associations leave open"""
        return position_covariances(
            self.sure, self.the_world, self.poses, self.landmarks, self.weights
        )


def log_prior(labels: np.ndarray, n_landmarks: int, p: float) -> np.ndarray:
    """(N, K) log probability that a range came from each landmark, knowing its label only."""
    prior = np.full((len(labels), n_landmarks), np.log(p / (n_landmarks - 1)))
    prior[np.arange(len(labels)), labels] = np.log1p(-p)
    return prior


def posterior(log_weights: np.ndarray) -> np.ndarray:
    """(N, K+1) posterior of each range over K landmarks and "none of these", each on its own.

    Parameters
    ----------
    log_weights : (N, K+1) log of prior times likelihood, the last column that of "none"; -inf
        for what cannot be, but not all along a row
    """
    return special.softmax(log_weights, axis=1)


def exclusive_posterior(log_weights: np.ndarray, scan_of: np.ndarray | None = None) -> np.ndarray:
    """The same where no two of the ranges of a scan came from the same landmark.

    Exact: the sum over all matchings, by forward and backward recursions over subsets of the
    landmarks (a permanent, in N K 2^K operations). "None" may be taken any number of times.
    Weights below e^-50 of a range's largest are raised to that, so that 14 of them, where two
    ranges fit one landmark only, do not underflow together.

    Parameters
    ----------
    scan_of : (N,) int, ascending, the scan of each range; None if all are of one

    Raises
    ------
    ValueError : more than 14 landmarks, or no matching at all is possible

    Source: the joint association events of Bar-Shalom, Fortmann, Tracking and Data Association,
    1988, chapter 9; Ryser, Combinatorial Mathematics, 1963, on permanents by subsets.
    """
    n_landmarks = log_weights.shape[1] - 1
    if n_landmarks > MOST_LANDMARKS:
        raise ValueError(f"n_landmarks is {n_landmarks}: mutual exclusion takes {MOST_LANDMARKS}")
    relative = log_weights - log_weights.max(axis=1, keepdims=True)
    scaled = np.where(np.isneginf(relative), 0.0, np.exp(np.maximum(relative, LEAST)))
    n = len(scaled)
    ends = [n] if scan_of is None else [*(np.flatnonzero(np.diff(scan_of)) + 1), n]
    found = _matchings_by_scan(scaled, np.array(ends))
    if not np.isfinite(found).all():
        raise ValueError("log_weights allow no matching of ranges and landmarks")
    return found


@compile_once
def _matchings_by_scan(weights, ends):
    """`_matchings` of every scan, whose rows end before `ends`."""
    found, start = np.empty(weights.shape), 0
    for end in ends:
        found[start:end] = _matchings(weights[start:end])
        start = end
    return found


@compile_once
def _matchings(weights):
    """(N, K+1) marginals of all matchings of rows and columns but the last, by subsets."""
    n, columns = weights.shape
    k = columns - 1
    before = np.zeros((n + 1, 1 << k))  # total weight of the first i rows on the subset s
    before[0, 0] = 1.0
    for i in range(n):
        for s in range(1 << k):
            if before[i, s] == 0.0:
                continue
            before[i + 1, s] += before[i, s] * weights[i, k]
            for j in range(k):
                if not s >> j & 1:
                    before[i + 1, s | 1 << j] += before[i, s] * weights[i, j]
    after = np.ones(1 << k)  # of the rows from i on, if the subset s is taken
    marginals = np.zeros((n, columns))
    for i in range(n - 1, -1, -1):
        earlier = np.zeros(1 << k)
        for s in range(1 << k):
            here = weights[i, k] * after[s]
            marginals[i, k] += before[i, s] * here
            earlier[s] = here
            for j in range(k):
                if not s >> j & 1:
                    here = weights[i, j] * after[s | 1 << j]
                    marginals[i, j] += before[i, s] * here
                    earlier[s] += here
        marginals[i] /= marginals[i].sum()
        after = earlier
    return marginals


def estimate(
    the_world: simulation.World, conventions: Conventions, start: str, exclusive: bool
) -> SoftEstimate:
    """EM over the batch from dead reckoning, landmarks started as `start` says.

    Parameters
    ----------
    start : one of `landmark_starts.STARTS`
    exclusive : whether the ranges of one pose come from different landmarks

    Raises
    ------
    ValueError : unknown start, or more landmarks than mutual exclusion takes
    """
    if start not in landmark_starts.STARTS:
        raise ValueError(f"start is {start!r}: it must be one of {sorted(landmark_starts.STARTS)}")
    poses = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
    landmarks = landmark_starts.start_landmarks(the_world, poses, start)
    return fit(the_world, conventions, (poses, landmarks), exclusive)


def fit(
    the_world: simulation.World,
    conventions: Conventions,
    start: robust.Estimate,
    exclusive: bool,
    widest: float = WIDEST,
    sure: gtsam.NonlinearFactorGraph | None = None,
) -> SoftEstimate:
    """EM from the poses and landmarks of `start`, the range sigma annealed from `widest` times.

    Each iteration: responsibilities at the present estimate, p from them (Jeffreys' prior), then
    Levenberg-Marquardt on ranges weighted by them. A wide sigma at first lets a range look
    beyond the landmark that a bad start makes likely.

    Parameters
    ----------
    sure : the factors that are not doubted; None for those of `factors.sure_factors`

    Source: Dempster, Laird, Rubin, JRSS B 39, 1977; soft association in SLAM: Bowman et al.,
    ICRA 2017; annealing: Ueda, Nakano, Neural Networks 11, 1998.
    """
    poses, landmarks = start[0].copy(), start[1].copy()
    sure = sure or sure_factors(the_world, conventions, landmarks)
    p, width = 0.5, widest
    for _ in range(ITERATIONS):
        weights = responsibilities(the_world, poses, landmarks, p, width, exclusive)
        p = _share_wrong(weights, the_world.label_of)
        factors = _weighted(sure, the_world, weights, width)
        moved_poses, moved_landmarks = _optimise(factors, poses, landmarks)
        moved = np.abs(moved_poses[:, :2] - poses[:, :2]).max()
        poses, landmarks = moved_poses, moved_landmarks
        if width == 1.0 and moved < SETTLED:
            break
        width = max(1.0, COOLING * width)
    return SoftEstimate(poses, landmarks, weights, p, the_world, sure)


def responsibilities(
    the_world: simulation.World,
    poses: np.ndarray,
    landmarks: np.ndarray,
    p: float,
    width: float,
    exclusive: bool,
) -> np.ndarray:
    """(M, K+1) posterior of every range over landmarks and "none", at given places.

    A landmark that is absent (NaN) may be the source all the same; its ranges are uniform up to
    the longest there is, and its weight goes to "none".

    Parameters
    ----------
    p : probability of a wrong label, in (0, 1)
    width : of the range noise, in range sigmas
    """
    sigma = width * the_world.scenario.range_sigma
    distances = np.linalg.norm(
        poses[the_world.pose_of, None, :2] - landmarks[None], axis=2
    )  # (M, K)
    residuals = (the_world.ranges[:, None] - distances) / sigma
    gaussian = -0.5 * residuals**2 - np.log(np.sqrt(2 * np.pi) * sigma)
    prior = log_prior(the_world.label_of, the_world.n_landmarks, p)
    absent = np.isnan(landmarks[:, 0])
    uniform = -np.log(the_world.ranges.max())
    log_weights = np.full((len(prior), prior.shape[1] + 1), -np.inf)
    log_weights[:, :-1][:, ~absent] = (prior + gaussian)[:, ~absent]
    if absent.any():
        log_weights[:, -1] = special.logsumexp(prior[:, absent], axis=1) + uniform
    if not exclusive:
        return posterior(log_weights)
    return exclusive_posterior(log_weights, the_world.pose_of)


def _share_wrong(weights: np.ndarray, labels: np.ndarray) -> float:
    """Expected share of wrong labels, with half a range added on either side."""
    right = weights[np.arange(len(labels)), labels].sum()
    return float((len(labels) - right + 0.5) / (len(labels) + 1))


def _weighted(
    sure: gtsam.NonlinearFactorGraph, the_world: simulation.World, weights: np.ndarray, width: float
) -> gtsam.NonlinearFactorGraph:
    """The sure factors, and each range to each landmark by its responsibility."""
    factors = gtsam.NonlinearFactorGraph(sure)
    sigma = width * the_world.scenario.range_sigma
    for m, k in np.argwhere(weights[:, :-1] > NEGLIGIBLE):
        t, distance = int(the_world.pose_of[m]), the_world.ranges[m]
        factors.push_back(range_factor(t, k, distance, sigma / np.sqrt(weights[m, k])))
    return factors


def _optimise(
    factors: gtsam.NonlinearFactorGraph, poses: np.ndarray, landmarks: np.ndarray
) -> robust.Estimate:
    params = gtsam.LevenbergMarquardtParams.CeresDefaults()
    values = solution.values_of(poses, landmarks)
    result = gtsam.LevenbergMarquardtOptimizer(factors, values, params).optimize()
    return solution.poses_of(result, len(poses)), solution.landmarks_of(result, len(landmarks))


def position_covariances(
    sure: gtsam.NonlinearFactorGraph,
    the_world: simulation.World,
    poses: np.ndarray,
    landmarks: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """(T, 2, 2) position covariances in the world frame, [m^2], associations integrated out.

    The information is that of the weighted graph less what the unknown associations withhold,
    the covariance of its score over them, range by range. Where they withhold more than 90 % in
    a direction, the posterior is no Gaussian about this estimate, and 10 % are kept.

    Source: Louis, JRSS B 44, 1982.
    """
    ordering = gtsam.Ordering()
    present = np.flatnonzero(np.isfinite(landmarks[:, 0]))
    for key in [*(X(t) for t in range(len(poses))), *(L(int(k)) for k in present)]:
        ordering.push_back(key)
    factors = _weighted(sure, the_world, weights, 1.0)
    jacobian, _ = factors.linearize(solution.values_of(poses, landmarks)).jacobian(ordering)
    complete = jacobian.T @ jacobian
    missing = _missing_information(the_world, poses, landmarks, present, weights)
    if missing.any():
        share, directions = linalg.eigh(missing, complete)  # their complete information is 1
        scaled = directions / np.sqrt(1 - np.clip(share, 0, MOST_MISSING))
        covariance = scaled @ scaled.T
    else:
        covariance = linalg.inv(complete)
    blocks = []
    for t, heading in enumerate(poses[:, 2]):
        cos, sin = np.cos(heading), np.sin(heading)
        rotation = np.array([[cos, -sin], [sin, cos]])
        body = covariance[3 * t : 3 * t + 2, 3 * t : 3 * t + 2]
        blocks.append(rotation @ body @ rotation.T)
    return np.array(blocks)


def _missing_information(
    the_world: simulation.World,
    poses: np.ndarray,
    landmarks: np.ndarray,
    present: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """(D, D) covariance of the score over the associations; poses first, then landmarks."""
    size = 3 * len(poses) + 2 * len(present)
    missing = np.zeros((size, size))
    open_ranges = np.flatnonzero(weights[:, :-1].max(axis=1) < 1 - NEGLIGIBLE)
    for m in open_ranges:
        t, mine = int(the_world.pose_of[m]), weights[m, present]
        offset = poses[t, :2] - landmarks[present]  # (P, 2)
        distance = np.linalg.norm(offset, axis=1)
        unit = offset / distance[:, None]
        cos, sin = np.cos(poses[t, 2]), np.sin(poses[t, 2])
        slope = (the_world.ranges[m] - distance) / the_world.scenario.range_sigma**2
        scores = np.zeros((len(present), size))
        scores[:, 3 * t : 3 * t + 2] = unit @ np.array([[cos, -sin], [sin, cos]])
        for row in range(len(present)):
            scores[row, 3 * len(poses) + 2 * row :][:2] = -unit[row]
        scores *= slope[:, None]
        mean = mine @ scores
        missing += scores.T @ (mine[:, None] * scores) - np.outer(mean, mean)
    return missing
