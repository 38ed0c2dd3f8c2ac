"""What a result says of itself: p-values that are right, and what counts as a reason."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sngr_utils.robust import diagnosis, em, misfit
from sngr_utils.slam import conventions
from sngr_utils.world import scenario, simulation
from sngr_utils.world.dead_reckoning import relative_motion

C = conventions.PRESETS["C"]
SOUND = diagnosis.Diagnosis(
    unexplained=0.3,
    held_out=0.3,
    held_out_p=1.0,
    worst_run=1.0,
    residual=1.0,
    residual_p=0.5,
    worst_step=1.0,
    drift=misfit.NONE,
    rival=np.inf,
    vague=1.0,
    extent=100.0,
)


@pytest.fixture(scope="module")
def drawn():
    return simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))


def test_a_run_of_bad_ranges_has_the_binomial_p_value(drawn):
    log = drawn.log(C.x0_sigmas)
    bad = (log.pose_of == 7).astype(float)
    share = 6.5 / (len(bad) + 1)
    runs = sum(log.n_poses + 1 - length for length in (1, 2, 4, 8))
    found = diagnosis.worst_run(log, bad, 1)
    assert found == pytest.approx(runs * stats.binom.sf(5, 6, share))
    assert found < 1e-5
    assert diagnosis.worst_run(log, np.zeros(len(bad))) == 1.0


def test_a_second_half_that_is_lost_is_a_run_however_long(drawn):
    """No short run of it is rare."""
    log = drawn.log(C.x0_sigmas)
    pose = np.repeat(np.arange(400), 2)
    bad = (pose >= 200).astype(float)
    long = log._with(
        odometry=np.zeros((399, 3)), pose_of=pose, ranges=np.ones(800), label_of=np.zeros(800, int)
    )
    assert diagnosis.worst_run(long, bad) < 1e-50
    assert diagnosis.worst_run(long, bad * (pose < 206)) < diagnosis.RARE
    assert diagnosis.worst_run(long, (pose % 2).astype(float)) == 1.0


def test_clutter_that_is_spread_evenly_is_rarely_a_run(drawn):
    """At most one in a hundred by Bonferroni; more than 10 of 300 have a chance below 1e-3."""
    log, rng = drawn.log(C.x0_sigmas), np.random.default_rng(0)
    draws = [(rng.random(len(log.ranges)) < 0.2).astype(float) for _ in range(300)]
    assert stats.binom.sf(10, 300, 0.01) < 1e-3
    assert sum(diagnosis.worst_run(log, bad) < diagnosis.RARE for bad in draws) <= 10


def test_the_worst_step_has_the_p_value_of_so_many(drawn):
    log, poses = drawn.log(C.x0_sigmas), drawn.poses
    told = log.odometry_covariances
    exact = relative_motion(poses)
    exact[4, 0] += 0.25  # five of its sigmas
    found = diagnosis.worst_step(log._with(odometry=exact), poses)
    assert found == pytest.approx(29 * stats.chi2.sf(25, 3))
    missed = log.odometry.copy()
    missed[4, 0] += 1.0
    assert diagnosis.worst_step(log, poses) > diagnosis.RARE
    wide = told.copy()
    wide[4, :2, :2] *= 1e4  # a step that slipped is judged by its turn, which is still trusted
    slipped = log._with(odometry=missed, odometry_covariances=wide)
    assert diagnosis.worst_step(slipped, poses) > diagnosis.RARE
    turned = slipped.odometry.copy()
    turned[4, 2] += 0.1  # ten of its sigmas
    assert diagnosis.worst_step(slipped._with(odometry=turned), poses) < diagnosis.RARE
    assert diagnosis.worst_step(log.first(1), poses[:1]) == 1.0


@pytest.mark.parametrize(("changed", "word"), [
    ({"unexplained": 0.51}, "fit nothing"), ({"worst_run": 0.001}, "some poses"),
    ({"held_out_p": 0.001}, "30% of held-out ranges"),
    ({"residual": 1.7}, "1.7 times the variance"),
    ({"residual": 0.4, "residual_p": 0.001}, "0.4 times the variance"),
    ({"extent": 1.9}, "1.9 times as wide"), ({"worst_step": 0.001}, "a step"),
    ({"drift": misfit.Misfit("in turning", 0.8, 0.001)}, "a drift in turning (of 0.8 sigmas"),
    ({"rival": 2.0}, "less likely by 2.0 nats"), ({"vague": 6.0}, "range sigmas"),
])  # fmt: skip
def test_each_doubt_is_told_and_even_clutter_is_none(changed, word):
    assert not SOUND.doubtful
    assert not replace(SOUND, residual=0.4, residual_p=0.1).doubtful  # of few ranges it is chance
    (reason,) = replace(SOUND, **changed).reasons
    assert word in reason


def test_a_pose_whose_labels_are_all_wrong_raises_the_question_of_a_slip(drawn):
    sound = replace(drawn, label_of=drawn.source_of)
    wrong = np.where(sound.pose_of == 12, (sound.source_of + 1) % 6, sound.source_of)
    for labels, asked in ((sound.label_of, False), (wrong, True)):
        log = replace(sound, label_of=labels).log(C.x0_sigmas)
        found = em.fit(
            log, C, (sound.poses, sound.landmarks), exclusive=True, clutter=True, widest=1.0
        )
        assert diagnosis.may_have_slipped(log, found) == asked


def test_held_out_ranges_that_the_others_do_not_foretell_are_told(drawn):
    """Two metres too long; some fit another landmark by chance."""
    sound = replace(drawn, label_of=drawn.source_of)
    log = sound.log(C.x0_sigmas)

    def fit(part, start):
        return em.fit(part, C, start, exclusive=True, clutter=True, widest=1.0)

    found = fit(log, (sound.poses, sound.landmarks))
    share, p_value = diagnosis.foretold(log, found, fit)
    assert share < 0.01
    assert p_value == 1.0
    held = np.arange(len(log.ranges)) % diagnosis.HELD_OUT == diagnosis.HELD_OUT // 2
    longer = log._with(ranges=np.where(held, log.ranges + 2.0, log.ranges))
    share, p_value = diagnosis.foretold(longer, found, fit)
    assert share > 0.5
    assert p_value < 1e-10
    nothing = log.keep(np.zeros(len(held), dtype=bool))
    assert diagnosis.foretold(nothing, found, fit) == (0.0, 1.0)


@pytest.mark.parametrize(("told", "flagged"), [(1.0, False), (3.0, True), (0.6, True)])
def test_noise_of_ranges_that_is_told_wrong_is_flagged(told, flagged):
    """Three times too large, or .6 times; over 10 worlds, two labels in ten wrong."""
    doubts = []
    for seed in range(200, 210):
        world = simulation.simulate(scenario.Scenario(), 0.2, rng=np.random.default_rng(seed))
        log = world.log(C.x0_sigmas)
        log = replace(log, range_sigmas=told * log.range_sigmas)

        def fit(log, start):
            return em.fit(log, C, start, exclusive=True, clutter=True, widest=1.0)

        found = fit(log, (world.poses, world.landmarks))
        reasons = diagnosis.diagnose(log, found, np.inf, fit).reasons
        doubts.append(any("the variance told" in reason for reason in reasons))
    assert doubts.count(flagged) >= 9


def test_a_robot_that_stays_where_it_is_is_flagged(drawn):
    """Its poses are where they are, and its landmarks anywhere on their rings."""
    still = replace(drawn, odometry=np.zeros_like(drawn.odometry))
    ranges = np.linalg.norm(drawn.landmarks[drawn.source_of] - drawn.poses[0, :2], axis=1)
    poses = np.tile(drawn.poses[0], (drawn.n_poses, 1))
    for world, path, flagged in ((drawn, drawn.poses, False),
                                 (replace(still, ranges=ranges), poses, True)):  # fmt: skip
        log = world.log(C.x0_sigmas)

        def fit(log, start):
            return em.fit(log, C, start, exclusive=True, clutter=True, widest=1.0)

        found = fit(log, (path, world.landmarks))
        reasons = diagnosis.diagnose(log, found, np.inf, fit).reasons
        assert any("as wide as" in reason for reason in reasons) == flagged
