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

from sngr_utils.numerics.jit import compile_once
from sngr_utils.slam.factors import range_derivatives
from sngr_utils.slam.selected_inverse import ChainCovariance
from sngr_utils.sngr.windows import WIDTH, n_windows
from sngr_utils.world.simulation import World

NO_FREEDOM = 1e-3  # of a residual's variance: below it the fit takes up the error, and hides it
AT_ONCE = 1000  # windows whose leverage is held in memory at a time


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
    covariance : the joint marginals there, see `selected_inverse`

    Source: Cook & Weisberg, Residuals and Influence in Regression, 1982, section 2.1 (leverage);
    Rao & Mitra, Generalized Inverse of Matrices, 1971, section 9.2 (the law of q).
    """
    used = np.flatnonzero(np.isfinite(landmarks[world.label_of, 0]))
    pose_of, label_of = world.pose_of[used], world.label_of[used]
    distances, by_pose, by_landmark = range_derivatives(poses[pose_of], landmarks[label_of])
    sigma = world.scenario.range_sigma
    rows, residuals = np.hstack([by_pose, by_landmark]) / sigma, world.ranges[used] - distances
    first = np.arange(n_windows(len(poses)))
    start, stop = np.searchsorted(pose_of, first), np.searchsorted(pose_of, first + WIDTH)
    most, parts = (stop - start).max(), []
    for some in np.array_split(first, -(-len(first) // AT_ONCE)):
        filled = start[some, None] + np.arange(most) < stop[some, None]
        index = np.where(filled, start[some, None] + np.arange(most), 0)
        leverage = np.zeros((len(some), most, most))
        _leverage(
            start[some], stop[some], pose_of, label_of, rows, covariance.poses, covariance.first,
            covariance.second, covariance.pose_landmark, covariance.landmarks, leverage,
        )  # fmt: skip
        # shorter windows are filled up with zeros
        whitened = np.where(filled, residuals[index] / sigma, 0.0)
        statistic, rank = quadratic_form(whitened, np.eye(most) - leverage)
        parts.append((statistic, rank - np.sum(~filled, axis=1), np.sum(whitened**2, axis=1)))
    statistic, rank, squares = (np.concatenate(part) for part in zip(*parts, strict=True))
    return ChiSquare(statistic, rank, squares, stop - start)


@compile_once
def _leverage(start, stop, pose_of, label_of, rows, own, first, second, cross, landmarks, out):
    """A_w Sigma_w A_w^T of N windows into `out`, (N, n, n), from the blocks of Sigma_w it needs.

    rows : (M, 4) derivatives of whitened ranges by their position, body frame, and landmark
    own, first, second, cross, landmarks : the fields of `ChainCovariance`
    """
    for w in range(len(start)):
        for a in range(start[w], stop[w]):
            for b in range(start[w], a + 1):  # the pose of b is no later than that of a
                s, t, j_b, j_a = pose_of[b], pose_of[a], 2 * label_of[b], 2 * label_of[a]
                total = 0.0
                for i in range(2):
                    for j in range(2):
                        if t == s:
                            pose = own[s, i, j]
                        elif t == s + 1:
                            pose = first[s, i, j]
                        else:
                            pose = second[s, i, j]
                        total += rows[b, i] * pose * rows[a, j]
                        total += rows[b, i] * cross[s, i, j_a + j] * rows[a, 2 + j]
                        total += rows[a, i] * cross[t, i, j_b + j] * rows[b, 2 + j]
                        total += rows[b, 2 + i] * landmarks[j_b + i, j_a + j] * rows[a, 2 + j]
                out[w, a - start[w], b - start[w]] = out[w, b - start[w], a - start[w]] = total


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
