"""Other people's nested samplers on a window, where they are installed (``pip install .[peers]``).

nestle is the lightest one there is, blackjax's nested slice sampler the fastest we know of; both
stand in ``make bench`` beside dynesty and ours, and nothing else needs them.
"""

from importlib.util import find_spec
from itertools import pairwise

import numpy as np

from sngr_utils.sampling.prior_transform import prior_transform
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.weighted_samples import WeightedSamples


def installed(name: str) -> bool:
    """Whether a module is there to import."""
    return find_spec(name) is not None


def sample_nestle(
    factors: compiled.Factors,
    covariance: np.ndarray,
    settings: SamplerSettings,
    *,
    rng: np.random.Generator,
) -> WeightedSamples:
    """nestle with a single ellipsoid, as `engines.sample_factors`.

    Source: K. Barbary, nestle 0.2; Mukherjee et al., ApJ 638, 2006 (single ellipsoid).
    """
    import nestle

    found = nestle.sample(
        lambda xi: compiled.log_likelihood(factors, xi),
        prior_transform(covariance, settings.prior_scale), len(covariance),
        npoints=settings.n_live, dlogz=settings.dlogz,
        rstate=np.random.RandomState(rng.integers(2**32)),
    )  # fmt: skip
    return WeightedSamples(
        found.samples, found.weights, found.logl, found.logz, found.logzerr, found.ncall
    )


class NestedSlice:
    """blackjax's nested slice sampler on windows of one size, compiled at its first run.

    As many slice steps as dimensions, half of the live points replaced at a time: the fastest
    of its settings that we tried.

    Source: Yallup, Kroupa, Handley, Nested slice sampling, arXiv:2601.23252.
    """

    def __init__(self, factors: compiled.Factors, settings: SamplerSettings) -> None:
        import blackjax
        import jax

        jax.config.update("jax_enable_x64", True)
        self.settings, counts = settings, factors.counts.copy()

        def sampler(arrays):
            return blackjax.nss(
                lambda z: -0.5 * z @ z,
                lambda z: jax_log_likelihood(arrays, counts, arrays["cholesky"] @ z),
                num_inner_steps=factors.dimension,
                num_delete=settings.n_live // 2,
            )

        self._start = jax.jit(lambda arrays, z: sampler(arrays).init(z))
        self._step = jax.jit(lambda arrays, key, state: sampler(arrays).step(key, state))

    def __call__(
        self, factors: compiled.Factors, covariance: np.ndarray, *, rng: np.random.Generator
    ) -> WeightedSamples:
        """As `engines.sample_factors`; it does not count its calls (NaN)."""
        import jax

        cholesky = np.linalg.cholesky(self.settings.prior_scale * covariance)
        arrays, n = {**arrays_of(factors), "cholesky": cholesky}, self.settings.n_live
        key = jax.random.key(int(rng.integers(2**32)))
        state = self._start(arrays, rng.standard_normal((n, len(cholesky))))
        points, logs, log_x, log_z = [], [], [0.0], -np.inf
        lost = 1 / np.arange(n, n - n // 2, -1)  # log volume, of each that dies in one step
        while True:
            live = np.asarray(state.particles.loglikelihood)
            if np.logaddexp(0, live.max() + log_x[-1] - log_z) <= self.settings.dlogz:
                break
            key, now = jax.random.split(key)
            state, dead = self._step(arrays, now, state)
            _append(dead.particles, points, logs)
            log_x.extend(log_x[-1] - np.cumsum(lost))
            shells = np.array(log_x[-len(lost) - 1 : -1]) + np.log(-np.expm1(-lost))
            log_z = np.logaddexp(log_z, np.logaddexp.reduce(logs[-1] + shells))
        _append(state.particles, points, logs)
        volumes = np.exp(log_x)
        shells = np.append(-np.diff(volumes), np.full(n, volumes[-1] / n))
        return _weighted(np.concatenate(points) @ cholesky.T, np.concatenate(logs), shells, n)


def _append(particles, points: list, logs: list) -> None:
    """The particles by rising likelihood."""
    log_likelihoods = np.asarray(particles.loglikelihood)  # not JAX's own sort, which compiles
    order = np.argsort(log_likelihoods)
    points.append(np.asarray(particles.position)[order])
    logs.append(log_likelihoods[order])


def _weighted(
    samples: np.ndarray, log_likelihoods: np.ndarray, shells: np.ndarray, n_live: int
) -> WeightedSamples:
    """Points with the prior mass of their shells; their calls are not counted."""
    log_weights = log_likelihoods + np.log(shells)
    log_z = float(np.logaddexp.reduce(log_weights))
    weights = np.exp(log_weights - log_z)
    error = float(np.sqrt(max(weights @ log_likelihoods - log_z, 0.0) / n_live))
    return WeightedSamples(samples, weights, log_likelihoods, log_z, error, calls=np.nan)


def arrays_of(factors: compiled.Factors) -> dict:
    """What `jax_log_likelihood` reads, as JAX may trace it."""
    return {
        name: getattr(factors, name) for name in ("poses", "points", "of", "measured", "factor")
    }


def jax_log_likelihood(arrays: dict, counts: np.ndarray, xi):
    """`compiled.log_likelihood` in JAX, of GTSAM's factors alone."""
    import jax.numpy as jnp

    n_poses, n_points, n_between, n_prior, n_point, n_near, n_range = map(int, counts)
    poses, points, of, w = (jnp.asarray(arrays[n]) for n in ("poses", "points", "of", "measured"))
    move = xi[: 3 * n_poses].reshape(-1, 3)
    poses = jnp.vstack([_retract(poses[:n_poses], move), poses[n_poses:, :3]])
    points = points.at[:n_points].add(xi[3 * n_poses :].reshape(-1, 2))
    a, b = of[:, 0].astype(int), of[:, 1].astype(int)
    ends = np.cumsum([0, n_between, n_prior, n_point, n_near, n_range])
    step, prior, point, near, far = (slice(*pair) for pair in pairwise(ends))
    total = 0.0
    for rows, from_rows, to_rows in (
        (step, poses[a[step]], poses[b[step]]),
        (prior, jnp.zeros((n_prior, 3)), poses[a[prior]]),
    ):
        relative = _local(_between(from_rows, to_rows), w[rows, :3])
        total += jnp.sum((relative * w[rows, 5:]) ** 2)
    total += jnp.sum(((points[a[point]] - w[point, :2]) * w[point, 5:7]) ** 2)
    for rows, places in ((near, points), (far, poses[:, :2])):
        distance = jnp.linalg.norm(places[a[rows]] - points[b[rows]], axis=1)
        total += jnp.sum(((distance - w[rows, 0]) * w[rows, 5]) ** 2)
    return -0.5 * arrays["factor"] * total


def _retract(poses, move):
    """MAP.retract(move): the exponential map of SE(2), as `compiled.place_variables`."""
    import jax.numpy as jnp

    turn = move[:, 2]
    half = jnp.where(jnp.abs(turn) > 1e-10, turn, 1.0) / 2
    along = jnp.where(jnp.abs(turn) > 1e-10, jnp.sin(half) * jnp.cos(half) / half, 1.0)
    across = jnp.where(jnp.abs(turn) > 1e-10, jnp.sin(half) ** 2 / half, 0.0)
    ahead = along * move[:, 0] - across * move[:, 1]
    left = across * move[:, 0] + along * move[:, 1]
    return _compose(poses, jnp.stack([ahead, left, turn], axis=1))


def _compose(poses, step):
    import jax.numpy as jnp

    cos, sin = jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])
    x = poses[:, 0] + cos * step[:, 0] - sin * step[:, 1]
    y = poses[:, 1] + sin * step[:, 0] + cos * step[:, 1]
    return jnp.stack([x, y, poses[:, 2] + step[:, 2]], axis=1)


def _between(start, end):
    import jax.numpy as jnp

    cos, sin = jnp.cos(start[:, 2]), jnp.sin(start[:, 2])
    dx, dy = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
    return jnp.stack([cos * dx + sin * dy, cos * dy - sin * dx, end[:, 2] - start[:, 2]], axis=1)


def _local(poses, measured):
    """Logarithm of measured^-1 * pose, as `compiled._pose_residual`."""
    import jax.numpy as jnp

    relative = _between(measured, poses)
    turn = (relative[:, 2] + jnp.pi) % (2 * jnp.pi) - jnp.pi
    half = turn / 2
    small = jnp.abs(turn) < 1e-4
    safe = jnp.where(small, 1.0, half)
    along = jnp.where(small, 1 - half**2 / 3, safe / jnp.tan(safe))
    x = along * relative[:, 0] + half * relative[:, 1]
    y = along * relative[:, 1] - half * relative[:, 0]
    return jnp.stack([x, y, turn], axis=1)
