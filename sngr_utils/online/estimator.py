"""Association-aware SNGR, online: at every pose it knows what came before, and nothing else.

One step (`Online.step`): predict the new pose, and doubt the odometry if the scan does; credit
the ranges; start landmarks whose place has become known; credit all earlier ranges anew; start
anew what went wrong. Non-Gaussian inference is asked two things only: where a landmark is, and
where the robot is when its scan contradicts the odometry. Many starts answer, and nested sampling
is the referee.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sngr_utils.online import data_association, slips
from sngr_utils.online.belief import P_PRIOR, Belief
from sngr_utils.online.data_association import DROPPED
from sngr_utils.online.landmarks import drop_landmarks, start_landmarks
from sngr_utils.robust import association, em, louis_covariance
from sngr_utils.settings import Checked, Probability
from sngr_utils.slam import chain_problem, chain_solver, landmark_starts
from sngr_utils.slam.conventions import Conventions
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.simulation import World

SWEEPS = 3  # over all ranges, at most, per step
SETTLING = 3  # updates without new factors at the very end
PATIENCE = 5  # poses between two looks at all ranges
MOST_LOST = 0.1  # share of all ranges that may be credited to none
BETTER = 1.0  # nats that an estimate of EM must gain to be adopted


class Settings(Checked):
    """What can be switched off, to see what it is worth; the defaults are the method.

    nested : nested sampling is the referee where many starts are not sound; else there is none
    delayed : a landmark waits until its posterior has one mode; else it starts by least squares
        on its first three poses, as in the paper
    exclusive : no two ranges of a scan come from the same landmark
    swap : a range may be credited to another landmark than its label's, not only dropped
    sweep : earlier ranges are credited anew at every step
    restart : in trouble, EM over all data so far is tried, and adopted where it is likelier
    doubt_odometry : a scan may overrule the odometry
    soft : what is read out at the end, estimate and covariance, admits that associations are
        uncertain; else those of the graph, which takes them for certain
    p : probability of a wrong label; None estimates it
    """

    nested: bool = True
    delayed: bool = True
    exclusive: bool = True
    swap: bool = True
    sweep: bool = True
    restart: bool = True
    doubt_odometry: bool = True
    soft: bool = True
    p: Probability | None = None


@dataclass(frozen=True)
class OnlineEstimate:
    """What the online estimator holds after the last pose.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN for one that is not started
    graph_poses : (T, 3) those of iSAM2's graph, which takes the credits for certain
    used : (M,) int, landmark each range is credited to, -1 for none
    position_covariances : (T, 2, 2) in the world frame, [m^2]
    p : share of wrong labels, estimated
    filtered : (T, 3) each pose as estimated when it was the newest, [m, m, rad]
    counts : how often: "landmark questions" and "position questions" (put to many starts, by
        reason), "landmark samples" and "position samples" (referred to nested sampling), "mirror
        waits" (landmarks left to wait by the mirror test, without a run),
        "landmark restarts", "batch trials" and "batch restarts" (EM tried and adopted), "slips",
        and of all ranges at the end "swapped" and "dropped"
    """

    poses: np.ndarray
    landmarks: np.ndarray
    graph_poses: np.ndarray
    used: np.ndarray
    position_covariances: np.ndarray
    p: float
    filtered: np.ndarray
    counts: Counter


def run(
    world: World,
    conventions: Conventions,
    settings: Settings,
    watch: Callable[[Belief], None] | None = None,
    *,
    rng: np.random.Generator,
) -> OnlineEstimate:
    """Feed a world to the estimator pose by pose.

    Parameters
    ----------
    watch : called with the belief after every step, e.g. to draw it
    """
    online = Online(world.first(1), conventions, settings, rng=rng)
    filtered = [online.belief.poses[-1]]
    for t in range(1, world.n_poses):
        online.step(world.first(t + 1))
        filtered.append(online.belief.poses[-1])
        if watch:
            watch(online.belief)
    return online.result(np.array(filtered))


class Online:
    """The estimator: a belief, and the decisions of one step."""

    def __init__(
        self,
        data: World,
        conventions: Conventions,
        settings: Settings,
        *,
        rng: np.random.Generator,
    ) -> None:
        self.settings, self.rng = settings, rng
        self.belief = Belief(data, conventions)
        if settings.p is not None:
            self.belief.p = settings.p

    def step(self, data: World) -> None:
        """One pose more; `data` is all that was measured up to it."""
        belief, settings = self.belief, self.settings
        belief.predict(data)
        if settings.doubt_odometry:
            slips.find_robot(belief, settings.nested, rng=self.rng)
        belief.confirm()
        self._credit(newest_only=not settings.sweep)
        start_landmarks(belief, settings.nested, settings.delayed, rng=self.rng)
        if settings.sweep:
            for _ in range(SWEEPS):
                if not self._credit():
                    break
        if settings.doubt_odometry:
            slips.doubt_steps(belief)
        drop_landmarks(belief)
        if settings.restart and self._in_trouble():
            self._restart()

    def _credit(self, newest_only: bool = False) -> bool:
        """Credit the ranges anew; has anything changed?"""
        belief, settings = self.belief, self.settings
        if np.isnan(belief.landmarks).all():
            return False
        found = belief.innovations(belief.covariance())
        credit = data_association.decide(
            belief.log, found, belief.credit.used, belief.shares, settings.exclusive,
            settings.swap,
        )  # fmt: skip
        if settings.p is None:
            judged = np.isfinite(belief.landmarks[belief.data.label_of, 0])
            belief.p = association.estimate_shares(
                belief.log.keep(judged), credit.weights[judged], belief.landmarks, belief.shares,
                P_PRIOR,
            ).wrong  # fmt: skip
        used = credit.used
        if newest_only:
            newest = belief.data.pose_of == belief.data.n_poses - 1
            used = np.where(newest, used, belief.credit.used)
        belief.credit = data_association.Credit(belief.credit.used, credit.weights)
        return belief.use(used)

    def _in_trouble(self) -> bool:
        """Has the newest step slipped, its scan lost half of its ranges, or all of them too many?

        The last is asked every `PATIENCE` poses only, for EM costs as much as the rest of a step.
        """
        belief, t = self.belief, self.belief.data.n_poses - 1
        lost = belief.credit.used == DROPPED
        known = np.isfinite(belief.landmarks).all()
        newest_lost = known and np.mean(lost[belief.data.pose_of == t]) >= 0.5
        too_many = t % PATIENCE == 0 and t > PATIENCE and np.mean(lost) > MOST_LOST
        return t - 1 in belief.slipped or newest_lost or too_many

    def _restart(self) -> None:
        """EM over all data so far, from where we are and from nothing; the best one is kept.

        Source: `em.fit`.
        """
        belief, settings, data = self.belief, self.settings, self.belief.data
        belief.counts["batch trials"] += 1
        blind = dead_reckoning(data.x0_mean, data.odometry)
        starts = [(belief.poses, belief.landmarks)] if np.isfinite(belief.landmarks).all() else []
        starts.append((blind, landmark_starts.start_landmarks(belief.log, blind, "grid")))
        found, least = None, belief.cost(belief.poses, belief.landmarks) - BETTER
        for start in starts:
            fit = em.fit(
                belief.log, belief.conventions, start, exclusive=settings.exclusive, clutter=False
            )
            cost = belief.cost(fit.poses, fit.landmarks)
            if cost < least:
                found, least = fit, cost
        if found is None:
            return
        belief.counts["batch restarts"] += 1
        best = np.argmax(found.responsibilities, axis=1)
        good = found.responsibilities.max(axis=1) > data_association.RESOLVED
        if not settings.swap:
            good &= best == data.label_of
        belief.rebuild(found.poses, found.landmarks, np.where(good, best, DROPPED))

    def result(self, filtered: np.ndarray) -> OnlineEstimate:
        """The estimate, with the covariance of its positions."""
        belief = self.belief
        belief.smoother.settle(SETTLING)
        belief.refresh()
        data, used = belief.data, belief.credit.used
        start = belief.poses, belief.landmarks
        if self.settings.soft:
            # weak priors where the landmarks are by now: their first places still pulled a little
            found = em.fit(
                belief.log, belief.conventions, start, exclusive=self.settings.exclusive,
                clutter=False, widest=1.0,
            )  # fmt: skip
            poses, landmarks = found.poses, found.landmarks
            covariances = found.position_covariances
        else:
            poses, landmarks = start
            sigma = belief.conventions.landmark_prior_sigma
            chain = chain_problem.of_log(belief.log, landmarks, sigma)
            covariances = louis_covariance.position_covariances(
                chain, chain_solver.state_of(chain, *start), np.eye(data.n_landmarks + 1)[used]
            )
        belief.counts["slips"] = len(belief.slipped)
        belief.counts["dropped"] = int(np.sum(used == DROPPED))
        belief.counts["swapped"] = int(np.sum((used != DROPPED) & (used != data.label_of)))
        return OnlineEstimate(
            poses, landmarks, belief.poses, used, covariances, belief.p, filtered, belief.counts
        )
