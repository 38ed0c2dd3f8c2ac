"""The linear problem of a Gauss-Newton step, and what notebook 02 makes of it from scratch."""

import numpy as np
import pytest
from helpers import cells_from_scratch

from sngr_utils.slam import equations
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.slam.levenberg_marquardt import converge
from sngr_utils.sngr import baseline
from sngr_utils.world.scenario import Scenario


@pytest.fixture(scope="module")
def from_scratch():
    """What the notebook's cells tagged "from-scratch" define."""
    return cells_from_scratch("02_trigger_sweep")


def test_rotations_give_the_r_of_numpy_and_the_least_squares_solution(from_scratch):
    rng = np.random.default_rng(0)
    rows, values = rng.normal(size=(30, 7)), rng.normal(size=30)
    R, b, cost = from_scratch["square_root"](rows, values)
    theirs = np.linalg.qr(rows, mode="r")
    assert np.allclose(R, np.sign(np.diag(theirs))[:, None] * theirs)
    step, squares, *_ = np.linalg.lstsq(rows, values)
    assert np.allclose(np.linalg.solve(R, b), step)
    assert cost == pytest.approx(0.5 * squares[0])


def test_equations_are_gtsams_at_the_estimate(clean):
    """The cost of their right-hand side is the graph's, a row for each scalar measurement."""
    J, right = equations.linearised(clean.solution, clean.solution.estimate)
    assert 0.5 * right @ right == pytest.approx(clean.solution.graph.error(clean.solution.estimate))
    n_ranges = len(clean.world.ranges)
    assert J.shape == (3 * clean.world.n_poses + n_ranges + 2 * 6, 3 * clean.world.n_poses + 2 * 6)


@pytest.mark.parametrize("p", [0.0, 0.3])
def test_window_covariances_and_scores_from_r_are_the_librarys(from_scratch, p):
    base = baseline.run_baseline(Scenario(), PRESETS["C"], p, 0)
    R, *_ = from_scratch["square_root"](
        *equations.linearised(base.solution, base.solution.estimate)
    )
    for t in (0, 13, 27):
        ours = from_scratch["window_covariance"](R, t)
        assert np.allclose(ours, base.covariances[t], rtol=1e-6, atol=1e-12)
        assert from_scratch["score"](ours) == pytest.approx(base.scores[t], abs=1e-6)


def test_gauss_newton_by_rotations_ends_where_gtsam_does(from_scratch, clean):
    """From dead reckoning, with promises that come true at the end."""
    at = equations.start_of(clean.world)
    for _ in range(5):
        R, b, promised = from_scratch["square_root"](*equations.linearised(clean.solution, at))
        at = equations.moved(clean.solution, at, np.linalg.solve(R, b))
    assert clean.solution.graph.error(at) == pytest.approx(promised, rel=1e-9)
    best = clean.solution.graph.error(converge(clean.solution).estimate)
    assert promised == pytest.approx(best, rel=1e-6)


def test_the_last_pose_touches_its_neighbour_and_the_landmarks_only(from_scratch, clean):
    """Of 30 poses and six landmarks: two poses and six landmarks, 18 rows."""
    J, right = equations.linearised(clean.solution, clean.solution.estimate)
    new = 3 + 6
    after, *_ = from_scratch["square_root"](J, right)
    before, *_ = from_scratch["square_root"](J[:-new], right[:-new])
    assert np.flatnonzero(np.abs(after - before).max(axis=1) > 1e-9).tolist() == [*range(84, 102)]
