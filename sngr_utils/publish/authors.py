"""What the original prints beside what its authors' conventions give, digit by digit.

`make original` writes ``paper/studies/authors_digits.json``; docs/original_code.md has conventions.
"""

import json
from collections import Counter
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

from sngr_utils import paths
from sngr_utils.publish import printed
from sngr_utils.publish.notebooks import ProjectError

EQUAL, TWICE, SAMPLED, UNEQUAL = "equal", "rounded twice", "in some draws", "unequal"
SAMPLED_KEYS = ("pose_rmse", "nees")  # of the table "sngr": what the sampler moves
# Unequal with a reason: TP + FP is 12 in that row, printed too.
MISPRINTS = {("per_seed_p0.3", "3", "triggered"): "a misprint of 12"}


def digits() -> Path:
    """Where the committed digits are."""
    return paths.PAPER / "studies" / "authors_digits.json"


def read(file: Path | None = None) -> dict:
    """What `make original` wrote, there or where it is committed.

    Raises
    ------
    ProjectError : nothing there
    """
    file = file or digits()
    if not file.exists():
        raise ProjectError(f"{file.name} is missing: make original")
    return json.loads(file.read_text())


def values(found: dict) -> dict[printed.Path, list[float | None]]:
    """Path of a printed number -> ours; several where the sampler, which had no seed, moves it."""
    ours = {tuple(key.split("/")): [value] for key, value in found["printed"].items()}
    for draw in found["draws"]:
        for name in SAMPLED_KEYS:
            path = ("sngr", str(draw["p"]), name)
            if "/".join(path) not in found["printed"]:
                ours.setdefault(path, []).append(draw[name])
    return ours


def compared(found: dict) -> dict[printed.Path, str]:
    """Path of a printed number -> whether ours rounds to it.

    "rounded twice": to three digits first, as the authors' notes have them, and those to two.
    """
    leaves = printed.leaves()
    return {path: _verdict(leaves[path], ours) for path, ours in values(found).items()}


def _verdict(was: printed.Printed, ours: list[float | None]) -> str:
    for verdict, places in ((EQUAL, ()), (TWICE, (3,))):
        hits = [_rounded(value, (*places, was.decimals)) == was.value for value in ours]
        if all(hits):
            return verdict
        if any(hits) or (len(ours) > 1 and min(ours) <= was.value <= max(ours)):
            return SAMPLED
    return UNEQUAL


def _rounded(value: float | None, places: tuple[int, ...]) -> float | None:
    """A number rounded as on paper, half up, once for each number of digits."""
    if value is None:
        return None
    exact = Decimal(repr(value))
    for n in places:
        exact = exact.quantize(Decimal(1).scaleb(-n), ROUND_HALF_UP)
    return float(exact)


def check(found: dict) -> str:
    """How many printed numbers come out, in a sentence; what a sampler moves may differ.

    Raises
    ------
    ProjectError : a digit differs without a reason; the message names each
    """
    verdicts, leaves = compared(found), printed.leaves()
    wrong = [
        f"{'/'.join(path)} is {values(found)[path][0]}, printed {leaves[path].value}"
        for path, verdict in verdicts.items()
        if verdict == UNEQUAL and path not in MISPRINTS and "/".join(path) in found["printed"]
    ]
    if wrong:
        raise ProjectError(f"{len(wrong)} printed numbers do not come out: {'; '.join(wrong)}")
    counts = Counter(verdicts.values())
    told = ", ".join(f"{counts[name]} {name}" for name in (EQUAL, TWICE, SAMPLED, UNEQUAL))
    return f"{len(verdicts)} printed numbers: {told} ({', '.join(MISPRINTS.values())})"
