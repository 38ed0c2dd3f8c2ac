"""The paper's claims under its authors' own conventions, over the worlds of a committed study.

The verdicts elsewhere are about our readings; these say which of them hang on those.
"""

import json
from functools import cache

import numpy as np
import pandas as pd

from sngr_utils import paths
from sngr_utils.metrics import cluster_bootstrap
from sngr_utils.metrics.cluster_bootstrap import Interval
from sngr_utils.publish import authors, claims, rules
from sngr_utils.publish.notebooks import ProjectError

SEED = 7300
WINDOWS = 28  # of a world, all of which an exhaustive run refines


@cache
def rows() -> pd.DataFrame:
    """One row for each world and p, see `experiments.authors_over_worlds`.

    Raises
    ------
    ProjectError : the study is not there
    """
    file = paths.PAPER / "studies" / "authors_conventions.json"
    if not file.exists():
        raise ProjectError(f"{file.name} is missing: make study/authors_conventions")
    cells = json.loads(file.read_text())["rows"]
    return pd.DataFrame([row for cell in cells for row in cell]).astype(float)


def levels() -> list[float]:
    """The p that the study has, from the least on."""
    return sorted(rows()["p"].unique().tolist())


def at(p: float) -> pd.DataFrame:
    """The worlds at one p, by their seeds."""
    return rows()[rows()["p"] == p].set_index("seed")


def measures(p: float) -> dict[str, Interval]:
    """What the trigger says at one p, with 95 % intervals over worlds.

    base_rate : share of the windows that may fire that failed
    base_there : the same in the worlds where it fires, each counted as often as it fires there
    gain : of the precision over that
    auc : of the score within worlds
    """
    world, rng = at(p), np.random.default_rng([SEED, round(100 * p)])
    chance = world["fired"] * world["failed"] / world["windows"]
    parts = {
        "silent": (world["fired"] == 0, np.ones(len(world))),
        "base_rate": (world["failed"], world["windows"]),
        "precision": (world["hits"], world["fired"]),
        "base_there": (chance, world["fired"]),
        "gain": (world["hits"] - chance, world["fired"]),
        "recall": (world["hits"], world["failed"]),
        "auc": (world["won"], world["pairs"]),
    }
    return {
        name: cluster_bootstrap.ratio(np.array(above, float), np.array(below, float), rng=rng)
        for name, (above, below) in parts.items()
    }


def holds() -> dict[str, np.ndarray]:
    """Claim in words -> (n,) bool, the worlds that can answer, as ``claims.yaml`` asks them.

    What a single window gains is that of its most probable place, since that is its mean.
    """
    level = {p: at(p) for p in levels()}
    clean, least, some, noisy, most = level.values()
    doubtful = [least, some, noisy]
    precise = pd.DataFrame({p: at(p)["hits"] / at(p)["fired"] for p in (0.2, 0.3, 0.4)})
    fires = some[some["refined"] > 0]
    mixed = noisy[(noisy["fired"] > 0) & noisy["failed"].between(1, noisy["windows"] - 1)]
    changed = {name: pd.DataFrame({i: world[f"refined_{name}"] / world[name] - 1
                                   for i, world in enumerate((some, noisy))}).abs()
               for name in ("rmse", "nees")}  # fmt: skip
    saved = pd.DataFrame({i: WINDOWS / world["refined"].clip(lower=1)
                          for i, world in enumerate((clean, *doubtful))})  # fmt: skip
    found = {
        "inconsistent": most["nees"] > clean["nees"],
        "rmse-grows": most["rmse"] > clean["rmse"],
        "no-false-alarm": clean["fired_clean"] == 0,
        "blind-spot": least["hits"][least["failed"] > 0] == 0,
        "same-scores": (least["score"] - clean["score"]).abs() <= 0.04,
        "displacements-cancel": least["rmse"] / clean["rmse"] <= 2,
        "precision-one": (precise.dropna(how="all").fillna(1) == 1).all(axis=1),
        "precision-informs": mixed["hits"] / mixed["fired"] > mixed["failed"] / mixed["windows"],
        "gains-nat": fires["gain_min"] >= 1,
        "gains-floor": fires["gain_min"] > 0.2,
        "rmse-unchanged": (changed["rmse"] <= 0.05).all(axis=1),
        "nees-unchanged": (changed["nees"] <= 0.05).all(axis=1),
        "landmarks-bad": pd.DataFrame([w["landmark_rmse"] > 1 for w in doubtful]).all(axis=0),
        "saves": (saved >= 1.35).all(axis=1),
        "moderate-saving": WINDOWS / fires["refined"] >= 7.55,
    }
    return {name: np.asarray(each, dtype=bool) for name, each in found.items()}


def told() -> dict[str, str]:
    """Claim of ``claims.yaml`` -> what the authors' conventions make of it, in a few words.

    Of a printed number: how many of its digits come out. Of a claim in words: the worlds where it
    holds, and the verdict by the rule that judges it under our readings too.
    """
    verdicts, found = authors.compared(authors.read()), {}
    for entry in claims.read().numbers:
        known = [verdicts[path] for path in entry.leaves() if path in verdicts]
        if known:
            come_out = sum(verdict in (authors.EQUAL, authors.TWICE) for verdict in known)
            found[entry.id] = f"{come_out} of {len(known)} digits"
    for name, (each, verdict) in _judged().items():
        found[name] = f"{int(each.sum())} of {len(each)}: {verdict}"
    return found


def _judged() -> dict[str, tuple[np.ndarray, str]]:
    """Claim in words -> the worlds where it holds, see `holds`, and the verdict."""
    shares = {entry.id: entry.share for entry in claims.read().prose}
    return {name: (each, rules.share(each, shares[name])) for name, each in holds().items()}


def sentence() -> str:
    """The digits and the claims in words that hold, for the README."""
    digits = list(authors.compared(authors.read()).values())
    words = [verdict for _, verdict in _judged().values()]
    equal, twice, drawn = map(digits.count, (authors.EQUAL, authors.TWICE, authors.SAMPLED))
    held = words.count(rules.REPRODUCED), words.count(rules.TREND), len(words)
    return (
        f"Under its authors' own conventions {equal} of {len(digits)} numbers printed of the "
        f"trigger and of SNGR come out to\nthe last digit, {twice} more were rounded twice, and "
        f"{drawn} lie among twenty runs of a sampler that had no seed. "
        "Over\na hundred worlds {} (+ {}) of {} claims in words hold.".format(*held)
    )
