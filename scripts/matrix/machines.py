"""Situations of a machine, a checkout and a user: each a few lines, in a copy of its own."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from copies import NAME, WITHOUT_RIGHTS, Copy, Skip, git, need

SITUATIONS = {}
RUN = f"run/{NAME}"
UNSHARE = "this user may not make a namespace"


def situation(name):
    """Register a function under a name."""
    return lambda function: SITUATIONS.setdefault(name, function)


def again(copy: Copy, *more: str) -> None:
    """Run the notebook and typeset from nothing: the results must be the template's."""
    for folder in ("build", "figures", "paper/generated"):
        shutil.rmtree(copy.root / folder)
    (copy.root / "paper/sngr.pdf").unlink(missing_ok=True)
    copy.works(*more, RUN)
    copy.works(*more, "pdf")
    copy.same_as_template()


def moved(copy: Copy, name: str) -> Copy:
    """The copy under another name."""
    target = copy.root.parent / "moved" / copy.root.name / name
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(target, ignore_errors=True)
    copy.root.rename(target)
    return Copy(target).adopt()


# --- the user's own settings --------------------------------------------------------------------

HOSTILE = {
    "NUMBA_DISABLE_JIT": "1",
    "NUMBA_CACHE_DIR": "/nowhere",
    "JOBLIB_TEMP_FOLDER": "/nowhere",
    "JOBLIB_MULTIPROCESSING": "0",
    "LOKY_PICKLER": "nothing",
    "LOKY_MAX_CPU_COUNT": "x",
    "PYTHONPATH": "/nowhere",
    "PYTHONHOME": "/nowhere",
    "PYTHONOPTIMIZE": "2",
    "PYTHONWARNINGS": "error",
    "PYTHONSTARTUP": "/nowhere",
    "PYTHONIOENCODING": "ascii",
    "PYTHONUTF8": "0",
    "PYTHONINSPECT": "1",
    "JUPYTER_PATH": "/nowhere",
    "JUPYTER_CONFIG_DIR": "/nowhere",
    "JUPYTER_RUNTIME_DIR": "/proc/x",
    "JUPYTER_DATA_DIR": "/nowhere",
    "IPYTHONDIR": "/proc/x",
    "MPLBACKEND": "nothing",
    "MPLCONFIGDIR": "/proc/x",
    "MATPLOTLIBRC": "/nowhere",
    "TEXINPUTS": "/nowhere",
    "TEXMFHOME": "/nowhere",
    "TEXMFCNF": "/nowhere",
    "TEXMFDBS": "/nowhere",
    "BIBINPUTS": "/nowhere",
    "BSTINPUTS": "/nowhere",
    "max_print_line": "20",
    "openout_any": "p",
    "CDPATH": "/",
    "BASH_ENV": "/nowhere",
    "ENV": "/nowhere",
    "GIT_DIR": "/nowhere",
    "GIT_WORK_TREE": "/nowhere",
    "TZ": "Mars/Olympus",
    "SOURCE_DATE_EPOCH": "1",
    "PYTEST_ADDOPTS": "--nothing",
    "COVERAGE_PROCESS_START": "/nowhere",
    "RUFF_CONFIG": "/nowhere",
    "DASK_CONFIG": "/nowhere",
    "PYDEVD_DISABLE_FILE_VALIDATION": "x",
    "PIP_CONSTRAINT": "/nowhere",
    "PIP_NO_BINARY": ":all:",
    "PIP_TARGET": "/nowhere",
    "UV_PROJECT": "/nowhere",
    "UV_SYSTEM_PYTHON": "1",
    "VIRTUAL_ENV": "/nowhere",
    "CONDA_PREFIX": "/nowhere",
    "GREP_OPTIONS": "-v",
    "LATEXMKRCSYS": "/nowhere",
    "OMP_NUM_THREADS": "x",
    "OPENBLAS_NUM_THREADS": "x",
    "KMP_AFFINITY": "x",
    "TQDM_MININTERVAL": "x",
    "FORCE_COLOR": "1",
    "COLUMNS": "x",
    "TERM": "nothing",
    "TMPDIR": "/nowhere",
    "SHELL": "/nowhere",
    "SHELLOPTS": "noexec",
    "BASHOPTS": "failglob",
    "BASH_FUNC_cd%%": "() { false; }",
    "MAKEFILES": "/nowhere",
    "TAR_OPTIONS": "--nothing",
    "XDG_CONFIG_HOME": "/proc/x",
    "XDG_CACHE_HOME": "/proc/x",
    "XDG_DATA_HOME": "/proc/x",
    "XDG_RUNTIME_DIR": "/proc/x",
    "GIT_CONFIG_GLOBAL": "/nowhere",
    "GIT_EXTERNAL_DIFF": "/nowhere",
    "PYTEST_PLUGINS": "nothing",
    "NODE_OPTIONS": "--nothing",
    "DEBUG": "*",
}


@situation("every variable that one of our tools reads is set")
def _(copy):
    copy.variables = HOSTILE
    again(copy)


@situation("NUMBA_DISABLE_JIT=1 past make: it is said")
def _(copy):
    copy.variables = {"NUMBA_DISABLE_JIT": "1"}
    done = copy.run(".venv/bin/python", "-c", "import sngr_utils.numerics.jit")
    assert "NUMBA_DISABLE_JIT is set" in done.text, done.text


@situation("a home full of settings")
def _(copy):
    copy.write("~/.latexmkrc", "$pdf_mode = 4; $aux_dir = 'aux'; $out_dir = 'elsewhere';")
    copy.write("~/.ipython/profile_default/startup/00.py", "raise SystemExit")
    copy.write("~/.config/matplotlib/matplotlibrc", "figure.figsize: 1, 1\nbackend: nothing\n")
    copy.write("~/.jupyter/jupyter_config.json", '{"KernelManager": {"shutdown_wait_time": "x"}}')
    copy.write("~/.gitconfig", "[core]\n autocrlf = true\n[commit]\n gpgsign = true\n")
    copy.write("~/.config/pip/pip.conf", "[global]\nno-binary = :all:\nuser = true\n")
    copy.write("~/.bashrc", "exit 3")
    copy.write("~/.dask/config.yaml", "{")
    again(copy)


@situation("~/.latexmkrc hides undefined references")
def _(copy):
    copy.write("~/.latexmkrc", "$aux_dir = 'aux'; $emulate_aux = 1; $silent = 1;")
    copy.edit("paper/sngr.tex", "See page", r"See \ref{nowhere} on page")
    copy.refuses("pdf", names="the paper was not typeset")
    assert not (copy.root / "paper/aux").exists()


@situation("a broken package in the user's texmf")
def _(copy):
    copy.write("~/texmf/tex/latex/booktabs/booktabs.sty", r"\broken")
    again(copy)


@situation("C locale")
def _(copy):
    copy.variables = {"LC_ALL": "C", "LANG": "C"}
    again(copy)


@situation("a locale that is not installed")
def _(copy):
    copy.variables = {"LC_ALL": "tr_TR.ISO-8859-9", "LANG": "xx"}
    again(copy)


@situation("no HOME")
def _(copy):
    copy.before = ("env", "-u", "HOME")
    again(copy)


@situation("a HOME that cannot be written")
def _(copy):
    copy.variables = {"HOME": "/proc/nowhere"}
    again(copy)


@situation("umask 077")
def _(copy):
    copy.before = ("bash", "-c", 'umask 077; exec "$@"', "-")
    again(copy)


@situation("stdin closed, no terminal")
def _(copy):
    copy.before = ("bash", "-c", 'exec "$@" <&-', "-")
    again(copy)


@situation("python3 on the PATH is another")
def _(copy):
    copy.write("bin/python3", "#!/bin/sh\nexit 1\n").chmod(0o755)
    copy.variables = {"PATH": f"{copy.root}/bin:{os.environ['PATH']}"}
    copy.works("check")


@situation("no Python that will do, for a set-up")
def _(copy):
    shutil.rmtree(copy.root / ".venv")
    for name in ("python3", "python3.11", "python3.12", "python3.13", "python3.14"):
        copy.write(f"bin/{name}", "#!/bin/sh\nexit 1\n").chmod(0o755)
    copy.variables = {"PATH": f"{copy.root}/bin:{os.environ['PATH']}"}
    copy.refuses("check", names="no Python 3.11 to 3.14 found")


@situation("PYTHON= names nothing")
def _(copy):
    (copy.root / ".venv/complete").unlink()
    copy.refuses("check", "PYTHON=/nowhere/python3", names="PYTHON=/nowhere/python3 is not")


# --- the checkout -------------------------------------------------------------------------------


@situation("a checkout with core.autocrlf=true")
def _(copy):
    target = copy.root.parent / f"{copy.root.name}.crlf"
    shutil.rmtree(target, ignore_errors=True)
    git(copy.root, "clone", "-q", "-c", "core.autocrlf=true", ".", str(target))
    assert b"\r" not in (target / "scripts/setup.sh").read_bytes()
    shutil.rmtree(copy.root)
    target.rename(copy.root)
    copy.adopt().works("check", "why", f"FIGURE={NAME}_f")


@situation("a shallow clone")
def _(copy):
    target = copy.root.parent / f"{copy.root.name}.shallow"
    shutil.rmtree(target, ignore_errors=True)
    git(copy.root, "clone", "-q", "--depth", "1", f"file://{copy.root}", str(target))
    shutil.rmtree(copy.root)
    target.rename(copy.root)
    copy.adopt().works("check", "why", f"FIGURE={NAME}_f")


@situation("a worktree")
def _(copy):
    target = copy.root.parent / f"{copy.root.name}.tree"
    git(copy.root, "worktree", "add", "-q", "--detach", str(target))
    (target.parent / f"{target.name}.home").mkdir(exist_ok=True)
    shutil.rmtree(f"{target}.home")
    Copy(target).adopt().works("check", "why", f"FIGURE={NAME}_f")
    shutil.rmtree(target)


@situation("no .git, and git is not installed")
def _(copy):
    shutil.rmtree(copy.root / ".git")
    copy.write("bin/git", "#!/bin/sh\nexit 127\n").chmod(0o755)
    copy.variables = {"PATH": f"{copy.root}/bin:{os.environ['PATH']}"}
    copy.works("check", "pdf", "why", f"FIGURE={NAME}_f")


@situation("another owner's checkout")
def _(copy):
    need("chown", "65534", str(copy.home), reason="only root gives files away")
    subprocess.run(["chown", "-R", "65534:65534", str(copy.root)], check=True)
    copy.works("check", "pdf", "why", f"FIGURE={NAME}_f")


@situation("a read-only checkout, or a shared one")
def _(copy):
    need(*WITHOUT_RIGHTS, "true", reason="setpriv is missing")
    copy.before = WITHOUT_RIGHTS
    subprocess.run(["chmod", "-R", "a-w", str(copy.root)], check=True)
    try:
        for target in ("check", RUN, "pdf", "setup"):
            copy.refuses(target, names="cannot be written")
    finally:
        subprocess.run(["chmod", "-R", "u+w", str(copy.root)], check=True)


@situation("figures/ and paper/ that cannot be written")
def _(copy):
    need(*WITHOUT_RIGHTS, "true", reason="setpriv is missing")
    copy.before = WITHOUT_RIGHTS
    copy.edit(f"params/{NAME}.yaml", "seed: 0", "seed: 1")
    for folder in ("figures", "paper"):
        (copy.root / folder).chmod(0o555)
    copy.refuses(RUN, names="Permission denied")


@situation("another's .venv, to be replaced")
def _(copy):
    need(*WITHOUT_RIGHTS, "true", reason="setpriv is missing")
    copy.before = WITHOUT_RIGHTS
    copy.write(".venv/complete", "old")
    for folder in (".venv/bin", ".venv"):
        (copy.root / folder).chmod(0o555)
    copy.refuses("check", names=".venv is not yours to replace")


@situation("spaces, quotes and other scripts in the path")
def _(copy):
    again(moved(copy, "ein Ordner, 'größer' & 測試"))


@situation("a long path")
def _(copy):
    moved(copy, "/".join(["a-folder-of-some-length"] * 8)).works("check", RUN)


@situation("reached by a link")
def _(copy):
    link = copy.root.with_name(copy.root.name + ".link")
    link.unlink(missing_ok=True)
    link.symlink_to(copy.root)
    done = Copy.run(copy, "bash", "-c", f"cd {link} && make check {RUN} pdf")
    link.unlink()
    assert done.status == 0, done.text


@situation("files dated 1980, and the clock set back")
def _(copy):
    for path in copy.root.rglob("*"):
        if path.is_file() and not path.is_symlink():
            os.utime(path, (315532800, 315532800) if path.suffix == ".py" else (4e9, 4e9))
    assert "up to date" in copy.works(RUN)
    copy.works("pdf")
    copy.same_as_template()


@situation("a moved checkout does not use the old one's environment")
def _(copy):
    text = (copy.root / ".venv/complete").read_text()
    copy.write(".venv/complete", text.replace(str(copy.root), "/elsewhere"))
    copy.refuses("check", "PYTHON=/nowhere", names="PYTHON=/nowhere is not a Python")


# --- the machine --------------------------------------------------------------------------------


@situation("one CPU")
def _(copy):
    need("taskset", "-c", "0", "true", reason="taskset is missing")
    copy.before = ("taskset", "-c", "0")
    again(copy)


@situation("-j8")
def _(copy):
    again(copy, "-j8")


@situation("no /dev/shm")
def _(copy):
    need("unshare", "-m", "true", reason=UNSHARE)
    copy.before = ("unshare", "-m", "sh", "-c", 'mount -t tmpfs -o ro t /dev/shm; exec "$@"', "-")
    copy.body("import joblib; joblib.Parallel(2)(joblib.delayed(abs)(i) for i in range(4))")
    copy.works(RUN)


@situation("no network after set-up")
def _(copy):
    need("unshare", "-n", "ip", "link", "set", "lo", "up", reason=UNSHARE)
    copy.before = ("unshare", "-n", "sh", "-c", 'ip link set lo up; exec "$@"', "-")
    again(copy)


@situation("the printed digits, by GTSAM 4.2")
def _(copy):
    need("python3.11", "-c", "", reason="GTSAM 4.2 has no wheel for another Python")
    assert "(a misprint of 12)" in copy.works("original")


@situation("a full disk")
def _(copy):
    need("unshare", "-m", "true", reason=UNSHARE)
    full = (
        "mount -t tmpfs -o size=64k t build && mkdir build/cache && head -c 99k /dev/zero > build/x"
    )
    copy.before = ("unshare", "-m", "sh", "-c", f'({full}) 2> /dev/null; exec "$@"', "-")
    copy.refuses(RUN, names="cannot be written")
    small = "cp -a build .b && mount -t tmpfs -o size=700k t build && cp -a .b/. build/"
    fill = "head -c 9M /dev/zero > build/x; rm -rf .b; truncate -s -12000 build/x"
    copy.before = ("unshare", "-m", "sh", "-c", f'({small}; {fill}) 2> /dev/null; exec "$@"', "-")
    copy.edit(f"params/{NAME}.yaml", "seed: 0", "seed: 1")
    copy.refuses(RUN, names="No space left on device")


@situation("little memory")
def _(copy):
    copy.before = ("bash", "-c", 'ulimit -v 3000000; exec "$@"', "-")
    copy.body("import numpy; numpy.ones(10**10)")
    copy.refuses(RUN, names="MemoryError")


@situation("build/ is a link to another file system")
def _(copy):
    shutil.rmtree(copy.root / "build")
    target = Path("/dev/shm") / f"sngr-matrix-{os.getpid()}"
    if not os.access("/dev/shm", os.W_OK):
        raise Skip("no other file system here")
    target.mkdir()
    (copy.root / "build").symlink_to(target)
    try:
        copy.works(RUN)
        assert "up to date" in copy.works(RUN)
        copy.works("pdf")
        copy.same_as_template()
    finally:
        shutil.rmtree(target)


# --- what is cut off, and what meets ------------------------------------------------------------


def started(copy: Copy, *command: str) -> subprocess.Popen:
    """A command of the copy that is left running, in a group of its own."""
    return subprocess.Popen(
        command, cwd=copy.root, env=copy.env(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, start_new_session=True,
    )  # fmt: skip


@situation("a killed kernel")
def _(copy):
    copy.body("import os; os.kill(os.getpid(), 9)")
    copy.refuses(RUN, names="the kernel died")


@situation("a killed worker")
def _(copy):
    copy.body(
        "import joblib, os; joblib.Parallel(2)(joblib.delayed(os._exit)(3) for i in range(4))"
    )
    copy.refuses(RUN, names="Terminated")


@situation("a cell that fails")
def _(copy):
    copy.body("1 / 0")
    copy.refuses(RUN, names="ZeroDivisionError: division by zero")


@situation("a killed make, then again")
def _(copy):
    before = copy.good()
    copy.body("import time; time.sleep(3)")
    process = started(copy, "make", RUN)
    while "running" not in process.stdout.readline():
        pass
    time.sleep(1)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert copy.good() == before
    copy.works(RUN)


@situation("an interrupted make")
def _(copy):
    before = copy.good()
    copy.body("import time; time.sleep(60)")
    process = started(copy, "make", RUN)
    while "running" not in process.stdout.readline():
        pass
    time.sleep(1)
    os.killpg(process.pid, signal.SIGINT)
    text = process.communicate(timeout=30)[0]
    assert process.returncode != 0
    assert "published results are untouched" in text, text
    assert "Traceback" not in text, text
    assert copy.good() == before


@situation("two makes at once")
def _(copy):
    copy.edit(f"params/{NAME}.yaml", "seed: 0", "seed: 1")
    both = [started(copy, "make", RUN, "pdf") for _ in range(2)]
    shown = [process.communicate(timeout=120)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], shown
    assert sum(text.count(": running") for text in shown) == 1, shown
    assert "waiting" in "".join(shown), shown
    copy.works(RUN, "pdf")


@situation("half a run left by an earlier one")
def _(copy):
    shutil.rmtree(copy.root / "build/results")
    run = next((copy.root / "build/runs").iterdir())
    (run / f"{NAME}.json").write_text("{")
    (run.parent / "junk").mkdir()
    copy.works(RUN)
    copy.works("pdf")
    copy.same_as_template()


# --- the lock -----------------------------------------------------------------------------------


@situation("a tampered lock, with pip")
def _(copy):
    tampered(copy)


@situation("a tampered lock, with uv")
def _(copy):
    need("uv", "--version", reason="uv is not on the PATH")
    tampered(copy)


def tampered(copy: Copy) -> None:
    """The first package alone, with a hash that is not its own: refused, the old .venv kept."""
    text = (copy.root / "environment.lock").read_text()
    first = next(block for block in re.split(r"\n(?=\S)", text) if ";" not in block)
    copy.write("environment.lock", re.sub(r"sha256:[0-9a-f]{8}", "sha256:00000000", first) + "\n")
    copy.refuses("check", f"PYTHON={sys.executable}", names="environment.lock was not installed")
    assert not (copy.root / ".venv.before").exists()


@situation("a lock that is empty, missing or a folder")
def _(copy):
    lock = copy.root / "environment.lock"
    lock.unlink()
    done = copy.run("make", "check")
    assert done.status != 0
    assert "environment.lock" in done.text
    lock.mkdir()
    assert copy.run("make", "check").status != 0
    assert (copy.root / ".venv/complete").exists()
