"""Noise from the data: the sigmas under which a log is most likely, with their errors.

The log likelihood of the sigmas is that of the data with poses and landmarks integrated out, to
second order about the estimate. A sigma is right where the squared residuals that the estimate
leaves, and the spread it leaves open, add up to what the sigma says. Of little data that is often
zero, which no odometry has. So the sigma of all steps has a prior, for position and for heading,
half-Cauchy and as wide as the log tells it; and what is largest is the density of its logarithm.
The prior counts for one residual at most, so that noise which is told wrong does no harm where the
data hold it; where they do not, it stays near what is told.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sngr_utils.slam import chain_problem, chain_solver
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.dead_reckoning import relative_motion, wrap_angle
from sngr_utils.world.log import Log

# What an odometry step's noise may grow with, and the unit of its sigma
SOURCES = {
    "position per root metre": "m / sqrt(m)",
    "position per step": "m",
    "heading per root metre": "rad / sqrt(m)",
    "heading per root radian": "rad / sqrt(rad)",
    "heading per step": "rad",
}
RANGE = "range factor"  # on the sigmas that the log gives
ROUNDS, LEAP = 60, 1.0  # at most, and the longest move of the logarithm of a sigma
SETTLED = 0.05  # nats that a round still gains
LEAST = 1e-3  # of the start: no sigma falls below it
ABSENT = 1e-2  # of the variance of all steps: a source that has less is not there
STANDING = 1e-2  # of the mean step: a step of no length has some noise all the same
NUDGE = 0.02  # of the logarithm of a sigma, by which the curvature is taken
UNHELD = 3.0  # relative error of a sigma that the data do not hold
POLICY = chain_solver.CERES._replace(damping=1e-12)  # a start that is nearly there


@dataclass(frozen=True)
class Noise:
    """Sigmas found.

    Attributes
    ----------
    logarithms : (C+1,) of the sigmas of `SOURCES` and of the factor on the ranges'
    present : (C+1,) False for a source that the data take for nothing
    log : with these sigmas
    estimate : of the log, at these sigmas
    """

    logarithms: np.ndarray
    present: np.ndarray
    log: Log
    estimate: chain_solver.Estimate
    _likelihood: "Likelihood"

    @property
    def sigmas(self) -> dict[str, float]:
        """By name; 0 for what is not there."""
        values = np.where(self.present, np.exp(self.logarithms), 0.0)
        return dict(zip([*SOURCES, RANGE], values.tolist(), strict=True))

    @cached_property
    def errors(self) -> dict[str, float]:
        """Relative standard error of each sigma; infinite for what is not there.

        It is never more than `UNHELD`, which says that the data do not hold the sigma.
        """
        found = np.flatnonzero(self.present)
        rows = []
        for i in found:
            step = np.where(np.arange(len(self.present)) == i, NUDGE, 0.0)
            slopes = [self._likelihood.slope(self.logarithms + sign * step) for sign in (1, -1)]
            rows.append((slopes[0] - slopes[1])[found] / (2 * NUDGE))
        curvatures, axes = np.linalg.eigh(-0.5 * (np.array(rows) + np.transpose(rows)))
        variances = axes**2 @ (1 / np.maximum(curvatures, UNHELD**-2))
        errors = np.full(len(self.present), np.inf)
        errors[found] = np.sqrt(variances)
        return dict(zip([*SOURCES, RANGE], errors.tolist(), strict=True))


def estimate(
    log: Log,
    poses: np.ndarray,
    landmarks: np.ndarray,
    weights: np.ndarray,
    *,
    landmark_prior_sigma: float,
) -> Noise:
    """The sigmas of ranges and odometry that make a log most likely.

    Each round multiplies a variance by what is seen of it over what is expected, given what the
    estimate has taken up.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2), an estimate to start from
    weights : (M, K) how much each range counts as one of each landmark

    Raises
    ------
    ValueError : fewer than three poses

    Source: Patterson, Thompson, Biometrika 58, 1971, on variances with what is estimated beside
    them integrated out; MacKay, Neural Computation 4, 1992, on the rounds; Gelman,
    Bayesian Analysis 1, 2006, on the prior.
    """
    if log.n_poses < 3:
        raise ValueError(f"{log.n_poses} poses: noise needs three")
    likelihood = Likelihood(log, poses, landmarks, weights, landmark_prior_sigma)
    at = start = likelihood.start()
    for _ in range(ROUNDS):
        seen, expected = likelihood.balance(at)
        move = np.clip(0.5 * np.log(np.maximum(seen, 1e-300) / expected), -LEAP, LEAP)
        move = np.maximum(at + move, start + np.log(LEAST)) - at
        at = at + move
        if move @ (seen - expected) < SETTLED:
            break
    found = likelihood.solve(at)
    return Noise(at, likelihood.present(at), likelihood.log_at(at), found, likelihood)


def shapes(odometry: np.ndarray) -> np.ndarray:
    """(C, T-1, 3, 3) covariances of steps for a sigma of 1 of each of `SOURCES`.

    A heading that errs all along a step moves its end aside, by a third of the squared length.
    """
    lengths = np.hypot(odometry[:, 0], odometry[:, 1])
    lengths = np.maximum(lengths, STANDING * lengths.mean())
    cos, sin = np.cos(odometry[:, 2]), np.sin(odometry[:, 2])
    x, y = odometry[:, 0], odometry[:, 1]
    aside = np.stack([sin * x - cos * y, cos * x + sin * y, np.ones(len(x))], axis=1)  # at the end
    swept = aside[:, :, None] * aside[:, None, :]
    swept[:, :2, :2] /= 3
    swept[:, :2, 2] /= 2
    swept[:, 2, :2] /= 2
    position, heading = np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0])
    metres, turned = lengths[:, None, None], np.abs(odometry[:, 2])[:, None, None]
    one = np.ones_like(metres)
    return np.array([
        metres * position, one * position, metres * swept, turned * swept, one * heading,
    ])  # fmt: skip


def step_covariances(sigmas: Mapping[str, float], odometry: np.ndarray) -> np.ndarray:
    """(T-1, 3, 3) of the steps, from the sigma of each of `SOURCES`."""
    variances = np.array([sigmas[name] for name in SOURCES]) ** 2
    return np.einsum("c,ctij->tij", variances, shapes(odometry))


class Likelihood:
    """Of the logarithms of the sigmas, poses and landmarks integrated out; with the prior."""

    def __init__(
        self,
        log: Log,
        poses: np.ndarray,
        landmarks: np.ndarray,
        weights: np.ndarray,
        landmark_prior_sigma: float,
    ):
        chain = chain_problem.of_log(log, landmarks, landmark_prior_sigma)
        self.chain = chain_problem.weighted(chain, weights, 1.0, 0.0)
        self.log, self.shapes = log, shapes(log.odometry)
        given = log.odometry_covariances.sum(axis=0)
        self.told = np.array([given[0, 0] + given[1, 1], given[2, 2]])  # of position and heading
        self.at = poses, landmarks, chain.calibration_means

    def start(self) -> np.ndarray:
        """Logarithms of sigmas that share alike what the log gives."""
        total = self.shapes.sum(axis=1)
        shared = np.array([self.told[0] / 4] * 2 + [self.told[1] / 3] * 3)
        total = np.append(total[:2, 0, 0], total[2:, 2, 2])
        # what no step has, because none turns, say, is left with no noise
        return np.append(
            0.5 * np.log(np.where(total > 0, shared / np.where(total > 0, total, 1), 1e-30)), 0.0
        )

    def present(self, sigmas: np.ndarray) -> np.ndarray:
        """(C+1,) whether a source has a share in the variance of position or heading."""
        variances = self._variances(sigmas)
        return np.append((variances / variances.sum(axis=0)).max(axis=1) > ABSENT, True)

    def _variances(self, sigmas: np.ndarray) -> np.ndarray:
        """(C, 2) of position and heading that each source has, all steps together; not zero."""
        traces = np.exp(2 * sigmas[:-1, None]) * np.diagonal(self.shapes.sum(axis=1), 0, 1, 2)
        traces = np.column_stack([traces[:, :2].sum(axis=1), traces[:, 2]])
        return np.maximum(traces, np.finfo(float).tiny)

    def log_at(self, sigmas: np.ndarray) -> Log:
        """The log with these sigmas."""
        return replace(
            self.log,
            odometry_covariances=self._covariances(sigmas),
            range_sigmas=np.exp(sigmas[-1]) * self.log.range_sigmas,
        )

    def solve(self, sigmas: np.ndarray) -> chain_solver.Estimate:
        """The estimate under these sigmas, from the one before."""
        chain = self._chain(sigmas)
        start = chain_solver.state_of(chain, *self.at[:2])._replace(calibration=self.at[2].copy())
        found = chain_solver.minimise(chain, LEAST_SQUARES, POLICY, start)
        found = chain_solver.concluded(chain, LEAST_SQUARES, *found)
        self.at = found.poses, found.landmarks, found.calibration
        return found

    def balance(self, sigmas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared residuals of each source in its sigmas, and how much they should be.

        What they should be is the number of residuals less what the estimate has fitted. The prior
        on position and that on heading are shared by their sources.
        """
        found, chain = self.solve(sigmas), self._chain(sigmas)
        information = chain.step_information
        residuals, spread = steps(self.log.odometry, found)
        pull = np.einsum("tij,tj->ti", information, residuals)
        share = information - information @ spread @ information
        variances = np.exp(2 * sigmas[:-1])
        seen = variances * np.einsum("ctij,tij->c", self.shapes, pull[:, :, None] * pull[:, None])
        expected = variances * np.einsum("ctij,tij->c", self.shapes, share)
        of_ranges = np.sum(chain.weights * (found.residuals / chain.sigmas) ** 2)
        free = 3 * len(found.poses) + found.landmarks.size + np.count_nonzero(chain.columns >= 0)
        by_ranges = free - np.einsum("tij,tji->", information, spread) - _by_priors(chain, found)
        own = self._variances(sigmas)
        total = own.sum(axis=0)
        seen += (own / total) @ (2 / (1 + total / self.told))
        expected += (own / total).sum(axis=1)
        return (
            np.append(seen, of_ranges),
            np.maximum(np.append(expected, chain.weights.sum() - by_ranges), 1e-300),
        )

    def slope(self, sigmas: np.ndarray) -> np.ndarray:
        """(C+1,) of the log likelihood."""
        return np.subtract(*self.balance(sigmas))

    def value(self, sigmas: np.ndarray) -> float:
        """The log likelihood with the prior, but for a constant."""
        found, chain = self.solve(sigmas), self._chain(sigmas)
        told = 0.5 * np.linalg.slogdet(chain.step_information)[1].sum()
        told -= chain.weights.sum() * sigmas[-1]
        total = self._variances(sigmas).sum(axis=0)
        prior = np.sum(0.5 * np.log(total) - np.log1p(total / self.told))
        return float(told + prior - found.cost - 0.5 * found.log_determinant)

    def _covariances(self, sigmas: np.ndarray) -> np.ndarray:
        return np.einsum("c,ctij->tij", np.exp(2 * sigmas[:-1]), self.shapes)

    def _chain(self, sigmas: np.ndarray) -> Chain:
        return self.chain._replace(
            step_information=np.linalg.inv(self._covariances(sigmas)),
            sigmas=np.exp(sigmas[-1]) * self.chain.sigmas,
        )


def steps(odometry: np.ndarray, found: chain_solver.Estimate) -> tuple[np.ndarray, np.ndarray]:
    """(T-1, 3) residuals of the odometry, and (T-1, 3, 3) how far the estimate leaves them open.

    In the frame of the end of a step.
    """
    motion = relative_motion(found.poses)
    back, blocks = carried(motion), found.covariance
    cross = back @ blocks.first
    spread = back @ blocks.poses[:-1] @ back.swapaxes(1, 2) + blocks.poses[1:]
    dx, dy, turned = (motion - odometry).T
    cos, sin = np.cos(motion[:, 2]), np.sin(motion[:, 2])
    residuals = [cos * dx + sin * dy, -sin * dx + cos * dy, wrap_angle(turned)]
    return np.stack(residuals, axis=1), spread - cross - cross.swapaxes(1, 2)


def carried(motion: np.ndarray) -> np.ndarray:
    """(T-1, 3, 3) how the end of each step moves with its beginning, each in its own frame."""
    x, y, turn = motion.T
    cos, sin = np.cos(turn), np.sin(turn)
    back = np.zeros((len(motion), 3, 3))
    back[:, 0, 0], back[:, 0, 1], back[:, 1, 0], back[:, 1, 1] = cos, sin, -sin, cos
    back[:, 0, 2], back[:, 1, 2], back[:, 2, 2] = sin * x - cos * y, cos * x + sin * y, 1.0
    return back


def _by_priors(chain: Chain, found: chain_solver.Estimate) -> float:
    """Degrees of freedom that the priors hold; an absent landmark is held by nothing else."""
    blocks = found.covariance
    variances = np.diagonal(blocks.landmarks).reshape(-1, 2).sum(axis=1)
    calibration = np.diagonal(found.calibration_covariance)
    return float(
        np.sum(chain.prior_information * blocks.poses[0])
        + np.nansum(chain.landmark_information * variances)
        + 2 * np.count_nonzero(np.isnan(variances))
        + np.sum(chain.calibration_information[chain.columns >= 0] * calibration)
    )
