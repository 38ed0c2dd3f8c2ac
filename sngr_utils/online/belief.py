"""What the online estimator holds: the data so far, the graph, and what each range is credited to.

Nothing is decided here. `slips`, `landmarks` and `estimator` decide.
"""

import warnings
from collections import Counter
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.online import data_association, localisation
from sngr_utils.online.data_association import DROPPED, Credit
from sngr_utils.online.smoother import Smoother
from sngr_utils.robust import association
from sngr_utils.robust.association import Shares
from sngr_utils.sampling.targets import place
from sngr_utils.slam import selected_inverse, solution
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import landmark_prior, odometry_factor, pose_prior, range_factor
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import Log, LogWarning
from sngr_utils.world.simulation import World

P_PRIOR = (2.0, 8.0)  # wrong and right labels that count as seen before the first
SLIP_SIGMA = 1.0  # m, of a step of the odometry that is no longer trusted


class Belief:
    """The state of the online estimator.

    Attributes
    ----------
    data : World, all that has been measured so far
    poses : (T, 3) estimated, [m, m, rad]; the newest may be a prediction, see `predict`
    landmarks : (K, 2) estimated, [m]; NaN for one that is not in the graph
    credit : to what each of the M ranges is credited, and the posterior of its source
    p : share of wrong labels, estimated
    slipped : steps of the odometry that are not trusted
    counts : what was done how often, see `estimator.OnlineEstimate`
    """

    def __init__(self, data: World, conventions: Conventions) -> None:
        self.data, self.conventions, self.smoother = data, conventions, Smoother()
        self.poses = data.x0_mean[None].copy()
        self.landmarks = np.full((data.n_landmarks, 2), np.nan)
        self.credit = data_association.nowhere(len(data.ranges), data.n_landmarks)
        self.p = P_PRIOR[0] / sum(P_PRIOR)
        self.slipped: set[int] = set()
        self.counts: Counter = Counter()
        prior = pose_prior(data.x0_mean, conventions.x0_sigmas)
        self._update({("x0",): prior}, start=solution.values_of(self.poses, self.landmarks))

    @property
    def log(self) -> Log:
        """What has been measured so far, with the steps that are not trusted."""
        with warnings.catch_warnings():  # a landmark without a range is nothing odd so early
            warnings.simplefilter("ignore", LogWarning)
            log = self.data.log(self.conventions.x0_sigmas)
            covariances = log.odometry_covariances.copy()
            covariances[list(self.slipped), :2, :2] = SLIP_SIGMA**2 * np.eye(2)
            return replace(log, odometry_covariances=covariances)

    @property
    def shares(self) -> Shares:
        """Of wrong labels; there is no clutter."""
        return Shares(self.p, 0.0)

    # --- the newest pose --------------------------------------------------------------------

    def predict(self, data: World) -> None:
        """Take the data of one pose more; the pose is predicted and not yet in the graph."""
        newest = dead_reckoning(self.poses[-1], data.odometry[-1:])[-1]
        fresh = data_association.nowhere(len(data.ranges) - len(self.data.ranges), data.n_landmarks)
        self.credit = Credit(
            np.append(self.credit.used, fresh.used),
            np.vstack([self.credit.weights, fresh.weights]),
        )
        self.data, self.poses = data, np.vstack([self.poses, newest])

    def confirm(self) -> None:
        """Put the predicted pose into the graph, with those of its ranges that are credited."""
        t = self.data.n_poses - 1
        credited = np.flatnonzero((self.data.pose_of == t) & (self.credit.used != DROPPED))
        start = gtsam.Values()
        start.insert(X(t), gtsam.Pose2(*self.poses[-1]))
        self._update({("odometry", t - 1): self.step(t - 1), **self._ranges(credited)}, start=start)

    def move_newest(self, position: np.ndarray, used: np.ndarray) -> None:
        """The predicted pose elsewhere, [m], and its ranges credited."""
        self.poses[-1, :2] = position
        self.credit = Credit(used, self.credit.weights)

    def step(self, t: int) -> gtsam.BetweenFactorPose2:
        """The odometry factor from pose t to t + 1, wide if it is not trusted."""
        scenario = self.data.scenario
        if t in self.slipped:
            scenario = scenario.model_copy(update={"odometry_sigma_xy": SLIP_SIGMA})
        return odometry_factor(t, self.data.odometry[t], scenario)

    def distrust(self, steps: list[int]) -> None:
        """Widen steps of the odometry that are in the graph."""
        self.slipped |= set(steps)
        self._update({("odometry", t): self.step(t) for t in steps})

    # --- ranges and landmarks ---------------------------------------------------------------

    def use(self, used: np.ndarray) -> bool:
        """Remove and add range factors until ranges are credited so; has anything changed?"""
        changed = np.flatnonzero(used != self.credit.used)
        removed = [("range", m) for m in changed if self.credit.used[m] != DROPPED]
        self.credit = Credit(used, self.credit.weights)
        if len(changed):
            self._update(self._ranges(changed[used[changed] != DROPPED]), removed)
        return len(changed) > 0

    def insert(self, k: int, position: np.ndarray, used: np.ndarray) -> None:
        """Start landmark k, with the ranges that `used` credits to it."""
        self.credit = Credit(used, self.credit.weights)
        sigma, start = self.conventions.landmark_prior_sigma, gtsam.Values()
        start.insert(L(k), position)
        prior = landmark_prior(k, position, sigma)
        ranges = self._ranges(np.flatnonzero(used == k))
        self._update({("landmark", k): prior, **ranges}, start=start)

    def remove(self, k: int) -> None:
        """Take out landmark k with its ranges."""
        mine = np.flatnonzero(self.credit.used == k)
        self.credit = Credit(
            np.where(self.credit.used == k, DROPPED, self.credit.used), self.credit.weights
        )
        self._update({}, [("landmark", k), *(("range", m) for m in mine)])

    def rebuild(self, poses: np.ndarray, landmarks: np.ndarray, used: np.ndarray) -> None:
        """The graph of another estimate and other associations, landmark priors centred on it."""
        kept = {**self.smoother.named("x0"), **self.smoother.named("odometry")}
        sigma = self.conventions.landmark_prior_sigma
        for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
            kept["landmark", k] = landmark_prior(k, landmarks[k], sigma)
        self.smoother, self.credit = Smoother(), Credit(used, self.credit.weights)
        ranges = self._ranges(np.flatnonzero(used != DROPPED))
        self._update({**kept, **ranges}, start=solution.values_of(poses, landmarks))

    def _ranges(self, which: np.ndarray) -> dict:
        data, sigma = self.data, self.data.scenario.range_sigma
        return {
            ("range", m): range_factor(
                int(data.pose_of[m]), int(self.credit.used[m]), data.ranges[m], sigma
            )
            for m in which
        }

    def _update(self, added: dict, removed: list | None = None, start=None) -> None:
        self.smoother.update(added, removed, start)
        self.refresh()

    def refresh(self) -> None:
        """Read the estimate from the smoother."""
        self.poses = solution.poses_of(self.smoother.values, self.data.n_poses)
        self.landmarks = solution.landmarks_of(self.smoother.values, self.data.n_landmarks)

    # --- uncertainty ------------------------------------------------------------------------

    def covariance(self) -> selected_inverse.ChainCovariance:
        """Covariance blocks at the estimate, also of a pose that is only predicted."""
        data, s, used = self.data, self.data.scenario, self.credit.used
        sigmas = np.tile(s.odometry_sigmas, (len(data.odometry), 1))
        sigmas[list(self.slipped), :2] = SLIP_SIGMA
        kept = used != DROPPED
        return selected_inverse.selected_inverse(
            self.poses, self.landmarks, data.odometry, data.pose_of[kept], used[kept],
            x0_mean=data.x0_mean, x0_sigmas=self.conventions.x0_sigmas, odometry_sigmas=sigmas,
            landmark_prior_sigma=self.conventions.landmark_prior_sigma,
            range_sigma=s.range_sigma,
        )  # fmt: skip

    def innovations(
        self, covariance: selected_inverse.ChainCovariance
    ) -> data_association.Innovations:
        """Innovations of all ranges at the estimate that has `covariance`."""
        return data_association.innovations(
            self.data, self.poses, self.landmarks, self.credit.used, covariance
        )

    def cost(self, poses: np.ndarray, landmarks: np.ndarray) -> float:
        """Minus the log posterior of an estimate, associations summed out, [nats].

        Without the weak priors on landmarks, which sit where each estimate started.
        """
        residuals = association.residuals(self.log, poses, landmarks)
        variances = np.full(residuals.shape, self.data.scenario.range_sigma**2)
        joint = association.log_joint(self.log, residuals, variances, self.shares)
        fit = np.logaddexp.reduce(joint, axis=1)
        sure = self.smoother.factors("x0", "odometry")
        return sure.error(solution.values_of(poses, landmarks)) - float(fit.sum())

    def credit_fitting(
        self, m: np.ndarray, k: np.ndarray, mode: localisation.Mode, evidence: place.Evidence
    ) -> np.ndarray:
        """(M,) credits with those pairs of a range and a landmark that fit a mode.

        Parameters
        ----------
        m, k : (N,) int, range and landmark behind each row of `evidence`
        """
        units = mode.mean - evidence.anchors
        units /= np.linalg.norm(units, axis=1)[:, None]
        spread = np.sum(units @ mode.covariance * units, axis=1)
        fit = localisation.fitting(evidence, mode.mean, evidence.variances + spread)
        pairs = np.column_stack([self.data.pose_of[m], k])
        _, first = np.unique(pairs[fit], axis=0, return_index=True)  # a landmark once in a scan
        used = self.credit.used.copy()
        used[m[fit][first]] = k[fit][first]
        return used
