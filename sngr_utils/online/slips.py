"""Steps of the odometry that are no longer trusted, and where the robot is then.

The estimator is not told that its wheels may slip. A scan of which most ranges contradict the
prediction raises the question; the posterior of its position, among known landmarks and under a
wide prior, answers it, and its evidence decides. Many starts come first, and nested sampling is
the referee where their weights are not sound.
"""

from dataclasses import replace

import numpy as np
from scipy import stats

from sngr_utils.online import data_association, localisation
from sngr_utils.online.belief import Belief
from sngr_utils.robust import association
from sngr_utils.sampling import importance
from sngr_utils.sampling.targets import place
from sngr_utils.slam import range_density, selected_inverse
from sngr_utils.world.dead_reckoning import relative_motion, wrap_angle
from sngr_utils.world.log import NO_LABEL

SLIP_ODDS = np.log(100.0)  # nats that a slip must gain: one step in a hundred slips
ROUGH = 3.0  # nats that a rough evidence may miss; within them it is computed well
SIZES = 3  # of a slip that are tried
NO_NOISE = 10.0  # odometry sigmas, the smallest of them
STEP_LIMIT = stats.chi2.ppf(1 - 1e-4, 3)  # squared normalised error of a step that slipped


def find_robot(belief: Belief, by_nested: bool, *, rng: np.random.Generator) -> None:
    """Ask where the robot is, if that is open or its scan contradicts the predicted pose.

    Where the step before has slipped already, what contradicts the prediction is taken for the
    heading after it, which a slip of the position alone leaves trusted.

    Parameters
    ----------
    by_nested : have the referee; else what many starts say stands
    """
    log, known = belief.log, belief.present & ~belief.in_doubt
    scan = belief.newest
    label_known = (log.label_of[scan] != NO_LABEL) & known[log.label_of[scan]]
    scan = scan[label_known]
    if len(scan) < 3 or len(belief.poses) < 3:
        return
    covariance = belief.covariance(anchored=True)
    found = belief.innovations(covariance)
    lost = _lost(belief, covariance)
    if not lost and not _contradicted(belief, found, scan):
        return
    step = _last_good(belief)
    if not lost and step > 0 and belief.slipped[step - 1]:
        belief.distrust(step - 1, turned=True)
        covariance = belief.covariance(anchored=True)
        found, lost = belief.innovations(covariance), _lost(belief, covariance)
    m, k, evidence = _scan_evidence(belief, scan, covariance)
    given = found.squared[m, k], found.variances[m, k], evidence.wrong, belief.longest
    trusted = np.log(range_density.density(*given)).sum()
    if lost:
        evidence = replace(evidence, sigma=min(_spread(covariance), belief.longest))
    else:
        evidence, rough = _likeliest_size(belief, evidence)
        if rough - trusted < SLIP_ODDS - ROUGH:
            return
    belief.counts["position questions"] += 1
    try:
        cloud, sound = localisation.many_starts(evidence, rng=rng)
    except importance.NoModeError:
        return
    if by_nested and not sound:
        belief.counts["position samples"] += 1
        cloud = localisation.sample(evidence, rng=rng)
    if not lost:
        if cloud.log_evidence - np.log(SIZES) - trusted < SLIP_ODDS:
            return
        belief.distrust(step, turned=False)
    best = localisation.modes(cloud, evidence)[0]
    if best.mass > localisation.ENOUGH_MASS:
        belief.move_newest(best.mean, step + 1, belief.credit_fitting(m, k, best, evidence))


def _scan_evidence(
    belief: Belief, scan: np.ndarray, covariance: selected_inverse.ChainCovariance
) -> tuple[np.ndarray, np.ndarray, place.Evidence]:
    """Every range of a scan with every landmark that is in the map, and what they say together."""
    log, known = belief.log, np.flatnonzero(belief.present & ~belief.in_doubt)
    m, k = (g.ravel() for g in np.meshgrid(scan, known, indexing="ij"))
    prior = np.exp(association.log_prior(log, belief.shares))[m, k]
    own = np.diag(covariance.landmarks).reshape(-1, 2).mean(axis=1)[k]
    return m, k, place.Evidence(
        belief.landmarks[k], log.ranges[m], own + log.range_sigmas[m] ** 2, 1 - prior,
        belief.longest, belief.poses[-1, :2], belief.longest,
    )  # fmt: skip


def _likeliest_size(belief: Belief, evidence: place.Evidence) -> tuple[place.Evidence, float]:
    """The evidence under the size of a slip that explains it best, and its log, roughly, [nats].

    Sizes go from what is no noise any more to the longest range, by equal factors.
    """
    steps = np.trace(belief.told[:, :2, :2], axis1=1, axis2=2) / 2
    least = min(NO_NOISE * np.sqrt(np.median(steps)), belief.longest)
    sizes = [replace(evidence, sigma=s) for s in np.geomspace(least, belief.longest, SIZES)]
    rough = [localisation.rough_evidence(size) for size in sizes]
    best = int(np.argmax(rough))
    return sizes[best], rough[best] - np.log(SIZES)


def _contradicted(belief: Belief, found: data_association.Innovations, scan: np.ndarray) -> bool:
    """Do most ranges of a scan miss the landmark of their label?"""
    return np.mean(found.squared[scan, belief.log.label_of[scan]] < data_association.GATE) < 0.5


def _last_good(belief: Belief) -> int:
    """The last pose before the newest that uses at least half of its ranges; else the one before.

    What slipped, slipped after it.
    """
    for t in range(len(belief.poses) - 2, -1, -1):
        used = belief.credit.used[belief.log.pose_of == t]
        if len(used) and np.mean(used != data_association.DROPPED) >= 0.5:
            return t
    return len(belief.poses) - 2


def _spread(covariance: selected_inverse.ChainCovariance) -> float:
    """Sigma of the newest position, [m]."""
    return float(np.sqrt(np.trace(covariance.poses[-1][:2, :2]) / 2))


def _lost(belief: Belief, covariance: selected_inverse.ChainCovariance) -> bool:
    """Is the newest position so vague that it tells no landmarks apart?"""
    sigmas = belief.log.range_sigmas[belief.newest]
    return _spread(covariance) > data_association.VAGUE * np.median(sigmas)


def doubt_steps(belief: Belief) -> None:
    """Trust no longer the steps that the whole estimate contradicts."""
    missed = relative_motion(belief.poses) - belief.log.odometry
    missed[:, 2] = wrap_angle(missed[:, 2])
    squared = np.einsum("ti,tij,tj->t", missed, np.linalg.inv(belief.told), missed)
    worst = np.flatnonzero((squared > STEP_LIMIT) & ~belief.slipped)
    if len(worst):
        belief.distrust(worst, turned=False)
        belief.solve()
