"""The modes of any small posterior by optimisation from many starts, and what one can do with them.

`importance` does the same, compiled, for windows whose factors are GTSAM's; here the posterior is
any function of many points at once (`landmark_target`,
`window_target`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import multivariate_t

from sngr_utils.importance import DEGREES, SAME_MODE
from sngr_utils.landmark_target import Landmark
from sngr_utils.laplace import derivatives
from sngr_utils.nested import NestedRun
from sngr_utils.window_target import LOG_TAU

LEAST_SHARE = 0.02  # of the draws that each mode gets, however light
STEP = 1e-4  # of the differences
MIN_DRAWS = 20  # of a mode
N_RING = 16  # starts around a ring

Target = Callable[[np.ndarray], np.ndarray]


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
        spread = np.linalg.cholesky(self.covariances[mode])
        away = (points - self.places[mode]) @ np.linalg.inv(spread).T
        constant = 0.5 * len(spread) * LOG_TAU + np.log(np.diag(spread)).sum()
        return -0.5 * np.sum(away**2, axis=1) - constant

    def label(self, points: np.ndarray) -> np.ndarray:
        """(N,) int: the mode that most likely made each of (N, d) points, all being Gaussian."""
        each = [mass + self.log_gaussian(m, points) for m, mass in enumerate(self.log_masses)]
        return np.argmax(each, axis=0)


def ring_starts(target: Landmark) -> np.ndarray:
    """(16, 2) places at equal angles on the ring of a landmark's first range, [m]"""
    angles = 2 * np.pi * np.arange(N_RING) / N_RING
    ring = target.ranges[0] * np.column_stack([np.cos(angles), np.sin(angles)])
    return target.positions[0] + ring


def find_modes(target: Target, starts: np.ndarray) -> Modes:
    """Quasi-Newton ascent from each of (N, d) starts; saddles and repetitions are left out.

    Raises
    ------
    ValueError : no start ended at a maximum
    """
    d, calls = starts.shape[1], 0
    offsets = STEP * np.vstack([np.zeros(d), np.eye(d), -np.eye(d)])
    found: list[tuple[float, np.ndarray, np.ndarray]] = []

    def descent(point):
        values = -target(point + offsets)
        return values[0], (values[1 : d + 1] - values[d + 1 :]) / (2 * STEP)

    for start in starts:
        end = minimize(descent, start, jac=True, method="BFGS", options={"gtol": 1e-3})
        calls += end.nfev * len(offsets)
        if any(_apart(end.x, place, covariance) < SAME_MODE for _, place, covariance in found):
            continue
        _, _, hessian = derivatives(target, end.x, STEP * np.eye(d))
        calls += 2 * d * (d + 3)
        hessian /= STEP**2
        if np.linalg.eigvalsh(hessian)[0] > 0:
            found.append((-end.fun, end.x, np.linalg.inv(hessian)))
    if not found:
        raise ValueError(f"none of {len(starts)} starts ended at a maximum")
    found.sort(key=lambda mode: -mode[0])
    heights, places, covariances = (np.array(part) for part in zip(*found, strict=True))
    return Modes(places, covariances, heights, calls)


def _apart(point: np.ndarray, place: np.ndarray, covariance: np.ndarray) -> float:
    """Distance in the standard deviations of a mode."""
    offset = point - place
    return float(np.sqrt(offset @ np.linalg.solve(covariance, offset)))


def laplace_draws(modes: Modes, n: int, *, rng: np.random.Generator) -> NestedRun:
    """n draws from the Gaussian at the highest mode, and its evidence."""
    spread = np.linalg.cholesky(modes.covariances[0])
    points = modes.places[0] + rng.standard_normal((n, len(spread))) @ spread.T
    return NestedRun(points, np.full(n, 1 / n), modes.log_gaussian(0, points),
                     float(modes.log_masses[0]), float("nan"), modes.calls)  # fmt: skip


def mixture_draws(target: Target, modes: Modes, n: int, *, rng: np.random.Generator) -> NestedRun:
    """About n importance samples from a mixture of Student t laws, one at each mode.

    Source: Owen & Zhou, JASA 95 (2000) 135 (deterministic mixtures).
    """
    shares = np.exp(modes.log_masses - modes.log_masses.max())
    shares = np.maximum(shares / shares.sum(), LEAST_SHARE)
    counts = np.maximum(MIN_DRAWS, (n * shares / shares.sum()).astype(int))
    laws = [
        multivariate_t(place, covariance, df=DEGREES)
        for place, covariance in zip(modes.places, modes.covariances, strict=True)
    ]
    draws = [law.rvs(count, random_state=rng) for law, count in zip(laws, counts, strict=True)]
    points, total = np.concatenate(draws), counts.sum()
    proposal = np.logaddexp.reduce([
        np.log(c / total) + law.logpdf(points) for c, law in zip(counts, laws, strict=True)
    ])
    values = target(points)
    log_evidence = np.logaddexp.reduce(values - proposal) - np.log(total)
    weights = np.exp(values - proposal - log_evidence) / total
    error = float(np.sqrt(total * np.var(weights)))
    return NestedRun(points, weights, values, float(log_evidence), error,
                     modes.calls + int(total))  # fmt: skip
