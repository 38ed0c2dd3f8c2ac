"""Steps of the odometry that are no longer trusted, and where the robot is then.

The estimator is not told that its wheels may slip. A scan of which half the ranges contradict
the prediction raises the question. The answers are hypotheses: the newest step has slipped, or the
robot has turned a step before, or both, or the last slip led elsewhere. Each is localised anew in
the known map, by all scans since, and the evidence decides.
"""

import numpy as np
from scipy import stats

from sngr_utils.online import data_association, localisation, relocalisation
from sngr_utils.online.belief import TURNED, Belief
from sngr_utils.robust import association
from sngr_utils.sampling import importance
from sngr_utils.sampling.targets import place
from sngr_utils.slam import selected_inverse
from sngr_utils.world.dead_reckoning import relative_motion, wrap_angle
from sngr_utils.world.log import NO_LABEL

SLIP_ODDS = np.log(100.0)  # nats that a slip must gain: one step in a hundred slips
FAR = 0.5  # times the longest range, sigma of a position after a slip
RECENT = 8  # poses for which the place after a slip may be put in question
SPARE = 2  # ranges that a slip must explain beyond what it can choose
STEP_LIMIT = stats.chi2.ppf(1 - 1e-4, 3)  # squared normalised error of a step that slipped


def find_robot(belief: Belief, by_nested: bool, *, rng: np.random.Generator) -> None:
    """Ask where the robot is, if that is open or its scan contradicts the predicted pose.

    Parameters
    ----------
    by_nested : nested sampling where many starts are not sound; else what they say stands
    """
    log, known = belief.log, belief.present & ~belief.in_doubt
    scan = belief.newest
    label_known = (log.label_of[scan] != NO_LABEL) & known[log.label_of[scan]]
    scan = scan[label_known]
    if len(scan) < 3 or len(belief.poses) < 3:
        return
    covariance = belief.covariance(anchored=True)
    if _lost(belief, covariance):
        _find_lost(belief, scan, covariance, by_nested, rng=rng)
    elif _contradicted(belief, belief.innovations(anchored=True), scan):
        _find_slipped(belief, covariance)


def _find_lost(
    belief: Belief, scan: np.ndarray, covariance: selected_inverse.ChainCovariance,
    by_nested: bool, *, rng: np.random.Generator,
) -> None:  # fmt: skip
    """The newest position from its scan alone, where the prediction tells no landmarks apart."""
    m, k, evidence = _scan_evidence(belief, scan, covariance)
    belief.counts["position questions"] += 1
    try:
        cloud, sound = localisation.many_starts(evidence, rng=rng)
    except importance.NoModeError:
        return
    if by_nested and not sound:
        belief.counts["position samples"] += 1
        cloud = localisation.sample(evidence, rng=rng)
    best = localisation.modes(cloud, evidence)[0]
    if best.mass > localisation.ENOUGH_MASS:
        tail = belief.poses[_last_good(belief) + 1 :].copy()
        tail[:, :2] += best.mean - tail[-1, :2]
        belief.move_newest(tail, belief.assign_fitting(m, k, best, evidence))


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
        belief.longest, belief.poses[-1, :2], min(_spread(covariance), belief.longest),
    )  # fmt: skip


def _find_slipped(belief: Belief, covariance: selected_inverse.ChainCovariance) -> None:
    """Move the newest poses where the likeliest hypothesis of a slip has them, if there is one."""
    last, good = len(belief.poses) - 1, _last_good(belief)
    if _explained(belief, last - 1, covariance):
        return
    recent = [s for s in np.flatnonzero(belief.slipped) if s >= last - RECENT]
    steps = dict.fromkeys(recent, 0.0) | {
        s: SLIP_ODDS for s in (good - 1, good) if s >= 0 and s not in recent
    }
    belief.counts["position questions"] += 1
    best, choice = 0.0, None
    for step, odds in steps.items():
        part = _stretch(belief, step, covariance)
        sigmas = np.sqrt(np.diag(covariance.poses[step + 1]))
        mean = belief.poses[step + 1]
        trusted = relocalisation.refined(part, mean, mean, sigmas).log_evidence
        far = np.full(2, FAR * belief.longest)
        for free in (np.array([True, False]), np.array([False, True]), np.array([True, True])):
            if free.all() and step == last - 1:
                continue  # one scan does not tell a heading
            wide = np.append(far if free[0] else sigmas[:2], TURNED if free[1] else sigmas[2])
            found = relocalisation.search(part, mean, wide, ~free, last - step - 1)
            gain = found.log_evidence - trusted - odds - SLIP_ODDS * free.all()
            weights = relocalisation.sources(part, found.pose)
            explained = np.sum(weights[:, :-1].max(axis=1) > data_association.RESOLVED)
            if gain > best and explained >= 2 * free[0] + free[1] + SPARE:
                best, choice = gain, (step, bool(free[1]), found.pose, weights)
    if choice is not None:
        _believe(belief, *choice)


def _explained(belief: Belief, step: int, covariance: selected_inverse.ChainCovariance) -> bool:
    """Does the pose after a step, near its prediction, explain all ranges since, by any labels?"""
    sigmas = np.sqrt(np.diag(covariance.poses[step + 1]))
    part = _stretch(belief, step, covariance)
    return relocalisation.credited(part, belief.poses[step + 1], sigmas) == 1.0


def _stretch(belief: Belief, step: int, covariance: selected_inverse.ChainCovariance):
    """What was measured since a step, with the known map."""
    unknown = ~belief.present | belief.in_doubt
    landmarks = np.where(unknown[:, None], np.nan, belief.landmarks)
    spread = np.diag(covariance.landmarks).reshape(-1, 2).mean(axis=1)
    part = belief.log.after(step + 1)
    return relocalisation.stretch(part, belief.poses[step + 1 :], landmarks, spread, belief.shares)


def _believe(
    belief: Belief, step: int, turned: bool, first: np.ndarray, weights: np.ndarray
) -> None:
    """A step has slipped, and none after it; the poses behind it are elsewhere."""
    belief.trust(np.flatnonzero(belief.slipped[step + 1 :]) + step + 1)
    belief.distrust(step, turned)
    tail = relocalisation.moved(belief.poses[step + 1 :], first)
    known = np.append(np.flatnonzero(belief.present & ~belief.in_doubt), data_association.DROPPED)
    fresh = known[np.argmax(weights, axis=1)]
    fresh[weights.max(axis=1) <= data_association.RESOLVED] = data_association.DROPPED
    used = belief.assignment.used.copy()
    used[belief.log.pose_of > step] = fresh
    belief.move_newest(tail, used)


def _contradicted(belief: Belief, found: data_association.Innovations, scan: np.ndarray) -> bool:
    """Do half of a scan's ranges miss the landmark of their label?"""
    return np.mean(found.squared[scan, belief.log.label_of[scan]] < data_association.GATE) <= 0.5


def _last_good(belief: Belief) -> int:
    """The last pose before the newest that uses at least half of its ranges; else the one before.

    What slipped, slipped after it.
    """
    for t in range(len(belief.poses) - 2, -1, -1):
        used = belief.assignment.used[belief.log.pose_of == t]
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
