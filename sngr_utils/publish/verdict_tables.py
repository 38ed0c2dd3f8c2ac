"""The verdicts as tables: in the paper, in its supplement, and on the front of the README."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils import paths, whole_file
from sngr_utils.publish import (
    authors,
    authors_worlds,
    cells,
    claims,
    controls,
    judge,
    latex,
    printed,
    rules,
)
from sngr_utils.publish.files import write_json
from sngr_utils.publish.judge import Row
from sngr_utils.publish.notebooks import ProjectError
from sngr_utils.settings import PRESET_NAMES

BEGIN, END = "<!-- claims: written by make reference -->", "<!-- /claims -->"
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
        values[f"claims.controls.{name}.pass"] = _count(line["pass"], _fmt(line["pass"]))
    tables = {
        "claims_headline": _table(headline(verdicts.rows), "P{55mm}P{22mm}P{24mm}lll"),
        "claims_summary": _table(summary(verdicts.rows)),
        "claims_controls": _table(control_table(verdicts.controls)),
        "claims_groups": _table(groups(verdicts.read), "llP{48mm}P{48mm}rl"),
        "claims_prose": _table(prose(verdicts.read), "lllll"),
    }
    if authors.digits().exists():  # else the paper names what it misses
        tables["claims_authors"] = _table(by_authors(verdicts.read), "lP{80mm}ll")
        values |= _of_authors()
    return {"notebook": "claims", "values": values, "tables": tables}


def _of_authors() -> dict[str, dict]:
    """What comes out under the authors' conventions, and what their trigger says."""
    verdicts = list(authors.compared(authors.read()).values())
    values = {"claims.authors.printed": _count(len(verdicts))}
    for verdict in (authors.EQUAL, authors.TWICE, authors.SAMPLED, authors.UNEQUAL):
        key = f"claims.authors.{verdict.replace(' ', '_')}"
        values[key] = _count(verdicts.count(verdict))
    for p in sorted(set(authors_worlds.rows()["p"])):
        for name, each in authors_worlds.measures(p).items():
            values[f"claims.authors.p{p:g}.{name}"] = _count(each.value, ".2f")
    return values


def _fmt(mean: float) -> str:
    """The format of a mean of counts."""
    return ".1f" if mean % 1 else ".0f"


def _count(n: float, fmt: str = ".0f") -> dict:
    return {"value": float(n), "format": fmt, "unit": "", "n": 1}


def _table(frame: pd.DataFrame, align: str | None = None) -> dict:
    entry = {"columns": [[name] for name in frame.columns], "rows": frame.to_numpy().tolist()}
    return entry | ({"align": align} if align else {})


def summary(by_preset: dict[str, list[Row]]) -> pd.DataFrame:
    """Number of rows by verdict: numbers and prose, under the reading and under the others."""
    rows = []
    for kind, name in KINDS.items():
        for preset, shown in _presets(" (our reading)").items():
            found = judge.counts(by_preset[preset], kind)
            rows.append([f"{name}, {shown}", *map(str, found.values()), str(sum(found.values()))])
    return pd.DataFrame(rows, columns=["claims", *rules.VERDICTS, "all"])


def _presets(ours: str) -> dict[str, str]:
    """Preset -> how a table names it, our reading first; `ours` follows that one's name."""
    reading = claims.read().reading
    others = [preset for preset in PRESET_NAMES if preset != reading]
    return {reading: f"preset {reading}{ours}"} | {each: f"preset {each}" for each in others}


def control_table(by_preset: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Whose numbers pass how many of the testable rows, under each preset."""
    lines = []
    for name, shown in CONTROLS.items():
        found = [by_preset[preset].loc[name] for preset in _presets("")]
        lines.append([shown, *(f"{passed:{_fmt(passed)}} of {rows:.0f}" for rows, passed in found)])
    heads = _presets(" (our reading)").values()
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
    return "< 1 %" if share < 0.01 else f"{100 * share:.0f} %"


def headline(by_preset: dict[str, list[Row]]) -> pd.DataFrame:
    """The claims that the main paper shows: ours, the verdicts, and what a test could refuse."""
    reading = claims.read().reading
    at = {preset: {row.id: row for row in rows} for preset, rows in by_preset.items()}
    others = [preset for preset in at if preset != reading]
    lines = []
    for name in claims.read().headline:
        row, elsewhere = at[reading][name], {}
        for preset in others:
            elsewhere.setdefault(at[preset][name].verdict, []).append(preset)
        told = [f"{', '.join(who)}: {verdict}" for verdict, who in elsewhere.items()]
        if len(elsewhere) == 1:  # the head of the column says of whom
            told = ["the same" if row.verdict in elsewhere else next(iter(elsewhere))]
        lines.append([row.what, row.printed, row.ours, _power(row), row.verdict,
                      "; ".join(told)])  # fmt: skip
    heads = ["claim", "printed", f"ours, preset {reading}", "power", f"verdict, {reading}"]
    return pd.DataFrame(lines, columns=[*heads, " and ".join(others)])


def _power(row: Row) -> str:
    """What a test could have refused: of a range, or how many worlds a claim in words needs."""
    if row.kind == "number":
        if row.share is None:
            return cells.NONE
        refused = "> 99" if row.share < 0.01 else f"{100 * (1 - row.share):.0f}"
        return f"refuses {refused} %"
    entry = {each.id: each for each in claims.read().prose}[row.entry]
    if entry.rule != "share":
        return "a sign test" if entry.rule == "rises" else cells.NONE
    n = int(row.n)
    for k in range(n + 1):
        if rules.share(np.arange(n) < k, entry.share) == rules.REPRODUCED:
            return f"needs {k} of {n}"
    return f"cannot, with {n}"


def prose(rows: list[Row]) -> pd.DataFrame:
    """One row per claim in words."""
    lines = [[row.where, row.what, row.ours, row.verdict, row.notebook]
             for row in rows if row.kind == "prose"]  # fmt: skip
    return pd.DataFrame(lines, columns=["where", "claim", "ours", "verdict", "notebook"])


def by_authors(rows: list[Row]) -> pd.DataFrame:
    """Each claim that the authors' own conventions can answer: our verdict, and theirs."""
    told, ours = authors_worlds.told(), {}
    for row in rows:
        if row.entry in told and (row.entry not in ours or row.id == row.entry):
            ours[row.entry] = [row.id, row.what, row.verdict, told[row.entry]]
    heads = ["row", "claim", f"verdict, preset {claims.read().reading}", "the authors' conventions"]
    return pd.DataFrame(list(ours.values()), columns=heads)


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


def whole(rows: list[Row]) -> str:
    """LaTeX: every claim with its verdict, as one table that goes on from page to page."""
    table = every(rows)
    text = latex.latex_table(_table(table, "lllllllP{33mm}l"))
    head, body = text.replace("{tabular}", "{longtable}").split("\\midrule\n")
    begin, head = head.split("\n", 1)
    caption = (
        f"\\caption{{Every claim with its verdict under preset {claims.read().reading}. "
        "Accepted: where the number by itself could lie; "
        "share: how much of its natural range that is. A series has one verdict. The cell "
        "that decides is in the last column.}\\label{tab:every}\\\\\n"
    )
    return f"{begin}\n{caption}{head}\\midrule\\endfirsthead\n{head}\\midrule\\endhead\n{body}"


def readme_block(verdicts: Verdicts) -> str:
    """The counts under each preset as a small table in Markdown, between their markers."""
    order = _presets(", our reading")
    numbers = {name: list(line[1:]) for name, line in zip(
        CONTROLS, control_table(verdicts.controls).itertuples(index=False), strict=True
    )}  # fmt: skip
    prose_ = [judge.counts(verdicts.rows[preset], "prose") for preset in order]
    holds = [f"{found[rules.REPRODUCED]} (+ {found[rules.TREND]}) of {sum(found.values())}"
             for found in prose_]  # fmt: skip
    lines = [[shown, *(holds if name == "holds" else numbers[name])]
             for name, shown in README_ROWS.items()]  # fmt: skip
    table = _markdown(pd.DataFrame(lines, columns=["what passes the test", *order.values()]))
    return "\n".join([BEGIN, *table, "", authors_worlds.sentence(), END])


README_ROWS = {  # as CONTROLS names them, and the claims in words
    "printed": "rows of printed numbers, of those that our worlds can refute",
    "random": "the same rows with random numbers",
    "fresh": "the same rows with one of our own worlds",
    "series": "of these, series",
    "shuffled": "the same series in any order",
    "triggers": "of all, rows of the trigger",
    "silent": "the same for a trigger that never fires",
    "holds": "claims in words (and as a trend)",
}


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
    whole_file.write_text(paths.README, before + readme_block(verdicts) + after)
