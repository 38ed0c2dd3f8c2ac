"""Results that survive: one row for each case of a study, kept as soon as it is known.

A row is found again by the code that made it, the task and its arguments, so that an edit of any
module behind the task starts anew, and two studies that ask the same of a world share the answer.
SQLite commits every row by itself: a kill at any moment loses what was being computed and nothing
else, several runs may write, and anyone may read meanwhile.
"""

import ast
import dataclasses
import functools
import hashlib
import io
import json
import sqlite3
import sys
import tokenize
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from contextvars import ContextVar
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from sngr_utils import paths

DEFAULT = paths.BUILD / "studies" / "rows.sqlite"
TABLE = "CREATE TABLE IF NOT EXISTS rows (key TEXT PRIMARY KEY, task TEXT, given TEXT, row TEXT)"

_active: ContextVar["RowStore | None"] = ContextVar("row_store", default=None)


class RowStore:
    """Rows by key, in a file of SQLite."""

    def __init__(self, connection: sqlite3.Connection):
        self.connection = connection

    def get(self, key: str):
        """The row of a key; None if there is none."""
        query = "SELECT row FROM rows WHERE key = ?"
        found = self.connection.execute(query, (key,)).fetchone()
        return found and json.loads(found[0])

    def put(self, key: str, task: Callable, case: tuple, row):
        """Keep a row, and return it as a later run will find it.

        Raises
        ------
        ValueError : a row that is not made of lists, dicts, numbers and strings
        """
        text = text_of(row, f"a row of {_name(task)}")
        values = key, _name(task), text_of(case, "a case"), text
        with self.connection:
            self.connection.execute("INSERT OR REPLACE INTO rows VALUES (?, ?, ?, ?)", values)
        return json.loads(text)


@contextmanager
def kept_in(path: Path = DEFAULT) -> Iterator[RowStore]:
    """Inside, `many_worlds.map_worlds` looks here before it computes, and keeps what it computes.

    Raises
    ------
    ValueError : a file that is no store
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with closing(sqlite3.connect(path, timeout=60)) as connection:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = NORMAL")  # a power cut may take the last rows
            connection.execute(TABLE)
        except sqlite3.DatabaseError as error:
            raise ValueError(f"{path} is no store of rows ({error}): remove it") from error
        store = RowStore(connection)
        token = _active.set(store)
        try:
            yield store
        finally:
            _active.reset(token)


def active() -> RowStore | None:
    """The store that `kept_in` has opened, if any."""
    return _active.get()


def key_of(task: Callable, case: tuple) -> str:
    """Hash of the code behind a task, its name and its arguments."""
    return _hash(code_of(task), _name(task), text_of(case, f"a case of {_name(task)}"))


def code_of(task: Callable) -> str:
    """Hash of the module of a task, all modules of the package behind it, and the lock file.

    Of the modules their code counts: docstrings, comments and blank lines do not.
    """
    return _code_of(task.__module__)


@functools.cache
def _code_of(module: str) -> str:
    files = [Path(sys.modules[module].__file__)]
    if module.startswith(f"{paths.PACKAGE.name}."):
        # reads every module of the package, a second that only a study pays
        from sngr_utils.publish.dependencies import imported_files

        files = imported_files(module, [f"import {module}"])
    return _hash(*(_code_in(path.read_text()) for path in files), paths.LOCK.read_text())


def _code_in(text: str) -> str:
    """The text of a module without what says nothing to Python, the same in all its versions."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            told = node.body[0]
            for row in range(told.lineno, told.end_lineno + 1):
                lines[row - 1] = ""
    return "\n".join(line.rstrip() for line in lines if line.strip())


def _name(task: Callable) -> str:
    return f"{task.__module__}.{task.__qualname__}"


def _hash(*texts: str) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:32]


def text_of(value, what: str) -> str:
    """JSON of a value, to the last bit of its numbers; the same for a list and a tuple.

    Raises
    ------
    ValueError : `what` is not made of lists, dicts, parameter sets, numbers and strings
    """
    try:
        return json.dumps(value, default=_plain, separators=(",", ":"))
    except TypeError as error:
        raise ValueError(f"{what} cannot be kept: {error}") from error


def _plain(value):
    """What JSON has for parameter sets, NumPy's numbers and ranges.

    Raises
    ------
    TypeError : anything else
    """
    if isinstance(value, BaseModel):
        return {"": type(value).__name__, **dict(value)}
    if dataclasses.is_dataclass(value):
        fields = dataclasses.fields(value)
        return {"": type(value).__name__, **{f.name: getattr(value, f.name) for f in fields}}
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, range):
        return list(value)
    raise TypeError(f"{type(value).__name__} is not made of numbers and strings")
