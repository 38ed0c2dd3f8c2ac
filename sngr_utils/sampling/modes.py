"""The modes of a small posterior by optimisation from many starts.

`importance` does the same for windows whose factors are GTSAM's; here the posterior is that of
`targets.landmark`, `targets.ambiguous_window` or `targets.whole_graph`.
"""

from dataclasses import dataclass

import numpy as np

from sngr_utils.numerics.derivatives import derivatives
from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import distances
from sngr_utils.sampling.importance import SAME_MODE
from sngr_utils.sampling.targets.ambiguous_window import LOG_TAU, Window
from sngr_utils.sampling.targets.compiled import evaluate
from sngr_utils.sampling.targets.landmark import Landmark
from sngr_utils.sampling.targets.whole_graph import WholeGraph
from sngr_utils.sampling.weighted_samples import WeightedSamples

STEP = 1e-4  # of the differences
MAX_STEPS, FLAT = 200, 1e-3  # of an ascent, and the slope at which it ends
LONGEST, SHORTEST = 2.0, 1e-10  # step
N_RING = 16  # starts around a ring


@dataclass(frozen=True)
class Modes:
    """Distinct maxima of a density over R^d, the highest first.

    Attributes
    ----------
    places : (m, d)
    covariances : (m, d, d) inverse Hessians of minus the log density
    heights : (m,) log density there, not normalised, [nats]
    calls : evaluations of the density it took to find them
    """

    places: np.ndarray
    covariances: np.ndarray
    heights: np.ndarray
    calls: int

    @property
    def log_masses(self) -> np.ndarray:
        """(m,) log of the mass of each mode if it were Gaussian (Laplace), [nats]"""
        d = self.places.shape[1]
        return self.heights + 0.5 * (d * LOG_TAU + np.linalg.slogdet(self.covariances)[1])

    def log_gaussian(self, mode: int, points: np.ndarray) -> np.ndarray:
        """(N,) log density of one mode's Gaussian at (N, d) points, [nats]"""
        only = slice(mode, mode + 1)
        away = distances(points, self.places[only], inverse_factors(self.covariances[only]))[:, 0]
        return self.heights[mode] - self.log_masses[mode] - 0.5 * away

    def label(self, points: np.ndarray) -> np.ndarray:
        """(N,) int: the mode that most likely made each of (N, d) points, all being Gaussian."""
        away = distances(points, self.places, inverse_factors(self.covariances))
        return np.argmax(self.heights - 0.5 * away, axis=1)


def inverse_factors(covariances: np.ndarray) -> np.ndarray:
    """(K, d, d) lower-triangular inverses of the Cholesky factors of (K, d, d) covariances"""
    return np.linalg.inv(np.linalg.cholesky(covariances))


def ring_starts(target: Landmark) -> np.ndarray:
    """(16, 2) places at equal angles on the ring of a landmark's first range, [m]"""
    angles = 2 * np.pi * np.arange(N_RING) / N_RING
    ring = target.ranges[0] * np.column_stack([np.cos(angles), np.sin(angles)])
    return target.positions[0] + ring


def find_modes(target: Landmark | Window | WholeGraph, starts: np.ndarray) -> Modes:
    """Quasi-Newton ascent from each of (N, d) starts; saddles and repetitions are left out.

    Raises
    ------
    ValueError : no start ended at a maximum
    """
    d, (mean, lower) = starts.shape[1], target.root
    ends, calls = _ascend(target.over(mean, lower), starts - mean)
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    for end in ends + mean:
        if any(_apart(end, place, covariance) < SAME_MODE for _, place, covariance in found):
            continue
        height, _, hessian = derivatives(target, end, STEP * np.eye(d))
        calls += 2 * d * (d + 3)
        hessian /= STEP**2
        if np.linalg.eigvalsh(hessian)[0] > 0:
            found.append((height, end, np.linalg.inv(hessian)))
    if not found:
        raise ValueError(f"none of {len(starts)} starts ended at a maximum")
    found.sort(key=lambda mode: -mode[0])
    heights, places, covariances = (np.array(part) for part in zip(*found, strict=True))
    return Modes(places, covariances, heights, calls)


@compile_once
def _ascend(factors, starts):
    """(N, d) ends of BFGS with halved steps from (N, d) offsets, and the calls it took.

    Source: Nocedal & Wright, Numerical Optimization, 2006, algorithm 6.1.
    """
    ends, calls, (n, d) = starts.copy(), 0, starts.shape
    work = factors.poses.copy(), factors.points.copy()
    for k in range(n):
        x, inverse = ends[k], np.eye(d)
        value, slope = _value_and_slope(factors, x, work)
        calls += 2 * d + 1
        for _ in range(MAX_STEPS):
            if np.abs(slope).max() < FLAT:
                break
            step = -inverse @ slope
            if step @ slope >= 0:
                inverse, step = np.eye(d), -slope
            step *= min(1.0, LONGEST / np.sqrt(step @ step))
            there, calls = _energy(factors, x + step, work), calls + 1
            while not there < value + 1e-4 * (step @ slope) and np.abs(step).max() > SHORTEST:
                step *= 0.5
                there, calls = _energy(factors, x + step, work), calls + 1
            if not there < value:
                break
            x += step
            value, new_slope = _value_and_slope(factors, x, work)
            calls += 2 * d + 1
            change, slope = new_slope - slope, new_slope
            along = step @ change
            if along > 1e-12:
                left = np.eye(d)
                for i in range(d):
                    for j in range(d):
                        left[i, j] -= step[i] * change[j] / along
                inverse = left @ inverse @ left.T
                for i in range(d):
                    for j in range(d):
                        inverse[i, j] += step[i] * step[j] / along
    return ends, calls


@compile_once
def _energy(factors, x, work):
    """Minus the log target at the offset x from the mean of its root, but for a constant."""
    return evaluate(factors, x, *work, np.inf) + 0.5 * (x @ factors.precision @ x)


@compile_once
def _value_and_slope(factors, x, work):
    """`_energy` and its (d,) gradient by central differences."""
    slope, at = np.empty(len(x)), x.copy()
    for i in range(len(x)):
        at[i] = x[i] + STEP
        up = _energy(factors, at, work)
        at[i] = x[i] - STEP
        slope[i] = (up - _energy(factors, at, work)) / (2 * STEP)
        at[i] = x[i]
    return _energy(factors, x, work), slope


def _apart(point: np.ndarray, place: np.ndarray, covariance: np.ndarray) -> float:
    """Distance in the standard deviations of a mode."""
    offset = point - place
    return float(np.sqrt(offset @ np.linalg.solve(covariance, offset)))


def laplace_draws(modes: Modes, n: int, *, rng: np.random.Generator) -> WeightedSamples:
    """n draws from the Gaussian at the highest mode, and its evidence."""
    spread = np.linalg.cholesky(modes.covariances[0])
    points = modes.places[0] + rng.standard_normal((n, len(spread))) @ spread.T
    return WeightedSamples(points, np.full(n, 1 / n), modes.log_gaussian(0, points),
                     float(modes.log_masses[0]), float("nan"), modes.calls)  # fmt: skip
