"""Where a notebook and its cells are found: on the web if the repository has an address there."""

import re
import subprocess

from sngr_utils import paths
from sngr_utils.publish import notebooks
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.publish.parameters import read_yaml
from sngr_utils.publish.trace import handed_on

DOCUMENTS = ("paper/sngr.tex", "paper/supplement.tex")  # what shows the results
ADDRESS = "repository-code"  # of CITATION.cff, the one place that knows it: absent until there is


def repository() -> str:
    """The address of the repository without a slash at its end; "" while it has none.

    Raises
    ------
    ProjectError : CITATION.cff is missing or broken, or the address is none of the web
    """
    citation = read_yaml(paths.CITATION)
    if not isinstance(citation, dict):
        raise ProjectError("CITATION.cff must hold 'key: value' lines")
    address = citation.get(ADDRESS, "")
    if address and not re.fullmatch(r"https://[^\s{}\\%#]+", str(address)):
        raise ProjectError(f"CITATION.cff: {ADDRESS} is {address!r}: it must begin with https://")
    return str(address).rstrip("/")


def commit() -> str:
    """The commit that is checked out; "" in a copy without history, or in another's repository."""
    try:
        top, head = subprocess.run(
            ["git", "rev-parse", "--show-toplevel", "HEAD"],
            cwd=paths.ROOT, capture_output=True, text=True, check=True,
        ).stdout.splitlines()  # fmt: skip
    except (OSError, subprocess.CalledProcessError, ValueError):
        return ""
    return head if paths.ROOT.samefile(top) else ""


def notebook_address(name: str) -> str:
    """Of a notebook, pinned to the commit; its file beside the PDF while there is no address."""
    if repository() and commit():
        return f"{repository()}/blob/{commit()}/notebooks/{name}.ipynb"
    return f"../notebooks/{name}.ipynb"


def latex() -> str:
    """LaTeX: the address of each notebook, and for each table and figure a link to its cell.

    The mark is the cell's number, as "In [7]" shows it. On the web the link leads to the line of
    the file where the cell begins; a file beside the PDF is opened at its head.
    """
    lines = []
    for name in notebooks.names():
        address = notebook_address(name)
        lines.append(rf"\expandafter\def\csname notebook@{name}\endcsname{{{address}}}")
        for (kind, what), cell in handed_on(name).items():
            key = f"figure@{name}_{what}" if kind == "figure" else f"{kind}@{what}"
            line = rf"?plain=1\#L{cell.line}" if "://" in address else ""
            mark = rf"\href{{{address}{line}}}{{[{cell.number}]}}"
            lines.append(rf"\expandafter\def\csname cell@{key}\endcsname{{{mark}}}")
    return "\n".join(lines) + "\n"
