"""What the data would change of a number that they are told: its value, its p-value, its size."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sngr_utils.robust import em, misfit
from sngr_utils.slam import conventions
from sngr_utils.world import scenario, simulation
from sngr_utils.world.dead_reckoning import relative_motion

C = conventions.PRESETS["C"]


def drawn(seed):
    world = simulation.simulate(scenario.Scenario(), 0.0, rng=np.random.default_rng(seed))
    return world, world.log(C.x0_sigmas)


def fit(log, world):
    wide = C.model_copy(update={"landmark_prior_sigma": 100.0})
    return em.fit(
        log, wide, (world.poses, world.landmarks), exclusive=True, clutter=True, widest=1.0
    )


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("ahead", {"odometry": [0.02, 0.0, 0.0]}),
        ("to the left", {"odometry": [0.0, 0.01, 0.0]}),
        ("in turning", {"odometry": [0.0, 0.0, 0.005]}),
        ("of the range scale", {"ranges": 0.01}),
    ],
)
def test_of_data_that_are_exact_but_for_one_number_it_is_found(name, change):
    """Its size is what it was changed by, to first order: a tenth is allowed."""
    world, log = drawn(100)
    offsets = world.poses[log.pose_of, :2] - world.landmarks[log.label_of]
    exact, ranges = relative_motion(world.poses), np.linalg.norm(offsets, axis=1)
    shift = np.array(change.get("odometry", [0.0, 0.0, 0.0]))
    scale = 1 + change.get("ranges", 0.0)
    log = log._with(odometry=exact + shift, ranges=scale * ranges)
    (found,) = [one for one in misfit.misfits(log, fit(log, world)) if one.name == name]
    sigmas = world.scenario.odometry_sigmas
    told = 0.01 * np.median(log.ranges) / 0.1 if scale > 1 else -np.sum(shift / sigmas)
    assert found.size == pytest.approx(told, rel=0.1)


def test_sound_data_are_rarely_called_wrong():
    """By Bonferroni at most one in a hundred: more than 4 of 60 have a chance below 1e-3."""
    worlds = [drawn(seed) for seed in range(100, 160)]
    found = [misfit.worst(log, fit(log, world)).p_value for world, log in worlds]
    assert stats.binom.sf(4, 60, 0.01) < 1e-3
    assert sum(p < 0.01 for p in found) <= 4


def test_a_gyro_with_a_bias_of_its_sigma_is_seen_in_thirty_poses():
    """In 13 of 15 development worlds: fewer than 6 of 10 have a chance below 1e-2."""
    found = []
    for seed in range(200, 210):
        world, log = drawn(seed)
        log = log._with(odometry=log.odometry + np.array([0.0, 0.0, 0.01]))
        found.append(misfit.worst(log, fit(log, world)))
    seen = [one for one in found if one.p_value < 0.01]
    assert stats.binom.cdf(5, 10, 13 / 15) < 1e-2
    assert len(seen) >= 6
    assert {one.name for one in seen} == {"in turning"}


def test_what_is_significant_but_small_is_no_doubt(monkeypatch):
    _, log = drawn(100)
    small = misfit.Misfit("ahead", 0.1, 1e-9)
    large = misfit.Misfit("in turning", -0.5, 0.002)
    monkeypatch.setattr(misfit, "misfits", lambda *given: [small, large])
    assert misfit.worst(log, None) == large._replace(p_value=0.004)
    monkeypatch.setattr(misfit, "misfits", lambda *given: [small])
    assert misfit.worst(log, None).p_value == 1.0


def test_without_ranges_or_steps_nothing_is_asked():
    world, log = drawn(100)
    for part in (log.first(1), log.keep(np.zeros(len(log.ranges), dtype=bool))):
        found = replace(fit(log, world), chain=fit(part, world.first(part.n_poses)).chain)
        found = replace(found, weights=found.weights[: len(part.ranges)])
        assert misfit.misfits(part, found) == []
        assert misfit.worst(part, found) == misfit.NONE
