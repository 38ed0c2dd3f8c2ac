"""What the tests of findings read: the results of all notebooks that are committed."""

import re

import numpy as np
from helpers import read_notebook

from sngr_utils import paths
from sngr_utils.publish.results import results_in

RESULTS = results_in(paths.REFERENCE)


def value(key):
    return RESULTS[key]["value"]


def worlds(key):
    """(n,) one number per world."""
    return np.array(RESULTS[key]["sample"], dtype=float)


def entry(table, row, column, part=1):
    """A number of a recorded table; rows, columns and parts of a cell count from one."""
    key = f"tab_{table}.row{row}.column{column}"
    return value(key if part == 1 else f"{key}.{part}")


def said(notebook, source):
    """The numbers, in order, that one stored cell prints or shows in the cells of a table.

    source : what stands in the code of this cell and of no other
    """
    code = [cell for cell in read_notebook(notebook).cells if cell.cell_type == "code"]
    (cell,) = (cell for cell in code if source in cell.source)
    text = "".join(out.text for out in cell.outputs if out.output_type == "stream")
    tables = "".join(out.get("data", {}).get("text/html", "") for out in cell.outputs)
    shown = (re.sub("<.*?>", "", one) for one in re.findall("<td.*?</td>", tables))
    text += " ".join(shown).replace("−", "-")
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text)]
