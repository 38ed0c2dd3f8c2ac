"""Importance sampling from a mixture that is fitted to its own weighted draws, round by round.

Student t laws at the modes are narrow where ranges bend the posterior along their rings: a few far
draws then carry most of the weight. So weighted draws become components of their own, each is
moved to the draws that it best explains, and the next round draws from what results. A share of
every round comes from the Gaussian that the target holds itself, which bounds the weights. A run
goes on until its effective sample size is large enough, and says how large it became.
"""

import math
from dataclasses import dataclass

import numpy as np

from sngr_utils.metrics.effective_sample_size import effective_sample_size
from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.linalg import distances
from sngr_utils.numerics.student_t import DEGREES, log_fall, log_height, student_t
from sngr_utils.sampling.modes import Modes, inverse_factors
from sngr_utils.sampling.targets.ambiguous_window import LOG_TAU, Window
from sngr_utils.sampling.targets.landmark import Landmark
from sngr_utils.sampling.weighted_samples import WeightedSamples

N_CENTRES = 60  # weighted draws that become components
MAX_DEPTH = 15.0  # nats below the highest mode, from which a mode gets no component
ROOT_SHARES = 0.2, 0.02  # of the draws that come from the root, in the first round and later
LEAST_SHARE = 0.02  # of each mode in the first round, however light
LIGHT = 1e-4  # mass below which a component is left out
ENOUGH = 4000  # effective draws, at which a run ends
MAX_ROUNDS = 12


@dataclass(frozen=True)
class Mixture:
    """Student t laws.

    Attributes
    ----------
    shares, places, covariances : (K,) summing to 1, (K, d), (K, d, d); the last ones are scales
    """

    shares: np.ndarray
    places: np.ndarray
    covariances: np.ndarray

    def draw(self, n: int, *, rng: np.random.Generator) -> np.ndarray:
        """(n, d) draws"""
        which = rng.choice(len(self.shares), n, p=self.shares)
        noise = student_t(n, self.places.shape[1], rng=rng)
        spreads = np.linalg.cholesky(self.covariances)[which]
        return self.places[which] + np.einsum("nij,nj->ni", spreads, noise)

    def each(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, K) log of share times density [nats], and squared Mahalanobis distances."""
        d, inverses = points.shape[1], inverse_factors(self.covariances)
        heights = np.log(self.shares) + np.linalg.slogdet(inverses)[1] + log_height(d)
        away = distances(points, self.places, inverses)
        return heights + log_fall(away, d), away

    def fitted(
        self, points: np.ndarray, weights: np.ndarray, each: tuple[np.ndarray, np.ndarray]
    ) -> "Mixture":
        """One step of expectation maximisation to (N, d) points with (N,) weights.

        `each` is what the method of that name says of the points.

        A component that few points stand for moves less than it would: its new mean and
        covariance count as the effective number of its points does against 2d.

        Source: Cappé et al., Statistics and Computing 18 (2008) 447.
        """
        logs, away = each
        shares = np.exp(logs - log_sum(logs)[:, None]) * weights[:, None]
        mass = shares.sum(axis=0)
        effective = mass**2 / np.maximum((shares**2).sum(axis=0), 1e-300)
        d = points.shape[1]
        places, covariances = _moved(
            points, shares, shares * (DEGREES + d) / (DEGREES + away), mass,
            effective / (effective + 2 * d), self.places, self.covariances,
        )  # fmt: skip
        kept = mass > LIGHT * mass.sum()
        return Mixture(mass[kept] / mass[kept].sum(), places[kept], covariances[kept])


def at_modes(modes: Modes) -> Mixture:
    """A component at each mode, its share its Laplace mass."""
    depth = modes.log_masses.max() - modes.log_masses
    kept = depth < MAX_DEPTH
    shares = np.maximum(np.exp(-depth[kept]) / np.exp(-depth).sum(), LEAST_SHARE)
    return Mixture(shares / shares.sum(), modes.places[kept], modes.covariances[kept])


def draws(
    target: Landmark | Window, modes: Modes, n: int, *, rng: np.random.Generator
) -> WeightedSamples:
    """Rounds of n importance samples, until there are `ENOUGH` effective ones or `MAX_ROUNDS`.

    The first round only shapes the mixture. The others count by their effective sample sizes.
    Weights are cut off at 1 / sqrt(n) where a mixture is fitted, and only there.

    Source: Cornuet et al., Scand. J. Statist. 39 (2012) 798 (rounds that are all kept); Ionides,
    J. Comput. Graph. Statist. 17 (2008) 295 (truncated weights).
    """
    mixture, rounds = at_modes(modes), []
    for number in range(MAX_ROUNDS):
        points, each, values, log_weights = _round(target, mixture, n, ROOT_SHARES[number > 0], rng)
        log_evidence = np.logaddexp.reduce(log_weights)
        weights = np.exp(log_weights - log_evidence)
        if number > 0:
            size = effective_sample_size(weights)
            rounds.append((points, weights, values, log_evidence, size))
        if sum(one[-1] for one in rounds) >= ENOUGH:
            break
        cut = np.minimum(weights, 1 / math.sqrt(n))
        if number == 0:
            mixture = _with_centres(mixture, points, cut / cut.sum(), rng)
            each = mixture.each(points)
        mixture = mixture.fitted(points, cut / cut.sum(), each)
    points, weights, values, evidences, sizes = zip(*rounds, strict=True)
    shares = np.array(sizes) / sum(sizes)
    log_evidence = float(np.log(shares @ np.exp(np.array(evidences) - evidences[0])) + evidences[0])
    pooled = np.concatenate([s * w for s, w in zip(shares, weights, strict=True)])
    return WeightedSamples(
        np.concatenate(points), pooled, np.concatenate(values), log_evidence,
        float(np.sqrt(np.sum((pooled - pooled.mean()) ** 2))), modes.calls + (len(sizes) + 1) * n,
    )  # fmt: skip


def _round(target, mixture, n, root_share, rng):
    """(n, d) points, `each` of them, log targets, and logs of their importance weights over n."""
    mean, lower = target.root
    from_root, d = int(root_share * n), len(mean)
    normals = rng.standard_normal((from_root, d))
    points = np.concatenate([mixture.draw(n - from_root, rng=rng), mean + normals @ lower.T])
    whitened = np.linalg.solve(lower, (points - mean).T)
    root = -0.5 * (np.sum(whitened**2, axis=0) + d * LOG_TAU) - np.log(np.diag(lower)).sum()
    each, share = mixture.each(points), from_root / n
    proposal = np.logaddexp(log_sum(each[0]) + math.log(1 - share), root + math.log(share))
    values = target(points)
    return points, each, values, values - proposal - math.log(n)


def _with_centres(mixture, points, weights, rng):
    """The mixture, and weighted draws as centres, each as wide as the component it came from."""
    chosen = np.unique(rng.choice(len(points), N_CENTRES, p=weights))
    near = mixture.each(points[chosen])[0].argmax(axis=1)
    shares = np.concatenate([0.2 * mixture.shares, np.full(len(chosen), 0.8 / len(chosen))])
    return Mixture(
        shares, np.concatenate([mixture.places, points[chosen]]),
        np.concatenate([mixture.covariances, mixture.covariances[near]]),
    )  # fmt: skip


def log_sum(logs: np.ndarray) -> np.ndarray:
    """(N,) log of the sum of exp over the rows of (N, K) logs"""
    top = logs.max(axis=1)
    return top + np.log(np.exp(logs - top[:, None]).sum(axis=1))


@compile_once
def _moved(points, shares, gains, mass, trust, places, covariances):
    """New (K, d) places and (K, d, d) covariances, `trust` of the fit and the rest as before."""
    (n, d), new_places, new = points.shape, places.copy(), np.zeros_like(covariances)
    offset = np.empty(d)
    for c in range(len(places)):
        total = gains[:, c].sum()
        if total == 0.0:
            continue
        for i in range(d):
            new_places[c, i] = (1 - trust[c]) * places[c, i]
        for k in range(n):
            share = trust[c] * gains[k, c] / total
            for i in range(d):
                new_places[c, i] += share * points[k, i]
        least = 1e-9 * mass[c]
        for k in range(n):
            if shares[k, c] < least:
                continue
            for i in range(d):
                offset[i] = points[k, i] - new_places[c, i]
                gain = gains[k, c] * offset[i]
                for j in range(i + 1):
                    new[c, i, j] += gain * offset[j]
        for i in range(d):
            for j in range(i + 1):
                fitted = trust[c] * new[c, i, j] / mass[c]
                new[c, i, j] = fitted + (1 - trust[c]) * covariances[c, i, j]
                new[c, j, i] = new[c, i, j]
    return new_places, new
