"""Copies of a small project, a moment to make each: one notebook, the real package and scripts.

They share the environment of the checkout: a copy's ``.venv`` is a shell whose Python sees the
copy's own package and the installed ones.
"""

import functools
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "build" / "matrix"
sys.path.insert(0, str(ROOT / "tests"))

NAME = "01_bimodal"
TOP = (
    "Makefile", "sngr_utils", "scripts", "pyproject.toml", ".gitattributes", ".gitignore",
    "README.md", "LICENSE", "LICENSE-text", ".binder",
)  # fmt: skip
PAPER = r"""\documentclass{article}\usepackage{booktabs,hyperref}
\pdftrailerid{}\pdfsuppressptexinfo=-1
\input{generated/values}\input{generated/timings}\input{generated/sources}
\newcommand{\cellmark}[1]{\csname cell@#1\endcsname}
\begin{document}Seed \csname res@seed\endcsname, drawn in
\cellmark{figure@01_bimodal_f}.\label{here} See page~\pageref{here}.\end{document}
"""
SUPPLEMENT = r"\documentclass{article}\begin{document}Seed, at length.\end{document}"
# status of a copy's Python, as a user without rights to other's files would have it
WITHOUT_RIGHTS = ("setpriv", "--bounding-set=-all", "--inh-caps=-all")


class Skip(Exception):
    """This machine cannot be brought into the situation; the message says why."""


@dataclass(frozen=True)
class Done:
    """A command that has run: its exit status and all it showed."""

    status: int
    text: str


class Copy:
    """A copy of the template, and the commands that are tried in it.

    Attributes
    ----------
    root : its folder
    home : an empty home of its user
    before : words that every command is run by, e.g. ``taskset -c 0``
    """

    def __init__(self, root: Path):
        self.root, self.home, self.before = root, root.with_name(root.name + ".home"), ()
        self.home.mkdir(parents=True)
        self.variables: dict[str, str] = {}

    def adopt(self) -> "Copy":
        """Give the copy its ``.venv``."""
        shutil.rmtree(self.root / ".venv", ignore_errors=True)
        (self.root / "build").mkdir(exist_ok=True)
        real = ROOT / ".venv"
        packages = next(real.glob("lib/python*/site-packages"))
        own = self.root / ".venv" / packages.relative_to(real)
        own.mkdir(parents=True)
        (self.root / ".venv/bin").mkdir()
        (self.root / ".venv/bin/python").symlink_to((real / "bin/python").resolve())
        (self.root / ".venv/share").symlink_to(real / "share")
        for name in ("pyvenv.cfg", "archive"):
            shutil.copy(real / name, self.root / ".venv")
        (own / "sngr.pth").write_text(f"{self.root}\n{packages}\n", encoding="utf-8")
        with open(self.root / "environment.lock", "rb") as lock:
            summed = subprocess.run(["cksum"], stdin=lock, capture_output=True, text=True).stdout
        (self.root / ".venv/complete").write_text(f"{summed.rstrip()} {self.root}\n")
        return self

    def run(self, *command: str, timeout: float = 1800) -> Done:
        """Run a command in the copy, as its user; what is late is killed, with all it started."""
        process = subprocess.Popen(
            [*self.before, *command], cwd=self.root, env=self.env(), start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        )  # fmt: skip
        try:
            text = process.communicate(timeout=timeout)[0]
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return Done(process.returncode, text)

    def env(self) -> dict[str, str]:
        """The variables of its user: of ours, the PATH and where packages come from."""
        network = re.compile("PATH|.*(CERT|PROXY|_INDEX|FIND_LINKS).*", re.I)
        kept = {name: value for name, value in os.environ.items() if network.fullmatch(name)}
        return kept | {"HOME": str(self.home), "LANG": "C.UTF-8"} | self.variables

    def works(self, *targets: str) -> str:
        """``make TARGETS``, which must do; returns what it showed."""
        done = self.run("make", *targets)
        assert done.status == 0, done.text[-600:]
        assert "Traceback" not in done.text, done.text[-600:]
        return done.text

    def refuses(self, *targets: str, names: str) -> str:
        """``make TARGETS``, which must fail with a line that names the thing, and lose nothing."""
        before = self.good()
        done = self.run("make", *targets)
        said = [line for line in done.text.splitlines() if not line.startswith("make")]
        assert done.status != 0, f"it did {targets}: {done.text[-300:]}"
        assert "Traceback" not in done.text, done.text[-600:]
        assert any("error: " in line and names in line for line in said), done.text[-600:]
        assert len(said) <= 12, done.text[-600:]
        assert self.good() == before, "something good was lost"
        return done.text

    def good(self) -> dict[str, bytes]:
        """What must not be lost: results, figures, the PDF, the environment's mark."""
        patterns = (
            "build/results/*",
            "figures/*",
            "paper/sngr.pdf",
            ".venv/complete",
            "params/*.yaml",
        )
        found = (path for pattern in patterns for path in self.root.glob(pattern))
        return {str(path): path.read_bytes() for path in found if path.is_file()}

    def same_as_template(self) -> None:
        """The results and the PDF must be the template's, byte for byte."""
        for file in (f"figures/{NAME}_f.pdf", f"build/results/{NAME}.json", "paper/sngr.pdf"):
            assert (self.root / file).read_bytes() == (template() / file).read_bytes(), file

    def write(self, file: str, content: str | bytes) -> Path:
        """Write a file of the copy, or of its home if it begins with ``~/``."""
        path = self.home / file[2:] if file.startswith("~/") else self.root / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def edit(self, file: str, old: str, new: str) -> None:
        """Replace a piece of a file; it must be there."""
        text = (self.root / file).read_text(encoding="utf-8")
        assert old in text, f"{old!r} is not in {file}"
        self.write(file, text.replace(old, new))

    def body(self, extra: str) -> None:
        """Add lines to the notebook's last cell, before it saves its results."""
        self.edit(
            f"notebooks/{NAME}.ipynb", '"paper.save()', '"' + extra + '\\n",\n    "paper.save()'
        )


def make_template() -> None:
    """The project that is copied: committed, its notebook published, its paper typeset."""
    from small_project import make_project

    folder = WORK / "template"
    shutil.rmtree(WORK, ignore_errors=True)
    folder.mkdir(parents=True)
    make_project(folder)
    for name in TOP:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, dirs_exist_ok=True)
        else:
            shutil.copy(source, folder)
    (folder / "paper/sngr.tex").write_text(PAPER)
    (folder / "paper/supplement.tex").write_text(SUPPLEMENT)
    (folder / "paper/reference").mkdir()
    shutil.copy(ROOT / f"paper/reference/{NAME}.json", folder / "paper/reference")
    shutil.copy(ROOT / "paper/verdicts.json", folder / "paper")
    for command in ("init -q -b main", "add -A", "commit -q -m small"):
        git(folder, *command.split())
    copy = Copy(folder).adopt()
    copy.works(f"run/{NAME}")
    if shutil.which("latexmk"):
        copy.works("pdf")


def git(folder: Path, *command: str) -> None:
    """Run git there, as nobody in particular."""
    who = ("-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "safe.directory=*")
    subprocess.run(["git", *who, *command], cwd=folder, check=True, capture_output=True)


def template() -> Path:
    """The folder of the template."""
    return WORK / "template"


def fresh(name: str) -> Copy:
    """A copy of the template in the folder ``name``."""
    root = WORK / name
    root.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(template(), root, symlinks=True, ignore=shutil.ignore_patterns(".venv"))
    return Copy(root).adopt()


@functools.cache
def can(*command: str) -> bool:
    """Whether a command runs here, e.g. one that needs a right."""
    try:
        return subprocess.run(command, capture_output=True, timeout=20).returncode == 0
    except OSError:
        return False


def need(*command: str, reason: str) -> None:
    """Skip, for the reason given, where a command does not run."""
    if not can(*command):
        raise Skip(reason)
