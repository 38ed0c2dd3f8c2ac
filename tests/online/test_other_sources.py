"""Where one range decides between two estimates of the whole."""

import numpy as np

from sngr_utils.experiments import kinds_of_worlds
from sngr_utils.experiments.online_variants import run_unwarned
from sngr_utils.online import estimator, other_sources, rivals
from sngr_utils.robust import em
from sngr_utils.slam import conventions
from sngr_utils.world import scenario, simulation

C = conventions.PRESETS["C"]


def fit(log, start, widest):
    return em.fit(log, C, start, exclusive=True, clutter=True, widest=widest)


def test_a_loop_that_one_range_closes_has_two_estimates(monkeypatch):
    """Development world 370, all known but for one label of the last pose: two paths, one for each
    source of that range, are as likely to a third of a nat, and further apart than they err."""

    def run():
        world, _ = kinds_of_worlds.draw("reach 4 m", 0.3, 370)
        rng = np.random.default_rng([370, kinds_of_worlds.STREAM, 1])
        return run_unwarned(world.log(C.x0_sigmas), C, estimator.Settings(), rng=rng)

    assert run().diagnosis.rival < 1
    monkeypatch.setattr(other_sources, "with_another_source", lambda *of: [])
    assert run().diagnosis.rival > 10


def test_where_all_is_heard_no_range_moves_the_path():
    asked = []
    drawn = simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))
    log = drawn.log(C.x0_sigmas)

    def watch(belief):
        asked.append(belief)

    run_unwarned(log, C, estimator.Settings(), watch, rng=np.random.default_rng(0))
    belief = asked[-1]
    ours = rivals.rival(
        log, log.odometry_covariances, fit(log, (belief.poses, belief.landmarks), 1.0)
    )
    told = log.odometry_covariances
    assert other_sources.with_another_source(belief, ours, told, fit, True) == []
