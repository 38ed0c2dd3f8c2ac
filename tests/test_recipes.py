"""Every program of docs/recipes.md runs as it stands; its assertions are its claims."""

import re

import pytest

from sngr_utils import paths

PAGE = (paths.ROOT / "docs/recipes.md").read_text(encoding="utf-8")
PROGRAMS = dict(re.findall(r"^## (.+?)\n.*?```python\n(.*?)```", PAGE, re.M | re.S))


def test_each_recipe_has_a_program_with_something_to_fail():
    assert len(PROGRAMS) == PAGE.count("\n## ") == PAGE.count("```python") == 6
    assert all("assert " in program for program in PROGRAMS.values())


@pytest.mark.parametrize("title", PROGRAMS)
def test_it_runs(title):
    exec(compile(PROGRAMS[title], title, "exec"), {"__name__": title})
