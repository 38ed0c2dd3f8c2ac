"""Which ranges leave a variable open, where GTSAM only says near which key it gave up."""

from collections.abc import Iterator
from contextlib import contextmanager

import gtsam
import numpy as np

NAMES = {"x": "pose", "l": "landmark"}
OPEN = 1e-9  # of the largest singular value of the whitened Jacobian: a direction that is open
SHARE = 0.1  # of the largest part of such a direction, a variable that takes part in it
SHOWN = 4  # variables, or factors of each kind, that the message lists


@contextmanager
def named(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> Iterator[None]:
    """Do GTSAM's work; where a system is indeterminate, say of which variables and factors.

    Parameters
    ----------
    graph, values : what is being solved, and where it is linearised

    Raises
    ------
    ValueError : an indeterminate system: poses and landmarks that are open, with all their factors
    """
    try:
        yield
    except RuntimeError as error:
        if "ndeterminate linear system" not in str(error):
            raise
        keys = _open_keys(graph, values)
        touching = (graph.at(i) for i in range(graph.size()))
        told = [_factor(factor) for factor in touching if not keys.isdisjoint(factor.keys())]
        what, why = _list([_variable(key) for key in sorted(keys)]), _list(told)
        raise ValueError(f"not determined: {what}; all that is known of it: {why}") from error


def _open_keys(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> set[int]:
    """Variables that can move and change no whitened residual, or as good as none."""
    ordering, keys = gtsam.Ordering(), list(values.keys())
    for key in keys:
        ordering.push_back(key)
    jacobian, _ = graph.linearize(values).jacobian(ordering)
    _, stretch, directions = np.linalg.svd(jacobian)
    stretch = np.pad(stretch, (0, len(directions) - len(stretch)))
    loose = directions[stretch <= max(OPEN * stretch.max(), stretch.min())]
    sizes = [3 if chr(gtsam.Symbol(key).chr()) == "x" else 2 for key in keys]
    parts = np.split(np.abs(loose), np.cumsum(sizes)[:-1], axis=1)
    most = np.max([part.max(axis=1) for part in parts], axis=0)
    return {
        key for key, part in zip(keys, parts, strict=True)
        if (part.max(axis=1) > SHARE * most).any()
    }  # fmt: skip


def _variable(key: int) -> str:
    symbol = gtsam.Symbol(key)
    return f"{NAMES[chr(symbol.chr())]} {symbol.index()}"


def _factor(factor: gtsam.NonlinearFactor) -> str:
    """E.g. "range 3.100 m of pose 2 and landmark 0"."""
    of = " and ".join(map(_variable, factor.keys()))
    if isinstance(factor, gtsam.RangeFactor2D):
        return f"range {factor.measured():.3f} m of {of}"
    return f"{'prior' if len(factor.keys()) == 1 else 'odometry'} of {of}"


def _list(words: list[str]) -> str:
    more = len(words) - SHOWN
    return ", ".join(words[:SHOWN]) + (f" and {more} more" if more > 0 else "")
