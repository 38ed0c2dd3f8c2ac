"""Results as LaTeX values and tables."""

from collections.abc import Sequence

import pandas as pd

from sngr_utils.publish.cells import from_json, text

LATEX_CELL = str.maketrans({
    "±": r"$\pm$", "×": r"$\times$", "–": "--", "−": "$-$", "σ": r"$\sigma$", "τ": r"$\tau$",
    "Δ": r"$\Delta$", "µ": r"$\mu$", "%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#",
})  # fmt: skip


def latex(results: Sequence[dict], timings: Sequence[dict] = ()) -> dict[str, str]:
    """File name -> LaTeX text: ``values.tex``, ``timings.tex`` and a file for each table.

    Raises
    ------
    ValueError : two notebooks hand on the same key or table
    """
    files, taken = {}, set()
    for file, group in (("values.tex", results), ("timings.tex", timings)):
        lines = []
        for result in group:
            for key, entry in [*result["values"].items(), *result.get("samples", {}).items()]:
                if key in taken:
                    raise ValueError(f"value {key!r} of {result['notebook']} is already taken")
                taken.add(key)
                shown = latex_value(entry)
                lines.append(rf"\expandafter\def\csname res@{key}\endcsname{{{shown}}}")
            for name, table in result["tables"].items():
                if f"tab_{name}.tex" in files:
                    raise ValueError(f"table {name!r} of {result['notebook']} is already taken")
                files[f"tab_{name}.tex"] = latex_table(table) + rf"\cellmark{{table@{name}}}" + "\n"
        files[file] = "\n".join(lines) + "\n"
    return files


def latex_value(entry: dict) -> str:
    """ "12.3 ± 0.4 m" as LaTeX."""
    return shown_value(entry, "~").translate(LATEX_CELL)


def shown_value(entry: dict, space: str = " ") -> str:
    """ "12.3 ± 0.4 m", with `space` before the unit."""
    shown = text(entry["value"], entry["format"])
    if entry["value"] is None:
        return shown
    if entry.get("standard_error"):  # none, or 0 where all worlds agree
        shown += f" ± {text(entry['standard_error'], entry['format'])}"
    return shown + (space + entry["unit"] if entry["unit"] else "")


def latex_table(table: dict) -> str:
    """A whole booktabs tabular, grouped heads spanning columns.

    The first column is left-aligned and the others centred, unless the table says its "align".
    """
    columns = [tuple(cell.translate(LATEX_CELL) for cell in head) for head in table["columns"]]
    frame = pd.DataFrame([[from_json(cell) for cell in row] for row in table["rows"]], dtype=object)
    frame.columns = (
        pd.MultiIndex.from_tuples(columns)
        if len(columns[0]) > 1
        else pd.Index([head[0] for head in columns])
    )
    align = table.get("align", "l" + "c" * (len(columns) - 1))
    shown = frame.style.format(lambda cell: str(cell).translate(LATEX_CELL)).hide(axis="index")
    return shown.to_latex(hrules=True, multicol_align="c", column_format=align)
