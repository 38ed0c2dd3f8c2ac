"""Every constant of the online estimator is changed, everywhere it is used, and put back."""

import pytest

from sngr_utils.experiments import sensitivity
from sngr_utils.online import belief, estimator, rivals, slips


def test_every_number_of_the_online_estimator_is_tried():
    found = sensitivity.constants()
    assert {("belief", "WINDOW"), ("slips", "SLIP_ODDS"), ("rivals", "SCANS")} <= set(found)
    assert not [name for _, name in found if name in sensitivity.FIXED]
    assert {("relocalisation", "SINGLE"), ("relocalisation", "REFINED")} <= set(found)  # one line
    modules = [module for module, name in found if name == "WINDOW"]
    assert modules == ["belief"]  # where it is set, not where it is imported


def test_a_constant_changes_wherever_it_is_imported_and_comes_back():
    before = belief.WINDOW
    with sensitivity._changed("belief", "WINDOW", 2.0):
        assert belief.WINDOW == estimator.WINDOW == 2 * before
        assert isinstance(belief.WINDOW, int)
    assert belief.WINDOW == estimator.WINDOW == before
    odds = slips.SLIP_ODDS
    with (
        pytest.raises(KeyError, match=r"0\.5"),
        sensitivity._changed("slips", "SLIP_ODDS", 0.5),
    ):
        _ = {}[float(slips.SLIP_ODDS / odds)]
    assert odds == slips.SLIP_ODDS


def test_a_probability_stays_one():
    assert sensitivity.scaled("RESOLVED", 0.6, 2.0) == pytest.approx(0.75)
    assert sensitivity.scaled("EXPLAINED", rivals.EXPLAINED, 2.0) < 1
    assert sensitivity.scaled("SCANS", 1, 0.5) == 1
    assert sensitivity.scaled("MANY", rivals.MANY, 2.0) == 2 * rivals.MANY
