"""The verdicts as tables: in the paper, in its appendix, and on the first screen of the README."""

from dataclasses import dataclass

import pandas as pd

from sngr_utils import paths
from sngr_utils.publish import cells, claims, controls, judge, latex, printed, rules
from sngr_utils.publish.files import write_json
from sngr_utils.publish.judge import Row
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.settings import PRESET_NAMES

BEGIN, END = "<!-- claims: written by make reference -->", "<!-- /claims -->"
ROWS_PER_PAGE = 54
KINDS = {"number": "numbers", "prose": "prose"}
CONTROLS = {  # as `controls.table` names them
    "printed": "the paper's own numbers",
    "random": "numbers drawn at random from their natural ranges",
    "fresh": "one of our worlds in the paper's place, judged by the others",
    "series": "the series among them, as printed",
    "shuffled": "the same series in any order",
    "triggers": "the rows of the trigger, as printed",
    "silent": "an invented trigger that never fires",
}


@dataclass(frozen=True)
class Verdicts:
    """Preset -> verdicts under it, and -> what the same rules say of other numbers."""

    rows: dict[str, list[Row]]
    controls: dict[str, pd.DataFrame]

    @property
    def read(self) -> list[Row]:
        """The verdicts under our reading."""
        return self.rows[claims.read().reading]


def judged(results: dict[str, dict]) -> Verdicts:
    """Verdicts and controls under each preset."""
    return Verdicts(
        {preset: judge.evaluate(results, preset) for preset in PRESET_NAMES},
        {preset: controls.table(results, preset) for preset in PRESET_NAMES},
    )


def result(verdicts: Verdicts) -> dict:
    """Counts and tables of the verdicts in the form of a notebook's JSON, for `latex.latex`."""
    reading, values = claims.read().reading, {}
    for kind, name in KINDS.items():
        values[f"claims.{name}.total"] = _count(sum(row.kind == kind for row in verdicts.read))
        for preset, rows in verdicts.rows.items():
            for verdict, n in judge.counts(rows, kind).items():
                key = f"claims.{name}.{verdict.replace(' ', '_')}"
                values[f"{key}.{preset}"] = _count(n)
                if preset == reading:
                    values[key] = _count(n)
    values["claims.printed"] = _count(len(printed.leaves()))
    for name, line in verdicts.controls[reading].iterrows():
        values[f"claims.controls.{name}.rows"] = _count(line["rows"])
        values[f"claims.controls.{name}.pass"] = _count(
            line["pass"], ".1f" if line["pass"] % 1 else ".0f"
        )
    tables = {
        "claims_summary": _table(summary(verdicts.rows)),
        "claims_controls": _table(control_table(verdicts.controls)),
        "claims_groups": _table(groups(verdicts.read), "llp{48mm}p{48mm}rl"),
        "claims_prose": _table(prose(verdicts.read), "lllll"),
    }
    return {"notebook": "claims", "values": values, "tables": tables}


def _count(n: float, fmt: str = ".0f") -> dict:
    return {"value": float(n), "format": fmt, "unit": "", "n": 1}


def _table(frame: pd.DataFrame, align: str | None = None) -> dict:
    entry = {"columns": [[name] for name in frame.columns], "rows": frame.to_numpy().tolist()}
    return entry | ({"align": align} if align else {})


def summary(by_preset: dict[str, list[Row]]) -> pd.DataFrame:
    """Number of rows by verdict: numbers and prose, under the reading and under the others."""
    reading, rows = claims.read().reading, []
    for kind, name in KINDS.items():
        for preset in sorted(by_preset, key=lambda each: each != reading):
            found = judge.counts(by_preset[preset], kind)
            shown = f"{name}, preset {preset}" + (" (our reading)" if preset == reading else "")
            rows.append([shown, *map(str, found.values()), str(sum(found.values()))])
    return pd.DataFrame(rows, columns=["claims", *rules.VERDICTS, "all"])


def control_table(by_preset: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Whose numbers pass how many of the testable rows, under each preset."""
    reading = claims.read().reading
    order = sorted(by_preset, key=lambda each: each != reading)
    lines = []
    for name, shown in CONTROLS.items():
        cells_ = []
        for preset in order:
            rows, passed = by_preset[preset].loc[name]
            cells_.append(f"{cells.text(passed, '.1f' if passed % 1 else '.0f')} of {rows:.0f}")
        lines.append([shown, *cells_])
    heads = [
        f"preset {preset}" + (" (our reading)" if preset == reading else "") for preset in order
    ]
    return pd.DataFrame(lines, columns=["rows that pass", *heads])


def groups(rows: list[Row]) -> pd.DataFrame:
    """One row per test of numbers: printed and ours, the share it would accept, the verdict."""
    aside = (rules.FOLLOWS, rules.CANNOT)
    lines = [[row.id, row.what, row.printed, row.ours, _share(row.share), row.verdict]
             for row in rows if row.kind == "number" and row.verdict not in aside]  # fmt: skip
    return pd.DataFrame(lines, columns=["row", "what", "printed", "ours", "accepts", "verdict"])


def _share(share: float | None) -> str:
    """A share of a natural range in percent."""
    if share is None:
        return cells.NONE
    return "< 1 %" if share < 0.01 else f"{share:.0%}".replace("%", " %")


def prose(rows: list[Row]) -> pd.DataFrame:
    """One row per claim in words."""
    lines = [[row.where, row.what, row.ours, row.verdict, row.notebook]
             for row in rows if row.kind == "prose"]  # fmt: skip
    return pd.DataFrame(lines, columns=["where", "claim", "ours", "verdict", "notebook"])


def every(rows: list[Row]) -> pd.DataFrame:
    """One row per printed number and per claim in words, with what would have been accepted."""
    lines = []
    for row in rows:
        verdict = f"{row.verdict}: {row.why}" if row.verdict == rules.FOLLOWS else row.verdict
        cell = f"{row.notebook}: {row.cell}"
        if row.kind == "prose":
            lines.append([row.id, cells.NONE, row.ours, row.n, *[cells.NONE] * 3, verdict, cell])
        for one in row.numbers:
            lines.append([one.id, one.printed, one.ours, one.n, one.accepted, _share(one.covered),
                          one.rank or cells.NONE, verdict, cell])  # fmt: skip
    columns = ["id", "printed", "ours", "n", "accepted", "share", "rank", "verdict", "cell"]
    return pd.DataFrame(lines, columns=columns)


def chunks(rows: list[Row]) -> str:
    """LaTeX: every claim with its verdict, as full-width tables that fill a page each."""
    frame = every(rows)
    pages = [frame.iloc[i : i + ROWS_PER_PAGE] for i in range(0, len(frame), ROWS_PER_PAGE)]
    text = []
    for number, page in enumerate(pages, start=1):
        tabular = latex.latex_table(_table(page, "l" * len(page.columns)))
        text.append(
            "\\begin{table*}[p]\n\\caption{Every claim with its verdict, "
            f"part {number} of {len(pages)}. Accepted: where the number by itself could lie; "
            "share: how much of its natural range that is. A series has one verdict. The cell "
            "that decides is in the last column.}\n"
            "\\centering\\scriptsize\\setlength{\\tabcolsep}{3pt}\n"
            f"{tabular}\\end{{table*}}\n"
        )
    return "\n".join(text)


def readme_block(verdicts: Verdicts) -> str:
    """The counts and the controls as Markdown, between their markers."""
    counted, prose_ = (judge.counts(verdicts.read, kind) for kind in KINDS)
    rows = sum(counted.values()) - counted[rules.FOLLOWS]
    intro = (
        f"The paper prints {len(printed.leaves())} numbers; {counted[rules.FOLLOWS]} of them "
        f"follow from others, and the rest makes {rows} rows, a series\nbeing one. These and "
        f"{sum(prose_.values())} claims of its prose are judged by rules stated in\n"
        "[claims.yaml](paper/claims.yaml), `sngr_utils/publish/prediction.py` and `rules.py`:"
    )
    worth = (
        "What a verdict is worth: of the rows that our worlds can test, which would refuse 85 % or "
        "more of\nwhat could have been printed, so many pass:"
    )
    return "\n".join([
        BEGIN, intro, "", *_markdown(summary(verdicts.rows)), "", MEANING, "", worth, "",
        *_markdown(control_table(verdicts.controls)), END,
    ])  # fmt: skip


MEANING = """\
*Reproduced*: the row could have been refuted and was not. *Trend*: it is refuted, but most worlds
(sign test, 2.5 %) change from its first level to its last in the printed direction; of prose, the
claim holds in more than half of the worlds (lower 95 % limit), but not in 80 %. *Untestable*: our
worlds differ so much that more than 15 % of all that could have been printed would pass. *Cannot
hold*: the paper's own numbers contradict it. A fresh world is one of our 30, judged by the other
29: that checks the error of the rules, not the likeness of our worlds to the paper's."""


def _markdown(frame: pd.DataFrame) -> list[str]:
    lines = ["| " + " | ".join(line) + " |" for line in [list(frame), *frame.to_numpy().tolist()]]
    return [lines[0], "|---" + "|---:" * (len(frame.columns) - 1) + "|", *lines[1:]]


def record(rows: list[Row]) -> dict[str, str]:
    """Claim -> its verdict in one line, so that whatever alters a claim or its verdict shows."""
    return {
        row.id: f"{row.what} | {row.rule} | {row.printed} | {row.ours} | "
        f"{_share(row.share)} | {row.verdict}"
        for row in rows
    }


def write_record(verdicts: Verdicts) -> None:
    """Write every verdict under every preset to ``paper/verdicts.json``."""
    write_json(paths.VERDICTS, {name: record(rows) for name, rows in verdicts.rows.items()})


def update_readme(verdicts: Verdicts) -> None:
    """Write the summary of the verdicts between the markers of the README.

    Raises
    ------
    ProjectError : no markers there
    """
    text = paths.README.read_text(encoding="utf-8")
    if BEGIN not in text or END not in text:
        raise ProjectError(f"README.md lacks the lines {BEGIN!r} and {END!r}")
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    paths.README.write_text(before + readme_block(verdicts) + after, encoding="utf-8")
