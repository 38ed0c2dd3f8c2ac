"""Do the ranges of a window agree with the estimate? A chi-square test that knows leverage.

In the linearised problem A d = b with unit noise, the residuals at the optimum are
r = (I - A Sigma A^T) e, Sigma the joint marginal covariance of all variables. The ranges of a
window touch its poses and some landmarks only, so the rows of A that belong to them need only
the blocks of Sigma of these: H = A_w Sigma_w A_w^T, their *leverage* on their own fit. Hence
r_w ~ N(0, I - H), and q = r_w^T (I - H)^+ r_w follows chi-square with rank(I - H) degrees of
freedom: exactly if the problem is linear, the noise as assumed and the estimate at the optimum.
Counting squared residuals as if H were 0 overlooks that the fit has bent towards its data.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from sngr_utils.slam.selected_inverse import ChainCovariance
from sngr_utils.sngr.windows import WIDTH, n_windows
from sngr_utils.world.simulation import World

NO_FREEDOM = 1e-3  # of a residual's variance: below it the fit takes up the error, and hides it


@dataclass(frozen=True)
class ChiSquare:
    """The test of N windows.

    Attributes
    ----------
    statistic : (N,) q
    rank : (N,) int, its degrees of freedom; 0 for a window without ranges to test
    squares : (N,) the plain sum of squared whitened residuals
    count : (N,) int, the ranges in it
    """

    statistic: np.ndarray
    rank: np.ndarray
    squares: np.ndarray
    count: np.ndarray

    @property
    def surprise(self) -> np.ndarray:
        """(N,) -log10 of the p-value; 0 where there is nothing to test."""
        return _surprise(self.statistic, self.rank)

    @property
    def naive_surprise(self) -> np.ndarray:
        """(N,) the same as if no range had any leverage: the plain sum against chi-square."""
        return _surprise(self.squares, self.count)


def chi_square(
    world: World, poses: np.ndarray, landmarks: np.ndarray, covariance: ChainCovariance
) -> ChiSquare:
    """The leverage-corrected chi-square of every window's ranges.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2), the optimum that the residuals are taken at, [m, m,
        rad] and [m]; a NaN landmark is absent, with all its ranges
    covariance : the joint marginals there, see `chain`

    Source: Cook & Weisberg, Residuals and Influence in Regression, 1982, section 2.1 (leverage);
    Rao & Mitra, Generalized Inverse of Matrices, 1971, section 9.2 (the law of q).
    """
    used = np.flatnonzero(np.isfinite(landmarks[world.label_of, 0]))
    rows, residuals = _whitened(world, poses, landmarks, used)
    pose_of, first = world.pose_of[used], np.arange(n_windows(len(poses)))
    start, stop = np.searchsorted(pose_of, first), np.searchsorted(pose_of, first + WIDTH)
    place = np.arange((stop - start).max())  # shorter windows are filled up with rows of zeros
    filled = start[:, None] + place < stop[:, None]
    index = np.where(filled, start[:, None] + place, 0)
    jacobian = np.zeros((*index.shape, 3 * WIDTH + 2 * len(landmarks)))
    window, slot = np.nonzero(filled)
    which = index[filled]
    for i in range(3):
        jacobian[window, slot, 3 * (pose_of[which] - window) + i] = rows[which, i]
    jacobian[window, slot, 3 * WIDTH :] = rows[which, 3:]
    leverage = jacobian @ _joint(covariance) @ jacobian.transpose(0, 2, 1)
    whitened = np.where(filled, residuals[index], 0.0)
    statistic, rank = quadratic_form(whitened, np.eye(len(place)) - leverage)
    squares, count = np.sum(whitened**2, axis=1), stop - start
    return ChiSquare(statistic, rank - np.sum(~filled, axis=1), squares, count)


def quadratic_form(residuals: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, ...]:
    """r^T C^+ r of (N, n) residuals under (N, n, n) covariances, and the (N,) ranks of C.

    Directions with less than `NO_FREEDOM` of a unit variance count as without any.
    """
    values, vectors = np.linalg.eigh(covariances)
    kept = values > NO_FREEDOM
    along = (vectors.transpose(0, 2, 1) @ residuals[:, :, None])[:, :, 0]
    terms = np.where(kept, along**2 / np.where(kept, values, 1.0), 0.0)
    return terms.sum(axis=1), kept.sum(axis=1)


def _surprise(statistic: np.ndarray, rank: np.ndarray) -> np.ndarray:
    tail = log_tail(statistic, np.maximum(rank, 1))
    return np.where(rank > 0, -tail / np.log(10), 0.0)


def log_tail(statistic: np.ndarray, rank: np.ndarray) -> np.ndarray:
    """(N,) log probability that chi-square with `rank` degrees of freedom exceeds `statistic`.

    Wrong labels make statistics of many thousands, where the probability is 0 in floating point;
    there the first terms of its asymptotic series keep the order.

    Source: Abramowitz & Stegun, Handbook of Mathematical Functions, 1964, equation 6.5.32.
    """
    shape, x = rank / 2, np.maximum(statistic / 2, 1.0)
    series = (shape - 1) * np.log(x) - x - special.gammaln(shape)
    series = series + np.log1p((shape - 1) / x * (1 + (shape - 2) / x))
    with np.errstate(divide="ignore"):
        exact = stats.chi2.logsf(statistic, rank)
    return np.where(exact > -600, exact, series)


def _whitened(
    world: World, poses: np.ndarray, landmarks: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian rows [pose | landmarks] (n, 3 + 2K) and residuals (n,) of the ranges `used`.

    Both in units of the range sigma; the pose's tangent is in its own body frame.
    """
    own, label = poses[world.pose_of[used]], world.label_of[used]
    offset = landmarks[label] - own[:, :2]
    distance = np.linalg.norm(offset, axis=1)
    ahead = offset / distance[:, None]
    cos, sin = np.cos(own[:, 2]), np.sin(own[:, 2])
    rows = np.zeros((len(used), 3 + 2 * len(landmarks)))
    rows[:, 0] = -cos * ahead[:, 0] - sin * ahead[:, 1]
    rows[:, 1] = sin * ahead[:, 0] - cos * ahead[:, 1]
    for i in range(2):
        rows[np.arange(len(used)), 3 + 2 * label + i] = ahead[:, i]
    sigma = world.scenario.range_sigma
    return rows / sigma, (world.ranges[used] - distance) / sigma


def _joint(covariance: ChainCovariance) -> np.ndarray:
    """(N, 9 + 2K, 9 + 2K) joint covariance of each window's poses and all landmarks.

    Zero where a landmark is absent: no range used touches it.
    """
    n, size = len(covariance.second), len(covariance.landmarks)
    poses = 3 * WIDTH
    joint = np.empty((n, poses + size, poses + size))
    joint[:, :poses, :poses] = covariance.windows
    for i in range(WIDTH):
        joint[:, 3 * i : 3 * i + 3, poses:] = covariance.pose_landmark[i : i + n]
    joint[:, poses:, :poses] = joint[:, :poses, poses:].transpose(0, 2, 1)
    joint[:, poses:, poses:] = covariance.landmarks
    return np.nan_to_num(joint, nan=0.0)
