"""What a setting is when nobody sets it: what the paper states, typed from it once more."""

import dynesty
import numpy as np

from sngr_utils import bimodal, cost, full_sngr, trigger_sweep
from sngr_utils.sampling import dynesty_nested, prior_transform
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.slam import landmark_starts
from sngr_utils.sngr import failure, gate, noop_baseline, trigger, windows
from sngr_utils.world import scenario


def test_scenario():
    """A circle of 5 m in 30 poses, 6 landmarks in [-4, 4]^2 m; 0.05 m, 0.01 rad, 0.1 m."""
    assert scenario.Scenario().model_dump() == {
        "n_poses": 30, "radius": 5.0, "n_landmarks": 6, "landmark_half_width": 4.0,
        "odometry_sigma_xy": 0.05, "odometry_sigma_theta": 0.01, "range_sigma": 0.1,
    }  # fmt: skip
    assert landmark_starts.START_AFTER == 3  # observations, before a landmark has its prior


def test_windows():
    """Three poses, failed above 0.5 m; 28 of 30 poses begin one, and t >= 2 may trigger."""
    assert (windows.WIDTH, failure.FAILURE_ERROR, trigger.FIRST_ELIGIBLE) == (3, 0.5, 2)
    assert windows.n_windows(30) == 28
    assert trigger.triggers(np.full(28, np.inf), 3.96).sum() == 26


def test_sampler():
    """nlive 100, walks max(d, 9), dlogz 0.5, the prior as wide as Sigma_w, half the error()."""
    settings = SamplerSettings()
    assert settings.model_dump() == {
        "n_live": 100, "min_walks": 9, "dlogz": 0.5, "prior_scale": 1.0, "likelihood_factor": 0.5,
    }  # fmt: skip
    assert [settings.walks(d) for d in (2, 9, 27)] == [9, 9, 27]


def test_gate_and_trigger_only_baseline():
    """1e-3 nats; 500 samples of N(MAP, 0.5^2 I)."""
    assert gate.Gate().gate_tolerance == 1e-3
    assert noop_baseline.TriggerOnly().model_dump() == {"noop_samples": 500, "noop_sigma": 0.5}


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


def test_dynesty_is_given_the_settings(monkeypatch):
    """Live points, steps and stopping rule arrive, and the last error of the evidence is kept."""
    seen = {}

    def watched(*arguments, **named):
        sampler = dynesty.NestedSampler(*arguments, **named)
        run = sampler.run_nested
        monkeypatch.setattr(sampler, "run_nested", lambda **how: (seen.update(how), run(**how)))
        seen.update(named)
        return sampler

    monkeypatch.setattr(dynesty_nested, "NestedSampler", watched)
    settings = SamplerSettings(n_live=25, min_walks=4, dlogz=3.0)
    found = dynesty_nested.run_nested(
        lambda x: -0.5 * x @ x, prior_transform.prior_transform(np.eye(2), 4.0), 2, settings,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert (seen["nlive"], seen["dlogz"], seen["print_progress"]) == (25, 3.0, False)
    assert seen["sample"].sampler_kwargs["walks"] == 4
    errors, values = found.results.logzerr, found.results.logz
    assert found.log_evidence_error == errors[-1] != errors[-2]
    assert found.log_evidence == values[-1] != values[-2]
    assert found.calls == found.results.ncall.sum()
