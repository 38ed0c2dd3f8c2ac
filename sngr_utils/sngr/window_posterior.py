"""The posterior of a window under all factors, each counted once.

A density in the tangent xi: with everything outside the window held at the estimate
("conditional"), or with the rest of the graph integrated out ("marginal").
"""

from dataclasses import dataclass

import gtsam
import numpy as np

from sngr_utils.numerics import derivatives
from sngr_utils.sampling.targets import compiled
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import closure, windows

STEP = 1e-3  # of the differences in `expand`, [m] or [rad]


@dataclass(frozen=True)
class Piece:
    """One factor's energy to second order: 1/2 xi^T Q xi + g^T xi, xi the tangent of its keys."""

    keys: list[int]
    quadratic: np.ndarray
    linear: np.ndarray


@dataclass(frozen=True)
class Target:
    """Posterior of a window, or of a window and its separators, in d tangent numbers.

    Attributes
    ----------
    keys : what moves; the window's poses first, other poses, then landmarks
    factors : the log posterior under a flat measure in xi, up to a constant
    covariance : (d, d) joint marginal covariance of `keys`
    """

    keys: list[int]
    factors: compiled.Factors
    covariance: np.ndarray

    def log_density(self, xi: np.ndarray) -> float:
        """At a (d,) tangent vector, up to a constant, [nats]."""
        return compiled.log_likelihood(self.factors, xi)

    def corrected(self, scale: float) -> compiled.Factors:
        """The target divided by N(0, scale * covariance), up to a constant: for a sampler that
        has it for a prior.

        Parameters
        ----------
        scale : c
        """
        own, d = self.factors.quadratic, len(self.covariance)
        own = own if len(own) else np.zeros((d, d))
        return self.factors._replace(quadratic=own - np.linalg.inv(scale * self.covariance))


def marginal_target(solution: Solution, t: int, pieces: list[Piece] | None = None) -> Target:
    """Posterior of window w(t) and all it is joined to, the rest of the graph integrated out.

    The poses before and after the window and the landmarks it ranges move along. The factors
    that do not touch the window reach them as a Gaussian, expanded at the estimate: a quadratic
    form, and a slope that balances the touching factors' even at a stationary point. A Gaussian
    has no negative curvature, so negative eigenvalues of the form are set to zero.

    Parameters
    ----------
    pieces : `expand` of the solution, if at hand
    """
    pieces, window = pieces or expand(solution), windows.window_keys(t)
    touching = closure.touching_factors(solution.graph, window)
    joined = sorted(set(touching.keyVector()) - set(window), key=_poses_first)
    keys, outside = [*window, *joined], [p for p in pieces if not set(window) & set(p.keys)]
    factors = compiled.flatten(touching, solution.estimate, keys, 1.0)
    quadratic = np.zeros((factors.dimension, factors.dimension))
    linear = np.zeros(factors.dimension)
    rest, linear[9:] = eliminated(outside, joined)
    quadratic[9:, 9:] = _floored(rest, 0.0)
    everything = eliminated(pieces, keys)[0]
    covariance = np.linalg.inv(_floored(everything, 1e-6 * np.trace(everything)))
    return Target(keys, factors._replace(quadratic=quadratic, linear=linear), covariance)


def target(
    solution: Solution,
    t: int,
    covariance: np.ndarray,
    separators: str,
    pieces: list[Piece] | None = None,
) -> Target:
    """Posterior of window w(t), all else held ("conditional"), or that of `marginal_target`.

    Parameters
    ----------
    covariance : (9, 9) joint marginal Sigma_w
    """
    if separators == "marginal":
        return marginal_target(solution, t, pieces)
    keys = windows.window_keys(t)
    touching = closure.touching_factors(solution.graph, keys)
    return Target(keys, compiled.flatten(touching, solution.estimate, keys, 1.0), covariance)


def expand(solution: Solution) -> list[Piece]:
    """Every factor of a solution to second order about its estimate.

    With the curvature of the residuals, which Gauss-Newton leaves out: with wrong associations
    residuals are metres, and that is no small term.
    """
    pieces = []
    for i in range(solution.graph.size()):
        one = solution.graph.at(i)
        keys = sorted(one.keys(), key=_poses_first)
        alone = gtsam.NonlinearFactorGraph()
        alone.push_back(one)
        factors = compiled.flatten(alone, solution.estimate, keys, 1.0)
        slope, hessian = derivatives.derivatives(
            lambda xi, factors=factors: compiled.log_likelihoods(factors, xi),
            np.zeros(factors.dimension), STEP * np.eye(factors.dimension),
        )[1:]  # fmt: skip
        pieces.append(Piece(keys, hessian / STEP**2, -slope / STEP))
    return pieces


def eliminated(pieces: list[Piece], keep: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """The energy of factors to second order, minimised over all variables but `keep`.

    Returns
    -------
    (d, d) Q and (d,) g of 1/2 xi^T Q xi + g^T xi, in the order of `keep`; zero for a variable
    that no factor holds
    """
    others = {key for piece in pieces for key in piece.keys} - set(keep)
    keys = [*keep, *sorted(others, key=_poses_first)]
    stop = np.cumsum([_dimension(key) for key in keys])
    place = {k: np.arange(e - _dimension(k), e) for k, e in zip(keys, stop, strict=True)}
    quadratic, linear = np.zeros((stop[-1], stop[-1])), np.zeros(stop[-1])
    for piece in pieces:
        at = np.concatenate([place[key] for key in piece.keys])
        quadratic[at[:, None], at] += piece.quadratic
        linear[at] += piece.linear
    d = sum(_dimension(key) for key in keep)
    gain = np.linalg.solve(quadratic[d:, d:], quadratic[d:, :d]).T
    rest = quadratic[:d, :d] - gain @ quadratic[d:, :d]
    return 0.5 * (rest + rest.T), linear[:d] - gain @ linear[d:]


def _floored(matrix: np.ndarray, least: float) -> np.ndarray:
    """A symmetric matrix with its eigenvalues raised to `least`."""
    eigenvalues, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(eigenvalues, least)) @ vectors.T


def _poses_first(key: int) -> tuple[bool, int]:
    return gtsam.Symbol(key).chr() != ord("x"), key


def _dimension(key: int) -> int:
    return 3 if gtsam.Symbol(key).chr() == ord("x") else 2
