"""What a driver's parameter is when nobody sets it: what the paper states, typed once more.

Settings of a single module are held to the paper in that module's own tests.
"""

from sngr_utils import bimodal, cost, full_sngr, trigger_sweep
from sngr_utils.slam import landmark_starts


def test_landmarks_start_after_three_observations():
    assert landmark_starts.START_AFTER == 3


def test_sweep_and_pipeline():
    sweep = trigger_sweep.Config()
    assert (sweep.p_levels, sweep.seeds) == ([0.0, 0.1, 0.2, 0.3, 0.4], [0, 1, 2, 3, 4])
    assert (sweep.tau, sweep.tau_grid) == (3.96, [3.9, 3.92, 3.96, 4.0])
    assert (sweep.p_clean, sweep.p_noisy) == (0.0, 0.3)
    for config in (full_sngr.Config(), cost.Config()):
        assert (config.tau, config.seed, config.p_levels) == (3.9, 0, [0.0, 0.1, 0.2, 0.3])
    assert (full_sngr.Config().p_diagnosed, full_sngr.Config().p_noop) == (0.2, 0.3)


def test_bimodal():
    """Anchors at (0, 0) and (4, 0) that both measure 3 m, so that c = 50 finds (2, +-sqrt 5)."""
    config = bimodal.Config()
    assert (config.anchor_distance, config.measured_range, config.prior_scale) == (4, 3, 50)
    assert (config.n_live, config.min_walks, config.dlogz) == (100, 9, 0.5)
