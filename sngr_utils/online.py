"""Association-aware SNGR, online: at every pose it knows what came before, and nothing else.

One step: predict the new pose and doubt the odometry if the scan does; credit the ranges;
start landmarks that have waited until their place is unambiguous; credit all earlier ranges
anew; start anew what went wrong. Nested sampling is asked for two things only: where a landmark
is, and where the robot is when its scan contradicts the odometry.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from pydantic import Field
from scipy import stats

from sngr_utils import association, chain, crediting, graph, place
from sngr_utils.crediting import DROPPED, Credit
from sngr_utils.smoother import Smoother
from sngr_utils.world import Checked, Probability, World, dead_reckoning

ENOUGH_MASS = 0.9  # of one mode, for a landmark to start
POSES_NEEDED = 4  # for a landmark to start: three of a short arc leave its mirror image
FEWEST_USED = 0.5  # share of the expected uses of its label below which a landmark starts anew
YOUNG = 6  # labels a landmark must have had before that is judged
LIKELY = 0.2  # probability that makes a range a witness of a landmark that waits
P_PRIOR = (2.0, 8.0)  # wrong and right labels that count as seen before the first
SWEEPS = 3  # at most, per step
SLIP_SIGMA = 1.0  # m, of a step that is no longer trusted
STEP_LIMIT = stats.chi2.ppf(1 - 1e-4, 3)  # squared normalised error of a step that slipped
SLIP_ODDS = np.log(100.0)  # nats that a slip must gain: one step in a hundred slips


class Settings(Checked):
    """What can be switched off, to see what it is worth; the defaults are the method.

    start : how a landmark starts: nested sampling or a grid of its posterior, once that has one
        mode, or least squares on its first three poses ("first_poses", as the paper does)
    exclusive : no two ranges of a scan come from the same landmark
    swap : a range may be credited to another landmark than its label's, not only dropped
    sweep : earlier ranges are credited anew at every step
    restart : every `restart_every` poses EM over all data so far, adopted where it is likelier
    doubt_odometry : a scan may overrule the odometry
    louis : the covariance admits that associations are uncertain
    p : probability of a wrong label; None estimates it
    """

    start: Literal["nested", "grid", "first_poses"] = "nested"
    exclusive: bool = True
    swap: bool = True
    sweep: bool = True
    restart_every: Annotated[int, Field(ge=0)] = 10
    doubt_odometry: bool = True
    louis: bool = True
    p: Probability | None = None
    mirror_first: bool = True


@dataclass(frozen=True)
class OnlineEstimate:
    """What the online estimator holds after the last pose.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN for one that was never started
    used : (M,) int, landmark each range is credited to, -1 for none
    position_covariances : (T, 2, 2) in the world frame, [m^2]
    p : share of wrong labels, estimated
    filtered : (T, 3) each pose as estimated when it was the newest, [m, m, rad]
    counts : how often: "landmark starts" (nested runs for them), "position checks" (nested runs
        for a scan that contradicts the odometry), "slips", "landmark restarts", "batch restarts"
    """

    poses: np.ndarray
    landmarks: np.ndarray
    used: np.ndarray
    position_covariances: np.ndarray
    p: float
    filtered: np.ndarray
    counts: Counter


def until(world: World, t: int) -> World:
    """What is known at pose t: the world without what comes later."""
    seen = world.pose_of <= t
    return replace(
        world, poses=world.poses[: t + 1], odometry=world.odometry[:t],
        pose_of=world.pose_of[seen], label_of=world.label_of[seen],
        source_of=world.source_of[seen], ranges=world.ranges[seen],
    )  # fmt: skip


def run(
    world: World,
    conventions: graph.Conventions,
    settings: Settings,
    watch: Callable[["Estimator"], None] | None = None,
    *,
    rng: np.random.Generator,
) -> OnlineEstimate:
    """Feed a world to the estimator pose by pose.

    Parameters
    ----------
    watch : called after every step, e.g. to draw it
    """
    estimator = Estimator(conventions, settings, rng=rng)
    filtered = []
    for t in range(world.n_poses):
        estimator.step(until(world, t))
        filtered.append(estimator.poses[-1])
        if watch:
            watch(estimator)
    return estimator.result(np.array(filtered))


class Estimator:
    """The state of the online estimator. `data` is all it has been given so far."""

    def __init__(
        self, conventions: graph.Conventions, settings: Settings, *, rng: np.random.Generator
    ) -> None:
        self.conventions, self.settings, self.rng = conventions, settings, rng
        self.counts: Counter = Counter()
        self.smoother = Smoother()
        self.clouds: dict[int, place.Posterior] = {}  # of the landmarks that wait
        self.tried: dict[int, np.ndarray] = {}  # and the ranges they were sampled from
        self.slipped: set[int] = set()  # steps of the odometry that are not trusted
        self.poses = np.zeros((0, 3))
        self.used = np.zeros(0, dtype=int)
        self.p = P_PRIOR[0] / sum(P_PRIOR) if settings.p is None else settings.p

    def step(self, data: World) -> None:
        """One pose more: `data` is all up to it."""
        self.data, t = data, data.n_poses - 1
        if t == 0:
            self.landmarks = np.full((data.n_landmarks, 2), np.nan)
        self._predict(t)
        self._credit(new_only=not self.settings.sweep)
        self._start_landmarks()
        if self.settings.sweep:
            for _ in range(SWEEPS):
                if not self._credit():
                    break
            if self.settings.doubt_odometry:
                self._doubt_steps()
            self._drop_landmarks()
        if self.settings.restart_every and t and (t % self.settings.restart_every == 0 or self._troubled(t)):
            self._restart()

    # --- the new pose -----------------------------------------------------------------------

    def _predict(self, t: int) -> None:
        data = self.data
        n_new = len(data.ranges) - len(self.used)
        self.used = np.append(self.used, np.full(n_new, DROPPED))
        elsewhere = np.eye(data.n_landmarks + 1)[np.full(n_new, data.n_landmarks)]
        self.weights = np.vstack([self.weights, elsewhere]) if t else elsewhere
        if t == 0:
            self.poses = data.x0_mean[None].copy()
            added = {("x0",): graph.pose_prior(data.x0_mean, self.conventions.x0_sigmas)}
        else:
            newest = dead_reckoning(self.poses[-1], data.odometry[t - 1 :])[-1]
            self.poses = np.vstack([self.poses, newest])
            if self.settings.doubt_odometry:
                self._find_robot(t)
            added = {("odometry", t - 1): self._odometry(t - 1)}
            scan = np.flatnonzero((data.pose_of == t) & (self.used != DROPPED))
            added |= {("range", m): self._range(m, self.used[m]) for m in scan}
        start = gtsam.Values()
        start.insert(X(t), gtsam.Pose2(*self.poses[-1]))
        self._update(added, start=start)

    def _odometry(self, t: int) -> gtsam.BetweenFactorPose2:
        scenario = self.data.scenario
        if t in self.slipped:
            scenario = scenario.model_copy(update={"odometry_sigma_xy": SLIP_SIGMA})
        return graph.odometry_factor(t, self.data.odometry[t], scenario)

    def _find_robot(self, t: int) -> None:
        """Ask where the robot is, if that is open or its scan contradicts the odometry."""
        data = self.data
        scan = np.flatnonzero((data.pose_of == t) & np.isfinite(self.landmarks[data.label_of, 0]))
        if len(scan) < 3 or t < 2:
            return
        labels, covariance = data.label_of[scan], self.covariance()
        found = crediting.innovations(data, self.poses, self.landmarks, self.used, covariance)
        sigma = np.sqrt(np.trace(covariance.poses[-1][:2, :2]) / 2)
        lost = sigma > crediting.VAGUE
        if not lost and np.mean(found.squared[scan, labels] < crediting.GATE) >= 0.5:
            return
        present = np.flatnonzero(np.isfinite(self.landmarks[:, 0]))
        m, k = (grid.ravel() for grid in np.meshgrid(scan, present, indexing="ij"))
        prior = np.exp(association.log_prior(data.label_of, data.n_landmarks, self.p))[m, k]
        own = np.diag(covariance.landmarks).reshape(-1, 2).mean(axis=1)[k]
        evidence = place.Evidence(
            self.landmarks[k], data.ranges[m], own + data.scenario.range_sigma**2,
            1 - prior, data.ranges.max(), self.poses[-1, :2], sigma if lost else SLIP_SIGMA,
        )  # fmt: skip
        cloud = place.sample(evidence, rng=self.rng)
        self.counts["position checks"] += 1
        if not lost:
            right = np.exp(-0.5 * found.squared[m, k]) / np.sqrt(2 * np.pi * found.variances[m, k])
            expected = np.log(prior * right + (1 - prior) / data.ranges.max()).sum()
            if cloud.log_evidence - expected < SLIP_ODDS:
                return
            self.counts["slips"] += 1
            self.slipped.add(t - 1)
        mode = place.modes(cloud, evidence)[0]
        if mode.mass > ENOUGH_MASS:
            self.poses[-1, :2] = mode.mean
            self._credit_fitting(m, k, mode, evidence)

    def _credit_fitting(self, ranges, landmarks, mode: place.Mode, evidence) -> None:
        """Credit those ranges of an evidence that fit its mode, one per pose and landmark."""
        offsets = mode.mean - evidence.anchors
        distances = np.linalg.norm(offsets, axis=1)
        units = offsets / distances[:, None]
        variances = evidence.variances + np.sum(units @ mode.covariance * units, axis=1)
        fit = (distances - evidence.ranges) ** 2 / variances < crediting.GATE
        pairs = np.column_stack([self.data.pose_of[ranges], landmarks])
        _, first = np.unique(pairs[fit], axis=0, return_index=True)
        self.used = self.used.copy()
        self.used[ranges[fit][first]] = landmarks[fit][first]

    # --- associations -----------------------------------------------------------------------

    def covariance(self) -> chain.ChainCovariance:
        """Covariance blocks of the present estimate with the ranges that are credited."""
        data, kept, s = self.data, self.used != DROPPED, self.data.scenario
        sigmas = np.tile(
            [s.odometry_sigma_xy, s.odometry_sigma_xy, s.odometry_sigma_theta],
            (len(data.odometry), 1),
        )
        sigmas[list(self.slipped), :2] = SLIP_SIGMA
        return chain.selected_inverse(
            self.poses, self.landmarks, data.odometry, data.pose_of[kept], self.used[kept],
            x0_mean=data.x0_mean, x0_sigmas=self.conventions.x0_sigmas, odometry_sigmas=sigmas,
            landmark_prior_sigma=self.conventions.landmark_prior_sigma,
            range_sigma=s.range_sigma,
        )  # fmt: skip

    def innovations(self) -> crediting.Innovations:
        return crediting.innovations(
            self.data, self.poses, self.landmarks, self.used, self.covariance()
        )

    def _credit(self, new_only: bool = False) -> bool:
        """Credit the ranges anew; has anything changed?"""
        if not np.isfinite(self.landmarks).any():
            return False
        data, settings = self.data, self.settings
        credit = crediting.decide(
            data, self.innovations(), Credit(self.used, None), self.p, settings.exclusive,
            settings.swap,
        )  # fmt: skip
        if settings.p is None:
            self.p = crediting.share_wrong(data, credit, self.landmarks, P_PRIOR)
        used = credit.used
        if new_only:
            used = np.where(data.pose_of == data.n_poses - 1, used, self.used)
        self.weights = credit.weights
        return self._use(used)

    def _use(self, used: np.ndarray) -> bool:
        """Swap range factors until the graph credits the ranges as `used` says."""
        changed = np.flatnonzero(used != self.used)
        removed = [("range", m) for m in changed if self.used[m] != DROPPED]
        added = {("range", m): self._range(m, used[m]) for m in changed if used[m] != DROPPED}
        self.used = used
        if len(changed):
            self._update(added, removed)
        return len(changed) > 0

    def _range(self, m: int, k: int) -> gtsam.RangeFactor2D:
        data = self.data
        return graph.range_factor(
            int(data.pose_of[m]), int(k), data.ranges[m], data.scenario.range_sigma
        )

    def _update(self, added: dict, removed: list | None = None, start=None) -> None:
        self.smoother.update(added, removed, start)
        self.poses = self.smoother.poses(self.data.n_poses)
        self.landmarks = self.smoother.landmarks(self.data.n_landmarks)

    def _doubt_steps(self) -> None:
        """Trust no longer the steps of the odometry that the estimate contradicts."""
        factors = {t: self._odometry(t) for t in range(self.data.n_poses - 1)}
        worst = {t: f for t, f in factors.items()
                 if t not in self.slipped and 2 * f.error(self.smoother.values) > STEP_LIMIT}
        if worst:
            self.slipped |= set(worst)
            self.counts["slips"] += len(worst)
            self._update({("odometry", t): self._odometry(t) for t in worst})

    # --- landmarks --------------------------------------------------------------------------

    def _start_landmarks(self) -> None:
        """Start every landmark that waits and whose posterior has become one mode."""
        for k in np.flatnonzero(np.isnan(self.landmarks[:, 0])):
            mine, chances = self._witnesses(k)
            if len(np.unique(self.data.pose_of[mine])) < POSES_NEEDED:
                continue
            if np.array_equal(mine, self.tried.get(k)):
                continue
            self.tried[k] = mine
            evidence = self._evidence(mine, chances)
            mode = self._locate(k, evidence)
            if mode is not None:
                self._insert(k, mode, mine, evidence)

    def _witnesses(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Ranges that may well be landmark k's, credited to none so far, and their chances."""
        data, absent = self.data, np.isnan(self.landmarks[:, 0])
        prior = np.exp(association.log_prior(data.label_of, data.n_landmarks, self.p))
        chances = self.weights[:, -1] * prior[:, k] / prior[:, absent].sum(axis=1)
        mine = np.flatnonzero((self.used == DROPPED) & (chances > LIKELY))
        return mine, chances[mine]

    def _evidence(self, mine: np.ndarray, chances: np.ndarray) -> place.Evidence:
        data, seen_from = self.data, self.data.pose_of[mine]
        spread = np.trace(self.covariance().poses[:, :2, :2], axis1=1, axis2=2) / 2
        anchors, ranges = self.poses[seen_from, :2], data.ranges[mine]
        return place.Evidence(
            anchors, ranges, spread[seen_from] + data.scenario.range_sigma**2, 1 - chances,
            data.ranges.max(), anchors.mean(axis=0), ranges.max(),
        )  # fmt: skip

    def _locate(self, k: int, evidence: place.Evidence) -> place.Mode | None:
        """Where the landmark starts, if that is known."""
        if self.settings.start == "first_poses":
            position = graph.start_landmark(evidence.anchors[:3], evidence.ranges[:3])
            return place.Mode(position, np.eye(2), 1.0)
        if self.settings.mirror_first and place.mirrored(evidence):
            self.counts["mirror waits"] += 1
            return None
        if self.settings.start == "nested":
            cloud = place.sample(evidence, rng=self.rng)
            self.counts["landmark starts"] += 1
        else:
            cloud = place.grid(evidence)
        self.clouds[k] = cloud
        best = place.modes(cloud, evidence)[0]
        return best if best.mass > ENOUGH_MASS else None

    def _insert(
        self, k: int, mode: place.Mode, mine: np.ndarray, evidence: place.Evidence
    ) -> None:
        """Landmark k into the graph, with those of its witnesses that fit."""
        self.clouds.pop(k, None)
        self._credit_fitting(mine, np.full(len(mine), k), mode, evidence)
        sigma = self.conventions.landmark_prior_sigma
        added = {("landmark", k): graph.landmark_prior(k, mode.mean, sigma)}
        added |= {("range", m): self._range(m, k) for m in np.flatnonzero(self.used == k)}
        start = gtsam.Values()
        start.insert(L(k), mode.mean)
        self._update(added, start=start)

    def _drop_landmarks(self) -> None:
        """Take out a landmark that its own labels do not use: it waits for another start."""
        data = self.data
        for k in np.flatnonzero(np.isfinite(self.landmarks[:, 0])):
            labelled = data.label_of == k
            used = np.sum(labelled & (self.used == k))
            if labelled.sum() >= YOUNG and used < FEWEST_USED * (1 - self.p) * labelled.sum():
                removed = [("landmark", k), *(("range", m) for m in np.flatnonzero(self.used == k))]
                self.used = np.where(self.used == k, DROPPED, self.used)
                self._update({}, removed)
                self.counts["landmark restarts"] += 1

    # --- the whole --------------------------------------------------------------------------

    def _troubled(self, t: int) -> bool:
        """Has the newest scan lost half of its ranges, or its step of the odometry?"""
        newest = self.used[self.data.pose_of == t]
        known = np.isfinite(self.landmarks).all()
        return t - 1 in self.slipped or (known and np.mean(newest == DROPPED) >= 0.5)

    def _restart(self) -> None:
        """EM over all data so far; adopted if it explains them better."""
        found = association.fit(
            self.data, self.conventions, (self.poses, self.landmarks), self.settings.exclusive,
            sure=self.smoother.factors("x0", "odometry", "landmark"),
        )
        self.counts["batch checks"] += 1
        if self._cost(found.poses, found.landmarks) < self._cost(self.poses, self.landmarks) - 1:
            self.counts["batch restarts"] += 1
            best = np.argmax(found.responsibilities, axis=1)
            good = found.responsibilities.max(axis=1) > crediting.RESOLVED
            self._rebuild(found, np.where(good, best, DROPPED))

    def _cost(self, poses: np.ndarray, landmarks: np.ndarray) -> float:
        """Minus the log posterior of an estimate, associations summed out, [nats]."""
        factors = self.smoother.factors("x0", "odometry", "landmark")
        data = self.data
        distances = np.linalg.norm(poses[data.pose_of, None, :2] - landmarks, axis=2)
        exact = crediting.Innovations(
            data.ranges[:, None] - distances,
            np.full(distances.shape, data.scenario.range_sigma**2) + 0 * distances,
        )
        fit = np.logaddexp.reduce(crediting.log_weights(data, exact, self.p), axis=1).sum()
        from sngr_utils import robust
        return factors.error(robust.values_of(poses, landmarks)) - float(fit)

    def _rebuild(self, found, used: np.ndarray) -> None:
        from sngr_utils import robust
        old = self.smoother
        self.smoother = Smoother()
        self.used = used
        added = {n: old._factors[n] for kind in ("x0", "odometry", "landmark") for n in old.names(kind)}
        added |= {("range", m): self._range(m, used[m]) for m in np.flatnonzero(used != DROPPED)}
        self._update(added, start=robust.values_of(found.poses, found.landmarks))

    def result(self, filtered: np.ndarray) -> OnlineEstimate:
        self.smoother.settle(3)
        self.poses = self.smoother.poses(self.data.n_poses)
        self.landmarks = self.smoother.landmarks(self.data.n_landmarks)
        if self.settings.louis:
            weights = association.responsibilities(
                self.data, self.poses, self.landmarks, self.p, 1.0, self.settings.exclusive
            )
        else:
            weights = np.zeros((len(self.used), self.data.n_landmarks + 1))
            weights[np.arange(len(self.used)), self.used] = 1.0
        sure = self.smoother.factors("x0", "odometry", "landmark")
        blocks = association._covariances(sure, self.data, self.poses, self.landmarks, weights)
        return OnlineEstimate(
            self.poses, self.landmarks, self.used, blocks, self.p, filtered, self.counts
        )
