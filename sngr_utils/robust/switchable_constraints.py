"""Switchable constraints: every range has a switch, a variable that says how far it is believed.

The switch s multiplies the whitened residual r of its range, and a prior holds it at 1: a range
that would pull the trajectory apart is turned off at a bounded cost. Switches are variables of
the graph like poses and landmarks, and GTSAM solves for all of them together.
"""

from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, S, X
from scipy import integrate, optimize

from sngr_utils.robust import losses
from sngr_utils.slam import levenberg_marquardt, solution
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import range_derivatives, sure_factors
from sngr_utils.world import simulation


def _efficiency(c: float) -> float:
    """Asymptotic efficiency on Gaussian data of Geman and McClure's loss with the constant c.

    (E psi')^2 / E psi^2 of its influence psi. Source: Huber, Robust Statistics, 1981, ch. 4.
    """

    def weighted(r, function):  # the density written out, for speed: this runs at import
        return function((r / c) ** 2, r) * (np.exp(-r * r / 2) / np.sqrt(2 * np.pi))

    def mean(function):
        return integrate.quad(weighted, -9, 9, (function,))[0]

    slope = mean(lambda q, _: (1 - 3 * q) / (1 + q) ** 3)
    return slope**2 / mean(lambda q, r: r**2 / (1 + q) ** 4)


# Sigma of the switch prior. Eliminating the switch leaves Geman and McClure's loss with c =
# 1 / sigma. The authors' sigma is 1: that is the row "geman_mcclure" of the peers, and throws
# away half of what good ranges say. This one is 95 % efficient on Gaussian data, as the
# constants of Huber's and Cauchy's losses are.
SWITCH_SIGMA = 1 / optimize.brentq(lambda c: _efficiency(c) - 0.95, 1, 10)


def solve(
    the_world: simulation.World,
    conventions: Conventions,
    start: losses.Estimate,
    switch_sigma: float = SWITCH_SIGMA,
) -> solution.Solution:
    """Solve for poses, landmarks and one switch per range, all switches on at the start.

    The switch function is the identity, which the authors prefer to a sigmoid: at the optimum
    s = 1 / (1 + sigma^2 r^2) is between 0 and 1 without being told to.

    Parameters
    ----------
    start : (T, 3) poses [m, m, rad] and (K, 2) landmarks [m]; ranges to a NaN landmark are
        left out
    switch_sigma : of the prior on a switch, without unit

    Returns
    -------
    the solution with its switches, S(m) for range m; the marginals of its poses are over them

    Raises
    ------
    ValueError : switch_sigma is not positive

    Source: Suenderhauf & Protzel, Switchable constraints for robust pose graph SLAM, IROS 2012.
    """
    if not switch_sigma > 0:
        raise ValueError(f"switch_sigma is {switch_sigma!r}: it must be positive")
    poses, landmarks = start
    factors = gtsam.NonlinearFactorGraph(sure_factors(the_world, conventions, landmarks))
    values = solution.values_of(poses, landmarks)
    prior = gtsam.noiseModel.Isotropic.Sigma(1, switch_sigma)
    used = np.isfinite(landmarks[the_world.label_of, 0])
    for m in np.flatnonzero(used):
        factors.push_back(gtsam.PriorFactorDouble(S(m), 1.0, prior))
        values.insert(S(m), 1.0)
    for t in range(the_world.n_poses):
        here = np.flatnonzero(used & (the_world.pose_of == t))
        if len(here):
            factors.push_back(switched_ranges(the_world, t, here))
    result = levenberg_marquardt.levenberg_marquardt(factors, values)
    return solution.Solution(None, factors, result, the_world.n_poses, the_world.n_landmarks)


def switched_ranges(the_world: simulation.World, t: int, here: np.ndarray) -> gtsam.CustomFactor:
    """One factor for the (n,) ranges `here`, all of pose t: n residuals, each with its switch.

    One factor for each pose and not for each range: what costs is the call of Python.
    """
    labels = the_world.label_of[here]
    seen, column = np.unique(labels, return_inverse=True)
    keys = [X(t), *(L(k) for k in seen), *(S(m) for m in here)]
    noise = gtsam.noiseModel.Isotropic.Sigma(len(here), the_world.scenario.range_sigma)
    return gtsam.CustomFactor(noise, keys, _switched_error(the_world.ranges[here], column))


def _switched_error(ranges: np.ndarray, column: np.ndarray) -> Callable:
    """s (distance - range) of n ranges and its Jacobians, as GTSAM's CustomFactor asks for them.

    column : (n,) int, which of the factor's landmarks each range is to
    """
    n, n_seen = len(ranges), int(column.max()) + 1
    rows = np.arange(n)

    def error(this, values, jacobians):
        keys = this.keys()
        pose = values.atPose2(keys[0])
        landmarks = np.array([values.atPoint2(key) for key in keys[1 : 1 + n_seen]])
        switches = np.array([values.atDouble(key) for key in keys[1 + n_seen :]])
        distances, by_position, ahead = range_derivatives(
            solution.pose_vector(pose), landmarks[column]
        )
        residuals = distances - ranges
        if jacobians is not None:
            by_pose = np.zeros((n, 3), order="F")
            by_pose[:, :2] = switches[:, None] * by_position
            jacobians[0] = by_pose
            by_landmarks = np.zeros((n_seen, n, 2))
            by_landmarks[column, rows] = switches[:, None] * ahead
            by_switches = np.diag(residuals)
            for i in range(n_seen):
                jacobians[1 + i] = np.asfortranarray(by_landmarks[i])
            for i in range(n):
                jacobians[1 + n_seen + i] = by_switches[:, i : i + 1]
        return switches * residuals

    return error
