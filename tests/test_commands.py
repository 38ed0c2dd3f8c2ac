"""What the README's commands do, in which order, with all programs they call replaced by stubs.

A stub writes a line to a log, and fails if the environment variable FAIL is part of that line.
"""

import runpy
import shutil
import signal
import subprocess
import sys

import joblib
import numba
import pytest
from numba.core import caching

from sngr_utils import __main__ as command_line
from sngr_utils import paths
from sngr_utils.experiments import studies

SCRIPTS = paths.ROOT / "scripts"
STUB = """#!/bin/sh
line="{name} $*"
echo "$line" >> "{log}"
case "$line" in *"$FAIL"*) exit 1;; esac
{then}
"""
STALE = """case "$*" in *stale) for name in $STALE; do echo "run/$name"; done;; esac
case "$1" in scripts/alone.py) shift 2; exec "$@";; esac"""
TOOLS = ("sh", "bash", "id", "uname", "cat", "cksum", "ls", "mkdir", "rm", "ln", "awk", "cp", "cmp",
         "mv", "grep", "head", "tail", "dirname", "make", "env",
         "mktemp", "df", "sleep")  # fmt: skip


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
        lines = self.log.read_text().splitlines()
        return done.returncode, [line for line in lines if "scripts/alone.py" not in line]


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
        "MPLCONFIGDIR", "CDPATH", "BASH_ENV", "SOURCE_DATE_EPOCH", "NUMBA_DISABLE_JIT",
        "JOBLIB_TEMP_FOLDER", "LOKY_PICKLER", "DASK_CONFIG", "PYTEST_ADDOPTS", "PYTHONWARNINGS",
        "TEXINPUTS", "TEXMFHOME", "TEXMFCNF", "BIBINPUTS", "BSTINPUTS", "LATEXMKRCSYS", "GIT_DIR",
        "max_print_line", "OPENBLAS_CORETYPE", "TZ", "COVERAGE_PROCESS_START", "RUFF_CONFIG",
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
    for name in ("setup.sh", "setup_more.sh", "private_pip.sh", "alone.py"):
        shutil.copy(paths.ROOT / "scripts" / name, checkout.folder / "scripts")
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
    assert locked.endswith("--only-binary :all: --no-deps --require-hashes -r environment.lock")
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


def test_a_failed_set_up_leaves_the_environment_that_was_there(setup):
    assert setup.run("bash", "scripts/setup.sh")[0] == 0
    good = (setup.folder / ".venv/complete").read_text()
    (setup.folder / "environment.lock").write_text("numpy==2 --hash=sha256:1\n")
    status, _ = setup.run("bash", "scripts/setup.sh", FAIL="--require-hashes")
    assert status == 1
    assert "error: environment.lock was not installed; what .venv held before" in setup.output
    assert (setup.folder / ".venv/complete").read_text() == good
    assert not (setup.folder / ".venv.before").exists()
    (setup.folder / ".venv").rename(setup.folder / ".venv.before")  # one that was killed
    assert setup.run("bash", "scripts/setup.sh", FAIL="--require-hashes")[0] == 1
    assert (setup.folder / ".venv/complete").read_text() == good
    assert setup.run("bash", "scripts/setup.sh")[0] == 0
    assert not (setup.folder / ".venv.before").exists()


@pytest.mark.parametrize("script", [("setup.sh",), ("setup_more.sh", "more", "environment.lock")])
def test_of_pips_and_uvs_settings_only_where_packages_come_from_counts(setup, script):
    setup.stub("bin/uv", "uv", "mkdir -p .venv/bin; env > seen")
    kept = dict.fromkeys(["PIP_INDEX_URL", "UV_DEFAULT_INDEX", "PIP_CERT", "UV_CACHE_DIR"], "a")
    unwanted = ["PIP_CONSTRAINT", "PIP_NO_BINARY", "UV_NO_BINARY", "PIP_USER", "PIP_TARGET",
                "UV_SYSTEM_PYTHON", "UV_PROJECT", "PIP_REQUIRE_VIRTUALENV"]  # fmt: skip
    dropped = dict.fromkeys(unwanted, "1")
    status, _ = setup.run("bash", f"scripts/{script[0]}", *script[1:], **kept, **dropped)
    assert status == 0, setup.output
    seen = dict(line.split("=", 1) for line in (setup.folder / "seen").read_text().splitlines())
    assert kept.items() <= seen.items()
    assert not dropped.keys() & seen.keys()


def test_what_a_target_of_its_own_needs_is_installed_by_its_hashes_and_once(setup):
    (setup.folder / ".venv").mkdir()
    command = ("bash", "scripts/setup_more.sh", "site", "environment.lock")
    status, _ = setup.run(*command, FAIL="--require-hashes")
    assert status == 1
    assert "error: environment.lock was not installed" in setup.output
    status, (line,) = setup.run(*command, PIP_FIND_LINKS="a")
    assert status == 0
    assert line.endswith("--only-binary :all: --no-deps --require-hashes -r environment.lock")
    assert setup.run(*command) == (0, [])


def test_two_set_ups_do_not_meet(setup):
    """The second waits, says so, and finds the work done."""
    setup.stub("bin/uv", "uv", '[ "$1" != venv ] || mkdir -p .venv/bin; sleep 0.3\n'
               f'ln -sf "{sys.executable}" .venv/bin/python')  # fmt: skip
    env = {"PATH": str(setup.bin), "HOME": str(setup.folder), "FAIL": "<none>"}
    both = [
        subprocess.Popen(["bash", "scripts/setup.sh"], cwd=setup.folder, env=env, text=True,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        for _ in range(2)
    ]  # fmt: skip
    shown = [process.communicate(timeout=30)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], shown
    assert sum("waiting: another make is at work here" in text for text in shown) == 1
    assert (setup.folder / "log").read_text().count("uv venv") == 1


def test_a_folder_that_cannot_be_written_is_named_at_once(setup):
    (setup.folder / "build").rmdir()
    (setup.folder / "build").write_text("a file")
    status, log = setup.run("bash", "scripts/setup.sh")
    assert (status, log) == (1, [])
    assert f"error: {setup.folder}/build cannot be written" in setup.output.splitlines()[0]


@pytest.mark.parametrize("name", ["setup", "pdf"])
def test_a_link_in_place_of_a_lock_is_not_followed(setup, name):
    (setup.folder / "precious").write_text("kept")
    (setup.folder / "build/.x.lock").symlink_to(setup.folder / "precious")
    alone = ("python3", "scripts/alone.py", "build/.x.lock", "cat", "precious")
    status, _ = setup.run(*alone)
    assert (status, (setup.folder / "precious").read_text()) == (1, "kept")
    assert setup.output.startswith("error: build/.x.lock: ")
    (setup.folder / "build/.x.lock").unlink()
    assert setup.run(*alone)[0] == 0
    assert setup.output == "kept"


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
    for name in ("install_tex.sh", "install_browser.sh", "typeset.sh"):
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


@pytest.mark.parametrize(
    ("script", "missing"),
    [("install_tex.sh", "TeX is missing"), ("install_browser.sh", "no Chromium")],
)
def test_what_is_done_as_root_is_said_before_and_can_be_declined(tex, script, missing):
    tex.stub("bin/apt-get", "apt-get")
    (tex.bin / "id").unlink()
    tex.stub("bin/id", "id", "echo 0")
    status, log = tex.run("bash", f"scripts/{script}", NO_APT="1")
    assert (status, [line for line in log if "apt-get" in line]) == (1, [])
    assert "may not" in tex.output
    assert "here (NO_APT is set)" in tex.output
    status, log = tex.run("bash", f"scripts/{script}")
    assert status == 1  # the stub installs nothing
    assert [line.split()[1] for line in log if line.startswith("apt-get")] == ["update", "install"]
    said = tex.output.index("As root, on this system and not only in this folder, this runs now")
    assert said < tex.output.index(f"error: {missing}")
    assert "To decline, stop it and set NO_APT=1." in tex.output


def test_with_tex_nothing_is_installed(tex):
    for name in ("latexmk", "pdflatex", "kpsewhich", "apt-get"):
        tex.stub(f"bin/{name}", name)
    status, log = tex.run("bash", "scripts/install_tex.sh")
    assert (status, tex.output) == (0, "")
    assert {line.split()[0] for line in log} == {"kpsewhich"}


LOG = "$into/$document.log"  # of the document that the stub is asked for


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
        (f"rm -f {LOG}", "not typeset"),  # it went elsewhere: undefined references could hide
    ],
)
@pytest.mark.parametrize("spoiled", ["sngr", "supplement"])
def test_a_paper_with_an_error_never_replaces_the_last_good_one(tex, latexmk, reason, spoiled):
    """Nor does a supplement with one replace either of the two."""
    names = "for last; do document=${last%.tex}; done; into=../build/paper"
    written = f"mkdir -p $into; echo new > $into/$document.pdf; echo fine > {LOG}"
    tex.stub(
        "bin/latexmk", "latexmk",
        f"{names}; {written}; if [ $document = {spoiled} ]; then {latexmk}; fi",
    )  # fmt: skip
    pdfs = [tex.folder / "paper" / f"{name}.pdf" for name in ("sngr", "supplement")]
    for pdf in pdfs:
        pdf.write_text("good\n")
        pdf.with_suffix(".tex").write_text("\\documentclass{article}\n")
    status, log = tex.run("bash", "scripts/typeset.sh")
    assert "-halt-on-error" in log[0]
    assert "-norc" in log[0]
    kept = [pdf.read_text() for pdf in pdfs]
    if reason is None:
        assert (status, kept) == (0, ["new\n"] * 2), tex.output
    else:
        assert (status, kept) == (1, ["good\n"] * 2)
        assert "error: the paper was not typeset; the last good PDF is untouched." in tex.output
        assert reason in tex.output


# --- what is asked wrongly ------------------------------------------------------------------------


@pytest.mark.parametrize("asked", ["--help", "--nonsense"])
@pytest.mark.parametrize(
    "script",
    ["matrix"] + [path.name for path in SCRIPTS.glob("*.py") if "__main__" in path.read_text()],
)
def test_a_script_tells_how_it_is_used_and_does_no_work(script, asked, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [script, asked])
    monkeypatch.syspath_prepend(str(SCRIPTS))
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(SCRIPTS / script), run_name="__main__")
    told = "".join(capsys.readouterr()) + str(left.value.code)
    assert script in told
    assert left.value.code != (0 if asked == "--nonsense" else 2)


@pytest.mark.parametrize("script", sorted(path.name for path in SCRIPTS.glob("*.sh")))
def test_a_shell_script_tells_what_it_is_for_and_does_no_work(script):
    done = subprocess.run(
        ["bash", f"scripts/{script}", "--help"], cwd=paths.ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) in (1, 2, 3)


@pytest.mark.parametrize("command", ["notebook", "quick", "aside", "refresh"])
@pytest.mark.parametrize("name", ["", "01", "01_bimodal.ipynb", "../x", "a\0b", "\n", "x" * 5000])
def test_a_name_of_no_notebook_is_refused_before_any_runs(command, name, capsys):
    assert command_line.main([command, "01_bimodal", name]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("error: no notebook ")
    assert said.err.count("\n") == 1
    assert len(said.err) < 400


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (["estimate", ""], "odometry.csv: No such file or directory"),
        (["estimate", "/dev/zero"], "/dev/zero: neither one of .pyfg"),
        (["estimate", "\x1b[2Jb.pyfg"], r"\x1b[2Jb.pyfg: no such file"),
        (["estimate", "a\0b.pyfg"], r"a\x00b.pyfg: no such file"),
        (["estimate", "x" * 5000 + ".pyfg"], "File name too long"),
        (["why", "x" * 100_000], "no notebook hands on a value, table or figure 'xxx"),
        (["study", "../x"], "study is '../x': it must be one of"),
    ],
)
def test_what_is_asked_wrongly_ends_in_one_line(asked, told, capsys):
    assert command_line.main(asked) == 1
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert told in said.err
    assert all(c.isprintable() for c in said.err.strip())


def test_a_project_where_compiled_code_cannot_be_kept_says_so(capsys, monkeypatch):
    # as for a user who may write neither here nor into a home
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])

    def compiles(args):
        numba.njit(cache=True)(lambda x: x)

    monkeypatch.setitem(command_line.COMMANDS, "check", (compiles, ""))
    assert command_line.main(["check"]) == 1
    assert capsys.readouterr().err == "error: build/cache: compiled code cannot be kept there\n"


@pytest.mark.parametrize("jobs", ["0", "-1", "1e3", "2.0", "", "9" * 5000, "٣"])
def test_a_number_of_workers_is_one_that_a_machine_may_have(jobs, capsys):
    with pytest.raises(SystemExit, match="2"):
        command_line.main(["study", "every_world", "--jobs", jobs])
    assert "argument --jobs" in capsys.readouterr().err


@pytest.mark.parametrize(("asked", "workers"), [([], 7), (["--jobs", "1"], 1)])
def test_a_study_has_all_cores_unless_it_is_told_otherwise(monkeypatch, asked, workers):
    found = []

    def run(name, jobs):
        found.append(joblib.effective_n_jobs(jobs))
        return "there"

    monkeypatch.setattr(studies, "run", run)
    monkeypatch.setattr(studies, "status", lambda name: (0, 1))
    monkeypatch.setattr(joblib._parallel_backends, "cpu_count", lambda *of, **options: 7)
    command_line.main(["study", "goats", *asked])
    assert found == [workers]


def test_a_command_leaves_signals_as_it_found_them(monkeypatch):
    """A process forked later, which inherits its handlers, ends when it is asked to."""
    before = [signal.getsignal(number) for number in command_line.ENDS]
    monkeypatch.setitem(command_line.COMMANDS, "check", (lambda args: 0, ""))
    assert command_line.main(["check"]) == 0
    assert [signal.getsignal(number) for number in command_line.ENDS] == before
