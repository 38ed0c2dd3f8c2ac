"""The online estimator with one of its constants at half and at twice its value."""

import ast
import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from sngr_utils import online
from sngr_utils.experiments import every_world
from sngr_utils.robust import diagnosis, mirrors, misfit, naming

FACTORS = (0.5, 2.0)
KINDS = (("circle", 0.3), ("reach 5 m", 0.3), ("slip 5 m", 0.3))
# Half or twice the odds, so that they stay probabilities
PROBABILITIES = (
    "RESOLVED", "ENOUGH_MASS", "LIKELY", "FEWEST_USED", "OPEN", "EXPLAINED", "POSSIBLE",
    "MOST_UNEXPLAINED",
)  # fmt: skip
FIXED = ("DROPPED", "FORBIDDEN")  # a name for no landmark, and what is beyond all odds
COMPILED = ("window",)  # whose numbers stand in compiled code, where a change is not noticed


def constants() -> list[tuple[str, str]]:
    """Module and name of every number that a module of the online estimator sets."""
    return [
        (name, constant)
        for name, module in _modules().items()
        if name not in COMPILED
        for constant in _set_by(module)
        if constant not in FIXED and isinstance(getattr(module, constant), (int, float))
    ]


def _set_by(module: ModuleType) -> list[str]:
    """Names in capitals that a module itself sets, alone or several in a line."""
    body = ast.parse(inspect.getsource(module)).body
    names = (part for node in body if isinstance(node, ast.Assign)
             for target in node.targets for part in ast.walk(target))  # fmt: skip
    return [part.id for part in names if isinstance(part, ast.Name) and part.id.isupper()]


def _modules() -> dict[str, ModuleType]:
    names = [info.name for info in pkgutil.iter_modules(online.__path__)]
    found = {name: importlib.import_module(f"{online.__name__}.{name}") for name in names}
    return found | {"diagnosis": diagnosis, "mirrors": mirrors, "misfit": misfit, "naming": naming}


def cells(seeds: range) -> list[tuple]:
    """Arguments of `rows`: every constant at every factor, and all as they are."""
    changes = [("", "", 1.0)]
    changes += [(*name, factor) for name in constants() for factor in FACTORS]
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
    modules = _modules()
    value = getattr(modules[module], name)
    users = [one for one in modules.values() if getattr(one, name, None) is value]
    for one in users:
        setattr(one, name, scaled(name, value, factor))
    try:
        yield
    finally:
        for one in users:
            setattr(one, name, value)


def scaled(name: str, value: float, factor: float) -> float:
    """A constant times a factor, whole if it was whole; of a probability, its odds."""
    if name in PROBABILITIES:
        odds = factor * value / (1 - value)
        return odds / (1 + odds)
    return type(value)(max(value * factor, 1) if isinstance(value, int) else value * factor)
