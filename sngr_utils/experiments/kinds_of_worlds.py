"""Worlds of every kind that a person who brings data may meet, by name, and how each is drawn."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sngr_utils.world import simulation, variations
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import World

SCENE = 10.0  # m, what clutter is uniform up to
FAR = 100.0  # m, and gross outliers
STREAM = 90  # of random numbers, beside the seed of the world
GYRO_BIAS = np.array([0.0, 0.0, 0.01])  # m, m, rad at every step

Change = Callable[[World, np.random.Generator], World]


def _same(world: World, rng: np.random.Generator) -> World:
    return world


def _added(share: float) -> Change:
    return lambda world, rng: variations.clutter_added(world, share, SCENE, rng=rng)


def _replaced(share: float, longest: float = SCENE) -> Change:
    return lambda world, rng: variations.clutter_replaced(world, share, longest, rng=rng)


def _jump(metres: float, radians: float) -> Change:
    return lambda world, rng: variations.jump(world, metres, radians, rng=rng)


def _told(ranges: float, odometry: float) -> Change:
    return lambda world, rng: variations.misstated(world, ranges, odometry)


def _burst(p: float, length: int) -> Change:
    return lambda world, rng: variations.burst(world, p, length, rng=rng)


CHANGES: dict[str, Change] = {
    "circle": _same,
    "straight": _same,
    "L": _same,
    "clutter added 1 %": _added(0.01),
    "clutter added 5 %": _added(0.05),
    "clutter added 20 %": _added(0.2),
    "clutter replaced 1 %": _replaced(0.01),
    "clutter replaced 5 %": _replaced(0.05),
    "clutter replaced 20 %": _replaced(0.2),
    "gross outliers": _replaced(0.05, FAR),
    "too long": lambda world, rng: variations.too_long(world, 0.05, 3.0, rng=rng),
    "reach 4 m": lambda world, rng: variations.within_reach(world, 4.0),
    "reach 5 m": lambda world, rng: variations.within_reach(world, 5.0),
    "burst 7": _burst(0.6, 7),
    "burst 5": _burst(0.8, 5),
    "slip 1 m": _jump(1.0, 0.0),
    "slip 5 m": _jump(5.0, 0.0),
    "slip 0.5 rad": _jump(0.0, 0.5),
    "range sigma 1.25": _told(1.25, 1.0),
    "range sigma 0.8": _told(0.8, 1.0),
    "odometry 2": _told(1.0, 2.0),
    "ranges 10 % long": lambda world, rng: replace(world, ranges=1.1 * world.ranges),
    "gyro bias": lambda world, rng: replace(world, odometry=world.odometry + GYRO_BIAS),
}
MISLED = ("ranges 10 % long", "gyro bias")  # by what the oracle knows, and is freed of
BENDS = {"straight": 0.0, "L": np.pi / 2}  # of roads, [rad]; the others are circles

# kind, preset, shares of wrong labels
ROWS = [
    ("circle", "C", (0.0, 0.3, 0.5, 0.6)), ("circle", "A", (0.0, 0.3, 0.5)),
    ("circle", "B", (0.0, 0.3, 0.5)),
    *((f"clutter {how} {share} %", "C", (0.0, 0.3))
      for share in (1, 5) for how in ("added", "replaced")),
    *((f"clutter {how} 20 %", "C", (0.2,)) for how in ("added", "replaced")),
    *((kind, "C", (0.3,)) for kind in ("gross outliers", "too long")),
    *((kind, "C", (0.0, 0.3)) for kind in ("reach 4 m", "reach 5 m", "straight", "L")),
    *((kind, "C", (0.0,)) for kind in ("burst 7", "burst 5")),
    *((kind, "C", (0.3,)) for kind in (
        "slip 1 m", "slip 5 m", "slip 0.5 rad",
        "range sigma 0.8", "range sigma 1.25", "odometry 2", *MISLED)),
]  # fmt: skip


def cells(seeds: range) -> list[tuple]:
    """Arguments of `rows` for every kind."""
    return [(kind, preset, p, seed) for seed in seeds for kind, preset, levels in ROWS
            for p in levels]  # fmt: skip


def draw(kind: str, p: float, seed: int) -> tuple[World, World]:
    """The world of a kind, and the sound one that it was made from.

    Raises
    ------
    ValueError : unknown kind
    """
    if kind not in CHANGES:
        raise ValueError(f"kind is {kind!r}: it must be one of {sorted(CHANGES)}")
    rng = np.random.default_rng(seed)
    if kind in BENDS:
        sound = variations.on_a_road(Scenario(), BENDS[kind], p, rng=rng)
    else:
        sound = simulation.simulate(Scenario(), p, rng=rng)
    return CHANGES[kind](sound, np.random.default_rng([seed, STREAM])), sound
