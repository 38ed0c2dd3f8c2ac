"""What the online estimator holds: the newest poses, the map, and what each range is assigned to.

Nothing is decided here. `slips`, `landmarks` and `estimator` decide. Poses that have left the
window are kept as they were then, and speak through `window.Past` only. Just over
300 lines: one class, whose parts share its state.
"""

import operator
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sngr_utils.detection import mirror_image
from sngr_utils.online import data_association, localisation, window
from sngr_utils.online.data_association import DROPPED, Assignment
from sngr_utils.robust import association
from sngr_utils.robust.association import Shares
from sngr_utils.sampling.targets import place
from sngr_utils.slam import (
    chain_cost,
    chain_problem,
    chain_solver,
    information,
    selected_inverse,
)
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import Log

PRIOR = Shares(wrong=0.2, clutter=0.05)  # before the first range
WINDOW = 60  # poses that are estimated anew at every step, up to twice as many
LOOSE = 10.0  # times the longest range: sigma that keeps a landmark from infinity
ANCHOR = 1e6  # times its own information, which makes a pose as good as known
TURNED = np.pi / 2  # rad, sigma of the heading after a step that is not trusted at all


def wider(log: Log, told: np.ndarray) -> np.ndarray:
    """(T-1,) bool, the steps of a log that are not as told: they may have slipped."""
    return (log.odometry_covariances != told).any(axis=(1, 2))


@dataclass(frozen=True)
class Left:
    """Poses that have left the window: log, covariances as told, estimate, and assignments."""

    log: Log
    told: np.ndarray
    poses: np.ndarray
    used: np.ndarray


class Belief:
    """The state of the online estimator.

    Attributes
    ----------
    log : what was measured at the poses of the window, a covariance wide for a step that slipped
    told : (S, 3, 3) covariances of its steps as they were measured
    poses : (W, 3) estimated, [m, m, rad]; the newest may be a prediction, see `predict`
    landmarks : (K, 2) estimated, [m]; NaN for one that is not in the map
    in_doubt : (K,) bool, landmarks in the map of which the mirror image may be the true place
    assignment : to what each range of the window is assigned, and the posterior of its source
    shares : of wrong labels and of clutter, estimated
    slipped : (S,) bool, steps of the odometry that are not trusted
    left, past : poses before the window, and what they say of it
    longest : range so far, [m]; 0 before there is one
    counts : what was done how often, see `estimator.OnlineEstimate`
    """

    def __init__(self, first: Log) -> None:
        self.log, self.told = first, first.odometry_covariances
        self.poses, self.landmarks = first.x0_mean[None].copy(), first.landmark_means.copy()
        self.in_doubt = np.zeros(first.n_landmarks, dtype=bool)
        self.assignment = data_association.nowhere(len(first.ranges), first.n_landmarks)
        self.shares, self.slipped = PRIOR, np.zeros(0, dtype=bool)
        self.left: list[Left] = []
        self.past = window.nothing(first.n_landmarks)
        self.longest = float(first.ranges.max(initial=0.0))
        self.counts: Counter = Counter()
        self._asked_at: tuple = (None,) * 5
        self._found: dict = {}

    @property
    def n_poses(self) -> int:
        """All poses so far."""
        return self.n_left + len(self.poses)

    @property
    def n_left(self) -> int:
        return sum(len(left.poses) for left in self.left)

    @property
    def newest(self) -> np.ndarray:
        """The ranges of the newest pose."""
        return np.arange(
            np.searchsorted(self.log.pose_of, len(self.poses) - 1), len(self.log.ranges)
        )

    @property
    def present(self) -> np.ndarray:
        """(K,) bool, the landmarks that are in the map"""
        return np.isfinite(self.landmarks[:, 0])

    # --- the newest pose --------------------------------------------------------------------

    def predict(self, new: Log) -> None:
        """Take one pose more, `new` being the log of it and of the one before.

        The pose is predicted, and its ranges are assigned to nothing yet.
        """
        if len(self.poses) >= 2 * WINDOW:
            self.shorten()
        fresh = data_association.nowhere(len(new.ranges), self.log.n_landmarks)
        self.assignment = Assignment(
            np.append(self.assignment.used, fresh.used),
            np.vstack([self.assignment.weights, fresh.weights]),
        )
        newest = dead_reckoning(self.poses[-1], new.odometry)[-1]
        self.log, self.poses = self.log.joined(new), np.vstack([self.poses, newest])
        self.told = np.concatenate([self.told, new.odometry_covariances])
        self.slipped = np.append(self.slipped, False)
        self.longest = max(self.longest, float(new.ranges.max(initial=0.0)))

    def move_newest(self, poses: np.ndarray, used: np.ndarray) -> None:
        """The last poses elsewhere, (N, 3) [m, m, rad], and all ranges assigned so."""
        self.poses = np.vstack([self.poses[: -len(poses)], poses])
        self.assignment = Assignment(used, self.assignment.weights)

    def distrust(self, steps: np.ndarray, turned: bool) -> None:
        """Let steps of the odometry err by as much as the longest range, perhaps in heading too."""
        wide = self.log.odometry_covariances.copy()
        for t in np.atleast_1d(steps):
            wide[t] = np.diag(np.full(3, self.longest**2))
            wide[t, 2, 2] = TURNED**2 if turned else self.told[t, 2, 2]
        self.slipped[steps] = True
        self.log = self.log.with_covariances(wide)

    def trust(self, steps: np.ndarray) -> None:
        """Take steps of the odometry at their word again."""
        told = self.log.odometry_covariances.copy()
        told[steps], self.slipped[steps] = self.told[steps], False
        self.log = self.log.with_covariances(told)

    # --- ranges and landmarks ---------------------------------------------------------------

    def use(self, used: np.ndarray) -> bool:
        """Assign ranges so, and estimate anew if that has changed anything; has it?"""
        changed = not np.array_equal(used, self.assignment.used)
        if changed:
            self.assignment = Assignment(used, self.assignment.weights)
            self.solve()
        return changed

    def insert(self, k: int, position: np.ndarray, used: np.ndarray) -> None:
        """Start landmark k, with the ranges that `used` assigns to it."""
        self._place(k, position)
        self.assignment = Assignment(used, self.assignment.weights)
        self.solve()

    def remove(self, k: int) -> None:
        """Take out landmark k with its ranges."""
        self._place(k, np.full(2, np.nan))
        self.in_doubt[k] = False
        self.past = window.without(self.past, k)
        self.use(np.where(self.assignment.used == k, DROPPED, self.assignment.used))

    def _place(self, k: int, position: np.ndarray) -> None:
        self.landmarks = self.landmarks.copy()
        self.landmarks[k] = position

    def solve(self) -> None:
        """Estimate the window anew, ranges taken as they are assigned."""
        chain = self.chain(self.landmarks)
        at = chain_solver.state_of(chain, self.poses, self.landmarks)
        at, _ = window.minimise(chain, self.past, at)
        self.poses, self.landmarks = information.poses_of(at.frames), at.landmarks

    def mirrored(self, k: int) -> tuple[float, np.ndarray, np.ndarray]:
        """How much worse the mirror image of landmark k is, all else moved along, [nats].

        Returns
        -------
        gap : negative if the image is the better place, infinite if there is none
        poses, landmarks : (W, 3) and (K, 2), with the image
        """
        mine = self.assignment.used == k
        anchors = self.poses[self.log.pose_of[mine], :2]
        if len(anchors) < 2:
            return 0.0, self.poses, self.landmarks
        found = mirror_image.mirror_test(
            anchors, self.log.ranges[mine], self.log.range_sigmas[mine] ** 2, self.landmarks[k]
        )
        here, there = self.landmarks[k], self.landmarks.copy()
        there[k] = max((found.image, found.landmark), key=lambda p: np.linalg.norm(p - here))
        ours, _, landmarks = self.settled(self.landmarks)
        theirs, image_poses, image = self.settled(there)
        apart = np.linalg.norm(landmarks[k] - image[k]) > self.log.range_sigmas[mine].min()
        return theirs - ours if apart else np.inf, image_poses, image

    def settled(
        self, landmarks: np.ndarray, used: np.ndarray | None = None
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost [nats], (W, 3) poses and (K, 2) landmarks at the minimum from other landmarks.

        Parameters
        ----------
        used : (M,) int, other assignments of the ranges
        """
        chain = self.chain(landmarks, used)
        at = chain_solver.state_of(chain, self.poses, landmarks)
        at, least = window.minimise(chain, self.past, at)
        return least, information.poses_of(at.frames), at.landmarks

    def chain(self, landmarks: np.ndarray, used: np.ndarray | None = None) -> Chain:
        """The problem of the window, its ranges assigned, with (K, 2) landmarks or NaN, [m]."""
        used = self.assignment.used if used is None else used
        return self._chain(self.log, self.poses, landmarks, used, self.n_left)

    def _chain(self, log: Log, poses, landmarks, used: np.ndarray, start: int) -> Chain:
        """The problem of a part of the log that begins at pose `start`."""
        chain = chain_problem.of_log(log, landmarks, LOOSE * max(self.longest, 1e-300))
        kept = used != DROPPED
        chain = chain._replace(
            pose_of=chain.pose_of[kept], landmark_of=used[kept], ranges=chain.ranges[kept],
            sigmas=chain.sigmas[kept], weights=chain.weights[kept],
        )  # fmt: skip
        if start > 0:  # the past says it
            return chain._replace(prior_information=np.zeros((3, 3)))
        return chain

    # --- the window -------------------------------------------------------------------------

    def shorten(self) -> None:
        """Let the older half of the window go."""
        self._leave(len(self.poses) - WINDOW)

    def _leave(self, n: int) -> None:
        """Sum up the first n poses of the window, and keep them as they are."""
        early = self.log.pose_of < n
        first = self.log.keep(early).first(n + 1)
        used, poses = self.assignment.used[early], self.poses[: n + 1]
        chain = self._chain(first, poses, self.landmarks, used, self.n_left)
        chain = chain._replace(landmark_information=np.zeros(len(self.landmarks)))
        at = chain_solver.state_of(chain, poses, self.landmarks)
        self.past = window.marginalise(chain, self.past, at)
        self.left.append(Left(first, self.told[:n], poses[:-1], used))
        self.log, self.poses = self.log.after(n), self.poses[n:]
        self.assignment = Assignment(self.assignment.used[~early], self.assignment.weights[~early])
        self.told, self.slipped = self.told[n:], self.slipped[n:]

    def whole(self) -> tuple[Log, np.ndarray, np.ndarray, np.ndarray]:
        """The log of all poses, covariances of its steps as told, (T, 3) poses, (M,) sources."""
        parts = [*self.left, Left(self.log, self.told, self.poses, self.assignment.used)]
        log = parts[0].log
        for part in parts[1:]:
            log = log.joined(part.log)
        return log, *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("told", "poses", "used")
        )

    def adopt(self, log: Log, told: np.ndarray, poses, landmarks, used: np.ndarray) -> None:
        """Another estimate of the whole, as `whole` gives it, in one window; and its sources."""
        self.log, self.told = log, told
        self.slipped = wider(log, told)
        self.left, self.past = [], window.nothing(log.n_landmarks)
        self.poses, self.landmarks = poses, landmarks.copy()
        weights = np.eye(log.n_landmarks + 1)[used]
        self.assignment = Assignment(used, weights)
        self.solve()

    # --- uncertainty ------------------------------------------------------------------------

    def covariance(self, anchored: bool = False) -> selected_inverse.ChainCovariance:
        """Covariance blocks of the window at the estimate, also of a pose that is predicted.

        Parameters
        ----------
        anchored : given the first pose, so that what all places err by in common is left out
        """
        return self._once(("covariance", anchored), lambda: self._covariance(anchored))

    def _covariance(self, anchored: bool) -> selected_inverse.ChainCovariance:
        chain = self.chain(self.landmarks)
        at = chain_solver.state_of(chain, self.poses, self.landmarks)
        window.cost(chain, self.past, at)
        system = window.linearise(chain, self.past, at)
        if anchored:
            system.own[0] += ANCHOR * np.diag(np.diag(system.own[0]))
        joint = selected_inverse.eliminate_poses(system, len(self.landmarks))
        return selected_inverse.conclude(system, joint, self.landmarks)

    def innovations(self, anchored: bool = False) -> data_association.Innovations:
        """Innovations of all ranges of the window at the estimate, by its `covariance`."""
        return self._once(("innovations", anchored), lambda: data_association.innovations(
            self.log, self.poses, self.landmarks, self.assignment.used, self.covariance(anchored)
        ))  # fmt: skip

    def _once(self, what: tuple, compute: Callable):
        """What `compute` finds at this very estimate; computed anew only when that has changed.

        So nothing of the estimate is ever changed in place.
        """
        at = self.log, self.poses, self.landmarks, self.assignment.used, self.past
        if not all(map(operator.is_, at, self._asked_at)):
            self._asked_at, self._found = at, {}
        if what not in self._found:
            self._found[what] = compute()
        return self._found[what]

    def assign_fitting(
        self, m: np.ndarray, k: np.ndarray, mode: localisation.Mode, evidence: place.Evidence
    ) -> np.ndarray:
        """(M,) assignments with those pairs of a range and a landmark that fit a mode.

        Parameters
        ----------
        m, k : (N,) int, range and landmark behind each row of `evidence`
        """
        units = mode.mean - evidence.anchors
        units /= np.linalg.norm(units, axis=1)[:, None]
        spread = np.sum(units @ mode.covariance * units, axis=1)
        fit = localisation.fitting(evidence, mode.mean, evidence.variances + spread)
        pairs = np.column_stack([self.log.pose_of[m], k])
        _, first = np.unique(pairs[fit], axis=0, return_index=True)  # a landmark once in a scan
        used = self.assignment.used.copy()
        used[m[fit][first]] = k[fit][first]
        return used


def cost(log: Log, poses: np.ndarray, landmarks: np.ndarray, shares: Shares) -> float:
    """Minus the log evidence of an estimate, associations summed out, roughly, [nats].

    Without the weak priors on landmarks, which sit where each estimate started. A landmark costs
    what it can choose: its place, as finely as its ranges hold it, in a scene as wide as the
    longest of them. Source: Schwarz, Annals of Statistics 6, 1978.
    """
    chain = chain_problem.of_log(log.keep(np.zeros(len(log.ranges), dtype=bool)), landmarks, np.inf)
    at = chain_solver.state_of(chain, poses, landmarks)
    total = chain_cost.cost(chain, LEAST_SQUARES, at)
    if len(log.ranges) == 0:
        return total
    residuals = association.residuals(log, poses, landmarks)
    variances = np.broadcast_to(log.range_sigmas[:, None] ** 2, residuals.shape)
    joint = association.log_joint(log, residuals, variances, shares)
    fit = np.logaddexp.reduce(joint, axis=1)
    information = np.exp(joint[:, :-1] - fit[:, None]).T @ log.range_sigmas**-2
    choices = np.log(np.maximum(information / 2 * log.ranges.max() ** 2 / (2 * np.pi), 1.0))
    return total - float(fit.sum()) + float(choices.sum())
