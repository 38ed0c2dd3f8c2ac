"""Times that are stored were taken on a quiet machine; none is left out, none goes untold."""

import pytest
from helpers import read_notebook
from stored_results import value

from sngr_utils import paths
from sngr_utils.publish import files, notebooks

MOST_BUSY = 0.1  # of the machine's time, that others may have had meanwhile
MOST_ERROR = 0.1  # standard error of a ratio of times, over the ratio
STORED = {name: read_notebook(name) for name in notebooks.names()}
TIMED = [
    name for name, found in STORED.items() if any("timing=True" in c.source for c in found.cells)
]
ASKED = {f"clock.{name}.others" for name in TIMED}


def test_every_stored_time_is_of_a_notebook_that_is_known_to_time():
    """By the files of times in the reference, and by the cells that no comparison looks at."""
    kept = {path.name.split(".")[0] for path in paths.REFERENCE.glob("*.timings.json")}
    ignored = {
        name
        for name, found in STORED.items()
        if any("nbval-ignore-output" in c.metadata.get("tags", []) for c in found.cells)
    }
    assert kept == ignored == set(TIMED)


@pytest.mark.parametrize("name", TIMED)
def test_stored_times_were_taken_on_a_quiet_machine(name):
    """In the reference and in the stored outputs, which are of one run.

    A failure says: execute this notebook alone, nothing else running, and store it again.
    """
    share = value(f"clock.{name}.others")
    assert share < MOST_BUSY
    assert STORED[name].metadata["others"] == round(share, 3)


@pytest.mark.parametrize("name", TIMED)
def test_stored_ratios_of_times_have_a_small_error(name):
    """Which a neighbour that comes and goes makes large."""
    clocks = files.read_json(paths.REFERENCE / f"{name}.timings.json")
    for key, entry in clocks.items():
        error = entry.get("standard_error")
        assert error is None or error < MOST_ERROR * entry["value"], key
