"""Range scale and offset that the online estimator finds on its way."""

from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.metrics.alignment import aligned_rmse
from sngr_utils.online import calibration, estimator
from sngr_utils.slam import conventions
from sngr_utils.world import scenario, simulation

C = conventions.PRESETS["C"]
TRUE, SHIFT = 1.1, 0.2


@pytest.fixture(scope="module")
def drawn():
    return simulation.simulate(scenario.Scenario(n_poses=45), 0.3, rng=np.random.default_rng(100))


def driven(drawn, **told):
    log = drawn.log(C.x0_sigmas)
    log = replace(
        log, ranges=TRUE * log.ranges + SHIFT, range_sigmas=TRUE * log.range_sigmas, **told
    )
    return estimator.run(log, C, estimator.Settings(), rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def known(drawn):
    return driven(drawn, scale=(TRUE, 0.0), offset=(SHIFT, 0.0))


def test_open_scale_and_offset_are_found_and_the_path_is_as_good(drawn, known):
    found = driven(drawn, scale=(1.0, 0.1), offset=(0.0, 0.5))
    assert found.calibration == pytest.approx([TRUE, SHIFT], abs=0.1)
    scale, offset = found.calibration  # of a circle of 5 m, they stand for each other
    assert scale * 5 + offset == pytest.approx(TRUE * 5 + SHIFT, abs=0.05)
    ours, best = (aligned_rmse(x.poses[:, :2], drawn.poses[:, :2]) for x in (found, known))
    assert ours < 1.15 * best
    assert (found.used == known.used).mean() > 0.97
    assert not found.diagnosis.doubtful


def test_what_is_known_stays(known):
    assert known.calibration.tolist() == [TRUE, SHIFT]


def test_corrections_add_up_and_the_prior_stays_where_it_was(drawn):
    log = drawn.log(C.x0_sigmas)
    first = calibration.of(replace(log, scale=(1.0, 0.1), offset=(0.0, 0.5)))
    once = first.after(np.array([1.1, 0.2]))
    twice = once.after(np.array([0.9, -0.1]))
    raw = twice.scale * 3.0 + twice.offset
    assert once.scale * (0.9 * 3.0 - 0.1) + once.offset == pytest.approx(raw)
    opened = twice.opened(twice.corrected(log))
    assert opened.scale[0] * twice.scale == pytest.approx(1.0)
    assert opened.scale[1] * twice.scale == pytest.approx(0.1)
    assert opened.offset[0] * twice.scale + twice.offset == pytest.approx(0.0)
    assert calibration.of(log).opened(log).scale == (1.0, 0.0)


def test_a_distance_cut_under_a_wrong_offset_is_whole_again_under_another(drawn):
    """Also one measured below zero, and one that the better offset cuts too."""
    log = drawn.log(C.x0_sigmas)._with(offset=(0.0, 1.0))
    log.ranges[:2] = 0.3, -0.2
    wrong = calibration.of(log).after(np.array([1.0, 6.0]))
    cut = wrong.corrected(log)
    assert (cut.ranges[:2] == calibration.NEAREST * log.range_sigmas[:2]).all()
    whole = wrong.uncut(cut, log.ranges)
    assert np.allclose(whole.ranges, log.ranges - 6)
    again = calibration.of(whole).after(np.array([1.0, -5.8])).corrected(whole)
    direct = calibration.of(log).after(np.array([1.0, 0.2])).corrected(log)
    assert np.allclose(again.ranges, direct.ranges)
    assert np.allclose(direct.ranges[:2], [0.1, 0.01])


def test_no_distance_is_negative_and_none_is_changed_for_nothing(drawn):
    log = drawn.log(C.x0_sigmas)
    assert calibration.of(log).corrected(log) is log
    shifted = calibration.of(replace(log, offset=(100.0, 1.0))).corrected(log)
    assert (shifted.ranges > 0).all()
