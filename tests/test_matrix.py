"""The situations of `make matrix`, and what is remembered of them."""

import json
import sys

import pytest

from sngr_utils import paths

MATRIX = paths.ROOT / "scripts/matrix"


@pytest.fixture(scope="module")
def situations():
    """Names of all situations, by the module that has them."""
    sys.path.insert(0, str(MATRIX))
    try:
        import archives
        import files
        import machines
        import texts
    finally:
        sys.path.remove(str(MATRIX))
    return {part.__name__: list(part.SITUATIONS) for part in (machines, texts, files, archives)}


def test_no_two_situations_have_one_name(situations):
    names = [name for part in situations.values() for name in part]
    assert len(names) == len(set(names)) > 60


def test_what_was_clean_is_a_situation_and_nearly_all_have_been(situations):
    clean = json.loads((MATRIX / "clean.json").read_text(encoding="utf-8"))
    names = {name for part in situations.values() for name in part}
    assert clean.keys() <= names
    assert len(clean) > 0.8 * len(names)  # others are skipped where they were tried
