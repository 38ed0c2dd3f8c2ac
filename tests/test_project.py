"""Rules of the house that a grep can check."""

import ast
import pkgutil
import re
import shutil
import subprocess
import tomllib
from fnmatch import fnmatch

import pytest
from helpers import paper_text

from sngr_utils import paths


def tracked(root):
    """Files that are committed; without history or git, those that .gitignore does not name."""
    if shutil.which("git"):
        git = ["git", "-c", f"safe.directory={root}", "ls-files", "-z"]  # whoever owns it
        done = subprocess.run(git, cwd=root, capture_output=True, text=True)
        if "Makefile" in done.stdout.split("\0"):
            return done.stdout.split("\0")[:-1]
    lines = (root / ".gitignore").read_text(encoding="utf-8").split()
    patterns = [".git", *(line.strip("/") for line in lines)]
    found, folders = [], [root]
    for folder in folders:
        for path in sorted(folder.iterdir()):
            name = path.relative_to(root).as_posix()
            if any(fnmatch(name, each) or fnmatch(path.name, each) for each in patterns):
                continue
            (folders if path.is_dir() else found).append(path if path.is_dir() else name)
    return found


TRACKED = tracked(paths.ROOT)
FILES = sorted(paths.PACKAGE.rglob("*.py"))


def test_a_copy_without_history_has_the_same_files(tmp_path):
    for name in TRACKED:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(paths.ROOT / name, tmp_path / name)
    for made in ("build/results/a.json", "figures/a_timing.pdf", "sngr_utils/__pycache__/a.pyc"):
        (tmp_path / made).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / made).touch()
    assert sorted(tracked(tmp_path)) == sorted(TRACKED)


def test_no_global_random_state():
    for path in [*FILES, *paths.NOTEBOOKS.glob("*.ipynb")]:
        used = set(re.findall(r"np\.random\.(\w+)", path.read_text(encoding="utf-8")))
        assert used <= {"default_rng", "Generator", "RandomState"}, (
            path
        )  # the last: nestle takes no other


def test_packages_hold_a_docstring_only():
    """What they import or define, all that is in them would depend on."""
    for path in FILES:
        if path.stem == "__init__":
            (docstring, *rest) = ast.parse(path.read_text(encoding="utf-8")).body
            assert isinstance(docstring, ast.Expr), path
            version = [ast.unparse(line).startswith("__version__ = ") for line in rest]
            assert all(version), path


def test_every_folder_is_on_the_map():
    """The package's docstring names each folder and each module at the door once."""
    text = (paths.PACKAGE / "__init__.py").read_text(encoding="utf-8")
    named = re.findall(r"`([a-z_]+)`", text)
    here = {path.stem for path in paths.PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    folders = {path.parent.name for path in paths.PACKAGE.glob("*/__init__.py")}
    assert set(named) == here | folders
    assert len(named) == len(set(named)) + 1  # `bimodal` ... heads the list of helpers


def test_the_readme_names_every_notebook_and_every_folder():
    text = paths.README.read_text(encoding="utf-8").split("## Where things are")[1]
    linked = set(re.findall(r"\]\((\w+)(?:/[\w.]+)?\)", text))
    assert {name.split("/")[0] for name in TRACKED if "/" in name and name[0] != "."} <= linked
    for path in paths.NOTEBOOKS.glob("*.ipynb"):
        assert f"[{path.stem}](notebooks/{path.name})" in text


@pytest.mark.parametrize("chapter", sorted(path.stem for path in paths.NOTEBOOKS.glob("*.ipynb")))
def test_a_chapter_has_its_helper_what_it_shows_and_its_tests(chapter):
    stem = chapter[3:]
    assert (paths.PACKAGE / f"{stem}.py").is_file()
    assert (paths.PACKAGE / f"show/{stem}.py").is_file()
    assert (paths.ROOT / f"tests/test_{stem}.py").is_file()


def test_long_modules_say_why():
    """Above 300 lines, in its docstring."""
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        assert text.count("\n") <= 300 or "300 lines" in ast.get_docstring(ast.parse(text)), path


@pytest.mark.parametrize(
    "name", [n for n in TRACKED if n.endswith((".md", ".yaml", ".tex", ".ipynb", "Makefile"))]
)
def test_what_is_said_of_the_package_is_there(name):
    text = (paths.ROOT / name).read_text(encoding="utf-8")
    for path in re.findall(r"\bsngr_utils/[\w/]+\.py\b", text):
        assert (paths.ROOT / path).exists(), path
    for dotted in re.findall(r"\bsngr_utils(?:\.[a-zA-Z]\w*)+", text):
        pkgutil.resolve_name(dotted)


def docstrings(folder, kinds):
    """(file, name, docstring) of every definition below a folder that has one."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, kinds) and ast.get_docstring(node):
                yield path, node.name, ast.get_docstring(node)


def test_equations_lead_to_code_and_back():
    """Each labelled equation is one public function's, and one closed-form test's."""
    text = (paths.PAPER / "sngr.tex").read_text(encoding="utf-8")
    labels = sorted(re.findall(r"\\label\{eq:(\w+)\}", text))
    definitions = (ast.FunctionDef, ast.ClassDef)
    coded = [
        label
        for path, name, told in docstrings(paths.PACKAGE, definitions)
        for label in re.findall(r'paper eq\. "(\w+)"', told)
        if not name.startswith("_")
    ]
    tested = [
        label
        for path, name, told in docstrings(paths.ROOT / "tests", ast.FunctionDef)
        for label in re.findall(r'^Equation "(\w+)"', told)
        if name.startswith("test_")
    ]
    assert sorted(coded) == labels
    assert sorted(tested) == labels


SITE_LOCK = paths.ROOT / "docs/site/requirements.lock"


def test_locks_pin_the_same_versions():
    locked = [
        set(
            re.findall(r"^([\w.-]+)(?:\[[\w,-]+\])?==(\S+)", path.read_text(encoding="utf-8"), re.M)
        )
        for path in (paths.LOCK, SITE_LOCK)
    ]
    both = {name for name, _ in locked[0]} & {name for name, _ in locked[1]}
    assert len(both) > 20
    pinned = [{pair for pair in pairs if pair[0] in both} for pairs in locked]
    assert pinned[0] == pinned[1]


@pytest.mark.parametrize(("lock", "group"), [(paths.LOCK, "dev"), (SITE_LOCK, "site")])
def test_lock_pins_everything_with_hashes_and_no_address(lock, group):
    text = lock.read_text(encoding="utf-8")
    assert "://" not in text
    blocks = re.split(r"\n(?=\S)", text.strip())
    assert len(blocks) > 50
    for block in blocks:
        assert re.match(r"[\w.-]+(\[[\w,-]+\])?==\S+", block), block
        assert "--hash=sha256:" in block, block
    pinned = {re.split(r"==|\[", block)[0].lower().replace("_", "-") for block in blocks}
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    required = project["dependency-groups"][group]
    required += project["project"]["dependencies"] if group == "dev" else []
    names = {re.split(r"[<>=;\[ ]", entry)[0].lower() for entry in required}
    normal = {re.sub(r"[._]", "-", name) for name in names}
    assert normal <= {re.sub(r"[._]", "-", name) for name in pinned}


@pytest.mark.parametrize("name", [n for n in TRACKED if not n.endswith((".pdf", ".png"))])
def test_no_tracked_file_names_a_machine_or_a_registry(name):
    if name in {"tests/test_project.py", "tests/test_notebooks.py"}:
        return  # they spell out what they look for
    text = (paths.ROOT / name).read_text(encoding="utf-8")
    assert not re.search(r"(?<![\w.])/(home|root|work|Users)/\w", text)
    assert not re.search(r"pypi\.org|pythonhosted|\d+\.\d+\.\d+\.\d+:\d+", text)


def test_every_value_of_the_paper_is_named_once():
    """No digit with a decimal point is typed in the paper's results: they come by \\res."""
    text = paper_text()
    used = set(re.findall(r"\\res\{([\w.]+)\}", text))
    assert len(used) > 25
    for kind, count in (("tab", 6), ("fig", 10)):
        assert len(re.findall(rf"\\{kind}\{{\w+\}}", text)) >= count
    captions = re.findall(r"\\caption\{(?:[^{}]|\{[^{}]*\})*\}", text)
    figures = [caption for caption in captions if "SNGR, as we run it" not in caption]
    assert all(r"\source{" in caption for caption in figures)


def test_readme_commands_are_make_targets():
    readme = (paths.ROOT / "README.md").read_text(encoding="utf-8")
    makefile = (paths.ROOT / "Makefile").read_text(encoding="utf-8")
    called = set(re.findall(r"(?:`|^)make ([a-z]+)\b(/?)", readme, flags=re.M))
    assert {"paper", "test", "results", "quick"} <= {target for target, _ in called}
    for target, of_one in called:
        rule = rf"(?:^|: ){target}/%:" if of_one else rf"^{target}:"
        assert re.search(rule, makefile, flags=re.M), target + of_one
