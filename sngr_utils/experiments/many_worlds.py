"""One task, many worlds: results in the order of the worlds, whoever computes them, and when.

Each case is a task of its own that draws all it needs from its seed, so results are the same in
sequence, in threads, in processes or on a cluster (``joblib.parallel_config``), in any order. A
terminal is shown how many are left. Inside `row_store.kept_in` every result is kept as it comes,
and a case whose result is kept already is not run again.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice

import joblib
from tqdm import tqdm

from sngr_utils.experiments import row_store

CHUNK = 64  # cases between two looks at a backend that hands over all its results at once


def map_worlds(task: Callable, cases: Iterable[tuple], jobs: int | None = None) -> list:
    """``task(*case)`` of every case, in their order.

    Parameters
    ----------
    task : a function of a module, so that a worker finds it
    cases : arguments, e.g. scenario, conventions, p and seed
    jobs : workers; None leaves number and backend to ``joblib.parallel_config``
    """
    cases, store = list(cases), row_store.active()
    keys = [row_store.key_of(task, case) for case in cases] if store else []
    kept = {i: store.get(key) for i, key in enumerate(keys)}
    found = {i: row for i, row in kept.items() if row is not None}
    missing = [i for i in range(len(cases)) if i not in found]
    tasks = (joblib.delayed(_numbered)(i, task, cases[i]) for i in missing)
    # disable=None: no bar but on a terminal
    with tqdm(total=len(cases), initial=len(found), desc=task.__name__, disable=None) as bar:
        for i, result in _as_they_come(tasks, jobs):
            found[i] = store.put(keys[i], task, cases[i], result) if store else result
            bar.update()
    return [found[i] for i in range(len(cases))]


def map_rows(task: Callable, cases: Iterable[tuple], jobs: int | None = None) -> list:
    """The same where a task returns a list of rows: the rows of all cases as one list."""
    return list(chain.from_iterable(map_worlds(task, cases, jobs)))


def _numbered(i: int, task: Callable, case: tuple) -> tuple:
    return i, task(*case)


def _as_they_come(tasks: Iterator, jobs: int | None) -> Iterator[tuple]:
    """What the workers return, the first that is ready first."""
    backend, _ = joblib.parallel.get_active_backend()
    if backend.supports_return_generator:
        yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)
        return
    with joblib.Parallel(n_jobs=jobs) as parallel:
        while chunk := list(islice(tasks, CHUNK)):
            yield from parallel(chunk)
