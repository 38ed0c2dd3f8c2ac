"""The helpers behind the notebooks are small, and their parameters cost nothing to check."""

import subprocess
import sys

import pytest

from sngr_utils import paths

LIGHT = ("audit", "triggers", "peers", "association_aware", "multimodal")
HEAVY = {"gtsam", "numba", "papermill", "dynesty", "matplotlib", "pandas", "scipy", "joblib"}
LINES = 150


@pytest.mark.parametrize("stem", LIGHT)
def test_a_helper_fits_on_two_pages(stem):
    assert len((paths.PACKAGE / f"{stem}.py").read_text().splitlines()) <= LINES


def test_parameters_are_checked_without_anything_heavy():
    code = [f"import sngr_utils.{stem}; sngr_utils.{stem}.Config()" for stem in LIGHT]
    code += ["import sys", f"print(sorted({HEAVY} & set(sys.modules)))"]
    found = subprocess.run(
        [sys.executable, "-c", "\n".join(code)], cwd=paths.ROOT, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert found.stdout.strip() == "[]"
