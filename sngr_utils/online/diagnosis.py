"""What a result says of itself, without the truth: does it explain what was measured?

Everything is a number that is known for a sound estimate: ranges that nothing explains are spread
evenly, what is predicted errs as it says, odometry is missed by its noise, and no other estimate
of the same data is as likely.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from sngr_utils.robust import association
from sngr_utils.robust.em import SoftEstimate
from sngr_utils.world.dead_reckoning import relative_motion, wrap_angle
from sngr_utils.world.log import Log

MEDIAN = stats.chi2.ppf(0.5, 1)  # of a squared normalised innovation
RUN = 3  # consecutive poses whose ranges are looked at together

# Set on development worlds of the kinds of `experiments.every_world`, seeds 100 to 119, so that
# few sound estimates are outside; on other worlds the study says how many are, and how many lost
# ones are not.
MOST_UNEXPLAINED = 0.27
RARE_RUN = 0.05
MOST_SURPRISE = 6.0
MOST_RESIDUAL = 1.6
MOST_MISSED = 0.55
WORST_STEP = 10.0
LEAST_RIVAL = 3.0  # nats


class DoubtWarning(UserWarning):
    """The result may be wrong."""


@dataclass(frozen=True)
class Diagnosis:
    """What there is to doubt.

    Attributes
    ----------
    unexplained : share of the ranges that is assigned to no landmark
    worst_run : p-value of the run of `RUN` poses with the most of them, for as many runs as there
        are, if they were spread evenly
    surprise : median squared normalised innovation of assigned ranges of the last third of the
        poses, predicted before they were used, over that of a chi-square; 1 if all is well
    residual : mean squared normalised residual of what is assigned, per degree of freedom
    odometry : the same of trusted steps, squared error over its covariance, 3 degrees each
    worst_step : squared normalised error of the worst trusted step
    rival : by how much the best other estimate is less likely, [nats]; infinite if there is none
    reasons : in words; empty if there is no doubt
    """

    unexplained: float
    worst_run: float
    surprise: float
    residual: float
    odometry: float
    worst_step: float
    rival: float

    @property
    def misfits(self) -> tuple[str, ...]:
        """What of the data the estimate does not explain, in words."""
        tests = {
            f"{self.unexplained:.0%} of the ranges fit nothing":
                self.unexplained > MOST_UNEXPLAINED,
            f"some poses have too many ranges that fit nothing (p {self.worst_run:.0e})":
                self.worst_run < RARE_RUN,
            f"residuals are {self.residual:.1f} times the noise": self.residual > MOST_RESIDUAL,
            f"odometry is missed by {self.odometry:.1f} times its noise":
                self.odometry > MOST_MISSED,
            f"a step is missed by {self.worst_step**0.5:.1f} sigmas": self.worst_step > WORST_STEP,
        }  # fmt: skip
        return tuple(misfit for misfit, holds in tests.items() if holds)

    @property
    def reasons(self) -> tuple[str, ...]:
        """What there is to doubt, in words."""
        tests = {
            f"ranges err {self.surprise:.1f} times as predicted": self.surprise > MOST_SURPRISE,
            f"another estimate is less likely by {self.rival:.1f} nats only":
                self.rival < LEAST_RIVAL,
        }  # fmt: skip
        return self.misfits + tuple(reason for reason, holds in tests.items() if holds)

    @property
    def doubtful(self) -> bool:
        return len(self.reasons) > 0


def diagnose(
    log: Log, told: np.ndarray, found: SoftEstimate, predicted: list[np.ndarray], rival: float
) -> Diagnosis:
    """What there is to doubt of an estimate.

    Parameters
    ----------
    told : (T-1, 3, 3) covariances of the odometry as measured
    predicted : squared normalised innovations of the assigned ranges of each pose
    rival : see `Diagnosis`
    """
    none = found.weights[:, -1]
    residuals = association.residuals(log, found.poses, found.landmarks)
    squared = np.nansum(found.responsibilities * (residuals / log.range_sigmas[:, None]) ** 2)
    freedom = (1 - none).sum() - 2 * np.isfinite(found.landmarks[:, 0]).sum()
    recent = np.concatenate([np.empty(0), *predicted[-max(log.n_poses // 3, 1) :]])
    odometry, worst_step = steps_missed(log, told, found.poses)
    return Diagnosis(
        unexplained=float(none.mean()) if len(none) else 0.0,
        worst_run=worst_run(log, none),
        surprise=float(np.median(recent) / MEDIAN) if len(recent) else 1.0,
        residual=float(squared / freedom) if freedom > 0 else 1.0,
        odometry=odometry,
        worst_step=worst_step,
        rival=float(rival),
    )


def worst_run(log: Log, weights_none: np.ndarray) -> float:
    """p-value of the run of poses with the most ranges that fit nothing, see `Diagnosis`."""
    if len(log.ranges) == 0:
        return 1.0
    share = (weights_none.sum() + 0.5) / (len(weights_none) + 1)
    kernel = np.ones(min(RUN, log.n_poses))
    none, all_ = (
        np.convolve(np.bincount(log.pose_of, w, minlength=log.n_poses), kernel, "valid")
        for w in (weights_none, np.ones(len(weights_none)))
    )
    tails = stats.binom.sf(np.round(none) - 1, all_.astype(int), share)
    return float(min(1.0, tails.min() * len(tails)))


def steps_missed(log: Log, told: np.ndarray, poses: np.ndarray) -> tuple[float, float]:
    """Mean and largest squared normalised error of the steps of the odometry that are trusted.

    Parameters
    ----------
    told : (T-1, 3, 3) covariances as measured; where those of the log are others, it slipped
    """
    trusted = (log.odometry_covariances == told).all(axis=(1, 2))
    if not trusted.any():
        return 0.0, 0.0
    missed = (relative_motion(poses) - log.odometry)[trusted]
    missed[:, 2] = wrap_angle(missed[:, 2])
    squared = np.einsum("ti,tij,tj->t", missed, np.linalg.inv(told[trusted]), missed)
    return float(squared.mean() / 3), float(squared.max())
