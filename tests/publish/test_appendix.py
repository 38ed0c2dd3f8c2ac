"""The artifact appendix says of each claim what to run and what to expect, within what."""

import pytest

from sngr_utils import paths
from sngr_utils.publish import appendix, judge, results, verified, verify


@pytest.fixture(scope="module")
def reference():
    return results.results_in(paths.REFERENCE)


@pytest.fixture(scope="module")
def rows(reference):
    return judge.evaluate(reference)


def lines_of(text):
    return [line.removesuffix(r" \\").split(" & ") for line in text.split("\n") if " & " in line]


def test_each_claim_that_can_be_checked_has_its_line(rows, reference, monkeypatch):
    monkeypatch.setattr(verified, "minutes", lambda: {"05_audit": 3.2})
    text = appendix.latex_text(rows, reference, {"cost.window_over_isam2"})
    told = [line[0] for line in lines_of(text) if line[0] != "claim"]
    expected = [row.id for row in rows if row.verdict not in ("follows", "cannot hold")]
    assert sorted(told) == sorted(expected)
    assert r"\texttt{make run/05\_audit}, 192 s." in text
    assert r"\texttt{make run/04\_cost}, not timed." in text
    clocks = {line[0]: line[3] for line in lines_of(text)}
    assert clocks["window-dear"] == appendix.CLOCK


def test_what_is_said_to_be_tolerated_is_what_verify_tolerates(rows, reference):
    """Every value moved to just inside and just outside of what the appendix says."""
    tried = 0
    for claim, key, _, allowed in lines_of(appendix.latex_text(rows, reference, set()))[1:]:
        name = key.split(" and ")[0].replace(r"\_", "_")
        if "pm" not in allowed:
            continue
        size, entry = float(allowed.split()[-1]), reference[name]
        for share, holds in ((0.9, True), (1.1, False)):
            now = {name: entry | {"value": entry["value"] + share * size}}
            (row,) = verify.compare_values({name: entry}, now)
            assert row.holds == holds, claim
            tried += 1
    assert tried > 60
