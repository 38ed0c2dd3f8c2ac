"""Association-aware SNGR, online: at every pose it knows what came before, and nothing else.

One step (`Online.step`): predict the new pose, and doubt the odometry if the scan does; assign
the ranges; start landmarks whose place has become known; assign all earlier ranges anew; start
anew what went wrong. Non-Gaussian inference is asked where a landmark is, and where the robot is
when its prediction tells no landmarks apart: many starts, and nested sampling where their
importance weights are unreliable. More than 300 lines: the settings, the step and the result in
one place.
"""

import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sngr_utils.online import calibration, data_association, other_sources, rivals, slips
from sngr_utils.online.belief import LOOSE, PRIOR, WINDOW, Belief, cost
from sngr_utils.online.data_association import DROPPED
from sngr_utils.online.landmarks import (
    POSES_NEEDED,
    drop_landmarks,
    start_landmarks,
    turn_over,
)
from sngr_utils.robust import (
    association,
    diagnosis,
    em,
    louis_covariance,
    mirrors,
    naming,
)
from sngr_utils.robust.association import Shares
from sngr_utils.robust.diagnosis import Diagnosis, DoubtWarning
from sngr_utils.settings import Checked, Probability
from sngr_utils.slam import chain_problem, chain_solver
from sngr_utils.slam.conventions import Conventions
from sngr_utils.world.log import Log, LogWarning, Measurements

FIRST_LOOK = 5  # poses, before which too few ranges tell whether too many are lost
SWEEPS = 3  # over all ranges, at most, per step
MOST_LOST = 0.1  # share of all ranges that may be assigned to none
MOST_BEYOND = 0.25  # share of the ranges that are more than one for each landmark of their scan
P_PRIOR = (2.0, 8.0)  # wrong and right labels that count as seen before the first


class Settings(Checked):
    """What can be switched off, to see what it is worth; the defaults are the method.

    nested : nested sampling where importance sampling from many starts is unreliable
    delayed : a landmark is initialised only when its posterior is unimodal; else by least squares
        on its first three poses, as in the paper
    exclusive : no two ranges of a scan come from the same landmark
    swap : a range may be assigned to another landmark than its label's, not only dropped
    sweep : earlier ranges are assigned anew at every step
    restart : in trouble, EM over all data so far is tried, and adopted where it is likelier; at
        the end other estimates of all data are. Without it there is nothing that the result is
        held against but mirror images
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
    poses : (T, 3), [m, m, rad]; if `Settings.soft`, the mean over the sides that are open
    landmarks : (K, 2), [m]; on the likeliest side; NaN for one that is not started
    landmark_covariances : (K, 2, 2), [m^2]
    in_doubt : (K,) bool, landmarks whose place is open, or their side (`mirrors.choices`), or
        their name (`naming`), or whether they are there (`rivals.dispensable`)
    graph_poses : (T, 3) those that take the assignments for certain
    used : (M,) int, landmark each range is assigned to, -1 for none
    position_covariances : (T, 2, 2) in the world frame, [m^2]
    calibration : (2,) range scale, and offset [m]; as the log has them where they are known
    p, clutter : shares of wrong labels and of ranges from no landmark, estimated
    filtered : (T, 3) each pose as estimated when it was the newest, [m, m, rad]
    counts : how often: "landmark questions" and "position questions" (put to many starts, by
        reason), "landmark samples" and "position samples" (drawn by nested sampling), "mirror
        waits" (initialisation delayed by the mirror test, without a run),
        "landmark restarts", "batch trials" and "batch restarts" (EM tried and adopted), "slips",
        and of all ranges at the end "swapped" and "dropped"
    diagnosis : what there is to doubt, see `diagnosis.Diagnosis`
    cost : minus the log evidence, see `rivals.rival`, [nats]
    """

    poses: np.ndarray
    landmarks: np.ndarray
    landmark_covariances: np.ndarray
    in_doubt: np.ndarray
    graph_poses: np.ndarray
    used: np.ndarray
    position_covariances: np.ndarray
    calibration: np.ndarray
    p: float
    clutter: float
    filtered: np.ndarray
    counts: Counter
    diagnosis: Diagnosis
    cost: float


def run(
    log: Log,
    conventions: Conventions,
    settings: Settings,
    watch: Callable[[Belief], None] | None = None,
    *,
    rng: np.random.Generator,
) -> OnlineEstimate:
    """Feed a log to the estimator pose by pose.

    Parameters
    ----------
    watch : called with the belief after every step, e.g. to draw it

    Warns
    -----
    DoubtWarning, LogWarning : see `Online.result`
    """
    online = Online(log.first(1), conventions, settings, rng=rng)
    for t in range(1, log.n_poses):
        online.take(of_pose(log, t))
        if watch:
            watch(online.belief)
    return online.result()


def of_pose(log: Log, t: int) -> Log:
    """Poses t-1 and t of a log, with the ranges of the second; it needs no second check."""
    both = log.first(t + 1).after(t - 1)
    return both.keep(both.pose_of == 1)


def _warn_of_repeats(log: Log) -> None:
    """Ranges beyond one for each landmark, scan by scan, are from none: say so if they are many."""
    beyond = np.maximum(np.bincount(log.pose_of) - log.n_landmarks, 0).sum()
    if beyond > MOST_BEYOND * len(log.ranges):
        warnings.warn(
            f"{beyond} of {len(log.ranges)} ranges are more than one for each landmark of a scan: "
            "if a landmark may be measured more than once in a scan, set exclusive=False",
            LogWarning,
            stacklevel=4,
        )


class Online:
    """The estimator: a belief, and the decisions of one step.

    Parameters
    ----------
    first : log of the first pose alone
    """

    def __init__(
        self,
        first: Log,
        conventions: Conventions,
        settings: Settings,
        *,
        rng: np.random.Generator,
    ) -> None:
        self.conventions, self.settings, self.rng = conventions, settings, rng
        self.calibration, self.next_look = calibration.of(first), calibration.FIRST
        self.belief = Belief(self.calibration.corrected(first))
        self.filtered, self.measured = [self.belief.poses[-1]], [first.ranges]
        self.last_batch = 0
        if settings.p is not None:
            self.belief.shares = PRIOR._replace(wrong=settings.p)

    def step(self, measurements: Measurements) -> None:
        """One pose more, and what was measured at it.

        Raises
        ------
        ValueError : naming field and row, see `Log`
        """
        self.take(self.belief.log.following(measurements))

    def take(self, new: Log) -> None:
        """`step`, `new` being the log of the pose before and of the next one, with its ranges."""
        belief, settings = self.belief, self.settings
        belief.predict(self.calibration.corrected(new))
        self.measured.append(new.ranges)
        turn_over(belief)
        if settings.doubt_odometry:
            slips.find_robot(belief, settings.nested, rng=self.rng)
        belief.solve()
        self._assign(newest_only=not settings.sweep)
        start_landmarks(belief, settings.nested, settings.delayed, rng=self.rng)
        if settings.sweep:
            for _ in range(SWEEPS):
                before = belief.assignment.used
                self._assign()
                if np.array_equal(before, belief.assignment.used):
                    break
        if settings.doubt_odometry:
            slips.doubt_steps(belief)
        drop_landmarks(belief)
        if settings.restart and self._in_trouble():
            self._restart()
        if self.calibration.open and belief.n_poses >= self.next_look and belief.present.all():
            self._calibrate()
        self.filtered.append(self._newest() if settings.soft else belief.poses[-1])

    def _newest(self) -> np.ndarray:
        """(3,) newest pose, the mean over the sides that the window leaves open, [m, m, rad].

        Up to 64 estimates of the window, as long as six landmarks are in doubt.
        """
        belief = self.belief
        asked = belief.in_doubt & belief.present
        if not asked.any():
            return belief.poses[-1]
        chain = belief.chain(belief.landmarks)
        others = mirrors.choices(chain, belief.poses, belief.landmarks, asked, belief.settled)
        return mirrors.over_sides(belief.poses, others, len(asked)).poses[-1]

    def _assign(self, newest_only: bool = False) -> None:
        """Assign the ranges anew."""
        belief, settings = self.belief, self.settings
        if not belief.present.any() or len(belief.log.ranges) == 0:
            return
        found = belief.innovations()
        assignment = data_association.decide(
            belief.log,
            found,
            belief.assignment.used,
            belief.shares,
            settings.exclusive,
            settings.swap,
        )
        belief.shares = self._shares(assignment.weights)
        used = assignment.used
        if newest_only:
            used = belief.assignment.used.copy()
            used[belief.newest] = assignment.used[belief.newest]
        belief.assignment = data_association.Assignment(belief.assignment.used, assignment.weights)
        belief.use(used)

    def _shares(self, weights: np.ndarray) -> Shares:
        """Shares of wrong labels and of clutter, from ranges labelled with what is in the map."""
        belief = self.belief
        judged = (belief.log.label_of >= 0) & belief.present[belief.log.label_of]
        log = belief.log if judged.all() else belief.log.keep(judged)
        shares = association.estimate_shares(
            log, weights[judged], belief.landmarks, belief.shares, P_PRIOR
        )
        return shares if self.settings.p is None else shares._replace(wrong=self.settings.p)

    def _in_trouble(self) -> bool:
        """Has the newest step slipped, or are half of its ranges lost, or too many of all?"""
        belief, t = self.belief, self.belief.n_poses - 1
        if t > 2 * WINDOW and t < calibration.MORE * self.last_batch:
            return False
        lost = belief.assignment.used == DROPPED
        scan = lost[belief.newest]
        newest_lost = belief.present.all() and len(scan) > 0 and np.mean(scan) >= 0.5
        expected = MOST_LOST + belief.shares.clutter
        too_many = t > FIRST_LOOK and len(lost) and np.mean(lost) > expected
        return bool(belief.slipped[-1] or newest_lost or too_many)

    def _restart(self) -> None:
        """EM over all data so far, from where we are and from nothing, and without the slips.

        The best one is kept, see `rivals.from_nothing`.
        """
        belief = self.belief
        belief.counts["batch trials"] += 1
        self.last_batch = belief.n_poses
        log, told, poses, _ = belief.whole()
        ours = cost(log, poses, belief.landmarks, belief.shares) + rivals.price_of_slips(log, told)
        found = rivals.from_nothing(log, told, self._fit, poses, belief.landmarks)
        best = min(found, key=lambda one: one.cost)
        if best.cost >= ours - rivals.BETTER:
            return
        belief.counts["batch restarts"] += 1
        self._adopt(best.log, told, best.found)
        if belief.n_poses > 2 * WINDOW:
            belief.shorten()

    def _calibrate(self) -> None:
        """Range scale and offset from all data so far, poses and landmarks along with them."""
        belief = self.belief
        self.next_look = calibration.MORE * belief.n_poses
        log, told, poses, _ = belief.whole()
        log = self.calibration.uncut(log, np.concatenate(self.measured))
        found = self._fit(self.calibration.opened(log), (poses, belief.landmarks), 1.0)
        left = calibration.of(log).after(found.calibration)
        if not left.scale > 0:
            return
        corrected, stretched = left.corrected(log), len(log.ranges) * np.log(left.scale)
        least = cost(log, poses, belief.landmarks, belief.shares) + rivals.BETTER
        if not cost(corrected, found.poses, found.landmarks, found.shares) + stretched <= least:
            return
        self.calibration = self.calibration.after(found.calibration)
        self._adopt(corrected, told, found)
        if belief.n_poses > 2 * WINDOW:
            belief.shorten()

    def _fit(self, log: Log, start: tuple[np.ndarray, np.ndarray], widest: float):
        """EM over a log, see `rivals.by_em`."""
        return rivals.by_em(log, self.conventions, start, widest, self.settings.exclusive)

    def _adopt(self, log: Log, told: np.ndarray, found: em.SoftEstimate) -> None:
        """Believe an estimate of the whole; a landmark placed from few poses is not initialised."""
        best = np.argmax(found.weights, axis=1)
        good = (best < log.n_landmarks) & (found.weights.max(axis=1) > data_association.RESOLVED)
        if not self.settings.swap:
            good &= best == log.label_of
        used, places = np.where(good, best, DROPPED), found.landmarks.copy()
        for k in range(log.n_landmarks):
            n_seen = len(np.unique(log.pose_of[used == k]))
            if n_seen < POSES_NEEDED and not log.surveyed[k]:
                places[k], used[used == k] = np.nan, DROPPED
        self.belief.adopt(log, told, found.poses, places, used)
        self.belief.in_doubt[:] = True  # until the mirror images have been tried
        turn_over(self.belief)

    def result(self) -> OnlineEstimate:
        """The estimate, with its uncertainty, and what there is to doubt.

        Warns
        -----
        DoubtWarning : it may be wrong, and why
        LogWarning : scans have so many ranges that `exclusive` credits many of them to nothing
        """
        belief = self.belief
        if self.settings.exclusive:
            _warn_of_repeats(belief.whole()[0])
        if self.calibration.open and belief.present.any():
            self._calibrate()
        graph_poses = belief.whole()[2]
        best, gap = self._stand_against_rivals()
        ours, (log, told, poses, used) = best.found, belief.whole()
        calibrated, cost_of_it, asked = self.calibration, best.cost, log
        if calibrated.open and belief.present.any():
            log = calibrated.uncut(log, np.concatenate(self.measured))
            asked = calibrated.opened(log)
            ours = self._fit(asked, (poses, belief.landmarks), 1.0)
            calibrated = calibrated.after(ours.calibration)
            log = calibration.of(log).after(ours.calibration).corrected(log)
            cost_of_it = rivals.rival(log, told, ours).cost
            cost_of_it += len(log.ranges) * np.log(calibrated.scale)  # of ranges as measured
            belief.in_doubt |= mirrors.elsewhere(best.found, ours)
        landmarks = ours.landmarks
        either = mirrors.over_sides(ours.poses, mirrors.turned(ours), log.n_landmarks)
        if self.settings.soft:
            poses, covariances = either.poses, ours.position_covariances + either.spread
        else:
            poses, landmarks = graph_poses, belief.landmarks
            chain = chain_problem.of_log(log, landmarks, LOOSE * belief.longest)
            covariances = louis_covariance.position_covariances(
                chain, chain_solver.state_of(chain, poses, landmarks),
                np.eye(log.n_landmarks + 1)[used],
            )  # fmt: skip
        wrong = ours.shares.wrong if self.settings.p is None else self.settings.p
        blocks = belief.covariance().landmarks.reshape(log.n_landmarks, 2, log.n_landmarks, 2)
        own = np.einsum("kikj->kij", blocks)
        in_doubt = belief.in_doubt | ~belief.present | self._vague() | either.open
        in_doubt |= naming.names_open(log, ours) | naming.exchanged(log, ours)
        in_doubt |= rivals.dispensable(log, ours)
        belief.counts["slips"] = int(belief.slipped.sum())
        belief.counts["dropped"] = int(np.sum(used == DROPPED))
        belief.counts["swapped"] = int(np.sum((used != DROPPED) & (used != log.label_of)))
        doubts = diagnosis.diagnose(asked, ours, gap, lambda *of: self._fit(*of, 1.0))
        found = OnlineEstimate(
            poses, landmarks, own, in_doubt, graph_poses, used,
            covariances, np.array([calibrated.scale, calibrated.offset]),
            wrong, ours.shares.clutter, np.array(self.filtered),
            belief.counts, doubts, cost_of_it,
        )  # fmt: skip
        if found.diagnosis.doubtful:
            warnings.warn("; ".join(found.diagnosis.reasons), DoubtWarning, stacklevel=3)
        return found

    def _stand_against_rivals(self) -> tuple[rivals.Rival, float]:
        """Adopt the likeliest estimate of all data; by how much the next one is worse, [nats]."""
        belief, settings = self.belief, self.settings
        log, told, poses, _ = belief.whole()
        ours = rivals.rival(log, told, self._fit(log, (poses, belief.landmarks), 1.0))
        by_slips = settings.restart and settings.doubt_odometry
        before, others = ours, []
        if settings.restart:
            others = rivals.against(log, told, ours.found, self._fit, by_slips)
            before = self._likelier(ours, others + rivals.grown(log, told, self._fit))
        if by_slips:
            before, made = rivals.reconsidered(before, told, self._fit)
            others += made
        sides = rivals.on_other_sides(told, before, self._fit)
        best = self._likelier(before, sides)
        turned = belief.counts["landmarks turned over"]
        self._adopt(best.log, told, best.found)
        if settings.restart:
            others += other_sources.with_another_source(
                belief, best, told, self._fit, settings.exclusive
            )
        last = self._likelier(best, others)
        if last is not best:
            best, turned = last, belief.counts["landmarks turned over"]
            self._adopt(best.log, told, best.found)
        for one in (before, *sides):
            if one.cost < best.cost + diagnosis.LEAST_RIVAL:
                belief.in_doubt |= mirrors.elsewhere(best.found, one.found)
        sure = ~belief.in_doubt
        different = [
            one
            for one in (ours, before, *others, *sides)
            if mirrors.differ(best.found, one.found, sure)
        ]
        belief.counts["batch restarts"] += any(one is ours for one in different)
        gap = min((one.cost for one in different), default=np.inf) - best.cost
        kept = belief.present == np.isfinite(best.found.landmarks[:, 0])
        if kept.all() and belief.counts["landmarks turned over"] == turned:
            return best, max(gap, 0.0)
        log, _, poses, _ = belief.whole()
        settled = self._fit(log, (poses, belief.landmarks), 1.0)
        return rivals.rival(log, told, settled), max(gap, 0.0)

    def _likelier(self, ours: rivals.Rival, others: list[rivals.Rival]) -> rivals.Rival:
        """The likeliest of all, if it is better than ours and may be adopted; else ours."""
        best = min([ours, *others], key=lambda one: one.cost)
        return best if self.settings.restart and best.cost < ours.cost - rivals.BETTER else ours

    def _vague(self) -> np.ndarray:
        """(K,) bool, landmarks that are nowhere well enough to tell their ranges from others'."""
        joint = self.belief.covariance(anchored=True).landmarks
        k = len(joint) // 2
        own = np.einsum("kikj->kij", np.nan_to_num(joint).reshape(k, 2, k, 2))
        if k == 0 or len(self.belief.log.ranges) == 0:
            return np.ones(k, dtype=bool)
        limit = data_association.VAGUE * np.median(self.belief.log.range_sigmas)
        return np.linalg.eigvalsh(own)[:, -1] > limit**2
