"""Write the student edition: the notebooks without their solutions, into build/student.

Cells tagged "solution" go, and so does what is folded into <details>. All else stays with its
stored outputs, so that nothing is executed. Paths in links and in the parameters cell are
rewritten for the other folder.
"""

import argparse
import re
import sys
from pathlib import Path

import nbformat

FOLDED = re.compile(r"<details>.*?</details>\n*", re.DOTALL)


def without_solutions(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook as students get it; what is handed in is changed."""
    notebook.cells = [
        cell for cell in notebook.cells if "solution" not in cell.metadata.get("tags", [])
    ]
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = FOLDED.sub("", cell.source).replace("](../", "](../../").rstrip()
        else:
            cell.source = cell.source.replace('"../build/', '"../')
    notebook.cells = [cell for cell in notebook.cells if cell.source]
    return notebook


def write(notebooks: Path, folder: Path) -> list[Path]:
    """Write the student edition of all notebooks of one folder into another."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for path in sorted(notebooks.glob("*.ipynb")):
        notebook = without_solutions(nbformat.read(path, as_version=4))
        written.append(folder / path.name)
        nbformat.write(notebook, written[-1])
    return written


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    root = Path(__file__).resolve().parents[1]
    count = len(write(root / "notebooks", root / "build" / "student"))
    print(f"build/student: {count} notebooks without solutions")
    sys.exit(0 if count else 1)
