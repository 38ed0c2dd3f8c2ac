"""The one command line of the project: ``python -m sngr_utils COMMAND``.

The Makefile calls it. A command imports what it needs when it runs: a check of all parameters
should not wait for what executes notebooks.
"""

import argparse
import importlib
import logging
import re
import signal
import sys
import time
from collections.abc import Callable

from sngr_utils.publish.notebooks import ProjectError

UNTOUCHED = "interrupted: published results are untouched"
ENDS = (signal.SIGINT, signal.SIGTERM)  # signals that end a command
_interrupted = []  # times of signals: after one, any exception is a consequence of it


def _calls(module: str, name: str) -> Callable[[argparse.Namespace], int]:
    """The command that calls a function without arguments."""

    def work(args: argparse.Namespace) -> int:
        getattr(importlib.import_module(f"sngr_utils.{module}"), name)()
        return 0

    return work


def _each(args) -> int:
    from sngr_utils.publish import notebooks, run

    known = notebooks.names()
    for name in args.names:
        if name not in known:
            raise ProjectError(f"no notebook {name[:60]!r}: it must be one of {', '.join(known)}")
    work = {
        "notebook": run.run_notebook,
        "quick": run.run_quick,
        "aside": run.run_aside,
        "refresh": run.refresh,
    }
    for name in args.names:
        work[args.command](name)
    return 0


def _verify(args) -> int:
    from sngr_utils import paths
    from sngr_utils.publish import verified, verify

    if verify.compare(paths.BUILD / "verify"):
        return 1
    verified.remember()
    return 0


def _why(args) -> int:
    from sngr_utils.publish import why

    print(why.why(args.name))
    return 0


def _bench(args) -> int:
    from sngr_utils.cost import Config
    from sngr_utils.experiments import batch_bench
    from sngr_utils.publish import parameters
    from sngr_utils.show import cost

    config = Config(**parameters.read_params("04_cost"))
    cost.print_bench(config)
    batch_bench.print_all(config.chosen)
    return 0


def _study(args) -> int:
    from contextlib import nullcontext

    import joblib

    from sngr_utils.experiments import studies

    try:  # no such study, or what keeps its rows is spoiled
        kept = studies.status(args.name)
    except ValueError as error:
        raise ProjectError(error) from error
    if args.status:
        print("{} of {} cells are kept".format(*kept))
        return 0
    where = nullcontext()
    if args.scheduler:
        try:
            from distributed import Client

            where = Client(args.scheduler)
        except (ImportError, ValueError) as error:  # it is an extra; no address
            raise ProjectError(f"--scheduler {args.scheduler}: {error}") from error
    backend = "dask" if args.scheduler else "loky"
    with where, joblib.parallel_config(backend=backend, n_jobs=-1):
        print(f"written: {studies.run(args.name, args.jobs)}")
    return 0


def _original(args) -> int:
    from pathlib import Path

    from sngr_utils.publish import authors

    print(authors.check(authors.read(Path(args.file))))
    return 0


def _estimate(args) -> int:
    from pathlib import Path

    from sngr_utils import estimate_file

    try:
        estimate_file.run(Path(args.file), args.out and Path(args.out), args.overwrite)
    except ValueError as error:
        raise ProjectError(" ".join(str(error).split())) from error
    return 0


COMMANDS = {
    "check": (_calls("publish.run", "check"), "check all parameter files and the claims"),
    "stale": (_calls("publish.run", "print_stale"), "print the make targets that are out of date"),
    "latex": (_calls("publish.run", "write_latex"), "write paper/generated from fresh results"),
    "verify": (_verify, "compare the runs aside with the committed reference"),
    "adopt": (_calls("publish.verify", "adopt"), "make the published results the reference"),
    "compile": (
        _calls("experiments.warm_up", "compile_all"),
        "compile everything that is compiled, before processes share it",
    ),
    "bench": (_bench, "time the engines side by side, with their errors"),
    "notebook": (_each, "publish notebooks with their YAML unless their results are fresh"),
    "quick": (_each, "run notebooks with params/quick, into build/quick"),
    "aside": (_each, "run notebooks with their YAML, into build/verify"),
    "refresh": (_each, "store fresh outputs in committed notebooks"),
    "why": (_why, "trace a value, table or figure to the cell, parameters and code behind it"),
    "estimate": (_estimate, "estimate the log of a file, or of a folder of tables"),
    "original": (_original, "compare what make original computed with the printed digits"),
    "study": (_study, "make a study that stands outside make paper; takes up what is kept"),
}


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m sngr_utils", description=__doc__.splitlines()[0]
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (work, meaning) in COMMANDS.items():
        command = commands.add_parser(name, help=meaning)
        if work is _each:
            command.add_argument("names", nargs="+")
        if work is _estimate:
            command.add_argument("file", help=".pyfg, .fg, Plaza1, Plaza2 or a folder of tables")
            command.add_argument("--out", help="folder of what is written (default: the file's)")
            command.add_argument("--overwrite", action="store_true", help="replace what is there")
        if work is _original:
            command.add_argument("file", help="what sngr_utils.experiments.authors_digits wrote")
        if work in (_study, _why):
            command.add_argument("name")
        if work is _study:
            meaning = "workers (default: all cores, or dask's)"
            command.add_argument("--jobs", type=_workers, metavar="N", help=meaning)
            command.add_argument("--scheduler", help="address of a dask scheduler")
            command.add_argument("--status", action="store_true", help="only say how far it is")
    args = parser.parse_args(arguments)
    before = {number: signal.signal(number, _interrupt) for number in ENDS}
    try:
        return _status(COMMANDS[args.command][0], args)
    except BaseException:
        if not _interrupted:
            raise
        for number in ENDS:  # who presses again stops no farewell, nor the end after it
            before[number] = signal.SIG_IGN
            signal.signal(number, signal.SIG_IGN)
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # no traceback of the lost kernel
        print(UNTOUCHED, file=sys.stderr)
        return 130
    finally:  # what a caller forks later would not end when asked to
        for number, handler in before.items():
            signal.signal(number, handler)


def _status(work: Callable[[argparse.Namespace], int], args: argparse.Namespace) -> int:
    """What a command returns; 1 for what it refuses, said in one line."""
    try:
        return work(args)
    except (ProjectError, OSError, MemoryError, RuntimeError) as error:
        told = _told(error)
        if _interrupted or told is None:
            raise
        shown = (c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in told)
        print("error:", "".join(shown), file=sys.stderr)  # a name cannot command a terminal
        return 1


def _told(error: Exception) -> str | None:
    """What is said of a refusal; None for what is none."""
    if isinstance(error, ProjectError):
        return str(error)
    if isinstance(error, RuntimeError):  # numba's, as a module begins that compiles anything
        unkept = str(error).startswith("cannot cache function")
        return "build/cache: compiled code cannot be kept there" if unkept else None
    # the machine says no: a full disk, no permission
    return f"{_of_machine(error)}; published results are untouched"


def _workers(text: str) -> int:
    if not re.fullmatch("[1-9][0-9]{0,3}", text):
        raise argparse.ArgumentTypeError(f"{text[:20]!r} is no number of workers, 1 to 9999")
    return int(text)


def _of_machine(error: OSError | MemoryError) -> str:
    """ "build/results/x.json: No space left on device", or its kind where it says no more."""
    where = getattr(error, "filename", None)
    what = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return what if where is None else f"{where}: {what}"


def _interrupt(signum, frame):
    """Stop; what arrives in the second after it would only stop what cleans up."""
    now = time.monotonic()
    if not _interrupted or now - _interrupted[-1] > 1:
        _interrupted.append(now)
        raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
