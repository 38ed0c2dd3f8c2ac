"""What a result says of itself, without the truth: does it explain what was measured?

Ranges that nothing explains are spread evenly over a sound estimate's poses, the steps of the
odometry are missed by their noise, no other estimate of the same data is nearly as likely, and
the places are known well enough to tell one landmark's ranges from another's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sngr_utils.robust import association, misfit
from sngr_utils.robust.em import SoftEstimate
from sngr_utils.robust.misfit import Misfit
from sngr_utils.world.dead_reckoning import relative_motion, wrap_angle
from sngr_utils.world.log import NO_LABEL, Log

RUN = 3  # consecutive poses whose ranges are looked at together, and twice as many, and so on
# Set for what they mean; on development worlds of the kinds of `experiments.every_world`, seeds 200
# to 224 and 300 to 317, few sound estimates are outside.
MOST_UNEXPLAINED = 0.5  # share of the ranges: the majority must be from a landmark
RARE = 0.01  # p-value that is no chance
POSSIBLE = 0.5  # and one that is worth a question
VAGUE = 5.0  # range sigmas, of a prediction above which it cannot tell landmarks apart
MOST_RESIDUAL = 1.6  # variance over what is told: range sigmas that are told a fifth too small
LEAST_RESIDUAL = 0.5  # and too large by two fifths
LEAST_EXTENT = 2.0  # of the way, in errors of its positions: less is standing still
HELD_OUT = 10  # one range of so many is held out
FIRM = 1e-3  # of the sigmas of the first pose: what all poses err by together foretells as well
LEAST_RIVAL = np.log(100.0)  # nats: odds of a hundred to one


Fit = Callable[[Log, tuple[np.ndarray, np.ndarray]], SoftEstimate]


class DoubtWarning(UserWarning):
    """The result may be wrong."""


@dataclass(frozen=True)
class Diagnosis:
    """What there is to doubt.

    Attributes
    ----------
    unexplained : share of the ranges that is assigned to no landmark
    held_out : share of every tenth range that fits nothing that the others foretell
    held_out_p : its p-value, if such ranges are as many as among all
    worst_run : p-value of the run of poses with the most of them, see `worst_run`
    residual : squared normalised residuals of the steps and of what is assigned, per degree of
        freedom
    residual_p : the chance that they are as small as that
    worst_step : p-value of the worst step of the odometry, for as many as there are
    drift : what every step, or range, seems to be wrong by, see `misfit.worst`
    rival : by how much the best other estimate is less likely, [nats]; infinite if there is none
    vague : sigma of a position, over the poses in the mean square, in range sigmas; infinite
        without ranges
    extent : of the way, in errors of its positions; infinite without a landmark that is found and
        not surveyed
    reasons : in words; empty if there is no doubt
    """

    unexplained: float
    held_out: float
    held_out_p: float
    worst_run: float
    residual: float
    residual_p: float
    worst_step: float
    drift: Misfit
    rival: float
    vague: float
    extent: float

    @property
    def reasons(self) -> tuple[str, ...]:
        """What there is to doubt, in words."""
        tests = {
            f"{self.unexplained:.0%} of the ranges fit nothing":
                self.unexplained > MOST_UNEXPLAINED,
            f"{self.held_out:.0%} of held-out ranges fit nothing (p {self.held_out_p:.0e})":
                self.held_out_p < RARE,
            f"some poses have too many ranges that fit nothing (p {self.worst_run:.0e})":
                self.worst_run < RARE,
            f"residuals have {self.residual:.1f} times the variance told":
                self.residual > MOST_RESIDUAL
                or (self.residual < LEAST_RESIDUAL and self.residual_p < RARE),
            f"a step of the odometry is missed (p {self.worst_step:.0e})": self.worst_step < RARE,
            f"odometry and map disagree by a drift {self.drift.name} "
            f"(of {self.drift.size:.1f} sigmas, p {self.drift.p_value:.0e})":
                self.drift.p_value < RARE,
            f"another estimate is less likely by {self.rival:.1f} nats only":
                self.rival < LEAST_RIVAL,
            f"positions err by {self.vague:.0f} range sigmas": self.vague > VAGUE,
            f"the way is {self.extent:.1f} times as wide as its positions err":
                self.extent < LEAST_EXTENT,
        }  # fmt: skip
        return tuple(reason for reason, holds in tests.items() if holds)

    @property
    def doubtful(self) -> bool:
        return len(self.reasons) > 0


def diagnose(log: Log, found: SoftEstimate, rival: float, fit: Fit) -> Diagnosis:
    """What there is to doubt of an estimate.

    Parameters
    ----------
    rival : see `Diagnosis`
    fit : EM over a log from (T, 3) poses and (K, 2) landmarks
    """
    none = found.weights[:, -1]
    held_out, held_out_p = foretold(log, found, fit)
    residuals = association.residuals(log, found.poses, found.landmarks, found.calibration)
    squared = np.nansum(found.responsibilities * (residuals / log.range_sigmas[:, None]) ** 2)
    squared += np.sum(_missed(log, found.poses) ** 2)  # as many as they set poses free
    placed = np.isfinite(found.landmarks[:, 0]) & ~log.surveyed
    freedom = (1 - none).sum() - 2 * placed.sum()
    spread = np.sqrt(found.position_covariances.trace(axis1=1, axis2=2).mean() / 2)
    return Diagnosis(
        unexplained=float(none.mean()) if len(none) else 0.0,
        held_out=held_out,
        held_out_p=held_out_p,
        worst_run=worst_run(log, none),
        residual=float(squared / freedom) if freedom > 0 else 1.0,
        residual_p=float(stats.chi2.cdf(squared, freedom)) if freedom > 0 else 1.0,
        worst_step=worst_step(log, found.poses),
        drift=misfit.worst(log, found),
        rival=float(rival),
        vague=float(spread / np.median(log.range_sigmas)) if len(log.ranges) else np.inf,
        extent=found.moved(found.poses - found.poses.mean(axis=0)) if placed.any() else np.inf,
    )


def foretold(log: Log, found: SoftEstimate, fit: Fit) -> tuple[float, float]:
    """Share of every tenth range that is nobody's in an estimate without them, and its p-value.

    That is for as large a share of nobody's ranges as among all, which the estimate has seen.
    """
    held = np.arange(len(log.ranges)) % HELD_OUT == HELD_OUT // 2
    if not held.any():
        return 0.0, 1.0
    seen = log.keep(~held)._with(x0_mean=found.poses[0], x0_sigmas=FIRM * log.x0_sigmas)
    other, asked = fit(seen, (found.poses, found.landmarks)), log.keep(held)
    residuals = association.residuals(asked, other.poses, other.landmarks, other.calibration)
    spread = other.position_covariances.trace(axis1=1, axis2=2)[asked.pose_of] / 2
    variances = np.broadcast_to((asked.range_sigmas**2 + spread)[:, None], residuals.shape)
    joint = association.log_joint(asked, residuals, variances, other.shares)
    none = association.posterior(joint)[:, -1].sum()
    share = (found.weights[:, -1].sum() + 0.5) / (len(log.ranges) + 1)
    return float(none / held.sum()), float(stats.binom.sf(np.round(none) - 1, held.sum(), share))


def worst_run(log: Log, bad: np.ndarray, shortest: int = RUN) -> float:
    """p-value of the run of poses with the most bad ranges, if they were spread evenly.

    Runs double in length up to half of all poses. The value is for as many as there are; they
    overlap, so that it is too large rather than too small.

    Parameters
    ----------
    bad : (M,) of each range, from 0 to 1
    shortest : run, in poses
    """
    if len(log.ranges) == 0:
        return 1.0
    share = (bad.sum() + 0.5) / (len(bad) + 1)
    bads = np.bincount(log.pose_of, bad, minlength=log.n_poses)
    counts, tails = np.bincount(log.pose_of, minlength=log.n_poses), []
    doublings = int(np.log2(max(log.n_poses / (2 * shortest), 1)))
    for length in shortest * 2 ** np.arange(doublings + 1):
        some, all_ = (_in_runs(each, min(length, log.n_poses)) for each in (bads, counts))
        tails.append(stats.binom.sf(np.round(some) - 1, np.round(all_), share))
    tails = np.concatenate(tails)
    return float(min(1.0, tails.min() * len(tails)))


def _in_runs(values: np.ndarray, length: int) -> np.ndarray:
    """Sums of so many consecutive values."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return total[length:] - total[:-length]


def worst_step(log: Log, poses: np.ndarray) -> float:
    """p-value of the worst step of the odometry, see `Diagnosis`.

    An estimate follows its odometry, so that it misses it by less than the noise: the value is
    too large rather than too small. A step that slipped counts by what is trusted of it.
    """
    if log.n_poses < 2:
        return 1.0
    squared = np.sum(_missed(log, poses) ** 2, axis=1)
    return float(min(1.0, stats.chi2.sf(squared.max(), 3) * len(squared)))


def _missed(log: Log, poses: np.ndarray) -> np.ndarray:
    """(T-1, 3) by how much the steps of the odometry are missed, in sigmas of their noise."""
    missed = relative_motion(poses) - log.odometry
    missed[:, 2] = wrap_angle(missed[:, 2])
    lower = np.linalg.cholesky(log.odometry_covariances)
    return np.linalg.solve(lower, missed[..., None])[..., 0]


def may_have_slipped(log: Log, found: SoftEstimate) -> bool:
    """Is it worth while to ask which of the steps has slipped?

    If one did, it is missed, or wrong labels explain the poses on its other side: they come in a
    run, perhaps of one pose.
    """
    run = worst_run(log, unlike_labels(log, found), 1)
    return worst_step(log, found.poses) < POSSIBLE or run < POSSIBLE


def unlike_labels(log: Log, found: SoftEstimate) -> np.ndarray:
    """(M,) probability that a range is not from its label's landmark; without one, from none."""
    right = found.weights[np.arange(len(log.ranges)), log.label_of]
    return 1 - np.where(log.label_of == NO_LABEL, 1 - found.weights[:, -1], right)
