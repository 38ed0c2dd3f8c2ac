"""Printed digits, and contradictions found and not invented."""

import pytest

from sngr_utils.publish import printed, report
from sngr_utils.publish.contradictions import contradictions


@pytest.fixture
def numbers():
    return dict(printed.leaves())


def test_digits_survive():
    four = printed.leaves()["tau_sensitivity", "3.92", "clean"]
    assert (four.value, four.low, four.high, four.decimals) == (0, -0.5, 0.5, 0)
    assert printed.number("4.00").decimals == 2
    assert printed.number("4.00").allows(3.995)
    assert not printed.number("4.00").allows(3.994)
    assert printed.number("4").allows(4.4)
    assert printed.number("-73").allows(-73.5)
    assert printed.number("null").value is None
    assert not printed.number("null").allows(0.0)
    with pytest.raises(ValueError, match="'about 4' is not a number"):
        printed.number("about 4")


def test_the_same_numbers_as_floats():
    loaded = report.printed_values()
    for path, number in printed.leaves().items():
        at = loaded
        for name in path:
            at = at[int(name)] if isinstance(at, list) else at[_key(at, name)]
        assert at == number.value


def test_leaves_are_read_anew_as_they_are_kept():
    again = printed.leaves.__wrapped__()
    assert again == printed.leaves()
    assert list(again)[:3] == [("bimodal", "map", "0"), ("bimodal", "map", "1"),
                               ("bimodal", "ns_best", "0")]  # fmt: skip
    assert again["baseline", "0.0", "precision"].value is None


def _key(at, name):
    return next(key for key in at if str(key) == name or _same_number(key, name))


def _same_number(key, name):
    try:
        return float(key) == float(name)
    except ValueError:
        return False


def test_ratio_holds_all_that_rounding_allows():
    got = printed.ratio(printed.number("336"), printed.number("44"))
    assert got.value == pytest.approx(336 / 44)
    assert (got.low, got.high) == pytest.approx((335.5 / 44.5, 336.5 / 43.5))
    assert got.decimals == 1
    scaled = printed.ratio(printed.number("336"), printed.number("44"), 28)
    assert (scaled.value, scaled.low, scaled.high) == pytest.approx((
        12 / 44,
        335.5 / 44.5 / 28,
        336.5 / 43.5 / 28,
    ))
    for over, under in (("336", "0"), ("336", "null"), ("null", "44")):
        nothing = printed.ratio(printed.number(over), printed.number(under))
        assert (nothing.value, nothing.low, nothing.high, nothing.decimals) == (None, None, None, 1)


def test_magnitude_turns_a_negative_number_round():
    turned = printed.number("-2.232").magnitude()
    assert (turned.value, turned.decimals) == (2.232, 3)
    assert (turned.low, turned.high) == pytest.approx((2.2315, 2.2325))
    for text in ("2.2", "0", "null"):
        assert printed.number(text).magnitude() == printed.number(text)


def test_a_range_is_allowed_if_it_meets_what_rounds_to_the_number():
    number = printed.number("0.54")
    for low, high, allowed in (
        (0.1, 0.534, False), (0.1, 0.535, True), (0.545, 0.9, True), (0.546, 0.9, False),
        (0.1, 0.9, True), (0.539, 0.541, True),
    ):  # fmt: skip
        assert number.allows(low, high) is allowed
    dash = printed.number("null")
    assert (dash.low, dash.high, dash.decimals) == (None, None, 0)
    assert not dash.allows(-1.0, 1.0)


def test_match():
    assert printed.match("baseline/{p}/rmse", ("baseline", "0.1", "rmse")) == {"p": "0.1"}
    assert printed.match("baseline/{p}/rmse", ("baseline", "0.1", "rmse_std")) is None
    assert printed.match("baseline/{p}", ("baseline", "0.1", "rmse")) is None


# the saving is largest without noise, whichever number is repaired
STANDS = {("", "moderate noise")}


def found(numbers):
    return {
        ("/".join(path), c.relation) for c in contradictions(numbers) for path in c.paths or [()]
    }


def test_what_the_paper_contradicts_and_nothing_else(numbers):
    assert found(numbers) == {
        ("bimodal/error_from_mode_ns", "distance"),  # 0.0165 m by its own coordinates
        ("per_seed_p0.3/3/triggered", "counts"),
        ("per_seed_p0.3/3/tp", "counts"),
        ("per_seed_p0.3/3/fp", "counts"),
        ("per_seed_p0.3/3/recall", "recall"),  # 10/23
        ("baseline/0.4/recall", "recall"),  # no share of 26 windows rounds to it
        ("diagnostics_p0.2/delta_logp_range/1", "largest gain"),
        ("diagnostics_p0.2/delta_logp_max_in_conclusion", "largest gain"),
        ("", "precision one"),
        ("", "choice of tau"),
        *STANDS,
    }


def test_contradictions_say_what_does_not_fit(numbers):
    assert [clash.why for clash in contradictions(numbers)] == [
        "the printed point lies 0.0159 m or more from the mode",
        "10 triggers, but TP + FP = 12",
        "the counts give 10/23",
        "the row gives 23/26",
        "the table has less than 1 at p = 0.4",
        "3.92 is as silent and recalls more, 4 is as silent and larger",
        "the table has 7.6 at p = 0, without noise in the labels",
        "two values of the same maximum",
    ]


def test_the_threshold_of_the_paper_is_no_contradiction_where_no_larger_one_is_silent(numbers):
    assert ("", "choice of tau") in found(numbers)
    numbers["tau_sensitivity", "4.00", "clean"] = printed.number("1")
    assert ("", "choice of tau") not in found(numbers)


# what would repair each contradiction
REPAIRS = {
    "bimodal/error_from_mode_ns": "0.016",
    "per_seed_p0.3/3/triggered": "12",
    "per_seed_p0.3/3/recall": "0.43",
    "baseline/0.4/recall": "0.88",
    "baseline/0.4/precision": "1.00",
    "diagnostics_p0.2/delta_logp_max_in_conclusion": "5.04",
    "tau_sensitivity/3.92/noisy_p0.3": "15",
}


def repaired(numbers):
    for path, text in REPAIRS.items():
        numbers[tuple(path.split("/"))] = printed.number(text)
    # with a precision of 1 all 24 alarms are right
    numbers["baseline", "0.4", "recall"] = printed.number("0.92")
    return numbers


def test_consistent_numbers_are_not_flagged(numbers):
    assert found(repaired(numbers)) == STANDS


SAME = "two tables disagree"


@pytest.mark.parametrize(
    ("path", "text", "expected"),
    [
        ("bimodal/delta_logp", "12.52", {
            ("bimodal/delta_logp", "gain", "not the difference printed")}),
        ("bimodal/error_from_mode_map", "2.230", {  # sqrt 5 = 2.2361, y known to half a thousandth
            ("bimodal/error_from_mode_map", "distance",
             "the printed point lies 2.2356 m or more from the mode")}),
        ("per_seed_p0.3/1/precision", "0.97", {
            ("per_seed_p0.3/1/precision", "precision", "the counts give 8/8")}),
        ("per_seed_p0.3/2/recall", "null", {
            ("per_seed_p0.3/2/recall", "recall", "the counts give 0/17")}),
        ("baseline/0.2/recall", "0.20", {
            ("baseline/0.2/recall", "recall", "the row gives 4/26")}),
        ("baseline/0.3/triggered", "27", {
            ("baseline/0.3/triggered", "eligible", "more than may fire"),
            ("baseline/0.3/recall", "recall", "the row gives 27/26"),
            ("tau_sensitivity/3.96/noisy_p0.3 baseline/0.3/triggered", "repeated", SAME),
            ("per_seed_p0.3/0/triggered baseline/0.3/triggered", "repeated", SAME)}),
        ("sngr/0.2/precision", "0.98", {  # 13.7 of 14 windows
            ("sngr/0.2/precision", "precision", "the row gives 14/14")}),
        ("sngr/0.3/recall", "0.88", {
            ("sngr/0.3/recall", "recall", "the row gives 22/26")}),
        ("cost/0.0/triggered", "5", {
            ("cost/0.0/triggered sngr/0.0/triggered", "repeated", SAME),
            ("cost/0.0/refine", "seconds per window", "44 s for 5 windows")}),
        ("tau_sensitivity/4.00/noisy_p0.3", "15", {
            ("tau_sensitivity/3.96/noisy_p0.3 tau_sensitivity/4.00/noisy_p0.3", "monotone",
             "more triggers above a higher threshold")}),
        ("tau_sensitivity/3.96/clean", "1", {
            ("tau_sensitivity/3.92/clean tau_sensitivity/3.96/clean", "monotone",
             "more triggers above a higher threshold")}),
        ("cost/0.0/saving", "7.4", {("cost/0.0/saving", "saving", "336 / 44 seconds")}),
        ("cost/0.1/saving", "1.0", {("cost/0.1/saving", "saving", "336 / 0 seconds")}),
        ("cost/0.2/refine", "180", {
            ("cost/0.2/refine", "seconds per window", "180 s for 14 windows")}),
        ("cost/0.1/refine", "9", {
            ("cost/0.1/saving", "saving", "336 / 9 seconds"),
            ("cost/0.1/refine", "seconds per window", "9 s for 0 windows")}),
        ("cost/0.0/exhaustive", "400", {
            ("cost/0.0/saving", "saving", "400 / 44 seconds"),
            ("cost/0.0/exhaustive", "seconds per window", "400 s for 28 windows")}),
        ("diagnostics_p0.2/delta_logp_max_in_conclusion", "5", set()),  # 5.04, rounded
        ("diagnostics_p0.2/delta_logp_max_in_conclusion", "5.1", {
            ("diagnostics_p0.2/delta_logp_range/1 diagnostics_p0.2/delta_logp_max_in_conclusion",
             "largest gain", "two values of the same maximum")}),
    ],
)  # fmt: skip
def test_each_relation_can_be_violated(numbers, path, text, expected):
    """One number altered in a consistent set: what then clashes, and in whose words."""
    numbers = repaired(numbers)
    numbers[tuple(path.split("/"))] = printed.number(text)
    assert {
        (" ".join("/".join(leaf) for leaf in clash.paths), clash.relation, clash.why)
        for clash in contradictions(numbers)
        if ("", clash.relation) not in STANDS
    } == expected


@pytest.mark.parametrize(
    ("windows", "seconds", "clashes"),
    [("10", "1.0E+2", False), ("11", "1.0E+2", True), ("14", "1.8E+2", False),
     ("13", "1.8E+2", True)],
)  # fmt: skip
def test_seconds_per_window_may_lie_at_the_very_end_of_their_rounding(
    numbers, windows, seconds, clashes
):
    """11 to 12 s is 10.5 to 12.5 s: 10 windows take 105 s, what 100 may have been, and 14 take
    175 s, what 180 may have been if the units were not known."""
    numbers = repaired(numbers)
    numbers["cost", "0.2", "triggered"] = printed.number(windows)
    numbers["cost", "0.2", "refine"] = printed.number(seconds)
    assert (("cost/0.2/refine", "seconds per window") in found(numbers)) == clashes


def test_rounding_explains_175_seconds_for_14_windows(numbers):
    """12.5 s per window beside "11 to 12": 174.6 s would do, so it is no contradiction."""
    assert numbers["cost", "0.2", "refine"].value == 175
    assert "seconds per window" not in {relation for _, relation in found(numbers)}
