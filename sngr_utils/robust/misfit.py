"""Would a log fit better if what it takes for known were not so? Asked without a new estimate.

At the minimum of the cost, its slope by a number that was held fast says which way the data want
that number, and the information that poses and landmarks leave of it says by how much: it is the
first step of an estimate that has it open. So a drift too small to show in any one step is seen,
or a range scale that the odometry bears with.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from sngr_utils.robust.em import SoftEstimate
from sngr_utils.slam import chain_cost, damped_step, information
from sngr_utils.slam.chain_cost import State
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.log import Log

ODOMETRY = ("ahead", "to the left", "in turning")  # what every step errs by, in its own frame
CALIBRATION = ("of the range scale", "of the range offset")
LEAST_LEFT = 1e-6  # share of the information on a number that must be left, for it to be asked
LEAST_SIZE = 0.25  # see `Misfit`: on a long drive a smaller one is significant, and harmless


class Misfit(NamedTuple):
    """What freeing one number would do.

    Attributes
    ----------
    name : one of `ODOMETRY` or `CALIBRATION`
    size : by how much a median measurement is wrong, in its sigmas
    p_value : of one as far from zero, if zero is true
    """

    name: str
    size: float
    p_value: float


NONE = Misfit("none", 0.0, 1.0)


def worst(log: Log, found: SoftEstimate) -> Misfit:
    """The least likely one of at least `LEAST_SIZE`, with the p-value of the worst of so many."""
    asked = misfits(log, found)
    large = [one for one in asked if abs(one.size) >= LEAST_SIZE]
    if not large:
        return NONE
    least = min(large, key=lambda one: one.p_value)
    return least._replace(p_value=min(1.0, least.p_value * len(asked)))


def misfits(log: Log, found: SoftEstimate) -> list[Misfit]:
    """Of a drift of the odometry, and of a range scale and offset that are not estimated.

    Source: Rao, Proceedings of the Cambridge Philosophical Society 44, 1948.
    """
    if not len(log.odometry) or not len(log.ranges):
        return []
    chain, at = found.minimum
    if not len(chain.ranges):
        return []
    steps = np.sqrt(np.median(np.diagonal(log.odometry_covariances, 0, 1, 2), axis=0))
    sigma = np.median(log.range_sigmas)
    asked = dict(zip(ODOMETRY, steps, strict=True))
    for name, column, step in zip(
        CALIBRATION, chain.columns, (sigma / np.median(log.ranges), sigma), strict=True
    ):
        if column < 0:
            asked[name] = step
    return [_misfit(log, chain, at, name, step) for name, step in asked.items()]


def _misfit(log: Log, chain: Chain, at: State, name: str, step: float) -> Misfit:
    """See `misfits`; derivatives are differences over a `step`, where the cost is quadratic."""
    costs, systems = [], []
    for by in (-step, 0.0, step):
        problem, there = _changed(log, chain, at, name, by)
        costs.append(chain_cost.cost(problem, LEAST_SQUARES, there))
        systems.append(chain_cost.linearise(problem, LEAST_SQUARES, there))
    before, here, after = systems
    cross = here._replace(
        slope=(after.slope - before.slope) / (2 * step),
        pull=(after.pull - before.pull) / (2 * step),
    )
    moves, border = np.empty(here.slope.shape), np.empty(here.pull.shape)
    taken_up = 2 * damped_step.solve(cross, 0.0, False, moves, border)
    total = (costs[0] - 2 * costs[1] + costs[2]) / step**2
    left = total - taken_up
    if taken_up < 0 or not left > LEAST_LEFT * total:
        return NONE._replace(name=name)
    slope = (costs[2] - costs[0]) / (2 * step) + np.sum(here.slope * moves) + here.pull @ border
    p_value = float(2 * stats.norm.sf(abs(slope) / np.sqrt(left)))
    return Misfit(name, float(-slope / left / step), p_value)


def _changed(log: Log, chain: Chain, at: State, name: str, by: float) -> tuple[Chain, State]:
    """The problem with one of its numbers changed, and the estimate as a point of it."""
    if name in CALIBRATION:
        change = by * np.eye(2)[CALIBRATION.index(name)]
        return chain, at._replace(calibration=at.calibration + change)
    change = by * np.eye(3)[ODOMETRY.index(name)]
    return chain._replace(motions=information.frames_of(log.odometry + change)), at
