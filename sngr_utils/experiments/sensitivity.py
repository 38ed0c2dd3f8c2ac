"""The online estimator with one of its constants at half and at twice its value."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from sngr_utils.experiments import every_world

ONLINE = "sngr_utils.online"
CONSTANTS = [  # module and name
    ("belief", "WINDOW"), ("belief", "LOOSE"), ("data_association", "GATE"),
    ("data_association", "VAGUE"), ("data_association", "IMPOSSIBLE"), ("estimator", "PATIENCE"),
    ("estimator", "MOST_LOST"), ("estimator", "BETTER"), ("landmarks", "LONG"),
    ("landmarks", "DECIDED"), ("landmarks", "LIKELY"), ("landmarks", "FEWEST_USED"),
    ("landmarks", "YOUNG"), ("localisation", "START_APART"), ("slips", "SLIP_ODDS"),
    ("slips", "FAR"), ("slips", "RECENT"), ("slips", "STEP_LIMIT"),
]  # fmt: skip
FACTORS = (0.5, 2.0)
KINDS = (("circle", 0.3), ("reach 4 m", 0.3), ("slip 5 m", 0.3))


def cells(seeds: range) -> list[tuple]:
    """Arguments of `rows`: every constant at every factor, and all as they are."""
    changes = [("", "", 1.0)]
    changes += [(*name, factor) for name in CONSTANTS for factor in FACTORS]
    return [(*change, *kind, seed) for change in changes for kind in KINDS for seed in seeds]


def rows(module: str, name: str, factor: float, kind: str, p: float, seed: int) -> list[dict]:
    """One world with one constant changed: the ratios to the oracle's errors."""
    with _changed(module, name, factor):
        (row,) = every_world.rows(kind, "C", p, seed)
    kept = {key: row[key] for key in ("kind", "p", "seed", "final", "filtered", "doubtful")}
    return [{"constant": f"{module}.{name}" if module else "", "factor": factor, **kept}]


@contextmanager
def _changed(module: str, name: str, factor: float) -> Iterator[None]:
    """A constant of a module of the online estimator times a factor, whole if it was whole."""
    if not module:
        yield
        return
    modules = [import_module(f"{ONLINE}.{other}") for other in {first for first, _ in CONSTANTS}]
    value = getattr(import_module(f"{ONLINE}.{module}"), name)
    users = [one for one in modules if getattr(one, name, None) is value]
    for one in users:
        setattr(one, name, type(value)(value * factor))
    try:
        yield
    finally:
        for one in users:
            setattr(one, name, value)
