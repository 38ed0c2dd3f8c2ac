"""The headless runner on a small project of its own: bad input, failure, freshness."""

import os
import re
import signal
import subprocess
import sys
import time

import nbformat
import pytest
from small_project import (
    BODY,
    CLAIMS,
    NAME,
    a_copy_to_spoil,
    at_home_in,
    declared_cell,
    light_body,
    make_project,
    write_notebook,
)

from sngr_utils import paths
from sngr_utils.__main__ import main
from sngr_utils.publish import (
    claims,
    dependencies,
    files,
    freshness,
    notebooks,
    parameters,
    run,
)


@pytest.fixture
def project(tmp_path):
    make_project(tmp_path)
    with at_home_in(tmp_path):
        yield tmp_path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A project whose notebook has been run and published."""
    folder = tmp_path_factory.mktemp("finished")
    make_project(folder)
    with at_home_in(folder):
        run.run_notebook(NAME)
    return folder


@pytest.fixture
def published(finished, tmp_path):
    """A copy of it: results do not depend on where the project lies."""
    with a_copy_to_spoil(finished, tmp_path):
        yield tmp_path


def edit(project, old, new):
    path = project / f"params/{NAME}.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def overwrite(path, content):
    assert path.exists()
    path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content)


def rewrite(file, old, new):
    """Replace a piece of a file of the project; it must be there."""

    def spoil(project):
        text = (project / file).read_text()
        assert old in text
        (project / file).write_text(text.replace(old, new, 1))

    return spoil


def replace(file, content):
    return lambda project: overwrite(project / file, content)


def remove(file):
    return lambda project: (project / file).unlink()


BOMB = "seed: &a0 [0]\n" + "".join(
    f"x{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("range_sigma: 0.2", "range_sigm: 0.2", "unknown key 'range_sigm'.*did you mean"),
        ("range_sigma: 0.2", "", "key 'range_sigma' is missing"),
        ("range_sigma: 0.2", "range_sigma: -0.2", "range_sigma is -0.2.*greater than"),
        ("range_sigma: 0.2", 'range_sigma: "high"', "range_sigma is 'high'.*valid number"),
        ("range_sigma: 0.2", "range_sigma: .nan", "range_sigma is nan.*finite"),
        ("range_sigma: 0.2", "range_sigma: true", "range_sigma is True"),
        ("seed: 0", "seed: 1.5", "seed is 1.5.*integer"),
        ("seed: 0", "seed: 0\nseed: 1", "not valid YAML.*duplicate key"),
        ("seed: 0", "seed: [0", "not valid YAML"),
        ("measured_range: 3.0", "measured_range: 1.0", "measured_range is 1.0: it must exceed"),
        ("seed: 0", "seed:\t0\n\tx: 1", "not valid YAML"),
        ("seed: 0", "seed: !!python/object/apply:os.getcwd []", "not valid YAML"),
        ("seed: 0", "seed: &a [*a]", "not valid YAML"),
        ("seed: 0", "seed: " + "[" * 600, "not valid YAML"),
        ("seed: 0", "seed: 0 #" + "x" * 1_000_000, "not valid YAML: it has more than 1000000 b"),
        ("seed: 0", "seed: 0x" + "f" * 5000, "not valid YAML: it has an integer of more than 300"),
        ("seed: 0", BOMB, "not valid YAML: its aliases stand for more than 1000000 entries"),
        ("seed: 0", "seed: 0\nnull: 1", "unknown key None"),
        ("seed: 0", "seed: 0\n[1]: 1", "unknown key|not valid YAML"),
    ],
)
def test_bad_parameters_name_file_and_key(project, capsys, old, new, message):
    edit(project, old, new)
    with pytest.raises(notebooks.ProjectError, match=f"(?s)params/{NAME}.yaml.*{message}"):
        parameters.read_params(NAME)
    for command in (["check"], ["stale"], ["notebook", NAME]):  # before anything runs
        assert main(command) == 1
        shown = capsys.readouterr()
        assert f"params/{NAME}.yaml" in shown.err
        assert shown.out == ""


def test_a_kernel_computes_alike_whoever_starts_it(project, monkeypatch):
    """Other kernels of linear algebra, or threads, give other last digits, and other samples."""
    theirs = {"OPENBLAS_CORETYPE": "Haswell", "OMP_NUM_THREADS": "7", "PYTHONHASHSEED": "3"}
    for name, value in theirs.items():
        monkeypatch.setenv(name, value)
    seen = "import os; print({name: os.environ.get(name) for name in " + repr([*theirs]) + "})"
    write_notebook(project, declared_cell(project), light_body() + seen)
    run.run_notebook(NAME)
    executed = (paths.EXECUTED / f"{NAME}.ipynb").read_text()
    alike = {"OPENBLAS_CORETYPE": None, "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    assert repr(alike) in executed
    assert {name: os.environ[name] for name in theirs} == theirs


def test_scientific_notation_is_a_number(project):
    edit(project, "range_sigma: 0.2", "range_sigma: 2e-1")
    assert parameters.read_params(NAME)["range_sigma"] == 0.2


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (rewrite("paper/claims.yaml", "rule: value", "rule: valu"), "claim 'small': rule: Input"),
        (rewrite("paper/claims.yaml", "rule: value", "rul: value"), "claim 'small': rule: Field"),
        (rewrite("paper/claims.yaml", "rule: value", "rule: share"), "needs 'share'"),
        (rewrite("paper/claims.yaml", "rule: value", "rule: rises"), "needs 'minus'"),
        (rewrite("paper/claims.yaml", ", at_most: 9", ""), "'value' needs a bound"),
        (rewrite("paper/claims.yaml", "at_most: 9", "at_most: nine"), "at_most: Input should be"),
        (
            rewrite("paper/claims.yaml", "ours: seed, at", "ours: 's{q}', at"),
            "'small': 'q' is not among",
        ),
        (
            rewrite("paper/claims.yaml", "baseline/0.0", "base/0.0"),
            "'seed': 'base/0.0/triggered' is not",
        ),
        (
            rewrite("paper/claims.yaml", "rule: d", "ratio: [a/b, a/c], rule: d"),
            "'seed': .'a', 'b'. is not",
        ),
        (rewrite("paper/claims.yaml", "reading: C", "reading: D"), "reading: Input should be 'A'"),
        (rewrite("paper/claims.yaml", "reading: C", "reading: C\nreading: C"), "duplicate key"),
        (rewrite("paper/claims.yaml", "reading: C", "reading: [C"), "not valid YAML"),
        (rewrite("paper/claims.yaml", "reading: C", "raeding: C"), "reading: Field required"),
        (replace("paper/claims.yaml", ""), "valid dictionary"),
        (replace("paper/claims.yaml", "[]"), "valid dictionary"),
        (remove("paper/claims.yaml"), "is missing"),
        (rewrite("paper/printed_values.yaml", "-12.50", "about 12"), "'about 12' is not a number"),
        (rewrite("paper/printed_values.yaml", "-12.50", ".nan"), "loglik_map: '.nan' is not"),
        (rewrite("paper/printed_values.yaml", "loglik_map:", "x:"), "'loglik_map',. is not among"),
        (rewrite("paper/printed_values.yaml", "-12.50", "[-12.50"), "not valid YAML"),
        (replace("paper/printed_values.yaml", ""), "must hold 'table: numbers' lines"),
        (remove("paper/printed_values.yaml"), "is missing"),
    ],
)
def test_what_is_read_after_the_notebooks_is_checked_before(project, capsys, spoil, message):
    spoil(project)
    for command in ("check", "latex"):
        assert main([command]) == 1
        shown = capsys.readouterr()
        assert shown.out == ""
        assert re.fullmatch(
            rf"error: paper/(claims|printed_values)\.yaml.*{message}.*\n", shown.err
        )


def test_a_sound_project_passes_the_check(project, capsys):
    assert main(["check"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("content", ["{", "[]", "null", '{"k": 3}', '{"k": {}}'])
def test_a_damaged_reference_is_named_before_the_notebooks_run(project, capsys, content):
    (project / "paper/reference").mkdir()
    (project / f"paper/reference/{NAME}.json").write_text(content)
    assert main(["check"]) == 1
    assert f"error: paper/reference/{NAME}.json is damaged" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("{1: 2}", "conventions has no field 1: it may set x0_sigmas, "),
        ("{null: 1}", "conventions has no field None"),
        ("{skip: 1}", "conventions has no field 'skip'"),
        ("{nees_frame: 1}", "nees_frame is 1: Input should be 'world' or 'body'"),
        ("[1]", "conventions is .1.: Input should be a valid dict"),
    ],
)
def test_a_convention_that_does_not_exist_is_a_sentence(tmp_path, given, message):
    text = (paths.PARAMS / "02_trigger_sweep.yaml").read_text()
    assert "conventions: {}" in text
    written = text.replace("conventions: {}", f"conventions: {given}")
    (tmp_path / "02_trigger_sweep.yaml").write_text(written)
    with pytest.raises(notebooks.ProjectError, match=rf"^.*02_trigger_sweep\.yaml: .*{message}"):
        parameters.read_params("02_trigger_sweep", tmp_path)


def test_missing_files_are_named(project):
    notebook = project / f"notebooks/{NAME}.ipynb"
    moved = notebook.rename(project / "elsewhere")
    with pytest.raises(notebooks.ProjectError, match=f"notebooks/{NAME}.ipynb is missing"):
        notebooks.names()
    with pytest.raises(notebooks.ProjectError, match=f"notebooks/{NAME}.ipynb is missing"):
        notebooks.sources(NAME)
    moved.rename(notebook)
    (project / f"params/{NAME}.yaml").unlink()
    with pytest.raises(notebooks.ProjectError, match=f"params/{NAME}.yaml is missing"):
        notebooks.names()
    with pytest.raises(notebooks.ProjectError, match=f"params/{NAME}.yaml is missing"):
        parameters.read_params(NAME)
    notebook.write_text("{")
    with pytest.raises(notebooks.ProjectError, match="is not a notebook"):
        notebooks.sources(NAME)


def test_notebook_without_parameters_or_driver(project):
    declared = declared_cell(project)
    declared.metadata.tags = []
    write_notebook(project, declared, BODY)
    with pytest.raises(notebooks.ProjectError, match="no cell tagged 'parameters'"):
        notebooks.parameters(NAME)
    with pytest.raises(notebooks.ProjectError, match=r"sngr_utils/other\.py is missing"):
        parameters.config_of("09_other")


def test_run_publish_and_freshness(published, capsys):
    result = files.read_json(paths.RESULTS / f"{NAME}.json")
    figure = paths.FIGURES / f"{NAME}_f.pdf"
    assert set(result["provenance"]["files"]) == {
        f"figures/{NAME}_f.pdf",
        f"figures/{NAME}_f_timing.pdf",
        f"build/executed/{NAME}.ipynb",
        f"build/results/{NAME}.timings.json",
    }
    assert figure.exists()

    capsys.readouterr()
    os.utime(published / f"params/{NAME}.yaml")  # a new date alone changes nothing
    edit(published, "seed: 0", "seed: 0  # nor does a comment")
    run.run_notebook(NAME)
    assert "up to date" in capsys.readouterr().out
    assert main(["stale"]) == 0
    assert capsys.readouterr().out == ""

    edit(published, "seed: 0", "seed: 5")
    assert not freshness.is_fresh(NAME, parameters.read_params(NAME))
    capsys.readouterr()
    assert main(["stale"]) == 0
    assert capsys.readouterr().out == f"run/{NAME}\n"
    with pytest.raises(notebooks.ProjectError, match="stale"):
        run.write_latex()
    run.run_notebook(NAME)
    run.write_latex()
    written = (paths.PAPER / "generated/values.tex").read_text()
    assert "{5.00}" in written
    assert r"res@claims.numbers.not_reproduced\endcsname{1}" in written  # 5, where 0 is printed
    assert "not reproduced" in (paths.PAPER / "generated/claims_full.tex").read_text()
    (published / "paper/claims.yaml").write_text(CLAIMS.replace("ours: seed", "ours: absent"))
    claims.read.cache_clear()
    with pytest.raises(notebooks.ProjectError, match="needs 'absent', which no notebook"):
        run.write_latex()


def test_damaged_or_edited_results_are_made_again(published):
    params = parameters.read_params(NAME)
    path, figure = paths.RESULTS / f"{NAME}.json", paths.FIGURES / f"{NAME}_f.pdf"
    good, drawn = path.read_text(), figure.read_bytes()
    figure.write_bytes(b"damaged")
    assert not freshness.is_fresh(NAME, params)
    figure.write_bytes(drawn)
    assert freshness.is_fresh(NAME, params)
    figure.write_bytes(b"damaged")
    for damage in ("{", good.replace('"value": 0.0', '"value": 7.0'), "[]", "null"):
        assert damage != good
        path.write_text(damage)
        assert not freshness.is_fresh(NAME, params)
    run.run_notebook(NAME)
    assert path.read_text() == good
    assert figure.read_bytes() == drawn
    (paths.EXECUTED / f"{NAME}.ipynb").unlink()
    assert not freshness.is_fresh(NAME, params)


def without_a_figure_in_the_list(project):
    path = project / f"build/results/{NAME}.json"
    result = files.read_json(path)
    del result["provenance"]["files"][f"figures/{NAME}_f.pdf"]
    files.write_json(path, result)


RESULT, CLOCKS = f"build/results/{NAME}.json", f"build/results/{NAME}.timings.json"
EXECUTED, FIGURE = f"build/executed/{NAME}.ipynb", f"figures/{NAME}_f.pdf"
TIMED = f"figures/{NAME}_f_timing.pdf"
SPOILED = {
    **{f"no {file}": remove(file) for file in (RESULT, CLOCKS, EXECUTED, FIGURE, TIMED)},
    "a result is another": rewrite(RESULT, '"value": 0.0', '"value": 0.1'),
    "provenance of another form": rewrite(RESULT, '"provenance": {', '"provenance": [], "x": {'),
    "inputs of another form": rewrite(RESULT, '"inputs": {', '"inputs": null, "x": {'),
    "files of another form": rewrite(RESULT, '"files": {', '"files": [], "x": {'),
    "a figure is not in the list of files": without_a_figure_in_the_list,
    "no values among the clocks": rewrite(CLOCKS, '"values": {', '"values": null, "x": {'),
    "a clock without a format": rewrite(CLOCKS, '"format"', '"fmt"'),
    "a figure": replace(FIGURE, b"%PDF"),
    "a figure of clocks": replace(TIMED, b""),
    "a parameter": rewrite(f"params/{NAME}.yaml", "range_sigma: 0.2", "range_sigma: 0.21"),
    "a cell": rewrite(f"notebooks/{NAME}.ipynb", "seed, 1", "seed, 2"),
    "a sentence of the notebook": rewrite(f"notebooks/{NAME}.ipynb", "hello", "hallo"),
    "a module": rewrite("sngr_utils/publish/report.py", "ERRORS = 3", "ERRORS = 4"),
    "a module that a module imports": rewrite("sngr_utils/paths.py", '"""Where', '"""Wo'),
    "a printed value": rewrite("paper/printed_values.yaml", "rmse: 0.15", "rmse: 0.16"),
    "the lock": rewrite("environment.lock", "numpy==", "numpy==9"),
}  # fmt: skip


@pytest.mark.parametrize("what", SPOILED)
def test_what_is_damaged_or_altered_is_not_fresh_and_never_typeset(published, capsys, what):
    assert freshness.is_fresh(NAME, parameters.read_params(NAME))
    SPOILED[what](published)
    assert not freshness.is_fresh(NAME, parameters.read_params(NAME))
    assert main(["latex"]) == 1
    assert f"results of {NAME} are missing or stale: run 'make res" in capsys.readouterr().err
    assert not (published / "paper/generated").exists()


@pytest.mark.parametrize("file", [RESULT, CLOCKS, EXECUTED])
def test_a_malformed_file_is_not_fresh(published, file):
    params, good = parameters.read_params(NAME), (published / file).read_text()
    for content in ("", "{", "{}", "[]", "null", "3", '"x"', b"\xff\xfe", "[" * 100_000):
        overwrite(published / file, content)
        assert not freshness.is_fresh(NAME, params), content[:9]
    overwrite(published / file, good)
    assert freshness.is_fresh(NAME, params)


@pytest.mark.parametrize("file", [RESULT, EXECUTED, FIGURE])
def test_a_link_is_replaced_and_not_written_through(published, tmp_path_factory, file):
    """What a link in build/ or figures/ leads to is not the project's."""
    precious = tmp_path_factory.mktemp("elsewhere") / "precious"
    precious.write_text("kept")
    (published / file).unlink(missing_ok=True)
    (published / file).symlink_to(precious)
    run.publish(NAME, next(paths.RUNS.iterdir()))
    assert precious.read_text() == "kept"
    assert (published / file).is_file()
    assert not (published / file).is_symlink()
    assert freshness.is_fresh(NAME, parameters.read_params(NAME))


def test_a_link_in_place_of_a_lock_is_not_opened(published, capsys):
    (published / "precious").write_text("kept")
    (published / f"build/.{NAME}.lock").unlink()
    (published / f"build/.{NAME}.lock").symlink_to(published / "precious")
    edit(published, "seed: 0", "seed: 1")
    assert main(["notebook", NAME]) == 1
    assert re.match(rf"error: .*\.{NAME}\.lock: .*; published", capsys.readouterr().err)
    assert (published / "precious").read_text() == "kept"


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (OSError(28, "No space left on device", "build/x"), "build/x: No space left on device"),
        (OSError(30, "Read-only file system"), "Read-only file system"),
        (MemoryError(), "MemoryError"),
    ],
)
def test_what_the_machine_refuses_is_a_sentence(monkeypatch, capsys, error, told):
    def refuse():
        raise error

    monkeypatch.setattr(run, "check", refuse)
    assert main(["check"]) == 1
    assert capsys.readouterr().err == f"error: {told}; published results are untouched\n"


def test_a_silent_kernel_is_a_sentence(project, monkeypatch, capsys):
    def silent(*args, **kwargs):
        raise RuntimeError("Kernel didn't respond in 60 seconds")

    monkeypatch.setattr("papermill.execute_notebook", silent)
    assert main(["notebook", NAME]) == 1
    assert "the kernel did not start: Kernel didn't respond" in capsys.readouterr().err


def test_a_dead_kernel_is_a_sentence(project, capsys):
    write_notebook(project, declared_cell(project), "import os; os._exit(3)")
    assert main(["notebook", NAME]) == 1
    assert "the kernel died" in capsys.readouterr().err


def test_parameters_cell_that_cannot_be_read(project):
    for source in ("seed: int = (", "seed: int = 1 * 3", "seed: Real = 0"):
        declared = declared_cell(project)
        declared.source = source
        write_notebook(project, declared, BODY)
        (project / f"params/{NAME}.yaml").write_text("seed: 0\n")
        with pytest.raises(notebooks.ProjectError, match=NAME):
            parameters.read_params(NAME)


def test_what_makes_results_stale(project):
    params = parameters.read_params(NAME)
    before = freshness.inputs(NAME, params)
    (project / "sngr_utils/unrelated.py").write_text("# new")
    assert freshness.inputs(NAME, params) == before
    used = project / "sngr_utils/publish/report.py"
    used.write_text(used.read_text() + "\n# changed\n")
    assert freshness.inputs(NAME, params) != before


def test_rows_of_studies_make_those_stale_that_read_them(project):
    params, declared = parameters.read_params(NAME), declared_cell(project)
    rows = project / "paper/studies/toy.json"
    rows.parent.mkdir()
    add(project, {"experiments/__init__.py": "", "experiments/studies.py": ""})
    for reader, told in (("", False), ("from sngr_utils.experiments import studies\n", True)):
        write_notebook(project, declared, reader + BODY)
        rows.write_text("[]")
        before = freshness.inputs(NAME, params)
        rows.write_text("[1]")
        assert (freshness.inputs(NAME, params) != before) == told


def add(project, files):
    """Write files of the package, given as name -> text; `slam/a.py` is in a sub-package."""
    for name, text in files.items():
        path = project / "sngr_utils" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


FOLDERS = {
    "slam/__init__.py": '"""A folder."""',
    "slam/solvers.py": "from sngr_utils.numerics.deep import linalg\ndef solve(): ...",
    "slam/unrelated.py": "",
    "numerics/__init__.py": "from sngr_utils import constants",
    "numerics/deep/__init__.py": "",
    "numerics/deep/linalg.py": "",
    "constants.py": "",
    "entry.py": "def later():\n    from .slam import solvers",
}


@pytest.mark.parametrize(
    "line",
    [
        "from sngr_utils.slam import solvers",
        "from sngr_utils.slam.solvers import solve",
        "from sngr_utils.slam.solvers import *",
        "import sngr_utils.slam.solvers",
        "if True:\n    import numpy, sngr_utils.slam.solvers as s",
        "from sngr_utils import entry",
    ],
)
def test_an_edit_in_a_folder_makes_stale_what_imports_it(project, line):
    add(project, FOLDERS)
    write_notebook(project, declared_cell(project), line)
    before = freshness.inputs(NAME, {})
    for name in {"__init__.py", *FOLDERS} - {"slam/unrelated.py", "entry.py"}:
        path = project / "sngr_utils" / name
        good = path.read_text()
        path.write_text(good + "\n# changed\n")
        assert freshness.inputs(NAME, {}) != before, name
        path.write_text(good)
    add(project, {"slam/unrelated.py": "# changed"})
    assert freshness.inputs(NAME, {}) == before


@pytest.mark.parametrize(
    ("line", "missing"),
    [
        ("from sngr_utils import nothing", "sngr_utils.nothing"),
        ("from sngr_utils.nothing import solve", "sngr_utils.nothing.solve"),
        ("import sngr_utils.nothing", "sngr_utils.nothing"),
        ("from sngr_utils.slam import solvers, nothing", "sngr_utils.slam.nothing"),
        ("from sngr_utils.slam.nothing import solve", "sngr_utils.slam.nothing.solve"),
        ("from sngr_utils.slam import *", r"sngr_utils.slam.\*"),
    ],
)
def test_a_module_that_is_not_there_is_named(project, line, missing):
    add(project, FOLDERS)
    write_notebook(project, declared_cell(project), line)
    with pytest.raises(notebooks.ProjectError, match=f"{NAME}.ipynb imports {missing}, which"):
        freshness.inputs(NAME, {})


def test_what_would_be_overlooked_is_an_error(project):
    write_notebook(project, declared_cell(project), "%pip list\nfrom sngr_utils import world")
    with pytest.raises(notebooks.ProjectError, match=f"{NAME}.ipynb: a cell is not plain Python"):
        freshness.inputs(NAME, {})
    add(project, {".ipynb_checkpoints/a.py": "", "folder/a.py": ""})
    with pytest.raises(notebooks.ProjectError, match=r"sngr_utils/folder/a\.py is in no package"):
        dependencies.import_graph()


def test_failing_notebook_keeps_what_was_published(published, capsys):
    before = {p: p.read_bytes() for p in paths.FIGURES.iterdir()}
    before |= {p: p.read_bytes() for p in paths.RESULTS.iterdir()}
    failing = light_body() + "\nraise RuntimeError('on purpose')"
    write_notebook(published, declared_cell(published), failing)
    assert main(["notebook", NAME]) == 1
    message = capsys.readouterr().err
    assert "RuntimeError: on purpose" in message
    assert f"build/staging/{NAME}/{NAME}.ipynb" in message
    assert all(path.read_bytes() == content for path, content in before.items())
    failed = nbformat.read(paths.STAGING / NAME / f"{NAME}.ipynb", as_version=4)
    assert any(o.output_type == "error" for c in failed.cells for o in c.get("outputs", []))


def test_notebook_that_saves_nothing_is_an_error(project):
    write_notebook(project, declared_cell(project), "1 + 1")
    with pytest.raises(notebooks.ProjectError, match="saved no results"):
        run.run_notebook(NAME)


def test_figures_no_longer_drawn_are_removed(published):
    """And nothing that no run has made."""
    (paths.FIGURES / f"{NAME}_mine.pdf").write_text("mine")
    drawn = light_body(f"{NAME}_g.pdf", f"{NAME}_f_timing.pdf")
    write_notebook(published, declared_cell(published), drawn)
    run.run_notebook(NAME)
    assert sorted(p.name for p in paths.FIGURES.iterdir()) == [
        f"{NAME}_f_timing.pdf",
        f"{NAME}_g.pdf",
        f"{NAME}_mine.pdf",
    ]


def test_quick_and_refresh(project):
    write_notebook(project, declared_cell(project), light_body())
    run.run_quick(NAME)
    assert (project / f"build/quick/{NAME}/{NAME}.json").exists()
    assert not paths.FIGURES.exists()
    run.refresh(NAME)
    refreshed = nbformat.read(project / f"notebooks/{NAME}.ipynb", as_version=4)
    assert refreshed.cells[2].execution_count == 2
    assert refreshed.metadata.language_info == {"name": "python"}
    write_notebook(project, declared_cell(project), "1 / 0")
    content = (project / f"notebooks/{NAME}.ipynb").read_bytes()
    with pytest.raises(notebooks.ProjectError, match="ZeroDivisionError"):
        run.refresh(NAME)
    assert (project / f"notebooks/{NAME}.ipynb").read_bytes() == content


def test_a_notebook_that_is_stored_says_how_busy_the_machine_was_if_it_hands_on_times(project):
    """The executed one does not: the same inputs give the same bytes."""
    clocks = (
        f'clocks = {{"notebook": "{NAME}", "values": {{}}, "tables": {{}}}}\n'
        f'Path(output_dir, "{NAME}.timings.json").write_text(json.dumps(clocks))'
    )
    write_notebook(project, declared_cell(project), light_body(), clocks)
    run.refresh(NAME)
    found = nbformat.read(project / f"notebooks/{NAME}.ipynb", as_version=4).metadata
    assert 0 <= found.others <= 1
    (ran,) = paths.RUNS.glob(f"{NAME}.*/{NAME}.ipynb")
    assert "others" not in nbformat.read(ran, as_version=4).metadata


@pytest.mark.parametrize("times", [1, 50])
def test_interrupt_leaves_with_a_message(times):
    """SIGINT to a running command, and more at once: a sentence, status 130, no traceback."""
    code = (
        "import sys, time; from sngr_utils.__main__ import main;"
        "from sngr_utils.publish import run;"
        "run.check = lambda: (print('started', flush=True), time.sleep(60));"
        "sys.exit(main(['check']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "started\n"
    time.sleep(0.2)
    for _ in range(times):
        process.send_signal(signal.SIGINT)
        time.sleep(0.0005)
    _, message = process.communicate(timeout=30)
    assert process.returncode == 130
    assert message == "interrupted: published results are untouched\n"
