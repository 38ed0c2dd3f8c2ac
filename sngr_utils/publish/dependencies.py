"""The files of the package that a notebook's code depends on.

`grimp`, the engine of import-linter, reads which module imports which. It leaves out what it
cannot find, so what a notebook imports, and that no file is overlooked, is checked here.
"""

import ast
from pathlib import Path

import grimp

from sngr_utils import paths
from sngr_utils.publish.notebooks import ProjectError

NAME = paths.PACKAGE.name


def imported_files(notebook: str, cells: list[str]) -> list[Path]:
    """Files that the code cells of a notebook import, directly or not, sorted.

    The ``__init__.py`` of each package on the way is among them, as Python runs it.

    Raises
    ------
    ProjectError : a cell that is no Python, or imports a module that the package does not have
    """
    graph = import_graph()
    found: set[str] = set()
    queue = [module for cell in cells for module in _imports(notebook, cell, graph)]
    while queue:
        module = queue.pop()
        if module not in found:
            found.add(module)
            queue.extend(graph.find_modules_directly_imported_by(module))
            if module != NAME:
                queue.append(module.rpartition(".")[0])
    return sorted(_file(module) for module in found)


def import_graph() -> grimp.ImportGraph:
    """Which module of the package imports which, as the files are now.

    Raises
    ------
    ProjectError : a Python file whose folder has no ``__init__.py``, which would go unnoticed
    """
    graph = grimp.build_graph(NAME, cache_dir=None)
    seen = {_file(module) for module in graph.modules}
    for path in sorted(paths.PACKAGE.rglob("*.py")):
        in_folder = path.parent.relative_to(paths.ROOT).parts
        if path not in seen and all(part.isidentifier() for part in in_folder):
            where = path.relative_to(paths.ROOT).as_posix()
            raise ProjectError(f"{where} is in no package: its folder has no __init__.py")
    return graph


def _imports(notebook: str, cell: str, graph: grimp.ImportGraph) -> list[str]:
    """Modules of the package that a cell imports itself."""
    where = f"notebooks/{notebook}.ipynb"
    try:
        nodes = list(ast.walk(ast.parse(cell)))
    except SyntaxError as error:
        raise ProjectError(f"{where}: a cell is not plain Python: {error}: {error.text}") from error
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return [_module(where, name, graph) for name in names if name.split(".")[0] == NAME]


def _module(where: str, name: str, graph: grimp.ImportGraph) -> str:
    """The module that an imported name is or, unless a package holds it, is defined in."""
    parent = name.rpartition(".")[0]
    if name in graph.modules:
        return name
    if parent in graph.modules and _file(parent).name != "__init__.py":
        return parent
    raise ProjectError(f"{where} imports {name}, which is not in {NAME}/")


def _file(module: str) -> Path:
    path = paths.ROOT.joinpath(*module.split("."))
    package = path / "__init__.py"
    return package if package.exists() else path.with_suffix(".py")
