"""Batch optimisation to convergence, by GTSAM."""

import gtsam

from sngr_utils.slam.solution import Solution


def optimise(graph: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> gtsam.Values:
    """Levenberg-Marquardt until nothing is gained; robust losses are reweighted."""
    # GTSAM's own defaults let lambda underflow to 0, which no factor raises again: a hang
    params = gtsam.LevenbergMarquardtParams.CeresDefaults()
    params.setMaxIterations(1000)
    params.setRelativeErrorTol(1e-12)
    params.setAbsoluteErrorTol(1e-9)
    return gtsam.LevenbergMarquardtOptimizer(graph, start, params).optimize()


def converge(solution: Solution, how: str = "batch", updates: int = 10) -> Solution:
    """The same factors with their estimate settled; `solution` is left as it was.

    "batch" is the default. iSAM2 leaves alone what moved by less than its relinearisation
    threshold, so no number of updates makes its gradient zero.

    Parameters
    ----------
    how : "batch", Levenberg-Marquardt from the estimate (`isam` then stays that of the input),
        or "updates", that many empty updates of iSAM2
    updates : for "updates" only

    Raises
    ------
    ValueError : unknown `how`
    """
    isam = gtsam.ISAM2(solution.isam)
    if how == "updates":
        for _ in range(updates):
            isam.update()
        estimate = isam.calculateEstimate()
    elif how == "batch":
        estimate = optimise(solution.graph, solution.estimate)
    else:
        raise ValueError(f"how is {how!r}: it must be 'batch' or 'updates'")
    return Solution(isam, solution.graph, estimate, solution.n_poses, solution.n_landmarks)
