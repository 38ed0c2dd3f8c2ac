"""When the results were last re-run and found to be the reference: ``paper/verified.json``."""

from datetime import date

from sngr_utils import paths
from sngr_utils.publish import notebooks
from sngr_utils.publish.execution import SECONDS
from sngr_utils.publish.files import read_json, write_json
from sngr_utils.publish.freshness import MALFORMED, digest, inputs
from sngr_utils.publish.links import commit
from sngr_utils.publish.parameters import read_params


def remember() -> None:
    """Write down that all values hold today, what each notebook was made from, its minutes."""
    names = notebooks.names()
    clocks = {name: paths.BUILD / "verify" / name / SECONDS for name in names}
    record = {
        "date": date.today().isoformat(),
        "commit": commit(),
        "values": sum(len(read_json(paths.REFERENCE / f"{name}.json")) for name in names),
        "inputs": {name: digest(inputs(name, read_params(name))) for name in names},
        "minutes": {
            name: round(read_json(path)["seconds"] / 60, 1)
            for name, path in clocks.items() if path.exists()
        },
    }  # fmt: skip
    write_json(paths.VERIFIED, record)


def minutes() -> dict[str, float]:
    """Minutes of each notebook when all were last verified; empty if that never was."""
    try:
        return {name: float(took) for name, took in read_json(paths.VERIFIED)["minutes"].items()}
    except MALFORMED:
        return {}


def last(name: str, hashes: dict[str, str]) -> str:
    """When a notebook was last verified, and whether its inputs, by their hashes, are the same."""
    try:
        record = read_json(paths.VERIFIED)
        same = record["inputs"].get(name) == digest(hashes)
        where = f"{record['date']} at commit {record['commit'][:12] or 'unknown'}"
        told = f"{where}: {record['values']} values held"
    except MALFORMED:
        return "never, as far as paper/verified.json knows: make verify"
    return f"{told}; its inputs {'are the same now' if same else 'have CHANGED since'}"
