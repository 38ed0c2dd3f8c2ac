"""The library's docstrings as pages, read from its sources without running any of them.

A docstring that names an equation of the paper shows it, as it stands in paper/sngr.tex.
"""

import ast
import itertools
import re
import textwrap
from pathlib import Path

from sngr_utils import paths

NAMED = re.compile(r'paper eq\. "(\w+)"')
ENTRY = re.compile(r"^(\S.*?) : (.*)$")
DEFINITIONS = (ast.FunctionDef, ast.ClassDef)


def pages() -> dict[str, str]:
    """Name -> text of each page: one for each folder, one for the modules at the door."""
    modules: dict[str, list[str]] = {}
    for path in sorted(paths.PACKAGE.rglob("*.py")):
        parts = path.relative_to(paths.ROOT).with_suffix("").parts
        if parts[-1] != "__main__":
            page = ".".join(parts[:2]) if len(parts) > 2 else parts[0]
            modules.setdefault(page, []).append(module(path, dotted(path), dotted(path) == page))
    return {
        name: "\n".join(sorted(texts, key=lambda text: f"\n{'=' * len(name)}\n" not in text))
        for name, texts in modules.items()
    }


def dotted(path: Path) -> str:
    """A module's name, for instance sngr_utils.slam.isam2."""
    parts = path.relative_to(paths.ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def module(path: Path, name: str, heads_page: bool) -> str:
    """What a module says of itself, and its public functions and classes."""
    tree = Qualified(name).visit(ast.parse(path.read_text(encoding="utf-8")))
    underline = ("=" if heads_page else "-") * len(name)
    text = [name, underline, "", f".. py:module:: {name}", "", *docstring(tree), ""]
    return "\n".join(text + members(tree, "function"))


class Qualified(ast.NodeTransformer):
    """Gives the names of a module's annotations in full, so that links find what is meant."""

    def __init__(self, module_name: str):
        self.module_name, self.known = module_name, {}

    def visit_Module(self, node: ast.Module) -> ast.Module:
        for line in node.body:
            if isinstance(line, DEFINITIONS):
                self.known[line.name] = f"{self.module_name}.{line.name}"
            elif isinstance(line, ast.Assign) and isinstance(line.targets[0], ast.Name):
                name = line.targets[0].id
                self.known[name] = f"{self.module_name}.{name}"
        for line in ast.walk(node):
            if isinstance(line, ast.ImportFrom) and line.module.startswith("sngr_utils"):
                for each in line.names:
                    self.known[each.asname or each.name] = f"{line.module}.{each.name}"
        return self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.Name:
        constant = node.id.isupper()  # a default value, not an annotation
        return node if constant else ast.Name(self.known.get(node.id, node.id))


def members(parent: ast.AST, kind: str) -> list[str]:
    """The public definitions in a module or class that have a docstring."""
    text = []
    for node in parent.body:
        if isinstance(node, DEFINITIONS) and node.name[0] != "_" and ast.get_docstring(node):
            text += definition(node, kind)
    return text


def definition(node: ast.FunctionDef | ast.ClassDef, kind: str) -> list[str]:
    """A signature and what stands below it."""
    if isinstance(node, ast.ClassDef):
        bases = ", ".join(map(ast.unparse, node.bases))
        head = f"class:: {node.name}" + (f"({bases})" if bases else "")
        inner = members(node, "method")
    else:
        marks = {ast.unparse(mark).split(".")[-1] for mark in node.decorator_list}
        if marks & {"property", "cached_property"}:
            head = f"property:: {node.name}"
        else:
            returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
            head = f"{kind}:: {node.name}({ast.unparse(node.args)}){returns}"
        inner = []
    below = "\n".join(["", *docstring(node), "", *inner])
    return [f".. py:{head}", textwrap.indent(below, "   "), ""]


def docstring(node: ast.AST) -> list[str]:
    """A docstring as reStructuredText, the equations that it names below its first paragraph."""
    told = ast.get_docstring(node) or ""
    lines = told.split("\n")
    end = lines.index("") if "" in lines else len(lines)
    shown = [f"\n.. math:: {equation(label)}\n" for label in NAMED.findall(told)]
    return [*sections(lines[:end]), *shown, *sections(lines[end:])]


def sections(lines: list[str]) -> list[str]:
    """Underlined heads become bold, and entries "name : meaning" a list of definitions."""
    text: list[str] = []
    for line, below in itertools.pairwise([*lines, ""]):
        entry = ENTRY.match(line)
        if re.fullmatch("-{3,}", below):
            text += [f"**{line}**", ""]
        elif entry:
            text += ["", f"``{entry[1]}``", f"    {entry[2]}"]
        elif not re.fullmatch("-{3,}", line):
            text.append(line)
    return text


def equation(label: str) -> str:
    r"""The TeX of the line of paper/sngr.tex that ends with \label{eq:...}, without alignment."""
    text = (paths.PAPER / "sngr.tex").read_text(encoding="utf-8")
    line = re.search(rf"^ *(.*?)[,.]? *\\label\{{eq:{label}\}}", text, re.M)
    return line[1].replace("&", "")
