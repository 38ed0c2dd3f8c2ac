"""Sentences of notebook 09 about signs, orders and all, on stored results."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers import read_notebook
from stored_results import entry, value

from sngr_utils import multimodal
from sngr_utils.experiments import two_anchors
from sngr_utils.sampling import ancestral_priors, reference

METHODS = ("one Gaussian", "c = 1", "c = 50", "ancestral", "ancestral, reweighted", "many starts")
FEW, CALLS_FEW, MORE, CALLS_MORE, WINDOW, CALLS_WINDOW = range(2, 8)  # columns of the summary
ASKED = set()  # all that is needed stands in tables, and in what the paper asks for


def cell(table, *at):
    return entry(f"multimodal_{table}", *at)


def summary(method, column, place=1):
    return cell("summary", METHODS.index(method) + 1, column, place)


def test_it_lasts_for_two_or_three_poses():
    for n in (2, 3):
        assert value(f"multimodal.landmark.{n}.wrong") > 95
        assert value(f"multimodal.landmark.{n}.two") > 85
    for n in (5, 8):
        assert value(f"multimodal.landmark.{n}.wrong") < 15


def test_no_other_gaussian_would_do_after_two_or_three_poses():
    assert all(cell("landmarks", row, 4) > 0.95 for row in (1, 2))


def test_windows_have_fewer_modes_with_more_ranges_and_none_with_good_odometry():
    shares = [value(f"multimodal.window.{n}.two") for n in (1, 2, 3, 6)]
    assert shares[0] > 50
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] < 25
    assert value("multimodal.strong.two") == 0


def test_the_mirror_test_finds_nearly_all_and_the_condition_number_nothing():
    found, missed, false = (
        value(f"multimodal.landmark.mirror.{name}") for name in ("found", "missed", "false")
    )
    assert found > 20 * missed
    assert false < 0.1 * found
    assert value("multimodal.landmark.condition.found") < 0.02 * found
    assert cell("triggers", 2, 5) > 10  # its false alarms
    assert value("multimodal.landmark.condition.auc_within") < 0.55
    assert value("multimodal.landmark.condition.auc") < 0.1  # it is small where they are ambiguous
    assert value("multimodal.landmark.condition.auc") < 0.2  # ambiguous while poses are sure
    for name in ("", "_landmark"):
        ours = value("multimodal.landmark.mirror.auc_within")
        assert ours > value(f"multimodal.landmark.condition{name}.auc_within") + 0.3


def test_in_windows_a_second_mode_found_from_many_starts_tells_more_than_the_condition_number():
    second, condition = (value(f"multimodal.window.{by}.auc") for by in ("second", "condition"))
    assert second > condition + 0.1


def test_a_missed_twin_costs_the_evidence_the_logarithm_of_two():
    assert cell("mode", 1, 6) == pytest.approx(-np.log(2), abs=0.01)  # c = 1, from one place


def test_from_a_mode_the_gaussian_priors_fail_and_from_the_saddle_they_work():
    assert cell("mode", 1, 3) > 0.45  # c = 1
    assert value("multimodal.two_anchors_mode.c50.mass_error") > 0.05
    for row in (2, 3, 4):  # c = 1, c = 50, ancestral
        assert cell("saddle", row, 3) < 0.05


def test_after_few_poses_the_ancestral_prior_and_importance_weights_find_the_masses():
    for method, mean in (("one Gaussian", 1 / 3), ("c = 1", 1 / 3), ("c = 50", 1 / 4)):
        assert abs(summary(method, FEW) - mean) < 0.06
    for method in METHODS[3:]:
        assert summary(method, FEW, 2) <= 0.05
    assert max(summary(method, MORE, 2) for method in METHODS) < 0.01
    assert summary("c = 1", CALLS_MORE) < summary("ancestral", CALLS_MORE)


def test_in_windows_the_ancestral_masses_drift_and_the_reweighted_meet_the_target():
    assert 0.05 < summary("ancestral", WINDOW, 2) < 0.1
    for method in METHODS[4:]:
        assert summary(method, WINDOW, 2) <= 0.05
    within = [value(f"multimodal.window.{m}.within") for m in ("starts", "ancestral", "c50")]
    assert within[0] == value("multimodal.window.ancestral.runs") > within[1] > within[2]


def test_many_starts_are_cheapest_of_all_that_meet_the_target():
    for calls in (CALLS_FEW, CALLS_WINDOW):
        others = [summary(method, calls) for method in METHODS[3:5]]
        assert summary("many starts", calls) < min(others)


@pytest.mark.parametrize(("n", "wrong"), [(2, False), (3, True), (6, False)])
def test_after_three_poses_the_gaussian_that_is_drawn_has_the_wrong_place(n, wrong):
    view = multimodal.view(multimodal.Config(), label=0, n=n)
    assert (np.linalg.norm(view.gaussian[0] - view.truth) > 1) == wrong  # m


def shown(word):
    """What the cell whose source has the `word` has shown, which nbval compares."""
    (cell,) = (c for c in read_notebook("09_multimodal").cells
               if c.cell_type == "code" and word in c.source)  # fmt: skip
    out = cell.outputs[0]
    return out["text"] if "text" in out else out["data"]["text/html"]


def test_both_shares_fall_from_one_half_to_almost_nothing_and_differ_a_little():
    rows = re.findall(r"^ +(\d+) +\S+ +([\d.]+) +([\d.]+)$", shown("share of the image"), re.M)
    n, image, second = np.array(rows, dtype=float).T
    assert (np.diff(image) <= 0).all()
    assert (np.diff(second) <= 0).all()
    for share in (image, second):
        assert share[n == 2] == 0.5
        assert (share[n == 3] > 0.4).all()  # two places
        assert (share[n >= 5] < 0.03).all()
    assert 0.01 < np.abs(image - second).max() < 0.15


def test_a_careless_ring_is_too_heavy_inside_and_hardly_so_with_the_papers_ranges():
    off = {}
    for sigma in (1.0, two_anchors.posterior().range_sigma):
        target = replace(two_anchors.posterior(), range_sigma=sigma)
        prior = ancestral_priors.ring(target)
        points = prior.draw(20_000, rng=np.random.default_rng(100))
        weights = np.exp(target(points) - prior.log_density(points))
        lengths = np.linalg.norm(points - target.positions[0], axis=1)
        careless = np.mean(weights * target.ranges[0] / lengths)
        off[sigma] = np.log(careless / np.mean(weights))
    assert off.pop(1.0) > 0.05
    assert abs(*off.values()) < 0.01
    right, wrong = (float(x) for x in re.findall(r"by ([+-][\d.]+) nats", shown("carelessly")))
    assert abs(right) < 0.02 < wrong


def test_what_the_mirror_test_missed_has_a_gap_just_above_the_limit_and_an_image_of_small_mass():
    limit = multimodal.Config().gap_limit
    rows = re.findall(r"<tr>(.*?)</tr>", shown("missed = landmarks"), re.S)
    missed = [re.findall(r"[\d.]+", re.sub("<[^>]*>", " ", row)) for row in rows]
    assert len(missed) == min(8, value("multimodal.landmark.mirror.missed"))
    for _, kl, second, gap, _ in np.array(missed, dtype=float):
        assert kl > 1
        assert second < 0.05
        assert limit <= gap < limit + 1


def test_brute_force_has_tens_of_thousands_of_points():
    target = multimodal.landmark(multimodal.Config(), 0, 3)
    assert 1e4 < len(reference.polar_grid(target, reference.N_RADII, reference.N_ANGLES)[0]) < 1e5
