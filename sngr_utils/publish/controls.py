"""What the verdicts are worth: the rules asked about numbers that the paper does not print.

A rule that accepts anything reproduces everything. So the count of reproduced rows stands beside
the counts for numbers drawn at random from their natural ranges, for the printed ones in any
other order, for a world of ours in the paper's place, and for a trigger that never fires. All are
means over many such numbers, and of the rows that our worlds can test.
"""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
import pandas as pd

from sngr_utils.publish import claims, number_tests, printed, rules
from sngr_utils.publish.contradictions import contradictions
from sngr_utils.publish.number_tests import NumberTest


def all_tests(results: dict[str, dict], preset: str) -> Iterator[NumberTest]:
    """Every test against samples of worlds under a preset, testable or not."""
    refuted = {
        path: clash.why for clash in contradictions(printed.leaves()) for path in clash.paths
    }
    for entry in claims.read().numbers:
        if entry.rule in number_tests.KINDS:
            tested, _ = number_tests.counted(entry, refuted)
            yield from number_tests.tests(entry, results, preset, tested)


def testable(tests: Iterable[NumberTest]) -> list[NumberTest]:
    """Those that refuse most of what their numbers could have been."""
    return [test for test in tests if not test.powerless and test.share <= rules.MAX_SHARE]


def shares(tests: list[NumberTest], passed: Callable[[NumberTest], float]) -> np.ndarray:
    """(k,) how often each of the tests passes, those left out to which the question is no use."""
    found = np.array([passed(test) for test in tests])
    return found[np.isfinite(found)]


def as_printed(test: NumberTest) -> float:
    """1 if the printed numbers pass, else 0."""
    return float(test.accepts(test.values[None])[0])


def never_firing(test: NumberTest) -> float:
    """The same for a trigger that never fires; NaN where the numbers are not of a trigger."""
    if test.entry.silent is None:
        return np.nan
    return float(test.accepts(np.full((1, len(test.was)), test.entry.silent))[0])


def table(results: dict[str, dict], preset: str) -> pd.DataFrame:
    """Whose numbers, the rows asked, how many of them pass on average, and their share."""
    tests = testable(all_tests(results, preset))
    of_triggers = [test for test in tests if test.entry.silent is not None]
    cases = {
        "printed": shares(tests, as_printed),
        "random": np.array([test.share for test in tests]),
        "fresh": shares(tests, NumberTest.fresh),
        "series": shares([test for test in tests if np.isfinite(test.shuffled())], as_printed),
        "shuffled": shares(tests, NumberTest.shuffled),
        "triggers": shares(of_triggers, as_printed),
        "silent": shares(of_triggers, never_firing),
    }
    lines = [(name, len(found), found.sum()) for name, found in cases.items()]
    return pd.DataFrame(lines, columns=["numbers", "rows", "pass"]).set_index("numbers")
