"""The verdicts as tables: in the paper, in its appendix, and on the first screen of the README."""

import pandas as pd

from sngr_utils import paths
from sngr_utils.publish import cells, claims, judge, latex, rules
from sngr_utils.publish.files import write_json
from sngr_utils.publish.judge import Row
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.settings import PRESET_NAMES

BEGIN, END = "<!-- claims: written by make reference -->", "<!-- /claims -->"
ROWS_PER_PAGE = 54
KINDS = {"number": "numbers", "prose": "prose"}
HEADS = dict(zip(rules.VERDICTS, ("R", "T", "N", "C", "–"), strict=True))


def judged(results: dict[str, dict]) -> dict[str, list[Row]]:
    """Preset -> verdicts under it."""
    return {preset: judge.evaluate(results, preset) for preset in PRESET_NAMES}


def result(by_preset: dict[str, list[Row]]) -> dict:
    """Counts and tables of the verdicts in the form of a notebook's JSON, for `latex.latex`."""
    rows = by_preset[claims.read().reading]
    values = {}
    for kind, name in KINDS.items():
        values[f"claims.{name}.total"] = _count(sum(row.kind == kind for row in rows))
        for preset, judged_rows in by_preset.items():
            for verdict, n in judge.counts(judged_rows, kind).items():
                key = f"claims.{name}.{verdict.replace(' ', '_')}"
                values[f"{key}.{preset}"] = _count(n)
                if judged_rows is rows:
                    values[key] = _count(n)
    tables = {
        "claims_summary": _table(summary(by_preset)),
        "claims_groups": _table(groups(rows), "llllll" + "c" * len(HEADS)),
        "claims_prose": _table(prose(rows), "lllll"),
    }
    return {"notebook": "claims", "values": values, "tables": tables}


def _count(n: int) -> dict:
    return {"value": float(n), "format": ".0f", "unit": "", "n": 1}


def _table(frame: pd.DataFrame, align: str | None = None) -> dict:
    entry = {"columns": [[name] for name in frame.columns], "rows": frame.to_numpy().tolist()}
    return entry | ({"align": align} if align else {})


def summary(by_preset: dict[str, list[Row]]) -> pd.DataFrame:
    """Number of claims by verdict: numbers and prose, under the reading and under the others."""
    reading, rows = claims.read().reading, []
    for kind, name in KINDS.items():
        for preset in sorted(by_preset, key=lambda each: each != reading):
            found = judge.counts(by_preset[preset], kind)
            shown = f"{name}, preset {preset}" + (" (our reading)" if preset == reading else "")
            rows.append([shown, *map(str, found.values()), str(sum(found.values()))])
    return pd.DataFrame(rows, columns=["claims", *rules.VERDICTS, "all"])


def groups(rows: list[Row]) -> pd.DataFrame:
    """One row per column or series of numbers: ranges of printed and ours, counts of verdicts."""
    frame, lines = pd.DataFrame([vars(row) for row in rows if row.kind == "number"]), []
    for entry, part in frame.groupby("entry", sort=False):
        first, found = part.iloc[0], part["verdict"].value_counts()
        ranges = [_range([pair[i] for pair in part["values"]]) for i in (0, 1)]
        tally = [str(found.get(verdict, 0)) for verdict in HEADS]
        rule = first["rule"].replace("_", " ")
        lines.append([entry, first["where"], first["what"], *ranges, rule, *tally])
    columns = ["id", "where", "what", "printed", "ours (means)", "rule", *HEADS.values()]
    return pd.DataFrame(lines, columns=columns)


def _range(values: list[float | None]) -> str:
    known = [value for value in values if value is not None]
    ends = [cells.text(end, ".3g") for end in (min(known), max(known))] if known else [cells.NONE]
    return ends[0] if ends[0] == ends[-1] else f"{ends[0]} to {ends[-1]}"


def prose(rows: list[Row]) -> pd.DataFrame:
    """One row per claim in words."""
    lines = [[row.where, row.what, row.ours, row.verdict, row.notebook]
             for row in rows if row.kind == "prose"]  # fmt: skip
    return pd.DataFrame(lines, columns=["where", "claim", "ours", "verdict", "notebook"])


def chunks(rows: list[Row]) -> str:
    """LaTeX: every claim with its verdict, as full-width tables that fill a page each."""
    frame = judge.frame(rows).drop(columns=["where", "what", "why"])
    frame["cell"] = frame.pop("notebook") + ": " + frame["cell"]
    pages = [frame.iloc[i : i + ROWS_PER_PAGE] for i in range(0, len(frame), ROWS_PER_PAGE)]
    text = []
    for number, page in enumerate(pages, start=1):
        tabular = latex.latex_table(_table(page, "l" * len(page.columns)))
        text.append(
            "\\begin{table*}[p]\n\\caption{Every claim with its verdict, "
            f"part {number} of {len(pages)}. The cell that decides is in the last column.}}\n"
            "\\centering\\scriptsize\\setlength{\\tabcolsep}{4pt}\n"
            f"{tabular}\\end{{table*}}\n"
        )
    return "\n".join(text)


def readme_block(by_preset: dict[str, list[Row]]) -> str:
    """The summary as Markdown, between its markers."""
    frame, reading = summary(by_preset), claims.read().reading
    table = ["| " + " | ".join(line) + " |" for line in [list(frame), *frame.to_numpy().tolist()]]
    table.insert(1, "|---" + "|---:" * (len(frame.columns) - 1) + "|")
    total = len(by_preset[reading])
    intro = (f"Verdicts on all {total} claims of the paper, by rules stated in\n"
             "[claims.yaml](paper/claims.yaml) and `sngr_utils/publish/rules.py`:")  # fmt: skip
    return "\n".join([BEGIN, intro, "", *table, END])


def record(rows: list[Row]) -> dict[str, str]:
    """Claim -> its verdict in one line, so that whatever alters a claim or its verdict shows."""
    return {
        row.id: f"{row.what} | {row.rule} | {row.printed} | {row.ours} | {row.verdict}"
        for row in rows
    }


def write_record(results: dict[str, dict]) -> None:
    """Write every verdict under every preset to ``paper/verdicts.json``."""
    by_preset = judged(results)
    write_json(paths.VERDICTS, {name: record(rows) for name, rows in by_preset.items()})


def update_readme(results: dict[str, dict]) -> None:
    """Write the summary of the verdicts between the markers of the README.

    Raises
    ------
    ProjectError : no markers there, or results that a claim needs are missing
    """
    text = paths.README.read_text(encoding="utf-8")
    if BEGIN not in text or END not in text:
        raise ProjectError(f"README.md lacks the lines {BEGIN!r} and {END!r}")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    paths.README.write_text(before + readme_block(judged(results)) + after, encoding="utf-8")
