"""Sentences of notebook 03 about signs and orders, on its stored tables."""

import numpy as np
import pytest
from stored_results import said, value

from sngr_utils import full_sngr


def rows(quantity):
    """(4 levels, presets A, B and C) of the n-th quantity of the table of the paper."""
    cells = [
        [f"tab_sngr.row{4 * quantity + i}.column{4 + j}" for j in range(3)] for i in (1, 2, 3, 4)
    ]
    return np.array([[value(cell) for cell in row] for row in cells], dtype=float)


def of_preset(quantity):
    """Presets A, B and C in a row of the table of the gains."""
    return np.array([value(f"tab_presets_gain.row{quantity}.column{j}") for j in (3, 4, 5)])


def test_more_is_accepted_the_more_labels_are_wrong_and_nothing_on_clean_data():
    accepted = rows(5)
    assert accepted[0].tolist() == [0, 0, 0]
    assert (np.diff(accepted[:, 2]) > 0).all()
    fired = rows(4)[:, 2]
    assert fired[1] / 2 < accepted[1, 2] < fired[1]  # under C: most at p = 0.1
    assert (accepted[2:, 2] == fired[2:]).all()  # and every window above


def test_the_error_hardly_changes_and_under_c_it_falls():
    before, after = rows(0), rows(1)
    change = after / before - 1
    assert (np.abs(change) < 0.04).all()
    assert (np.abs(after - before) < 0.05).all()  # m, where wrong labels make it one or two:
    assert (np.abs(before[1:, 2] - 1.5) < 0.65).all()
    assert (np.abs(change[:, :2]) < 0.01).all()
    assert (change[1:, 2] < 0).all()
    assert change[-1, 2] < -0.01


def test_lazy_relinearisation_gains_everywhere_and_eager_next_to_nothing():
    least, median, largest = (of_preset(row) for row in (3, 4, 5))
    assert (least[[0, 2]] > 0).all()
    assert abs(median[1]) < 0.05
    assert largest[0] < 1.0 < 5.04 < largest[2]
    assert largest[1] < 1.0
    assert least[2] < 1.0 < 5.842 < largest[2]  # a wider range than the printed one
    assert 0.5 < value("sngr.ess_median") < 0.65


def test_it_fires_under_every_preset_at_small_p_and_on_clean_data():
    fired = rows(4)
    assert (fired[:2] > 0).all()
    assert (rows(6)[0] == 0).all()  # precision on clean data


def test_odometry_alone_is_better_from_the_first_wrong_labels_on():
    assert (rows(0)[1:, 2] > value("sngr.odometry_rmse")).all()
    assert rows(0)[0, 2] < value("sngr.odometry_rmse")
    printed = [value(f"tab_sngr.row{4 + i}.column3") for i in (1, 2, 3, 4)]
    assert (np.array(printed) > rows(1)[:, 2]).all()


def test_a_proposal_wider_than_odometry_costs_thousands_of_nats_and_not_seventy():
    assert value("noop.mean_log_weight") < -1000


def test_the_gate_is_ten_times_finer_than_the_noise_of_a_mean():
    assert 8 < value("sngr.mean_cost") / 0.001 < 13


def test_the_clouds_of_the_window_that_is_shown_are_narrow_and_the_truth_is_outside_all():
    """By the fast path, which samples this window as dynesty does."""
    config = full_sngr.Config(p_levels=[0.2, 0.3], engine="fast")
    level = full_sngr.run(config)[config.p_diagnosed]
    window = full_sngr.example_window(config, level)
    assert window.t == 14
    truth, estimate, samples, mean = full_sngr.window_positions(config, level, window)
    reach = np.linalg.norm(samples - estimate, axis=2).max(axis=0)
    assert (reach < 0.25).all()  # m
    assert (np.linalg.norm(truth - estimate, axis=1) > 1).all()
    assert (np.linalg.norm(mean - estimate, axis=1) < 0.05).all()


def test_clean_windows_lose_what_a_mean_loses_and_others_gain():
    """Of the table: p, refined, accepted, median and largest gain, change of the RMSE."""
    table = np.reshape(said("03_full_sngr", "show.gain_table(levels)"), (4, 6))
    median, largest = table[:, 3], table[:, 4]
    assert abs(median[0] + value("sngr.mean_cost")) < 0.005
    assert largest[0] < 0 < median[1] < min(median[2:])
    assert (np.diff(largest) > 0).all()


def test_the_window_has_a_tenth_of_the_samples_that_the_gate_asks_for():
    samples, loss = said("03_full_sngr", "n_own = effective")
    assert 8 < 9 / (2 * 0.001) / samples < 12
    assert loss == round(9 / (2 * samples), 3)


@pytest.mark.parametrize("preset", ["A", "B", "C"])
def test_the_effective_sample_size_is_the_same_whether_a_window_gains_or_not(preset):
    """By the compiled sampler, as A and B are in the notebook; C by dynesty has the median."""
    level = full_sngr.run_level(full_sngr.Config(engine="nested", preset=preset), 0.2)
    assert 0.5 < min(level.ess_shares) <= max(level.ess_shares) < 2 / 3
    assert (max(level.gains) > 10, np.median(level.gains) < 0) == (preset == "C", preset == "B")


def test_the_step_gains_more_in_every_window_over_two_orders_of_magnitude():
    more, windows = said("03_full_sngr", "stepped = []")
    assert more == windows == value("sngr.refined.C")
    least, largest = (of_preset(row)[2] for row in (3, 5))
    assert 1.8 < np.log10(largest / least) < 2.2


def test_what_the_exercises_print():
    """Spread without and with the root; log weights; gains at a skip of 1, 2, 5 and 10."""
    _, printed, _, correct = said("03_full_sngr", "level.spread_ratios(sampled)")
    assert correct < 1 < printed
    assert 1.25 < printed / correct < np.sqrt(2)
    sampled, exact = said("03_full_sngr", "full_sngr.noop_means")
    assert exact < -1000
    assert abs(sampled / exact - 1) < 0.02
    skips = np.reshape(said("03_full_sngr", "for skip in (1, 2, 5, 10)"), (4, 3))
    median, largest = skips[:, 1], skips[:, 2]
    assert abs(median[0]) < 0.1 < 0.5 < median[-1]
    assert (np.diff(median) >= 0).all()
    assert largest.argmax() == 2
    assert largest[0] > largest[1]
    assert largest[0] < largest[-1] / 2  # most of the gain went
