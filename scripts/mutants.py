"""Break the library at random, one small change at a time: do its tests notice?

mutmut makes the mutants of the modules that pyproject.toml lists under [tool.mutants], and runs
for each those of their own tests that reach the changed function, in a copy of the checkout below
build/mutants. It changes what stands in functions and methods, but neither constants and defaults
outside of them nor decorated functions (properties, compiled code).

Usage: mutants.py [--sample N] [--seed S] [PATTERN ...]
"""

import argparse
import ast
import configparser
import fnmatch
import os
import random
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

from mutmut.mutation.data import SourceFileMutationData
from mutmut.mutation.diff_apply import get_diff_for_mutant
from mutmut.mutation.file_mutation import mutate_file_contents
from mutmut.stats import status_by_exit_code
from mutmut.utils.format_utils import get_mutant_name, orig_function_and_class_names_from_key

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "mutants"
OWN_TESTS = 2  # files of tests for each module
ENOUGH = 0.9  # share of the mutants that are to be caught, equivalent ones apart


def imported(path: Path) -> set[str]:
    """Modules of the library that a file imports, as paths."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    froms = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
    names = {node.module for node in froms}
    names |= {f"{node.module}.{name.name}" for node in froms for name in node.names}
    paths = {name.replace(".", "/") + ".py" for name in names}
    return {path for path in paths if (ROOT / path).is_file()}


def own_tests(modules: list[str], elsewhere: list[str]) -> list[str]:
    """Files of tests: of those that import a module, the two that import least besides.

    Those of the module's own room come first.

    elsewhere : patterns of tests that take long, or need more than a copy
    """
    files = [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob("tests/**/test_*.py"))]
    files = [name for name in files if not any(fnmatch.fnmatch(name, each) for each in elsewhere)]
    imports = {name: imported(ROOT / name) for name in files}
    chosen = set()
    for module in modules:
        room = Path(module).parent.name
        users = [
            (Path(name).parent.name != room, len(imports[name]), name)
            for name in files
            if module in imports[name]
        ]
        chosen.update(name for *_, name in sorted(users)[:OWN_TESTS])
    return sorted(chosen)


def prepare(modules: list[str], settings: dict) -> None:
    """The folder that mutmut works in, with its settings."""
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    tests = own_tests(modules, settings["elsewhere"])
    for name in ("sngr_utils", *settings["copied"]):
        (WORK / name).symlink_to(ROOT / name)  # mutmut copies what it finds
    options = {
        "source_paths": ["sngr_utils"],
        "only_mutate": modules,
        "also_copy": settings["copied"],
        "pytest_add_cli_args": settings["pytest"],
        "pytest_add_cli_args_test_selection": tests,
        "timeout_constant": "6",  # seconds, times 15: a loaded machine is not a hanging mutant
    }
    config = configparser.ConfigParser()
    config["mutmut"] = {
        key: value if isinstance(value, str) else "\n" + "\n".join(value)
        for key, value in options.items()
    }
    with (WORK / "setup.cfg").open("w", encoding="utf-8") as file:
        config.write(file)


def mutants_of(module: str) -> list[str]:
    """Names of all mutants of a module."""
    source = (ROOT / module).read_text(encoding="utf-8")
    names = mutate_file_contents(module, source).mutant_names
    return [get_mutant_name(Path(module), name) for name in names]


def describe(name: str, module: str) -> tuple[dict[str, str], str]:
    """Function, text before and after of a mutant, and FILE:LINE."""
    diff = get_diff_for_mutant(name, path=module).split("\n")[2:]
    was, becomes = (
        " ".join(line[1:].strip() for line in diff if line.startswith(sign)) for sign in "-+"
    )
    function, class_name = orig_function_and_class_names_from_key(name)
    lines = (ROOT / module).read_text(encoding="utf-8").split("\n")
    begin = next(i for i, line in enumerate(lines) if re.match(rf"\s*def {function}\(", line))
    first = next(line[1:].strip() for line in diff if line.startswith("-"))
    at = next(i for i, line in enumerate(lines[begin:], begin + 1) if line.strip() == first)
    qualified = f"{class_name}.{function}" if class_name else function
    return {"function": qualified, "was": was, "becomes": becomes}, f"{module}:{at}"


def chosen(patterns: list[list[str]]) -> list[str]:
    """Modules of the library that match a pattern of each list, as paths."""
    files = [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob("sngr_utils/**/*.py"))]
    return [
        name
        for name in files
        if all(any(fnmatch.fnmatch(name, each) for each in some) for some in patterns)
    ]


def main() -> int:
    """Make, run and report; 0 if enough are caught."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sample", type=int, default=0, help="how many; all if not given")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("patterns", nargs="*", default=["*"], help="modules; all if not given")
    asked = parser.parse_args()
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mutants"]
    known = tomllib.loads((ROOT / settings["equivalent"]).read_text())["mutant"]
    modules = chosen([settings["modules"], asked.patterns])
    prepare(modules, settings)
    os.chdir(WORK)
    module_of = {name: module for module in modules for name in mutants_of(module)}
    names = sorted(module_of)
    if 0 < asked.sample < len(names):
        names = random.Random(asked.seed).sample(names, asked.sample)
    of = f"{len(names)} of {len(module_of)} mutants of {len(modules)} modules, seed {asked.seed}"
    print(of, flush=True)
    shown = None if sys.stdout.isatty() else subprocess.PIPE  # it draws as for a terminal
    mutmut = Path(sys.executable).with_name("mutmut")
    done = subprocess.run([mutmut, "run", *names], stdout=shown, text=True)
    if done.returncode != 0:
        said = (done.stdout or "").rsplit("\r", 1)[-1]
        said += f"error: mutmut ended with {done.returncode}: do the tests pass without a mutant?"
        sys.exit(said)
    return report(names, module_of, known)


def report(names: list[str], module_of: dict[str, str], known: list[dict]) -> int:
    """Print what was caught, module by module, and what was not; 0 if it is enough."""
    same = [{key: each[key] for key in ("function", "was", "becomes")} for each in known]
    tally, survivors = {module: Counter() for module in module_of.values()}, []
    for module, count in tally.items():
        data = SourceFileMutationData(path=module)
        data.load()
        for name in sorted(set(names) & set(data.exit_code_by_key)):
            status = status_by_exit_code[data.exit_code_by_key[name]]
            if status not in ("survived", "no tests"):
                count["caught"] += 1
                continue
            change, place = describe(name, module)
            count["equivalent" if change in same else "survived"] += 1
            if change not in same:
                survivors.append((place, change))
    for place, change in survivors:
        print(f"\n{place} {change['function']}\n  - {change['was']}\n  + {change['becomes']}")
    print(f"\n{'module':40}  caught  survived  equivalent")
    total = sum(tally.values(), Counter())
    for name, count in [*tally.items(), ("all", total)]:
        print(f"{name:40}{count['caught']:8}{count['survived']:10}{count['equivalent']:12}")
    share = total["caught"] / max(1, total["caught"] + total["survived"])
    print(f"\n{share:.1%} of the mutants that change something were caught; {ENOUGH:.0%} is asked")
    return int(share < ENOUGH)


if __name__ == "__main__":
    sys.exit(main())
