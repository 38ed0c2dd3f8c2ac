"""The committed notebooks as a reader finds them (nbval re-runs them besides)."""

import ast
import re
import tomllib

import nbformat
import pytest
from helpers import read_notebook

from sngr_utils import paths
from sngr_utils.publish import notebooks, parameters

NAMES = sorted(path.stem for path in paths.NOTEBOOKS.glob("*.ipynb"))


@pytest.fixture(params=NAMES)
def name(request):
    return request.param


def code_cells(name):
    return [c for c in read_notebook(name).cells if c.cell_type == "code"]


def test_all_are_there():
    assert notebooks.names() == NAMES
    limits = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert [*NAMES, "all"] == list(limits["tool"]["reading"]["minutes"])


def test_every_code_cell_has_run_in_order_without_error_or_stderr(name):
    """nbval compares nothing where the execution count is missing, so this must fail there."""
    counts = [cell.execution_count for cell in code_cells(name)]
    assert counts == list(range(1, len(counts) + 1))
    for cell in code_cells(name):
        for output in cell.outputs:
            assert output.output_type != "error"
            assert output.get("name") != "stderr"


def test_outputs_are_stored(name):
    outputs = [o for cell in code_cells(name) for o in cell.outputs]
    assert sum("image/png" in o.get("data", {}) for o in outputs) >= 1
    assert sum("text/html" in o.get("data", {}) for o in outputs) >= 2


def test_parameters_are_those_of_the_yaml_and_of_the_driver(name):
    defaults = notebooks.parameters(name)
    assert defaults == parameters.read_params(name)
    fields = parameters.config_of(name).model_fields
    assert set(defaults) == set(fields)
    assert {key: field.default for key, field in fields.items()} == defaults
    (cell,) = (c for c in code_cells(name) if "parameters" in c.metadata.get("tags", []))
    for line in ast.parse(cell.source).body:
        key, kind = line.target.id, ast.unparse(line.annotation).split("[")[0]
        if key == notebooks.OUTPUT_DIR:
            assert ast.literal_eval(line.value).startswith("../build/")
        else:
            assert kind in str(fields[key].annotation)


def test_quick_parameters_are_valid_and_differ(name):
    assert parameters.read_params(name, paths.PARAMS / "quick") != parameters.read_params(name)


def test_cells_are_short(name):
    """An algorithm that a cell writes out from scratch may take 40 lines."""
    for cell in code_cells(name):
        if "parameters" not in cell.metadata.get("tags", []):
            limit = 40 if "from-scratch" in cell.metadata.get("tags", []) else 15
            assert len(cell.source.splitlines()) <= limit, cell.source


def test_cells_hold_no_plotting_and_no_sweep(name):
    """Plots are ``plots.draw_*``; a loop over seeds lives in the library."""
    for cell in code_cells(name):
        assert not re.search(r"\bax\.(?!set_title)\w+\(|\bplt\.|for \w+ in .*seeds", cell.source)


def test_exercises_have_folded_solutions(name):
    solutions = [c for c in code_cells(name) if "solution" in c.metadata.get("tags", [])]
    assert 2 <= len(solutions) <= 3
    for cell in solutions:
        assert cell.metadata.jupyter == {"source_hidden": True, "outputs_hidden": True}
    text = "\n".join(c.source for c in read_notebook(name).cells if c.cell_type == "markdown")
    assert text.count("<details>") == text.count("</details>") == len(solutions)


@pytest.mark.parametrize("name", NAMES)
def test_exercises_are_predicted_completed_and_a_project(name):
    """The stub of the second answers nothing, and its solution is what an assert calls right."""
    cells = read_notebook(name).cells
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    asked = re.findall(r"^\*\*(\d)\. (\w+): ", text, re.M)
    assert asked == [("1", "Predict"), ("2", "Complete"), ("3", "Project")]
    tags = [cell.metadata.get("tags", []) for cell in cells]
    at = tags.index(["exercise"])
    stub, check, solution = cells[at : at + 3]
    assert "...  # your lines" in stub.source
    assert tags[at + 1] == ["check"]
    assert "assert " in check.source
    assert "solution" in tags[at + 2]
    assert [check.outputs[0].text, solution.outputs[0].text[:5]] == ["not written yet\n", "right"]


@pytest.mark.parametrize("name", NAMES)
def test_pictures_are_described_to_who_cannot_see_them(name):
    """A cell's "alt" says what its picture shows and what to notice (the site's alt text)."""
    for cell in code_cells(name):
        drawn = any("image/png" in output.get("data", {}) for output in cell.outputs)
        told = cell.metadata.get("alt", "")
        assert drawn == bool(told), cell.source
        assert not drawn or (len(told) > 100 and "notice" in told.lower()), told


def test_stored_outputs_name_no_machine(name):
    text = (paths.NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8")
    assert not re.search(r"/(home|root|work|tmp|Users)/\w", text)
    assert not re.search(r"https?://(?!www\.w3\.org)", text)
    assert not re.search(r" at 0x[0-9a-f]{6}", text), "the address of an object, another each time"


def test_only_wall_clocks_are_left_out_of_the_comparison(name):
    """nbval leaves out what a tag or a comment tells it to."""
    for cell in code_cells(name):
        assert not re.search(r"nbval|pytest_validate", cell.source, flags=re.IGNORECASE)
        tags = [
            tag for tag in cell.metadata.get("tags", []) if re.match("nbval|raises|pytest", tag)
        ]
        assert tags in ([], ["nbval-ignore-output"])
        if tags:
            assert re.search(r"timing=True|\bCPU\b", cell.source), cell.source


@pytest.mark.parametrize(
    ("place", "old", "new"),
    [
        ("params", "seed: 0", "seed: 1"),
        ("params", "range_sigma: 0.2\n", "range_sigma: 0.21\n"),
        ("notebooks", "seed: int = 0", "seed: int = 1"),
        ("notebooks", "seed: int = 0", "seed: float = 0"),
        ("notebooks", "../build/by_hand", "../figures"),
    ],
)
def test_a_parameter_altered_in_one_place_would_be_noticed(tmp_path, monkeypatch, place, old, new):
    source = paths.PARAMS / "01_bimodal.yaml"
    if place == "notebooks":
        source = paths.NOTEBOOKS / "01_bimodal.ipynb"
    text = source.read_text(encoding="utf-8")
    assert text.count(old) >= 1
    (tmp_path / source.name).write_text(text.replace(old, new), encoding="utf-8")
    monkeypatch.setattr(paths, place.upper(), tmp_path)
    with pytest.raises((AssertionError, notebooks.ProjectError)):
        test_parameters_are_those_of_the_yaml_and_of_the_driver("01_bimodal")


def test_another_default_in_the_library_would_be_noticed(monkeypatch):
    class Config(parameters.config_of("01_bimodal")):
        seed: int = 1

    monkeypatch.setattr(parameters, "config_of", lambda name: Config)
    with pytest.raises(AssertionError):
        test_parameters_are_those_of_the_yaml_and_of_the_driver("01_bimodal")


def test_a_stripped_notebook_would_be_noticed(tmp_path, monkeypatch):
    stripped = read_notebook("01_bimodal")
    for cell in stripped.cells:
        if cell.cell_type == "code":
            cell.execution_count, cell.outputs = None, []
    nbformat.write(stripped, tmp_path / "01_bimodal.ipynb")
    monkeypatch.setattr(paths, "NOTEBOOKS", tmp_path)
    with pytest.raises(AssertionError):
        test_every_code_cell_has_run_in_order_without_error_or_stderr("01_bimodal")
    with pytest.raises(AssertionError):
        test_outputs_are_stored("01_bimodal")


def test_the_longest_notebooks_are_named_and_come_first():
    numbers = [name.partition("_")[0] for name in notebooks.names()]
    assert set(notebooks.LONGEST) <= set(numbers)
    assert sorted(notebooks.names(), key=notebooks.length)[0].startswith(notebooks.LONGEST[0])
