"""Sentences of notebook 04 about signs and orders, on its stored tables."""

import numpy as np
from stored_results import value

from sngr_utils import cost
from sngr_utils.experiments import refinement_cost
from sngr_utils.experiments.bench import MOST_BIAS, MOST_ERROR
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sngr.baseline import run_baseline
from sngr_utils.world.scenario import Scenario

ENGINES = range(1, 7)  # rows: three of dynesty, two compiled, the fast path
DYNESTY, FEW, MANY, FAST = range(3), 3, 4, 5
ASKED = {"closure.call_over_window", "growth.anew_slope"}


def column(number, part=""):
    """(6,) of the table of accuracy."""
    return np.array(
        [value(f"tab_accuracy.row{i}.column{number}{part}") for i in ENGINES],
        dtype=float,
    )


def test_two_engines_may_have_a_ratio_and_dynesty_has_too_few_runs():
    bias, error = column(3), column(3, ".2")
    small, known = np.abs(bias) + 1.96 * error <= MOST_BIAS, error <= MOST_ERROR
    assert np.flatnonzero(small & known).tolist() == [MANY, FAST]
    assert not known[list(DYNESTY)].any()
    assert (np.abs(bias) < 1.96 * error)[list(DYNESTY)].all()


def test_short_walks_leave_a_bias_of_four_tenths():
    bias, error = column(3), column(3, ".2")
    assert 0.35 < bias[FEW] < 0.45
    assert bias[FEW] > 10 * error[FEW]


def test_the_fast_path_errs_least():
    for quantity in (4, 5):  # rms of log Z, error of the mean
        assert column(quantity).argmin() == FAST


def test_one_start_is_wrong_and_content_in_every_run_and_many_are_right():
    one, many = ([value(f"tab_two_modes.row{row}.column{j}") for j in (2, 3)] for row in (1, 2))
    assert one == [0, 40]
    assert many == [40, 0]


def test_the_saving_is_total_over_triggered():
    """Under C at the first level: 28 windows, and those that fire there in notebook 03."""
    fired = value("tab_sngr.row17.column6")
    assert fired == 20
    saving = value("cost.saving_calls")
    assert abs(saving * fired / 28 - 1) < 0.1


def test_triggers_are_the_printed_ones_on_clean_data_under_b_only():
    """At the first, third and fourth level the paper prints a number; tau as in notebook 03."""
    printed, a, b, c = (
        [value(f"tab_sngr.row{row}.column{j}") for row in (17, 19, 20)] for j in (3, 4, 5, 6)
    )
    assert b[0] == printed[0] < a[0] < c[0]
    assert all(ours[1:] != printed[1:] for ours in (a, b, c))
    for others in zip(a[1:], b[1:], c[1:], strict=True):
        assert not set(others) & set(printed[1:])


def test_b_saves_nearly_as_much_as_printed_and_a_less():
    """Counts of calls on clean data, so the same on every machine."""
    config = cost.Config()
    saved = {}
    for preset in ("A", "B"):
        chosen = config.under(preset).chosen
        base = run_baseline(config.part(Scenario), chosen, 0.0, config.seed)
        saved[preset] = refinement_cost.measure(
            base, chosen, config.tau, config.part(SamplerSettings), "nested"
        ).saving_calls
    assert value("cost.saving_calls") < 1.5 < saved["A"] < 5 < 6 < saved["B"] < 7.6


def test_one_by_one_the_closure_costs_what_its_factors_say_and_in_one_call_half_as_much():
    """Times of a quiet machine; `test_findings_times` says whether it was one."""
    more = value("closure.all_factors") / value("closure.window_factors")
    assert 0.75 < value("closure.loop_over_window") / more < 1.33
    assert 2 < value("closure.call_over_window") < 0.6 * more


def test_most_of_a_windows_time_is_no_likelihood_and_all_windows_cost_a_few_runs_of_isam2():
    assert value("cost.likelihood_share") < 50
    assert 1 < value("engine.fast_all_over_isam2") < 10


def test_marginals_grow_with_the_length_and_asked_anew_with_its_square():
    assert value("growth.slope") <= 1
    assert 1.7 < value("growth.anew_slope") < 2.4
    assert 1 < value("growth.together.first") < value("growth.together.last")
