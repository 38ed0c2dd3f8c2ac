"""Situations of who keeps what was made, and of who begins with what was kept."""

import hashlib
import io
import os
import re
import shutil
import sys
import tarfile
from pathlib import Path

from copies import NAME, ROOT, Copy, Skip, can, template

sys.path.insert(0, str(ROOT / "scripts"))
import packed

SITUATIONS = {}
KEPT = "kept/sngr-results.tar.gz"
EACH_MODULE = """
import importlib, pkgutil, sys, sngr_utils
for module in pkgutil.walk_packages(sngr_utils.__path__, "sngr_utils."):
    "__main__" in module.name or importlib.import_module(module.name)
print("3.%d" % sys.version_info[1])
"""


def situation(name):
    """Register a function under a name."""
    return lambda function: SITUATIONS.setdefault(name, function)


def kept(copy: Copy) -> Path:
    """The archive of a copy, put aside; nothing that was executed is left."""
    copy.works("archive")
    shutil.move(copy.root / "build/archive", copy.root / "kept")
    for folder in ("build/results", "build/runs", "build/executed", "figures"):
        shutil.rmtree(copy.root / folder)
    return copy.root / KEPT


def hashed(tarball: Path) -> None:
    """Write the checksum beside a tarball."""
    digest = hashlib.sha256(tarball.read_bytes()).hexdigest()
    tarball.with_name(f"{tarball.name}.sha256").write_text(f"{digest}  {tarball.name}\n")


@situation("the paper from an archive of results")
def _(copy):
    before = kept(copy).read_bytes()
    copy.works("results-from", f"TARBALL={KEPT}")
    assert not (copy.root / "build/runs").exists(), "tests would take it for an execution"
    assert "up to date" in copy.works("results")
    copy.works("pdf")
    copy.same_as_template()
    copy.works("archive")
    assert (copy.root / "build/archive" / Path(KEPT).name).read_bytes() == before


@situation("an archive that was altered, is of other inputs, or lies")
def _(copy):
    tarball, take = kept(copy), ("results-from", f"TARBALL={KEPT}")
    good = tarball.read_bytes()
    tarball.write_bytes(good[:-1] + b"x")
    copy.refuses(*take, names="is not what")
    tarball.write_bytes(good)
    copy.edit(f"params/{NAME}.yaml", "seed: 0", "seed: 1")
    copy.refuses(*take, names="other inputs")
    copy.edit(f"params/{NAME}.yaml", "seed: 1", "seed: 0")
    with tarfile.open(fileobj=io.BytesIO(good)) as opened:
        content = {each.name: opened.extractfile(each).read() for each in opened}
    results = f"build/results/{NAME}.json"
    packed.write(
        {**content, results: content[results].replace(b'"value": 0.0', b'"value": 7.0')}, tarball
    )
    hashed(tarball)
    copy.refuses(*take, names="differs from the archive")
    packed.write({**content, "../../out": b"", "params/x.yaml": b"", "figures/../x": b""}, tarball)
    hashed(tarball)
    copy.works(*take)
    assert not (copy.root / "params/x.yaml").exists()
    assert not (copy.root / "x").exists()
    assert not (copy.root.parent / "out").exists()


@situation("the paper's sources typeset alone")
def _(copy):
    if not (template() / "paper/sngr.pdf").exists():
        return
    copy.write("figures/x.pdf", (copy.root / f"figures/{NAME}_f.pdf").read_bytes())
    copy.edit("paper/sngr.tex", "Seed", r"\includegraphics{../figures/x} See \cite{a}. Seed")
    copy.edit("paper/sngr.tex", r"\usepackage{", r"\usepackage{graphicx,")
    copy.edit(
        "paper/sngr.tex",
        r"\end{document}",
        r"\bibliographystyle{plain}\bibliography{r}\end{document}",
    )
    copy.write("paper/r.bib", "@misc{a, title = {A}}")
    assert "1 pages, typeset from the tarball alone" in copy.works("arxiv")
    first = (copy.root / "build/arxiv.tar.gz").read_bytes()
    copy.works("arxiv")
    assert (copy.root / "build/arxiv.tar.gz").read_bytes() == first


def installed_by(copy: Copy, steps: str) -> None:
    """Run steps of installation in an empty environment, and a notebook in it."""
    done = copy.run("python3", "-m", "venv", "empty")
    assert done.status == 0, done.text
    copy.variables = {"PATH": f"{copy.root}/empty/bin:{os.environ['PATH']}"}
    shutil.rmtree(copy.root / ".venv")
    done = copy.run("bash", "-c", steps, timeout=900)
    assert done.status == 0, done.text[-600:]
    done = copy.run("python", "-m", "sngr_utils", "quick", NAME, timeout=300)
    assert done.status == 0, done.text[-600:]


def another_python(minor: int) -> None:
    """Register a set-up from nothing with Python 3.MINOR, if it is on the PATH or pyenv's."""

    def each(copy: Copy) -> None:
        root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
        named = [f"python3.{minor}", *map(str, root.glob(f"versions/3.{minor}.*/bin/python"))]
        found = [python for python in named if can(python, "--version")]
        if not found or sys.version_info[1] == minor:
            raise Skip("it is not here" if not found else "it is the checkout's own")
        shutil.rmtree(copy.root / ".venv")
        copy.works("check", f"PYTHON={found[-1]}")
        done = copy.run(".venv/bin/python", "-c", EACH_MODULE)
        assert done.status == 0, done.text[-600:]
        assert done.text.endswith(f"3.{minor}\n"), done.text[-600:]  # after first-time remarks
        copy.works(f"run/{NAME}")

    SITUATIONS[f"a set-up from nothing with Python 3.{minor}"] = each


for minor in range(11, 15):
    another_python(minor)
OTHER_PYTHONS = {name for name in SITUATIONS if name.startswith("a set-up from nothing")}


@situation("Binder's steps in an empty environment")
def _(copy):
    installed_by(copy, "bash .binder/postBuild")


@situation("Colab's cell in an empty environment")
def _(copy):
    page = (ROOT / "docs/oneclick.md").read_text(encoding="utf-8")
    cell = re.search(r"```\n(!git.*?)```", page, re.S)[1]
    _clone, _folder, *steps = cell.splitlines()
    installed_by(copy, "set -e\n" + "\n".join(line.removeprefix("!") for line in steps))
