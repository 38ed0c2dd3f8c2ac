"""Trace a number, table or figure of the paper to the cell, parameters and code behind it."""

import difflib
import json
import re
from collections.abc import Iterator

from sngr_utils import paths
from sngr_utils.publish import claims, links, notebooks, results, verified
from sngr_utils.publish.files import read_json
from sngr_utils.publish.freshness import inputs, is_fresh
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.publish.parameters import read_params
from sngr_utils.publish.trace import Cell, handed_on, made_in, recording

Line = tuple[str, str]
TABLE_CELL = re.compile(r"tab_(\w+)\.row\d+\.column[\d.]+")  # as the reference names it
STUDY = re.compile(r"\b(?:committed|study)\(\"(\w+)\"\)")  # what a cell takes its rows from


def why(name: str) -> str:
    """All that is known of a key of `\\res`, of a table or a cell of it, or of a figure, in lines.

    Raises
    ------
    ProjectError : nothing has that name; says which names are near
    """
    lines = list(_of_value(name) or _of_shown(name) or _of_verdicts(name))
    if not lines:
        raise ProjectError(_unknown(name))
    return "\n".join([name, *(f"  {label:<11}{text}" for label, text in lines)])


def _of_value(key: str) -> list[Line]:
    """Lines on a value; none if no notebook hands it on."""
    for notebook in notebooks.names():
        entry, where = _entry(notebook, key)
        if entry:
            found = [*_number(entry), ("read from", where)]
            if in_table := TABLE_CELL.fullmatch(key):
                return [*found, *_of_shown(in_table[1])]
            direct = handed_on(notebook).get(("value", key))
            cells = [direct] if direct else recording(notebook, key)
            found += [*_cells(cells), *_made(notebook)]
            return [*found, *_places(rf"\\res\{{{re.escape(key)}\}}", key), *_claims(key)]
    return []


def _of_shown(name: str) -> list[Line]:
    """Lines on a table, or on a figure by the name of its file or the notebook's own for it."""
    for notebook in notebooks.names():
        for (kind, what), cell in handed_on(notebook).items():
            names = {what, f"{notebook}_{what}"} if kind == "figure" else {what}
            if kind != "value" and name.split(".pdf")[0] in names:
                asked = rf"\\tab\{{{re.escape(what)}\}}|generated/tab_{re.escape(what)}\}}"
                if kind == "figure":
                    asked = rf"\\fig\{{{notebook}\}}\{{{re.escape(what)}\}}"
                found = [("kind", f"{kind} of notebook {notebook}"), *_cells([cell])]
                return [*found, *_made(notebook), *_places(asked, f"{notebook}_{what}")]
    return []


def _of_verdicts(name: str) -> list[Line]:
    """Lines on what is counted from the verdicts and no notebook hands on."""
    if not name.startswith(("claims.", "claims_")):
        return []
    asked = rf"(\\res\{{|\\tab\{{|generated/(tab_)?){re.escape(name)}\}}"
    code = "sngr_utils/publish/verdict_tables.py"
    counted = f"counted from the verdicts on paper/claims.yaml ({code})"
    return [("kind", counted), *_places(asked, name)]


def _entry(notebook: str, key: str) -> tuple[dict | None, str]:
    """A value as it was last made: from the results at hand if fresh, else from the reference."""
    for folder in (paths.RESULTS, paths.REFERENCE):
        for path in (folder / f"{notebook}.json", folder / f"{notebook}.timings.json"):
            found = results.entries_in(path).get(key) if path.exists() else None
            if found and (folder == paths.REFERENCE or is_fresh(notebook, read_params(notebook))):
                return found, path.relative_to(paths.ROOT).as_posix()
    return None, ""


def _number(entry: dict) -> Iterator[Line]:
    from sngr_utils.publish.latex import shown_value  # pandas

    entry = {"unit": "", **entry}  # of a table's cell the heading has it
    size = f"; sample size {entry['n']}" if "n" in entry else ""
    yield "value", f"{shown_value(entry)}, in full {entry['value']!r}{size}"
    error = entry.get("standard_error")
    known = "none: not a mean over worlds" if error is None else f"standard error {error:.3g}"
    yield "error", known
    told = entry.get("tolerance", {"kind": "exact", "size": 0})
    unit = entry["unit"] or "in its unit"
    sizes = {"exact": "exactly the same", "absolute": f"within {told['size']:g} {unit}"}
    yield "tolerance", sizes.get(told["kind"], f"within {told['size']:g} {told['kind']}")


def _cells(cells: list[Cell]) -> Iterator[Line]:
    """The cells that hand it on, and those before that make what they use."""
    used = []
    for cell in cells:
        earlier = made_in(cell)
        yield "cell", _place(cell)
        yield from (("made in", _place(each)) for each in earlier)
        used += [name for each in [*earlier, cell] for name in STUDY.findall(each.source)]
    yield from (("study", _study(name)) for name in dict.fromkeys(used))


def _study(name: str) -> str:
    """The file of a study, the command that makes it, and its own seeds."""
    study = read_json(paths.PAPER / "studies" / f"{name}.json")
    seeds = sorted({row["seed"] for rows in study["rows"] for row in rows if "seed" in row})
    told = f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seeds {seeds}"
    return f"paper/studies/{name}.json, {told}, code {study['code'][:16]}: make study/{name}"


def _place(cell: Cell) -> str:
    text = cell.source.split("\n")[cell.at]
    return f"notebooks/{cell.notebook}.ipynb [{cell.number}], line {cell.line + cell.at}: {text}"


def _made(notebook: str) -> Iterator[Line]:
    """Parameters, seeds, fingerprints, and when the notebook was last verified."""
    params = read_params(notebook)
    told = [f"{key} = {json.dumps(value)}" for key, value in params.items()]
    yield "parameters", f"params/{notebook}.yaml: {', '.join(told)}"
    seeds = [each for key, each in zip(params, told, strict=True) if "seed" in key]
    yield "seeds", ", ".join(seeds) or "none"
    hashes, stem = inputs(notebook, params), notebook.split("_", 1)[1]
    marks = ", ".join(f"{part} {hashes[part]}" for part in ("package", "notebook", "lock"))
    yield "code", f"sngr_utils/{stem}.py, sngr_utils/show/{stem}.py and what they import: {marks}"
    yield "verified", verified.last(notebook, hashes)


def _places(pattern: str, plain: str) -> Iterator[Line]:
    """Lines of the paper, its supplement and the README that ask for a thing or name it."""
    found = [place for file in links.DOCUMENTS for place in _asked_in(file, pattern)]
    for place in found or ["neither the paper nor its supplement shows it"]:
        yield "paper", place
    for number, line in enumerate(_text("README.md"), start=1):
        if re.search(rf"(?<![\w.]){re.escape(plain)}(?![\w])", line):
            yield "README", f"README.md:{number}"


def _asked_in(file: str, pattern: str) -> Iterator[str]:
    """Each line of a document that matches, with the heading above it."""
    section = "preamble"
    for number, line in enumerate(_text(file), start=1):
        heading = re.search(r"\\(?:sub)?section\*?\{([^}]*)\}|\\begin\{(abstract)\}", line)
        section = (heading[1] or heading[2]) if heading else section
        if re.search(pattern, line):
            yield f"{file}:{number}, section {section!r}"


def _text(file: str) -> list[str]:
    return (paths.ROOT / file).read_text(encoding="utf-8").split("\n")


def _claims(key: str) -> Iterator[Line]:
    """The claims of the original that a value judges, with the verdict committed."""
    committed = read_json(paths.VERDICTS)[claims.read().reading]
    for claim in claims.resting_on(key):
        verdict = committed.get(claim, "no verdict yet: make reference").split(" | ")[-1]
        yield "claim", f"paper/claims.yaml {claim!r}: {verdict}"


def _unknown(name: str) -> str:
    known = list(results.results_in(paths.REFERENCE))
    known += [what for book in notebooks.names() for _, what in handed_on(book)]
    near = difflib.get_close_matches(name, known, n=3)
    hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
    return f"no notebook hands on a value, table or figure {name[:60]!r}{hint}"
