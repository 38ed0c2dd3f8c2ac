"""The closure of a window: the factors that touch it, to a fixed point."""

import gtsam
import numpy as np


def touching_factors(
    graph: gtsam.NonlinearFactorGraph, keys: list[int]
) -> gtsam.NonlinearFactorGraph:
    """The factors with at least one of `keys`: all that change when the window moves."""
    index, subset = gtsam.VariableIndex(graph), gtsam.NonlinearFactorGraph()
    for i in sorted({i for key in keys for i in index.at(key)}):
        subset.add(graph.at(i))
    return subset


def variable_closure(graph: gtsam.NonlinearFactorGraph, keys: list[int]) -> set[int]:
    """Closure C_w: all variables joined to `keys` by factors, to a fixed point.

    In a connected graph this is every variable, whatever the window.
    """
    neighbours: dict[int, set[int]] = {}
    for i in range(graph.size()):
        factor_keys = graph.at(i).keys()
        for key in factor_keys:
            neighbours.setdefault(key, set()).update(factor_keys)
    closed, frontier = set(keys), list(keys)
    while frontier:
        new = neighbours.get(frontier.pop(), set()) - closed
        closed |= new
        frontier.extend(new)
    return closed


def conditional_covariance(
    graph: gtsam.NonlinearFactorGraph, estimate: gtsam.Values, keys: list[int]
) -> np.ndarray:
    """(9, 9) covariance of a window with all other variables held, linearised at `estimate`.

    The inverse of the window's block of the information matrix; in the body-frame tangent.
    """
    factors, ordering = touching_factors(graph, keys), gtsam.Ordering()
    held = [key for key in factors.keyVector() if key not in keys]
    for key in [*keys, *held]:
        ordering.push_back(key)
    jacobian, _ = factors.linearize(estimate).jacobian(ordering)
    own = jacobian[:, : 3 * len(keys)]
    return np.linalg.inv(own.T @ own)
