"""What losses make of ten ranges to one landmark, and a scan that several landmarks explain."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sngr_utils.robust import em, switchable_constraints
from sngr_utils.robust.losses import GNC_SQUARED, LOSSES
from sngr_utils.settings import READING
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.slam.range_loss import GEMAN_MCCLURE, Loss, rho, weight
from sngr_utils.world import simulation
from sngr_utils.world.scenario import Scenario

N_RIGHT, N_WRONG, WRONG_BY = 7, 3, 1.0  # ranges of the first example, and an error of [m]


def kernels(residuals: np.ndarray, scenario: Scenario) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Loss [nats] and weight of a whitened residual, method -> two (N,) arrays.

    The weight is that of the range in the least-squares problem whose minimum is the same.
    The null hypothesis is as wide as the landmarks' square.
    """
    switch = Loss(GEMAN_MCCLURE, 1 / switchable_constraints.SWITCH_SIGMA)
    found, square = {}, 0.5 * residuals**2
    for name, loss in {**LOSSES, "switchable": switch}.items():
        found[name] = tuple(np.array([f(loss, r) for r in residuals]) for f in (rho, weight))
    inside = residuals**2 < GNC_SQUARED
    found["gnc_tls"] = np.minimum(square, GNC_SQUARED / 2), inside.astype(float)
    ratio = scenario.landmark_half_width / scenario.range_sigma
    null = square / ratio**2 + np.log(ratio)
    found["max_mixture_null"] = np.minimum(square, null), np.where(square < null, 1, ratio**-2)
    return found


def pull(scenario: Scenario, distances: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Ten ranges to a landmark 3 m away, three of them another one's, and the cost of a distance.

    The ranges are quantiles of their law, so that nothing here is random.

    Returns
    -------
    ranges : (10,) [m], the wrong ones last
    costs : method -> (N,) total loss at the (N,) distances, over its range, in [0, 1]
    """
    quantiles = stats.norm.ppf((np.arange(N_RIGHT) + 0.5) / N_RIGHT)
    ranges = 3 + scenario.range_sigma * quantiles
    ranges = np.append(ranges, np.median(ranges) + WRONG_BY + scenario.range_sigma * quantiles[2:5])
    residuals = (ranges[:, None] - distances) / scenario.range_sigma
    costs = {}
    for name, (loss, _) in kernels(residuals.ravel(), scenario).items():
        total = loss.reshape(residuals.shape).sum(axis=0)
        costs[name] = (total - total.min()) / np.ptp(total)
    return ranges, costs


@dataclass(frozen=True)
class Scan:
    """The ranges of one pose, one of which several landmarks explain.

    Attributes
    ----------
    position : (2,) of the pose, estimated, [m]
    landmarks : (K, 2) estimated, [m]
    ranges : (M,), [m]
    labels, sources : (M,) landmark that each range is labelled with, and came from
    wrong : share of wrong labels, estimated
    open : the range in question
    """

    position: np.ndarray
    landmarks: np.ndarray
    ranges: np.ndarray
    labels: np.ndarray
    sources: np.ndarray
    wrong: float
    open: int


def ambiguous(scenario: Scenario, p: float, seed: int) -> Scan:
    """The scan of a world with the range whose source is most open under EM."""
    conventions = PRESETS[READING]
    the_world = simulation.simulate(scenario, p, rng=np.random.default_rng(seed))
    log = the_world.log(conventions.x0_sigmas)
    found = em.estimate(log, conventions, "grid", exclusive=False, clutter=False)
    m = int(np.argmax(stats.entropy(found.responsibilities, axis=1)))
    here = np.flatnonzero(log.pose_of == log.pose_of[m])
    return Scan(
        found.poses[log.pose_of[m], :2], found.landmarks, log.ranges[here], log.label_of[here],
        the_world.source_of[here], found.shares.wrong, int(np.argmax(here == m)),
    )  # fmt: skip
