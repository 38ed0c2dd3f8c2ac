"""Try the project in many situations: ``python scripts/matrix [--strict] [PART OF A NAME]``.

Prints tried, clean and skipped, with the reason. Fails on a situation that is not clean and, if
strict, on a skip that `MAY_SKIP` does not name. With `--minutes` none is begun after so long, and
those that were not tried are named.
"""

import argparse
import math
import shutil
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import partial

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
    "the printed digits, by GTSAM 4.2",
}
SITUATIONS = {**machines.SITUATIONS, **texts.SITUATIONS, **files.SITUATIONS, **archives.SITUATIONS}


def attempt(name: str, until: float) -> tuple[str, str, str]:
    """(verdict, name, why) of a situation, in a copy of its own that is removed if clean."""
    started, folder = time.perf_counter(), f"{list(SITUATIONS).index(name):02d}"
    if started > until:
        return "not tried", name, "no time was left"
    try:
        copy = copies.fresh(folder)
        SITUATIONS[name](copy)
    except copies.Skip as reason:
        return "skipped", name, str(reason)
    except Exception as error:
        return "UNCLEAN", name, f"{type(error).__name__}: {error} (see build/matrix/{folder})"
    shutil.rmtree(copy.root, ignore_errors=True)
    return "clean", name, f"{time.perf_counter() - started:.0f} s"


def main() -> int:
    """Try them all, two at a time; the exit status."""
    parser = argparse.ArgumentParser(prog="matrix", description=__doc__)
    parser.add_argument("--strict", action="store_true", help="fail on a skip that is not named")
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin none after so long")
    parser.add_argument("part", nargs="?", default="", help="only names that contain this")
    args = parser.parse_args()
    until = time.perf_counter() + 60 * args.minutes
    copies.make_template()
    chosen = [name for name in SITUATIONS if args.part in name]
    found = []
    with ThreadPoolExecutor(2) as pool:
        for verdict, name, why in pool.map(partial(attempt, until=until), chosen):
            print(f"{verdict:9} {name}: {why}", flush=True)
            found.append((verdict, name))
    counts = Counter(verdict for verdict, _ in found)
    told = ", ".join(f"{counts[kind]} {kind}" for kind in ("clean", "skipped", "UNCLEAN"))
    tried = len(found) - counts["not tried"]
    print(f"tried {tried} of {len(found)}: {told}")
    unnamed = [name for verdict, name in found if verdict == "skipped" and name not in MAY_SKIP]
    if args.strict and unnamed:
        print(f"error: skipped, and not named in MAY_SKIP: {', '.join(unnamed)}", file=sys.stderr)
        return 1
    return 1 if counts["UNCLEAN"] else 0


if __name__ == "__main__":
    sys.exit(main())
