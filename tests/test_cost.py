"""Notebook 04 on small parameters: what must hold."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import handed_on, quick_config

from sngr_utils import cost, full_sngr
from sngr_utils.experiments import bench, refinement_cost
from sngr_utils.metrics import standard_error
from sngr_utils.publish import report
from sngr_utils.show import cost as show

pytestmark = pytest.mark.usefixtures("house_style")


@pytest.fixture(scope="module")
def costs():
    config = quick_config("04_cost").model_copy(update={"n_poses": 8})
    return config, cost.run(config)


def test_saving_is_total_over_selected(costs):
    _, levels = costs
    for level in levels.values():
        assert level.fired.any()
        n, k = len(level.calls), int(level.fired.sum())
        assert level.saving_calls == pytest.approx(n / k, rel=0.2)
        ran = np.isfinite(level.calls)
        assert ran[level.fired].all()
        assert ran.sum() == k + -(-(n - k) // refinement_cost.EVERY)
        assert (level.seconds[ran] > 0).all()
        known = np.where(ran, np.where(level.fired, 2.0, 3.0), np.nan)
        assert level.exhaustive(known) == 2 * k + 3 * (n - k)


def test_selective_windows_are_those_of_the_pipeline():
    """Notebook 04 times the very runs of notebook 03: same streams, same calls."""
    changes = {"n_poses": 8, "p_levels": [0.3], "tau": 3.0, "n_live": 20, "dlogz": 5.0}
    pipeline = full_sngr.run(full_sngr.Config(p_diagnosed=0.3, p_noop=0.3, **changes))[0.3]
    timed = cost.run(cost.Config(**changes))[0.3]
    assert len(pipeline.windows) > 0
    for window in pipeline.windows:
        assert timed.calls[window.t] == window.run.calls


def test_three_ways_to_write_the_closure_agree(costs, tmp_path):
    config, levels = costs
    level = levels[config.p_levels[0]]
    closure = cost.closure_cost(
        config, level, cost.middle_window(levels), rng=np.random.default_rng(0)
    )
    assert closure.largest_difference < 1e-8
    assert closure.all_factors == level.baseline.solution.graph.size()
    assert closure.window_factors == 22
    to = report.Report("x", tmp_path)
    show.record(config, levels, closure, to)
    loop = handed_on(to)["closure.loop_over_window"]
    assert loop["value"] == closure.seconds_loop.mean() / closure.seconds_window.mean()
    times = closure.seconds_loop, closure.seconds_window
    error = np.hypot(*(standard_error.standard_error(each) / each.mean() for each in times))
    assert loop["standard_error"] == pytest.approx(
        loop["value"] * np.sinh(1.96 * error) / 1.96, rel=1e-6
    )
    presets = cost.run_presets(config, levels)
    assert presets["C"] is levels
    table = show.cost_table(presets)
    shown = table.map(str)
    assert table.shape == (6, 6)
    assert shown["", "printed"][4] == "1.4"
    assert shown["preset", "C"][5] == f"{level.saving_calls:.1f}"
    to.table("cost", table, timing=True)
    to.save()
    assert (tmp_path / "x.timings.json").exists()
    ratios = show.closure_table(closure)["ratio [95 %]"]
    assert [len(cell.numbers) for cell in ratios] == [3, 3, 1]
    assert len(closure.seconds_loop) == refinement_cost.BATCHES
    fig, axes = plt.subplots(1, 2, figsize=(2 * 2, 2.5))
    show.draw_saving(axes[0], {"ours": ([4], [2.5]), "printed": ([], [])}, 10)
    to.figure(fig, "all")


def test_more_live_points_cost_more(costs):
    config, levels = costs
    t = cost.middle_window(levels)
    small, large = (
        cost.single_window(config.model_copy(update={"n_live": n}), t) for n in (20, 80)
    )
    assert large.calls > 2 * small.calls
    assert large.log_evidence_error < small.log_evidence_error


def test_bad_cost_names_the_parameter():
    with pytest.raises(ValueError, match="timing_calls"):
        cost.Config(timing_calls=1)
    with pytest.raises(ValueError, match="n_poses"):
        cost.Config(n_poses=4)
    with pytest.raises(ValueError, match="p_levels"):
        cost.Config(p_levels=[0.1, 0.1])


def test_saving_without_triggers_is_not_a_number():
    assert np.isnan(refinement_cost.saving(10.0, 0.0))


# --- counting from scratch -----------------------------------------------------------------------


def test_calls_counted_by_hand_are_those_of_a_sampler_that_asks_once_a_point(from_scratch):
    counting = from_scratch["counted"](lambda x: -0.5 * x @ x)
    assert [counting(np.full(2, x)) for x in (0.0, 1.0)] == [0.0, -1.0]
    assert counting.calls == 2


def test_saving_and_ratio_from_scratch_are_the_librarys(from_scratch):
    rng = np.random.default_rng(0)
    work, fired = rng.integers(100, 200, 20).astype(float), rng.random(20) < 0.4
    level = refinement_cost.Cost(None, fired, work, work, 1.0)
    assert from_scratch["saving"](work, fired) == pytest.approx(level.saving_calls)
    times = rng.exponential(size=(2, 30))
    assert from_scratch["ratio"](*times) == pytest.approx(bench.ratio(*times))
