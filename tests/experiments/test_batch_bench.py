from sngr_utils.experiments import batch_bench
from sngr_utils.slam import conventions
from sngr_utils.world.scenario import Scenario


def test_every_method_is_that_of_gtsam_and_takes_less_time():
    """One world of half the poses, nothing random; both ways twice, the first to compile."""
    scenario = Scenario(n_poses=15)
    rows = batch_bench.compare(scenario, conventions.PRESETS["C"], 0.2, range(101, 102))
    assert list(rows) == [*batch_bench.ROBUST, *batch_bench.EM]
    for ((ours, theirs, difference),) in rows.values():
        assert difference < 1e-4
        assert 0 < ours < theirs
