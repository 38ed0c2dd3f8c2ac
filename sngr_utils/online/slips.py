"""Steps of the odometry that are no longer trusted, and where the robot is then.

The estimator is not told that its wheels may slip. A scan of which most ranges contradict the
prediction raises the question; the posterior of its position, among known landmarks and under a
wide prior, answers it, and its evidence decides. Many starts come first, and nested sampling is
the referee where their weights are not sound.
"""

import numpy as np
from scipy import stats

from sngr_utils.online import data_association, localisation
from sngr_utils.online.belief import SLIP_SIGMA, Belief
from sngr_utils.robust import association
from sngr_utils.sampling.targets import place
from sngr_utils.slam import range_density

SLIP_ODDS = np.log(100.0)  # nats that a slip must gain: one step in a hundred slips
ROUGH = 3.0  # nats that a rough evidence may miss; within them it is computed well
STEP_LIMIT = stats.chi2.ppf(1 - 1e-4, 3)  # squared normalised error of a step that slipped


def find_robot(belief: Belief, by_nested: bool, *, rng: np.random.Generator) -> None:
    """Ask where the robot is, if that is open or its scan contradicts the predicted pose.

    Parameters
    ----------
    by_nested : have the referee; else what many starts say stands
    """
    data = belief.data
    t, known = data.n_poses - 1, np.isfinite(belief.landmarks[:, 0])
    scan = np.flatnonzero((data.pose_of == t) & known[data.label_of])
    if len(scan) < 3 or t < 2:
        return
    covariance = belief.covariance()
    found = belief.innovations(covariance)
    sigma = np.sqrt(np.trace(covariance.poses[-1][:2, :2]) / 2)
    fit = found.squared[scan, data.label_of[scan]] < data_association.GATE
    lost = sigma > data_association.VAGUE
    if not lost and np.mean(fit) >= 0.5:
        return
    m, k = (grid.ravel() for grid in np.meshgrid(scan, np.flatnonzero(known), indexing="ij"))
    prior = np.exp(association.log_prior(belief.log, belief.shares))[m, k]
    own = np.diag(covariance.landmarks).reshape(-1, 2).mean(axis=1)[k]
    evidence = place.Evidence(
        belief.landmarks[k], data.ranges[m], own + data.scenario.range_sigma**2, 1 - prior,
        data.ranges.max(), belief.poses[-1, :2], sigma if lost else SLIP_SIGMA,
    )  # fmt: skip
    given = found.squared[m, k], found.variances[m, k], 1 - prior, data.ranges.max()
    trusted = np.log(range_density.density(*given)).sum()
    if not lost and localisation.rough_evidence(evidence) - trusted < SLIP_ODDS - ROUGH:
        return
    belief.counts["position questions"] += 1
    cloud, sound = localisation.many_starts(evidence, rng=rng)
    if by_nested and not sound:
        belief.counts["position samples"] += 1
        cloud = localisation.sample(evidence, rng=rng)
    if not lost:
        if cloud.log_evidence - trusted < SLIP_ODDS:
            return
        belief.slipped.add(t - 1)
    best = localisation.modes(cloud, evidence)[0]
    if best.mass > localisation.ENOUGH_MASS:
        belief.move_newest(best.mean, belief.credit_fitting(m, k, best, evidence))


def doubt_steps(belief: Belief) -> None:
    """Trust no longer the steps that the whole estimate contradicts."""
    steps = [t for t in range(belief.data.n_poses - 1) if t not in belief.slipped]
    values = belief.smoother.values
    worst = [t for t in steps if 2 * belief.step(t).error(values) > STEP_LIMIT]
    if worst:
        belief.distrust(worst)
