from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sngr_utils.detection import mirror_image
from sngr_utils.online import localisation
from sngr_utils.sampling.targets import compiled, place
from sngr_utils.sampling.weighted_samples import WeightedSamples
from sngr_utils.world import dead_reckoning, scenario, simulation

STEP = np.diag(scenario.Scenario().odometry_sigmas ** 2)


def evidence_of(seed, n_poses, wrong=0.2):
    """The ranges that n dead-reckoned poses have of each landmark of a world."""
    drawn = simulation.simulate(scenario.Scenario(), 0.2, rng=np.random.default_rng(seed))
    blind = dead_reckoning.dead_reckoning(drawn.x0_mean, drawn.odometry)
    variances = dead_reckoning.dead_reckoning_variances(blind, STEP) + 0.1**2
    for k in range(drawn.n_landmarks):
        mine = (drawn.label_of == k) & (drawn.pose_of < n_poses)
        seen_from, ranges = drawn.pose_of[mine], drawn.ranges[mine]
        if len(ranges) >= 3:
            anchors = blind[seen_from, :2]
            yield place.Evidence(
                anchors, ranges, variances[seen_from], np.full(len(ranges), wrong),
                drawn.ranges.max(), anchors.mean(axis=0), ranges.max(),
            )  # fmt: skip


def grid(evidence, cells=200, reach=1.5):
    """The posterior on a square grid about the centre of the prior, the reference of the tests.

    `cells` along each axis, out to `reach` sigmas of the prior.

    A place is uniform within its cell, which widens every range by a twelfth of its square.
    """
    axis, step = np.linspace(-1, 1, cells, retstep=True)
    axis, step = axis * reach * evidence.sigma, step * reach * evidence.sigma
    evidence = replace(evidence, variances=evidence.variances + step**2 / 12)
    xi = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    log_likelihoods = compiled.log_likelihoods(evidence.factors, xi)
    log_densities = log_likelihoods - 0.5 * np.sum(xi**2, axis=1) / evidence.sigma**2
    total = np.logaddexp.reduce(log_densities)
    norm = np.log(step**2 / (2 * np.pi * evidence.sigma**2))
    return WeightedSamples(
        xi + evidence.centre,
        np.exp(log_densities - total),
        log_likelihoods,
        float(total + norm + evidence.ceiling),
        0.0,
        len(xi),
    )


def test_compiled_likelihood_is_the_two_component_one():
    """Against SciPy's densities, to rounding."""
    evidence = next(evidence_of(100, 6))
    for spot in np.random.default_rng(0).normal(size=(50, 2)) * 5:
        distances = np.linalg.norm(spot - evidence.anchors, axis=1)
        right = stats.norm.pdf(evidence.ranges, distances, np.sqrt(evidence.variances))
        expected = np.log(0.8 * right + 0.2 / evidence.longest).sum()
        ours = compiled.log_likelihood(evidence.factors, spot - evidence.centre)
        assert ours + evidence.ceiling == pytest.approx(expected, abs=1e-9)


def test_a_range_without_a_floor_is_an_ordinary_one():
    evidence = next(evidence_of(100, 6, wrong=0.0))
    xi = np.array([0.3, -0.2])
    distances = np.linalg.norm(xi + evidence.centre - evidence.anchors, axis=1)
    expected = -0.5 * np.sum((distances - evidence.ranges) ** 2 / evidence.variances)
    assert compiled.log_likelihood(evidence.factors, xi) == pytest.approx(expected)


@pytest.mark.parametrize("n_poses", [3, 4, 5])
def test_masses_are_those_of_a_fine_grid(n_poses):
    """Either side of the track, and of the first mode where there is one to speak of.

    Mean of 40 runs within 0.05. One run has a standard error of 0.11 at worst, so 0.05 is 2.9 of
    the mean's: it fails by chance in one case of 250. Where one mode holds nearly all, and a
    landmark starts, the error of one run is below 0.03.
    """
    for i, evidence in enumerate(evidence_of(100, n_poses)):
        reference = grid(evidence, 400)
        expected = masses_of(reference, evidence)
        runs = [
            masses_of(localisation.sample(evidence, rng=np.random.default_rng([i, r])), evidence)
            for r in range(40)
        ]
        side, first = np.mean(runs, axis=0)
        assert side == pytest.approx(expected[0], abs=0.05)
        if expected[1] > 0.6:
            assert first == pytest.approx(expected[1], abs=0.05)


@pytest.mark.parametrize("n_poses", [3, 5, 8])
def test_masses_of_many_starts_are_those_of_a_fine_grid_where_they_call_themselves_sound(n_poses):
    """Mean of 20 runs within 0.05, evidence within 0.1 nats.

    A sound run has 200 effective draws, and a mass a standard error of 0.035 at most: 0.05 is six
    of the mean's. The grid's own error of the evidence is 0.02. Where the mirror test sees one
    place, which is where they are asked, most runs are sound.
    """
    for i, evidence in enumerate(evidence_of(100, n_poses)):
        reference = grid(evidence, 600)
        expected, runs = masses_of(reference, evidence), []
        for r in range(20):
            cloud, trusted = localisation.many_starts(evidence, rng=np.random.default_rng([i, r]))
            if trusted:
                runs.append([*masses_of(cloud, evidence), cloud.log_evidence])
        assert localisation.mirrored(evidence) or len(runs) > 10
        if len(runs) <= 10:
            continue
        side, first, log_evidence = np.mean(runs, axis=0)
        assert side == pytest.approx(expected[0], abs=0.05)
        if expected[1] > 0.6:
            assert first == pytest.approx(expected[1], abs=0.05)
        assert log_evidence == pytest.approx(reference.log_evidence, abs=0.1)


def test_starts_are_apart_and_the_likeliest_first():
    evidence = next(evidence_of(100, 6))
    starts = localisation.crossing_starts(evidence, 8)
    distances = np.linalg.norm(starts[:, None] - starts, axis=2)[np.triu_indices(len(starts), 1)]
    assert distances.min() > localisation.START_APART * np.sqrt(evidence.variances.min())
    heights = [
        compiled.log_likelihood(evidence.factors, spot - evidence.centre)
        - 0.5 * np.sum((spot - evidence.centre) ** 2) / evidence.sigma**2
        for spot in starts
    ]
    assert heights == sorted(heights, reverse=True)


def test_of_many_ranges_the_likeliest_are_crossed(monkeypatch):
    """A scan of 24 ranges, each of any of 24 landmarks: 576 circles, 165,600 pairs of circles."""
    rng, n, crossed = np.random.default_rng(100), 24, []
    landmarks, robot = rng.uniform(-10, 10, (n, 2)), np.array([1.0, -2.0])
    ranges = np.linalg.norm(landmarks - robot, axis=1) + rng.normal(0, 0.1, n)
    label = rng.permutation(n)
    label[: n // 2] = np.arange(n // 2)  # half the labels are right
    wrong = np.where(label[:, None] == np.arange(n), 0.5, 0.98)
    evidence = place.Evidence(
        np.tile(landmarks, (n, 1)), np.repeat(ranges, n), np.full(n * n, 0.01), wrong.ravel(),
        30.0, np.zeros(2), 30.0,
    )  # fmt: skip
    cross = localisation.landmark_starts.crossings
    monkeypatch.setattr(
        localisation.landmark_starts, "crossings",
        lambda *of: crossed.append(len(of[1])) or cross(*of),
    )  # fmt: skip
    best = localisation.crossing_starts(evidence, 1)[0]
    assert crossed == [localisation.CROSSED]
    assert best == pytest.approx(robot, abs=0.3)


def masses_of(cloud, evidence):
    """Share of a cloud on one side of the track, and of its first mode."""
    centre, normal = mirror_image.trajectory_line(evidence.anchors)
    side = cloud.weights[(cloud.samples - centre) @ normal > 0].sum()
    return side / cloud.weights.sum(), localisation.modes(cloud, evidence)[0].mass


def test_a_straight_line_leaves_two_modes_of_one_half_each():
    positions = np.column_stack([np.arange(5.0), np.zeros(5)])
    ranges = np.linalg.norm(positions - [2.5, 4.0], axis=1)
    evidence = place.Evidence(
        positions, ranges, np.full(5, 0.01), np.full(5, 0.1), 10.0, positions.mean(axis=0), 5.0
    )
    for cloud in (grid(evidence), localisation.sample(evidence, rng=np.random.default_rng(0))):
        first, second = localisation.modes(cloud, evidence)[:2]
        assert first.mass + second.mass > 0.95
        assert first.mass == pytest.approx(0.5, abs=0.15)
        assert sorted([first.mean[1], second.mean[1]]) == pytest.approx([-4, 4], abs=0.2)
    assert localisation.mirrored(evidence)


def test_a_circle_around_a_landmark_leaves_one():
    positions = simulation.circle_poses(12, 5.0)[:, :2].copy()  # as compiled: contiguous
    ranges = np.linalg.norm(positions - [1.0, 2.0], axis=1)
    ranges[3] += 2.0  # one of them is wrong
    evidence = place.Evidence(
        positions, ranges, np.full(12, 0.01), np.full(12, 0.1), 10.0, np.zeros(2), 8.0
    )
    best = localisation.modes(
        localisation.sample(evidence, rng=np.random.default_rng(0)), evidence
    )[0]
    assert best.mass > 0.98
    assert best.mean == pytest.approx([1.0, 2.0], abs=0.1)
    assert not localisation.mirrored(evidence)
    assert localisation.crossing_starts(evidence, 1)[0] == pytest.approx([1.0, 2.0], abs=0.02)
    assert localisation.fitting(evidence, best.mean, evidence.variances).sum() == 11


def test_bad_evidence_is_refused():
    good = next(evidence_of(100, 6))
    for name, value in (
        ("variances", np.zeros(len(good.ranges))), ("wrong", np.ones(len(good.ranges))),
        ("anchors", good.anchors[:-1]), ("sigma", 0.0), ("ranges", np.zeros(0)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=name):
            replace(good, **{name: value})
