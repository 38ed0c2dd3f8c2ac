"""A helper's `Config` can be read without what its functions run, so checks take no time.

Likewise what a notebook shows can be imported without GTSAM, which no table or figure needs.
"""

import subprocess
import sys

import pytest

HEAVY = {"gtsam", "numba", "papermill", "matplotlib", "dynesty"}
LIGHT = ["bimodal", "trigger_sweep", "full_sngr", "cost"]  # of the nine helpers
SHOWN = ["style", "common", *LIGHT]


def loaded(modules: list[str], watched: set[str]) -> set[str]:
    """Which of `watched` are loaded once a fresh Python has imported `modules`."""
    code = f"import sys, {', '.join(modules)}; print(*({watched!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_helpers_load_nothing_heavy():
    assert loaded([f"sngr_utils.{stem}" for stem in LIGHT], HEAVY) == set()


def test_what_is_shown_needs_no_gtsam():
    assert loaded([f"sngr_utils.show.{stem}" for stem in SHOWN], {"gtsam", "numba"}) == set()


@pytest.mark.parametrize("module", ["gtsam", "sngr_utils.slam.isam2", "sngr_utils.sngr.windows"])
def test_what_is_heavy_would_be_noticed(module):
    assert "gtsam" in loaded([module], HEAVY)
