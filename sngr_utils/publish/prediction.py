"""Where further worlds may lie, given ours: what printed numbers are held against.

A number that is one world's outcome must lie where one further world of ours may; a series, such
as a column over p, must as a whole, with its steps. All errors are about 5 % whatever the law,
since the worlds and the printed one are ranked together. `Natural` is what a number could have
been before anyone looked; the share of it that would be accepted says what a verdict is worth.
"""

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

from sngr_utils.publish.printed import SLACK

LEVEL = 0.05  # wanted probability of refuting a value that is right
MIN_WORLDS = 20  # behind any verdict
SPLITS = 1000  # random choices of five worlds
FIVE = 5  # worlds behind the paper's means, and in its table by seed
FIVE_LEVEL = 0.99  # of the choices of five that are accepted: errs in 1 to 14 %, see its test
FLOOR = 0.02  # of the natural range: the least spread, where worlds are alike
SIDES = (0.05, 0.5, 0.95)  # quantiles: how wide the law of five worlds is, on either side
TIE = 1e-5  # relative: equal but for rounding


class Natural(BaseModel):
    """What a number could have been, with the reason; declared in ``paper/claims.yaml``."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    low: float
    high: float
    log: bool = False
    why: str

    @model_validator(mode="after")
    def _is_a_range(self) -> "Natural":
        if not (0 if self.log else -np.inf) < self.low < self.high:
            raise ValueError(f"{self.low:g} to {self.high:g} is no range")
        return self

    def unit(self, x: np.ndarray) -> np.ndarray:
        """0 at the lower end, 1 at the upper, what lies outside at the nearer end."""
        ends = np.array([self.low, self.high])
        inside = np.clip(x, *ends)
        low, high = np.log(ends) if self.log else ends
        return ((np.log(inside) if self.log else inside) - low) / (high - low)

    def value(self, unit: np.ndarray) -> np.ndarray:
        """The inverse of `unit`."""
        if self.log:
            return self.low * (self.high / self.low) ** np.asarray(unit)
        return self.low + (self.high - self.low) * np.asarray(unit)

    def draw(self, shape: tuple[int, ...], *, rng: np.random.Generator) -> np.ndarray:
        """Numbers of which the range knows nothing more: uniform on its scale."""
        return self.value(rng.uniform(size=shape))

    def covered(self, low: float, high: float, decimals: int | None) -> float:
        """Share of the range that lies from `low` to `high`, once rounded to `decimals` if any."""
        half = 0.0 if decimals is None else 0.5 * 10.0**-decimals
        if self.log:
            a, b = self.unit(np.array([low - half, high + half]))
            return float(b - a)
        a, b = np.clip([low - half, high + half], self.low - half, self.high + half)
        return float((b - a) / (self.high - self.low + 2 * half))


@dataclass(frozen=True)
class Cloud:
    """Our worlds at the levels of a series, and how the paper's numbers came from its worlds.

    Attributes
    ----------
    worlds : (n, m) rounded as the paper rounds where it prints single worlds; NaN undefined
    natural : the range of all m
    of : "one" world at m levels, the "mean" or "std" of five, or five worlds' "values" (m = 1)
    """

    worlds: np.ndarray
    natural: Natural
    of: str

    def accepts(self, candidates: np.ndarray, *, rng: np.random.Generator) -> np.ndarray:
        """(c,) whether numbers (c, m), or five unordered ones (c, k), may be further worlds'."""
        if self.of == "one":
            if self.worlds.shape[1] == 1:
                low, high = world_interval(self.worlds[:, 0])
                return (candidates[:, 0] >= low - SLACK) & (candidates[:, 0] <= high + SLACK)
            return _series_accepts(self.natural.unit(self.worlds), self.natural.unit(candidates))
        cloud, given = self.five(candidates.shape[1], rng=rng), self.natural.unit(candidates)
        if self.of == "values":
            given = np.sort(given, axis=1)
        else:
            cloud, given = _with_steps(cloud), _with_steps(given)
        low, centre, high = np.quantile(cloud, SIDES, axis=0)
        reach = np.maximum([centre - low, high - centre], FLOOR)
        far, given = (
            np.max(np.abs(x - centre) / np.where(x < centre, *reach), axis=1)
            for x in (cloud, given)
        )
        return given <= np.quantile(far, FIVE_LEVEL) + SLACK

    def five(self, k: int, *, rng: np.random.Generator) -> np.ndarray:
        """(SPLITS, m) what five of our worlds give, on the unit scale; "values": k of them sorted.

        A mean or a standard deviation of five is set against that of the other worlds, and the
        difference against that of all: so the worlds that we have are not taken for the law.
        """
        n, unit = len(self.worlds), self.natural.unit
        chosen = rng.permuted(np.tile(np.arange(n), (SPLITS, 1)), axis=1)
        if self.of == "values":
            return np.sort(unit(self.worlds[chosen[:, :k], 0]), axis=1)
        statistic = np.mean if self.of == "mean" else spread
        parts = (self.worlds[chosen[:, :FIVE]], self.worlds[chosen[:, FIVE:]])
        five, rest = (unit(statistic(part, axis=1)) for part in parts)
        return five - rest + unit(statistic(self.worlds, axis=0))

    def intervals(self, *, rng: np.random.Generator) -> list[tuple[float, float]]:
        """For each level by itself, where a further world, or a statistic of five, may lie."""
        if self.of in ("one", "values"):
            return [world_interval(column) for column in self.worlds.T]
        ends = np.quantile(self.five(0, rng=rng), [0.01, 0.99], axis=0)
        return [tuple(pair) for pair in self.natural.value(ends).T]


def world_interval(sample: np.ndarray) -> tuple[float, float]:
    """Closed interval that holds the value of one further world.

    From the k-th smallest to the k-th largest of the n defined values, k = max(1, floor(0.025
    (n + 1))). If all n + 1 worlds are alike in law, each rank of the further one is equally
    likely, so it falls outside with a probability of at most 2k / (n + 1), whatever the law:
    0.065 for n = 30, at most 0.05 from n = 39. NaN where no world defines it.

    Source: Wilks, Annals of Mathematical Statistics 12 (1941) 91.
    """
    ranked = np.sort(sample[np.isfinite(sample)])
    if not len(ranked):
        return np.nan, np.nan
    k = max(1, int(LEVEL / 2 * (len(ranked) + 1)))
    return float(ranked[k - 1]), float(ranked[-k])


def _series_accepts(worlds: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """(c,) whether (c, m) candidates are not the farthest off among (n, m) worlds and themselves.

    How far off a series is: the distance to the nearest other one, summed over its values and its
    steps, each in units of its standard deviation; what is undefined says nothing. Candidate and
    worlds are measured alike, so the rank of a candidate that is one more world is uniform: it is
    refused with a probability of at most 5 %, 1 / 31 for 30 worlds.

    Source: Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World, 2005 (conformal).
    """
    n, c = len(worlds), len(candidates)
    pool = np.concatenate(
        [np.broadcast_to(worlds, (c, *worlds.shape)), candidates[:, None]], axis=1
    )
    pool = _with_steps(pool)
    pool = pool / _deviation(pool, axis=1)
    apart = np.zeros((c, n + 1, n + 1), dtype=np.float32)
    for one in np.moveaxis(pool.astype(np.float32), -1, 0):
        gap = np.abs(one[:, :, None] - one[:, None])
        apart += np.where(gap >= 0, gap, 0)
    apart[:, np.arange(n + 1), np.arange(n + 1)] = np.inf
    far = apart.min(axis=-1)
    as_far = np.sum(far[:, :-1] >= far[:, -1:] * (1 - TIE), axis=1)
    return as_far + 1 > LEVEL * (n + 1)


def _with_steps(series: np.ndarray) -> np.ndarray:
    """(..., 2 m - 1) the values and their steps."""
    return np.concatenate([series, np.diff(series, axis=-1)], axis=-1)


def _deviation(x: np.ndarray, axis: int) -> np.ndarray:
    """Standard deviation of what is defined, but not below `FLOOR`; the axis is kept."""
    known = np.isfinite(x)
    n = np.maximum(known.sum(axis=axis, keepdims=True), 1)
    filled = np.where(known, x, 0.0)
    gap = np.where(known, x - filled.sum(axis=axis, keepdims=True) / n, 0.0)
    return np.maximum(np.sqrt((gap**2).sum(axis=axis, keepdims=True) / n), FLOOR)


def spread(values: np.ndarray, axis: int = 0) -> np.ndarray:
    """Sample standard deviation."""
    return np.std(values, axis=axis, ddof=1)
