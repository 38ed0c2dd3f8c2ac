"""`make why` against seven keys, two tables and two figures that were traced by hand."""

import re
from datetime import date

import pytest
from helpers import paper_text
from small_project import NAME, at_home_in, make_project

from sngr_utils import paths
from sngr_utils.__main__ import main
from sngr_utils.publish import (
    claims,
    files,
    freshness,
    links,
    notebooks,
    parameters,
    trace,
    verified,
    why,
)


def traced(name):
    """Label -> texts, in order."""
    told = {}
    for line in why.why(name).split("\n")[1:]:
        told.setdefault(line[2:13].strip(), []).append(line[13:])
    return told


def source_at(text):
    """The first line of the cell whose place a text tells as "FILE [7], line 3: ..."."""
    file, number, line = re.match(r"(\S+) \[(\d+)\], line (\d+): ", text).groups()
    in_file = (paths.ROOT / file).read_text(encoding="utf-8").split("\n")[int(line) - 1]
    return int(number), in_file.strip(' ",').removesuffix("\\n").replace('\\"', '"')


# by hand: the cell that hands it on, the cells that compute what it holds, its seeds, and how
# often the paper asks for it
BY_HAND = {
    "bimodal.map_y": ("show.record(result, paper)", ["result = bimodal.run(config)"], "seed = 0"),
    "sweep.tau": (
        "show.record(sweep, presets, paper)", ["sweep = trigger_sweep.run(config)"],
        "seeds = [0, 1, 2, 3, 4]",
    ),
    "growth.slope": (
        "show.record_engines(engines, grown, (fast, isam2), paper)",
        ["grown = cost.grow(config)"], "seed = 0",
    ),
    "peers.isam2.none.p0.4.ratio": (
        "show.record(config, runs, paper)", ["runs = peers.run(config)"], "first_seed = ",
    ),
    "online.p0.4.ratio": (
        "show.record(config, runs, ablation, slips, paper)",
        ["runs = association_aware.run(config)"], "first_seed = 6000, n_seeds = 30",
    ),
    "worlds.lost": (
        "worlds.record(rows, paper)", ['rows = studies.committed("every_world")'],
        "first_seed = 6000, n_seeds = 30",
    ),
    "cost.saving_calls": (
        "show.record(config, costs, closure, paper)", ["costs = cost.run(config)"], "seed = 0",
    ),
}  # fmt: skip


@pytest.mark.parametrize("key", BY_HAND)
def test_a_key_leads_to_the_cells_that_were_found_by_hand(key):
    recorded, computed, seeds = BY_HAND[key]
    told = traced(key)
    number, source = source_at(told["cell"][0])
    assert source == recorded
    earlier = dict(source_at(text) for text in told["made in"])
    assert set(computed) <= set(earlier.values())
    assert max(earlier) < number
    assert told["seeds"][0].startswith(seeds)
    asked = [
        f"{file}:{i}"
        for file in links.DOCUMENTS
        for i, line in enumerate((paths.ROOT / file).read_text(encoding="utf-8").split("\n"), 1)
        if rf"\res{{{key}}}" in line
    ]
    assert [place.split(", section")[0] for place in told["paper"]] == (
        asked or ["neither the paper nor its supplement shows it"]
    )


def test_what_a_study_hands_on_is_told_with_the_seeds_of_the_study():
    (told,) = traced("worlds.lost")["study"]
    rows = files.read_json(paths.PAPER / "studies/every_world.json")["rows"]
    seeds = [row["seed"] for cell in rows for row in cell]
    file, command = "paper/studies/every_world.json", "make study/every_world"
    assert told.startswith(f"{file}, seeds {min(seeds)} to {max(seeds)}, code ")
    assert told.endswith(command)
    assert "study" not in traced("sweep.tau")


def test_an_entry_of_a_table_is_told_with_its_table():
    reference = files.read_json(paths.REFERENCE / "10_real_data.json")
    entry = next(key for key in reference if key.startswith("tab_real_peers.row"))
    told = traced(entry)
    assert repr(reference[entry]["value"]) in told["value"][0]
    table = traced("real_peers")
    assert {label: told[label] for label in table} == table


def test_a_value_is_told_with_its_error_and_its_tolerance():
    told = traced("online.p0.4.ratio")
    (path,) = told["read from"]
    content = files.read_json(paths.ROOT / path)
    entry = (files.entries(content) if "values" in content else content)["online.p0.4.ratio"]
    assert repr(entry["value"]) in told["value"][0]
    assert f"{entry['value']:.3f} ± {entry['standard_error']:.3f}" in told["value"][0]
    assert told["tolerance"] == ["within 3 standard errors"]
    for part, text in freshness.inputs(
        "08_association_aware", parameters.read_params("08_association_aware")
    ).items():
        assert part not in ("package", "notebook", "lock") or f"{part} {text}" in told["code"][0]


@pytest.mark.parametrize(
    ("name", "notebook", "cell"),
    [
        ("online_goal", "08_association_aware", "online_goal"),
        ("tau", "02_trigger_sweep", "tau"),
        ("08_association_aware_summary", "08_association_aware", "summary"),
        ("growth_timing", "04_cost", "growth"),
    ],
)
def test_a_table_or_figure_leads_to_its_cell(name, notebook, cell):
    (where,) = traced(name)["cell"]
    number = int(re.match(rf"notebooks/{notebook}\.ipynb \[(\d+)\]", where)[1])
    (found,) = [each for each in trace.code_cells(notebook) if each.number == number]
    assert f'"{cell}"' in found.source


def test_a_table_that_a_loop_names_is_found_by_the_reference(tmp_path, monkeypatch):
    """The loop comes first, and the table that a cell names itself stays that cell's."""
    sources = ['for x in "ab":\n    paper.table(f"t_{x}", x)', 'paper.supplement("t_b", x)']
    cells = [trace.Cell(NAME, i, 1, source, ()) for i, source in enumerate(sources, start=1)]
    monkeypatch.setattr(trace, "code_cells", lambda notebook: cells)
    monkeypatch.setattr(paths, "REFERENCE", tmp_path)
    files.write_json(tmp_path / f"{NAME}.json", {"tab_t_a.row1.column2": {}, "tab_u.row1.c": {}})
    found = {name: (cell.number, cell.at) for (_, name), cell in trace.handed_on(NAME).items()}
    assert found == {"t_a": (1, 1), "t_b": (2, 0)}


def test_only_what_a_statement_needs_is_told(monkeypatch):
    """Not a name that a function, a comprehension or a loop has for itself, nor another's line."""
    sources = [
        "import numpy as np\nrows = np.arange(3)",
        "def f(rows):\n    return rows\n\n\nx = 1\nk = 2",
        "k = 1\nother = [x for x in rows]",
        'total = g(rows)\nfor k in range(3):\n    total += k\npaper.table("t", total)\n'
        'paper.table("u", other)\npaper.table("w", f(3))\nplot(other, rows)\n'
        'paper.figure(fig, "v")',
    ]
    cells = [trace.Cell(NAME, i, 1, source, ()) for i, source in enumerate(sources, start=1)]
    monkeypatch.setattr(trace, "code_cells", lambda notebook: cells)
    made = {
        name: [earlier.number for earlier in trace.made_in(cell)]
        for (_, name), cell in trace.handed_on(NAME).items()
    }
    assert made == {"t": [1], "u": [1, 3], "w": [2], "v": [1, 2, 3]}


def test_a_claim_is_told_with_its_verdict():
    claim, verdict = next(iter(files.read_json(paths.VERDICTS)[claims.read().reading].items()))
    (entry,) = [each for each in claims.read().numbers if each.id == claim]
    assert f"{claim!r}: {verdict.split(' | ')[-1]}" in traced(entry.ours)["claim"][0]


def test_every_claim_is_found_by_the_keys_it_rests_on():
    keys = claims.needed(claims.read().reading)
    found = {claim.split(".")[0] for key in keys for claim in claims.resting_on(key)}
    assert found == {entry.id.split(".")[0] for entry in claims.read().numbers} | {
        entry.id for entry in claims.read().prose
    }


def test_what_is_counted_from_the_verdicts_says_so():
    assert "verdict_tables" in traced("claims.prose.total")["kind"][0]


def test_an_unknown_name_is_a_sentence(capsys):
    assert main(["why", "onlin.p0.4.ratio"]) == 1
    assert "did you mean 'online.p0.4.ratio'" in capsys.readouterr().err


# --- links of the PDF ---------------------------------------------------------------------------

BODY = paper_text()


def test_each_table_and_figure_of_the_paper_has_a_link_to_its_cell():
    marked = set(re.findall(r"csname cell@(\S+?)\\endcsname", links.latex()))
    shown = {f"figure@{book}_{name}" for book, name in re.findall(r"\\fig\{(\w+)\}\{(\w+)\}", BODY)}
    tables = set(re.findall(r"(?:\\tab\{|generated/tab_)(\w+)\}", BODY))
    shown |= {f"table@{name}" for name in tables if not name.startswith("claims_")}
    assert len(shown) > 40
    assert shown <= marked


def test_links_go_to_files_until_the_repository_has_an_address(monkeypatch):
    assert "://" not in links.latex()
    assert (paths.PAPER / links.notebook_address("04_cost")).exists()
    monkeypatch.setattr(links, "repository", lambda: "https://example.org/sngr")
    monkeypatch.setattr(links, "commit", lambda: "c0ffee")
    (cell,) = [c for (kind, name), c in trace.handed_on("04_cost").items() if name == "saving"]
    address = "https://example.org/sngr/blob/c0ffee/notebooks/04_cost.ipynb"
    mark = rf"\href{{{address}?plain=1\#L{cell.line}}}{{[{cell.number}]}}"
    assert rf"csname cell@figure@04_cost_saving\endcsname{{{mark}}}" in links.latex()
    monkeypatch.setattr(links, "commit", lambda: "")  # an archive: nothing to pin to
    assert "://" not in links.latex()


@pytest.mark.parametrize("text", ["[]", "", "repository-code: ftp://x", "repository-code: 3", "{"])
def test_an_address_that_is_none_is_a_sentence(tmp_path, monkeypatch, text):
    (tmp_path / "CITATION.cff").write_text(text)
    monkeypatch.setattr(paths, "CITATION", tmp_path / "CITATION.cff")
    with pytest.raises(notebooks.ProjectError, match=r"CITATION\.cff"):
        links.repository()


def test_a_folder_without_history_has_no_commit(tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    assert links.commit() == ""


# --- when it was verified -----------------------------------------------------------------------


def test_verified_says_when_and_whether_anything_changed_since(tmp_path):
    make_project(tmp_path)
    (tmp_path / "paper/reference").mkdir()
    (tmp_path / f"paper/reference/{NAME}.json").write_text('{"a": {"value": 1}, "b": {"value": 2}}')
    with at_home_in(tmp_path):
        hashes = freshness.inputs(NAME, parameters.read_params(NAME))
        assert verified.last(NAME, hashes).startswith("never")
        aside = paths.BUILD / "verify" / NAME
        aside.mkdir(parents=True)
        files.write_json(aside / verified.SECONDS, {"seconds": 90.0})
        assert verified.minutes() == {}
        verified.remember()
        assert verified.minutes() == {NAME: 1.5}
        assert files.read_json(paths.VERIFIED)["values"] == 2
        told = verified.last(NAME, hashes)
        assert told.startswith(date.today().isoformat())
        assert told.endswith("2 values held; its inputs are the same now")
        assert verified.last(NAME, hashes | {"package": "x"}).endswith("have CHANGED since")
        for spoiled in ("", "null", "[]", '{"date": 1}'):
            paths.VERIFIED.write_text(spoiled)
            assert verified.last(NAME, hashes).startswith("never")
            assert verified.minutes() == {}
