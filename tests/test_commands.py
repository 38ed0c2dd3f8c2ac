"""What the README's commands do, in which order, with all programs they call replaced by stubs.

A stub writes a line to a log, and fails if the environment variable FAIL is part of that line.
"""

import shutil
import subprocess
import sys

import pytest

from sngr_utils import paths

STUB = """#!/bin/sh
line="{name} $*"
echo "$line" >> "{log}"
case "$line" in *"$FAIL"*) exit 1;; esac
{then}
"""
STALE = 'case "$*" in *stale) for name in $STALE; do echo "run/$name"; done;; esac'
TOOLS = ("sh", "bash", "id", "uname", "cat", "cksum", "ls", "mkdir", "rm", "ln", "awk", "cp", "cmp",
         "mv", "grep", "head", "tail", "dirname", "make", "env")  # fmt: skip


class Checkout:
    """A folder with the Makefile, a stubbed environment, and only the basic tools on the PATH."""

    def __init__(self, folder):
        self.folder, self.log, self.bin = folder, folder / "log", folder / "bin"
        for name in ("bin", "scripts", "notebooks", "paper", "build"):
            (folder / name).mkdir()
        for tool in TOOLS:
            (self.bin / tool).symlink_to(shutil.which(tool))

    def stub(self, path, name, then=""):
        path = self.folder / path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(STUB.format(name=name, log=self.log, then=then))
        path.chmod(0o755)

    def run(self, *command, **variables):
        """Status, and what the stubs logged, a line each; `output` has what was shown."""
        self.log.write_text("")
        # not the jobs of the make that runs these tests
        env = {"PATH": str(self.bin), "HOME": str(self.folder), "FAIL": "<none>"} | variables
        done = subprocess.run(
            [str(part) for part in command], cwd=self.folder, env=env, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.output = done.stdout
        return done.returncode, self.log.read_text().splitlines()


@pytest.fixture
def checkout(tmp_path):
    return Checkout(tmp_path)


# --- make ---------------------------------------------------------------------------------------


@pytest.fixture
def made(checkout):
    """A checkout in which make runs; setup is not logged, every target asks for it."""
    shutil.copy(paths.ROOT / "Makefile", checkout.folder)
    for name in ("01_a", "02_b"):
        (checkout.folder / f"notebooks/{name}.ipynb").touch()
    checkout.stub("scripts/install_tex.sh", "tex")
    checkout.stub("scripts/typeset.sh", "typeset")
    checkout.stub(".venv/bin/python", "python", STALE)
    (checkout.folder / "scripts/setup.sh").touch()
    return checkout


TEX, TYPESET = "tex ", "typeset "
RUN = "python -m sngr_utils"
CHECK, SORT_OUT, LATEX = (f"{RUN} {command}" for command in ("check", "stale", "latex"))
COMPILE, COMPARE = f"{RUN} compile", f"{RUN} verify"
RUN_A = f"{RUN} notebook 01_a"
SCRATCH = [f"{RUN} aside 02_b", f"{RUN} aside 01_a"]


@pytest.mark.parametrize(
    ("target", "fails", "called"),
    [
        ("paper", None, [TEX, SORT_OUT, COMPILE, RUN_A, LATEX, TYPESET]),
        ("paper", TEX, [TEX]),  # it says at once that TeX is missing
        ("paper", SORT_OUT, [TEX, SORT_OUT]),  # bad parameters: before anything runs
        ("paper", RUN_A, [TEX, SORT_OUT, COMPILE, RUN_A]),  # nothing stale is typeset
        ("paper", LATEX, [TEX, SORT_OUT, COMPILE, RUN_A, LATEX]),
        ("results", None, [SORT_OUT, COMPILE, RUN_A]),
        ("pdf", None, [LATEX, TYPESET]),
        ("run/01_a", None, [RUN_A]),
        ("test", None, [CHECK, COMPILE, "python -m pytest"]),
        ("test", CHECK, [CHECK]),
        ("verify", None, [CHECK, COMPILE, *SCRATCH, COMPARE]),
        ("verify", CHECK, [CHECK]),
        ("why", "<name one>", []),
        ("verify", SCRATCH[0], [CHECK, COMPILE, *SCRATCH]),  # a failed run is never compared
    ],
)  # fmt: skip
def test_each_command_runs_what_it_promises_in_order(made, target, fails, called):
    status, log = made.run("make", target, "JOBS=1", STALE="01_a", FAIL=fails or "<none>")
    assert (status != 0) == (fails is not None), made.output
    assert log == [line for line in called if fails != SCRATCH[0] or line != SCRATCH[1]]


@pytest.mark.parametrize("jobs", ["-j8", "JOBS=2"])
def test_parallel_runs_keep_the_order(made, jobs):
    status, log = made.run("make", jobs, "paper", STALE="02_b 01_a")
    assert status == 0, made.output
    assert log[:3] == [TEX, SORT_OUT, COMPILE]
    assert sorted(log[3:5]) == [RUN_A, RUN_A.replace("01_a", "02_b")]
    assert log[5:] == [LATEX, TYPESET]


def test_paper_again_runs_no_notebook(made):
    assert made.run("make", "paper", STALE="") == (0, [TEX, SORT_OUT, LATEX, TYPESET])
    assert "all notebooks are up to date" in made.output


def test_nothing_of_the_users_python_counts(made):
    """What Python, Jupyter and Matplotlib would read from a user's set-up does not reach them."""
    names = [
        "PYTHONPATH", "PYTHONHOME", "PYTHONOPTIMIZE", "PYTHONHASHSEED", "PYTHONNOUSERSITE",
        "JUPYTER_PATH", "JUPYTER_CONFIG_DIR", "IPYTHONDIR", "VIRTUAL_ENV", "MPLBACKEND",
        "MPLCONFIGDIR", "CDPATH", "BASH_ENV", "SOURCE_DATE_EPOCH",
    ]  # fmt: skip
    theirs = dict.fromkeys(names, "theirs")
    (made.folder / "probe.mk").write_text("include Makefile\nprobe:\n\t@env\n")
    status, _ = made.run("make", "-f", "probe.mk", "probe", **theirs)
    assert status == 0
    seen = dict(line.split("=", 1) for line in made.output.splitlines() if "=" in line)
    assert "theirs" not in {seen.get(name) for name in names}
    assert seen["PYTHONNOUSERSITE"] == "1"
    assert seen["PYTHONHASHSEED"] == "0"
    assert seen["MPLCONFIGDIR"] == f"{made.folder}/build/cache/matplotlib"


# --- scripts/setup.sh ---------------------------------------------------------------------------


@pytest.fixture
def setup(checkout):
    """setup.sh with a uv that makes an environment without installing anything."""
    shutil.copy(paths.ROOT / "scripts/setup.sh", checkout.folder / "scripts")
    (checkout.folder / "environment.lock").write_text("numpy==1 --hash=sha256:0\n")
    (checkout.bin / "python3").symlink_to(sys.executable)
    make = f'[ "$1" != venv ] || (mkdir -p .venv/bin && ln -s "{sys.executable}" .venv/bin/python)'
    checkout.stub("bin/uv", "uv", make)
    return checkout


def test_set_up_installs_the_lock_by_its_hashes_and_once(setup):
    status, log = setup.run("bash", "scripts/setup.sh")
    assert status == 0, setup.output
    made, locked, ours = log
    assert made.startswith("uv venv ")
    assert locked.endswith("--no-deps --require-hashes -r environment.lock")
    assert ours.endswith("--no-deps --no-build-isolation --editable .")
    assert setup.run("bash", "scripts/setup.sh") == (0, [])  # does nothing if current
    (setup.folder / "environment.lock").write_text("numpy==2 --hash=sha256:0\n")
    assert len(setup.run("bash", "scripts/setup.sh")[1]) == 3
    (setup.folder / ".venv/bin/python").unlink()  # its Python is gone
    assert len(setup.run("bash", "scripts/setup.sh")[1]) == 3


def test_a_failed_set_up_is_not_current(setup):
    status, _ = setup.run("bash", "scripts/setup.sh", FAIL="--require-hashes")
    assert status != 0
    status, log = setup.run("bash", "scripts/setup.sh")
    assert (status, len(log)) == (0, 3)


def test_without_a_python_that_will_do_set_up_says_so(setup):
    (setup.bin / "python3").unlink()
    setup.stub("bin/python3", "python3", "exit 1")  # a Python that is too old says no
    status, log = setup.run("bash", "scripts/setup.sh")
    assert status == 1
    assert not any(line.startswith("uv") for line in log)
    assert "error: no Python 3.11 to 3.14 found; name one with: make setup PYTHON=" in setup.output


# --- TeX ----------------------------------------------------------------------------------------


@pytest.fixture
def tex(checkout):
    for name in ("install_tex.sh", "typeset.sh"):
        shutil.copy(paths.ROOT / "scripts" / name, checkout.folder / "scripts")
    return checkout


def test_without_tex_and_without_leave_to_install_it_says_what_to_run(tex):
    command = ("bash", "scripts/install_tex.sh")
    status, _ = tex.run(*command)  # no apt-get here
    assert status == 1
    assert "error: TeX is missing" in tex.output
    assert "apt-get install" in tex.output or "brew install" in tex.output
    assert "make results" in tex.output
    (tex.bin / "id").unlink()
    tex.stub("bin/id", "id", "echo 1000")
    tex.stub("bin/apt-get", "apt-get")
    tex.stub("bin/sudo", "sudo", "exit 1")  # not without a password
    status, log = tex.run(*command)
    assert status == 1
    assert "error: TeX is missing" in tex.output
    assert not any(line.startswith("apt-get") for line in log)


def test_with_tex_nothing_is_installed(tex):
    for name in ("latexmk", "pdflatex", "kpsewhich", "apt-get"):
        tex.stub(f"bin/{name}", name)
    status, log = tex.run("bash", "scripts/install_tex.sh")
    assert (status, tex.output) == (0, "")
    assert {line.split()[0] for line in log} == {"kpsewhich"}


LOG = "../build/paper/sngr.log"


@pytest.mark.parametrize(
    ("latexmk", "reason"),
    [
        (f"echo fine > {LOG}", None),
        (
            f"echo '! Package sngr Error: no notebook hands on the value' > {LOG}; exit 1",
            "hands on",
        ),
        (f"echo 'LaTeX Warning: There were undefined references.' > {LOG}", "undefined references"),
        (f"echo 'LaTeX Warning: Citation x undefined on page 1' > {LOG}", "Citation x undefined"),
        ("echo 'killed'; exit 137", "killed"),
    ],
)
def test_a_paper_with_an_error_never_replaces_the_last_good_one(tex, latexmk, reason):
    written = f"mkdir -p ../build/paper; echo new > ../build/paper/sngr.pdf; {latexmk}"
    tex.stub("bin/latexmk", "latexmk", written)
    (tex.folder / "paper/sngr.pdf").write_text("good\n")
    status, log = tex.run("bash", "scripts/typeset.sh")
    assert "-halt-on-error" in log[0]
    kept = (tex.folder / "paper/sngr.pdf").read_text()
    if reason is None:
        assert (status, kept) == (0, "new\n"), tex.output
    else:
        assert (status, kept) == (1, "good\n")
        assert "error: the paper was not typeset; the last good PDF is untouched." in tex.output
        assert reason in tex.output
