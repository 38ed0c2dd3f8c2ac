"""A helper's `Config` can be read without what its functions run, so checks take no time.

Likewise what a notebook shows can be imported without GTSAM, which no table or figure needs.
"""

import subprocess
import sys

import pytest

from sngr_utils import paths
from sngr_utils.publish import notebooks

HEAVY = {"gtsam", "numba", "papermill", "matplotlib", "dynesty", "pandas", "scipy", "joblib"}
SHOWN = ["start_here", "factor_graph", "bimodal", "trigger_sweep", "full_sngr", "cost", "style",
         "common"]  # fmt: skip
LINES = dict.fromkeys([name[3:] for name in notebooks.names()], 150) | {"bimodal": 200}


def loaded(modules: list[str], watched: set[str]) -> set[str]:
    """Which of `watched` are loaded once a fresh Python has imported `modules`."""
    built = "; ".join(f"getattr({name}, 'Config', int)()" for name in modules)
    code = f"import sys, {', '.join(modules)}; {built}; print(*({watched!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("stem", LINES)
def test_a_helper_fits_on_two_pages(stem):
    assert len((paths.PACKAGE / f"{stem}.py").read_text().splitlines()) <= LINES[stem]


def test_helpers_and_their_parameters_load_nothing_heavy():
    assert loaded([f"sngr_utils.{stem}" for stem in LINES], HEAVY) == set()


def test_what_is_shown_needs_no_gtsam():
    assert loaded([f"sngr_utils.show.{stem}" for stem in SHOWN], {"gtsam", "numba"}) == set()


def test_what_is_heavy_would_be_noticed():
    assert "gtsam" in loaded(["sngr_utils.sngr.windows"], HEAVY)


def test_no_grammar_is_parsed_for_what_nothing_checks():
    """Neither here nor where notebooks are executed: it costs every process a second."""
    assert "rfc3987_syntax.syntax_helpers" not in sys.modules
