"""Losses of a range: what a whitened residual costs, and the weight that reweighting gives it.

Each is GTSAM's, in value too: its Levenberg-Marquardt accepts a step by the cost.
"""

import math
from typing import NamedTuple

from sngr_utils.numerics.jit import compile_once

_KINDS = SQUARED, HUBER, CAUCHY, DCS, GEMAN_MCCLURE = range(5)


class Loss(NamedTuple):
    """rho(r) of a residual r in sigmas.

    Attributes
    ----------
    kind : SQUARED, HUBER, CAUCHY, DCS or GEMAN_MCCLURE
    constant : k of Huber and of Cauchy, Phi of DCS, c of Geman and McClure; of no effect on the
        square
    """

    kind: int
    constant: float


LEAST_SQUARES = Loss(SQUARED, 1.0)


@compile_once
def rho(loss, r):
    """Loss of a residual r in sigmas, r^2 / 2 at small r. Sources: see `losses.METHODS`."""
    c, square = loss.constant, r * r
    if loss.kind == HUBER and abs(r) > c:
        return c * (abs(r) - 0.5 * c)
    if loss.kind == CAUCHY:
        return 0.5 * c * c * math.log1p(square / (c * c))
    if loss.kind == DCS and square > c:
        return 1.5 * c - 2.0 * c * c / (c + square)
    if loss.kind == GEMAN_MCCLURE:
        return 0.5 * c * c * square / (c * c + square)
    return 0.5 * square


@compile_once
def weight(loss, r):
    """rho'(r) / r, by which a squared residual counts in the reweighted problem."""
    c, square = loss.constant, r * r
    if loss.kind == HUBER and abs(r) > c:
        return c / abs(r)
    if loss.kind == CAUCHY:
        return c * c / (c * c + square)
    if loss.kind == DCS and square > c:
        return (2.0 * c / (c + square)) ** 2
    if loss.kind == GEMAN_MCCLURE:
        return (c * c / (c * c + square)) ** 2
    return 1.0
