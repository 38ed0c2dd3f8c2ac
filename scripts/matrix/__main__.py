"""Try the project in many situations: ``python scripts/matrix [--strict] [PARTS OF NAMES]``.

Prints tried, clean and skipped, with the reason. Fails on a situation that is not clean and, if
strict, on a skip that `MAY_SKIP` does not name. With `--minutes` the short ones come first, none is
begun after so long, and those that were not tried are named with the day when each last was clean.
That day, and the seconds, stand in ``clean.json``, which runs without `--minutes` write.
"""

import argparse
import datetime
import json
import math
import shutil
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import archives
import copies
import files
import machines
import texts

# what a machine of continuous integration may lack
MAY_SKIP = {
    "a full disk",
    "a tampered lock, with uv",
    "no /dev/shm",
    "no network after set-up",
    *archives.OTHER_PYTHONS,
    "the printed digits, by GTSAM 4.2",
}
CLEAN = Path(__file__).with_name("clean.json")  # name -> day, and seconds, when last clean
SITUATIONS = {**machines.SITUATIONS, **texts.SITUATIONS, **files.SITUATIONS, **archives.SITUATIONS}


def attempt(name: str, until: float) -> tuple[str, str, str, float]:
    """(verdict, name, why, seconds) of a situation; its copy is removed if clean."""
    started, folder = time.perf_counter(), f"{list(SITUATIONS).index(name):02d}"
    if started > until:
        return "not tried", name, f"no time was left; last clean {remembered(name)['day']}", 0.0
    verdict, why = "clean", ""
    try:
        copy = copies.fresh(folder)
        SITUATIONS[name](copy)
        shutil.rmtree(copy.root, ignore_errors=True)
    except copies.Skip as reason:
        verdict, why = "skipped", str(reason)
    except Exception as error:
        verdict, why = "UNCLEAN", f"{type(error).__name__}: {error} (see build/matrix/{folder})"
    took = time.perf_counter() - started
    return verdict, name, why or f"{took:.0f} s", took


def remembered(name: str) -> dict:
    """The day on which a situation was last clean, and its seconds."""
    return json.loads(CLEAN.read_text()).get(name, {"day": "never", "seconds": 60})


def remember(found: list[tuple[str, str, str, float]]) -> None:
    """Write down what was clean today, and forget what is no situation any more."""
    today = datetime.date.today().isoformat()
    known = {name: of for name, of in json.loads(CLEAN.read_text()).items() if name in SITUATIONS}
    for verdict, name, _, took in found:
        if verdict == "clean":
            known[name] = {"day": today, "seconds": round(took)}
    CLEAN.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


def main() -> int:
    """Try them all, two at a time; the exit status."""
    parser = argparse.ArgumentParser(prog="matrix", description=__doc__)
    parser.add_argument("--strict", action="store_true", help="fail on a skip that is not named")
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin none after so long")
    parser.add_argument("parts", nargs="*", default=[""], help="only names that contain one")
    args = parser.parse_args()
    until = time.perf_counter() + 60 * args.minutes
    copies.make_template()
    chosen = [name for name in SITUATIONS if any(part in name for part in args.parts)]
    if args.minutes < math.inf:
        chosen.sort(key=lambda name: remembered(name)["seconds"])
    found = []
    with ThreadPoolExecutor(2) as pool:
        for one in pool.map(partial(attempt, until=until), chosen):
            print(f"{one[0]:9} {one[1]}: {one[2]}", flush=True)
            found.append(one)
    if args.minutes == math.inf:
        remember(found)
    counts = Counter(verdict for verdict, *_ in found)
    told = ", ".join(f"{counts[kind]} {kind}" for kind in ("clean", "skipped", "UNCLEAN"))
    print(f"tried {len(found) - counts['not tried']} of {len(found)}: {told}")
    skipped = {name for verdict, name, *_ in found if verdict == "skipped"}
    if args.strict and (unnamed := sorted(skipped - MAY_SKIP)):
        print(f"error: skipped, and not named in MAY_SKIP: {', '.join(unnamed)}", file=sys.stderr)
        return 1
    return 1 if counts["UNCLEAN"] else 0


if __name__ == "__main__":
    sys.exit(main())
