"""Rules of the house that a grep can check."""

import ast
import pkgutil
import re
import subprocess
import tomllib

import pytest

from sngr_utils import paths
from sngr_utils.publish import dependencies

TRACKED = subprocess.run(
    ["git", "ls-files", "-z"], cwd=paths.ROOT, capture_output=True, text=True, check=True
).stdout.split("\0")[:-1]
FILES = sorted(paths.PACKAGE.rglob("*.py"))

# The order in which the package's docstring lists the modules; each imports only from above.
# A module in a folder is listed as "folder.module".
ORDER = [
    "paths", "style", "jit", "world", "variations", "metrics", "graph", "mirror", "windows",
    "information", "chain",
    "nested", "compiled", "compiled_nested", "compiled_walk", "importance", "laplace",
    "window_target", "landmark_target", "many_starts", "adaptive", "brute_force",
    "ancestral", "contest",
    "posterior", "engines", "refine", "baseline", "corrected",
    "window_audit", "sampler_audit", "refined_sweep",
    "sweeps", "robust", "association", "switchable", "mixtures",
    "crossings", "particles", "fastslam", "estimators",
    "leverage", "detectors", "calibration", "clustered", "detection_study", "detection_summary",
    "place", "crediting", "smoother", "belief", "landmark_start", "odometry_doubt", "online",
    "online_study", "plots", "peer_plots", "online_plots", "report", "trigger_tables",
    "trigger_plots", "multimodal_plots", "bench",
    "printed", "contradictions", "rules", "parameters", "bimodal", "trigger_sweep",
    "full_sngr", "cost", "triggers", "audit_tables", "audit", "peer_tables", "peers",
    "online_tables", "association_aware", "multimodal", "multimodal_tables",
    "claims", "verdicts", "verdict_tables", "warm_up", "dependencies", "run",
    "verify",
]  # fmt: skip
DRIVERS = {
    "bimodal", "trigger_sweep", "full_sngr", "cost", "audit", "triggers", "peers",
    "association_aware", "multimodal",
}  # fmt: skip


def test_no_global_random_state():
    for path in [*FILES, *paths.NOTEBOOKS.glob("*.ipynb")]:
        used = set(re.findall(r"np\.random\.(\w+)", path.read_text(encoding="utf-8")))
        assert used <= {"default_rng", "Generator"}, path


def module_of(path):
    """Name of a file of the package as ORDER has it."""
    return ".".join(path.relative_to(paths.PACKAGE).with_suffix("").parts)


def test_packages_hold_a_docstring_only():
    """What they import or define, all that is in them would depend on."""
    for path in FILES:
        if path.stem == "__init__":
            (docstring, *rest) = ast.parse(path.read_text(encoding="utf-8")).body
            assert isinstance(docstring, ast.Expr), path
            version = [ast.unparse(line).startswith("__version__ = ") for line in rest]
            assert all(version), path


def test_imports_follow_the_documented_order():
    assert sorted(ORDER) == sorted(module_of(path) for path in FILES if path.stem != "__init__")
    listed = re.findall(r"^`([\w.]+)`", (paths.PACKAGE / "__init__.py").read_text(), flags=re.M)
    assert [name for name in ORDER if name in listed] == listed
    graph = dependencies.import_graph()
    for number, name in enumerate(ORDER):
        found = graph.find_modules_directly_imported_by(f"sngr_utils.{name}")
        imported = {module.removeprefix("sngr_utils.") for module in found}
        assert imported <= set(ORDER[:number]), name
        if name in DRIVERS:
            assert not imported & DRIVERS, f"{name}: drivers do not import each other"


@pytest.mark.parametrize(
    "name", [n for n in TRACKED if n.endswith((".md", ".yaml", ".tex", ".ipynb", "Makefile"))]
)
def test_what_is_said_of_the_package_is_there(name):
    text = (paths.ROOT / name).read_text(encoding="utf-8")
    for path in re.findall(r"\bsngr_utils/[\w/]+\.py\b", text):
        assert (paths.ROOT / path).exists(), path
    for dotted in re.findall(r"\bsngr_utils(?:\.[a-zA-Z]\w*)+", text):
        pkgutil.resolve_name(dotted)


def test_plots_know_nothing_of_gtsam_and_never_show():
    text = (paths.PACKAGE / "plots.py").read_text(encoding="utf-8")
    assert "gtsam" not in text.lower()
    assert ".show(" not in text


def test_lock_pins_everything_with_hashes_and_no_address():
    text = paths.LOCK.read_text(encoding="utf-8")
    assert "://" not in text
    blocks = re.split(r"\n(?=\S)", text.strip())
    assert len(blocks) > 100
    for block in blocks:
        assert re.match(r"[\w.-]+(\[[\w,-]+\])?==\S+", block), block
        assert "--hash=sha256:" in block, block
    pinned = {re.split(r"==|\[", block)[0].lower().replace("_", "-") for block in blocks}
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    required = project["project"]["dependencies"] + project["dependency-groups"]["dev"]
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
    text = (paths.PAPER / "sngr.tex").read_text(encoding="utf-8")
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
    targets = set(re.findall(r"(?:`|^)make ([a-z]+)\b", readme, flags=re.M))
    assert {"paper", "test", "results", "quick"} <= targets
    for target in targets:
        assert re.search(rf"^{target}:|^\.PHONY:.*\b{target}\b", makefile, flags=re.M), target
