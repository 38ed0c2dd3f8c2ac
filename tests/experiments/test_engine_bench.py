import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import handed_on

from sngr_utils import cost
from sngr_utils.experiments import bench, engine_bench, growth
from sngr_utils.publish import files, report
from sngr_utils.sampling import settings
from sngr_utils.show import cost as show
from sngr_utils.slam import conventions
from sngr_utils.sngr import refine, trigger
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate

SMALL = {"bench_windows": 2, "bench_runs": 2, "reference_draws": 2000, "lengths": [12, 24],
         "n_live": 30, "dlogz": 2.0, "timing_calls": 10}  # fmt: skip


@pytest.fixture(scope="module")
def engines():
    config = cost.Config(**SMALL)
    return config, cost.compare_engines(config)


def test_every_engine_takes_part_and_is_measured(engines):
    _, performances = engines
    assert len(performances) == 6
    runs = [len(p.seconds) for p in performances.values()]
    assert runs == [1, 1, 1, 20, 20, 20]
    for p in performances.values():
        assert (p.seconds >= 0).all()
        assert (p.calls > 30).all()
        assert (np.abs(p.errors) < 3).all()  # ten times the error of 30 live points
    assert show.times_faster(performances, bench.WINDOW_LOOP)[0] == 1
    assert show.times_faster(performances, "fast path")[0] > 10


def test_bench_tables_and_values(engines, tmp_path, capsys, monkeypatch):
    config, performances = engines
    per_call = cost.likelihood_seconds(config)
    assert 1e-8 < per_call < 1e-4
    assert show.speed_table(performances, per_call).shape == (6, 6)
    assert show.accuracy_table(performances).shape == (6, 6)
    fig, axes = plt.subplots(1, 3)
    show.draw_engines(axes[:2], performances, per_call)
    limits, quickest = axes[0].lines[0].get_xdata(), axes[0].lines[-1].get_xdata()
    assert limits[-1] < quickest[0] == 1e3 * performances["fast path"].seconds.mean()
    grown = cost.grow(config)
    show.draw_growth(axes[2], grown.lengths, grown.seconds, dict.fromkeys(grown.seconds, 1.0))
    to = report.Report("04_cost", tmp_path)
    show.record_engines(performances, grown, (np.full(3, 0.1), np.full(3, 0.05)), to)
    to.figure(fig, "growth", timing=True)
    handed_on(to)
    timings = files.read_json(tmp_path / "04_cost.timings.json")["values"]
    results = files.read_json(tmp_path / "04_cost.json")
    assert timings["engine.fast_all_over_isam2"]["value"] == 2
    assert timings["engine.closure_loop.ratio"]["value"] > 1
    assert results["values"]["engine.nested.bias"]["n"] == 20
    assert results["figures"] == ["04_cost_growth_timing.pdf"]
    plt.close(fig)
    monkeypatch.setattr(show, "compare_engines", lambda config, with_peers: performances)
    monkeypatch.setattr(show, "grow", lambda config: grown)
    show.print_bench(config)
    assert "fast path" in capsys.readouterr().out


def test_refining_all_windows_by_the_fast_path_is_cheap():
    seconds, isam2 = cost.exhaustive_fast(cost.Config())
    assert len(seconds) == len(isam2) == 9
    assert (isam2 > 0).all()
    assert np.median(seconds) < 0.5


def test_growth_measures_what_it_says():
    grown = growth.growth(SMALL["lengths"], Scenario(), conventions.PRESETS["B"], 0)
    assert set(grown.seconds) == set(growth.GROWTH)
    assert all((seconds > 0).all() for seconds in grown.seconds.values())
    table = show.growth_table(grown)
    assert table.shape == (5, 4)
    assert np.isnan(growth.Growth(np.array([3, 4]), {"a": np.array([1.0, np.nan])}).slope("a"))


def test_slope_of_a_power_law():
    lengths = np.array([10, 100, 1000])
    grown = growth.Growth(lengths, {"square": 3e-6 * lengths**2.0})
    assert grown.slope("square") == pytest.approx(2)


def test_long_worlds_keep_the_step():
    scenario = Scenario()
    short, long = (
        growth.long_world(n, scenario, rng=np.random.default_rng(0)) for n in (30, 300)
    )  # fmt: skip
    same = simulate(scenario, 0.0, rng=np.random.default_rng(0))
    assert np.array_equal(short.ranges, same.ranges)
    steps = [np.linalg.norm(np.diff(w.poses[:, :2], axis=0), axis=1).mean() for w in (short, long)]
    assert steps[1] == pytest.approx(steps[0], rel=0.01)


def test_two_modes_from_one_start_and_from_many():
    """One start is wrong always; 32 miss a basin of one half once in 2^32."""
    modes = engine_bench.two_modes(20, rng=np.random.default_rng(0))
    (one, _), (many, content) = modes.values()
    assert np.all((one < 0.1) | (one > 0.9))
    assert np.all(np.abs(many - 0.5) < 0.1)
    assert content.all()
    assert show.two_mode_table(modes)["right"].map(str).tolist() == ["0 of 20", "20 of 20"]


def test_reference_is_that_of_the_likelihood(noisy):
    """Against a second reference with other draws, at 5 standard errors."""
    likelihood = refine.window_likelihood(noisy.solution, 9, 0.5)
    first, second = (
        engine_bench.reference(likelihood, noisy.covariances[9], settings.SamplerSettings(), 20_000,
                        rng=np.random.default_rng(seed))
        for seed in (0, 1)
    )  # fmt: skip
    spread = np.hypot(first.log_evidence_error, second.log_evidence_error)
    assert abs(first.log_evidence - second.log_evidence) < 5 * spread
    assert np.allclose(np.diag(first.covariance), np.diag(second.covariance), rtol=0.1)


def test_windows_are_spread_over_those_that_may_trigger():
    assert engine_bench.spread_evenly(4, 28) == [2, 10, 19, 27]
    assert min(engine_bench.spread_evenly(1, 28)) >= trigger.FIRST_ELIGIBLE


def test_bad_bench_names_the_parameter():
    for name, value in {
        "bench_runs": 1,
        "bench_windows": 0,
        "lengths": [2],
        "bench_p": 2.0,
    }.items():
        with pytest.raises(ValueError, match=name):
            cost.Config(**{name: value})


def test_a_ratio_stands_beside_a_small_bias_only():
    """Errors of log Z with a standard error of .01: a bias of .02 is small, one of .04 is not."""
    spread = np.tile([-0.2, 0.2], 200)
    for shift, sound in ((0.02, True), (0.04, False), (-0.04, False)):
        runs = bench.Performance(*[np.ones(400)] * 2, spread + shift, *[np.ones(400)] * 3)
        assert bench.comparable(runs) == sound
    few = bench.Performance(*[np.ones(100)] * 2, spread[:100], *[np.ones(100)] * 3)
    assert not bench.comparable(few)


def test_a_ratio_has_the_interval_of_a_quotient_of_means():
    """Of 2000 quotients of exponential means 93 to 97 % contain the true one (5 errors: 6e-7)."""
    rng = np.random.default_rng(0)
    found = [bench.ratio(rng.exponential(6, 80), rng.exponential(2, 120)) for _ in range(2000)]
    ratios, low, high = np.array(found).T
    assert ((low < ratios) & (ratios < high)).all()
    assert abs(np.mean((low < 3) & (high > 3)) - 0.945) < 5 * np.sqrt(0.05 * 0.95 / 2000)
    assert np.isnan(bench.ratio(np.array([1.0]), np.ones(3))[1])
