"""A task for studies that takes no time, in a module that workers import at once."""

import os
from pathlib import Path

import numpy as np

CALLS = []
FACTOR = {"of x": 1.0}


def draw(folder: str, seed: int) -> list[dict]:
    """A row of each kind of number. The process ends where the folder has a file of that name."""
    if Path(folder, str(seed)).exists():
        os._exit(9)
    CALLS.append(seed)
    x = FACTOR["of x"] * np.random.default_rng(seed).normal()
    return [{"seed": seed, "x": x, "n": np.int64(seed), "no": np.nan, "text": "a"}]


def last_first(seed: int, n: int) -> int:
    """The seed; the first takes longest, so that results come in another order than the cases."""
    return sum(range(20_000 * (n - seed))) * 0 + seed
