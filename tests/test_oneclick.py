"""Binder, the container and the public CI use the lock and the commands that are tested here."""

import json
import re
import tomllib

from sngr_utils import paths
from sngr_utils.publish.parameters import read_yaml

PYTHONS = ["3.11", "3.12", "3.13", "3.14"]


def installs(text):
    """Arguments of pip's installations, without how much is said and kept."""
    lines = re.findall(r"pip install (.+)$", text.replace("!pip", "pip"), re.M)
    return [re.sub(r"--quiet |--no-cache-dir ", "", line) for line in lines]


def test_binder_and_colab_install_as_the_set_up_does():
    binder, colab, own = (
        (paths.ROOT / name).read_text(encoding="utf-8")
        for name in (".binder/postBuild", "docs/oneclick.md", "scripts/setup.sh")
    )
    asked = re.findall(r'^"\$\{install\[@\]\}" (.+?)(?: \|\|)?$', own, re.M)
    assert installs(binder) == installs(colab) == asked
    assert len(asked) == 2
    assert (paths.ROOT / ".binder/runtime.txt").read_text().strip().removeprefix(
        "python-"
    ) in PYTHONS


def test_the_page_has_the_address_once_there_is_one():
    address = read_yaml(paths.CITATION).get("repository-code", "ADDRESS")
    page = (paths.ROOT / "docs/oneclick.md").read_text(encoding="utf-8")
    assert f"git clone --quiet --depth 1 {address} sngr" in page


def test_the_container_makes_the_same_environment():
    text = (paths.ROOT / ".devcontainer/devcontainer.json").read_text(encoding="utf-8")
    container = json.loads(text)
    assert container["postCreateCommand"] == "make setup"
    assert re.fullmatch(r"python:(3\.\d+)-\w+", container["image"])[1] in PYTHONS


def test_the_public_ci_calls_the_same_script_on_all_that_is_supported():
    workflow = read_yaml(paths.ROOT / ".github/workflows/ci.yml")
    job = workflow["jobs"]["run"]
    assert job["strategy"]["matrix"]["python"] == PYTHONS
    assert [name.split("-")[0] for name in job["strategy"]["matrix"]["os"]] == ["ubuntu", "macos"]
    (last,) = [step for step in job["steps"] if ".ci/run" in step.get("run", "")]
    assert last["run"] == "bash .ci/run"
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    first, end = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", project["requires-python"]).groups()
    assert [f"3.{minor}" for minor in range(int(first), int(end))] == PYTHONS
