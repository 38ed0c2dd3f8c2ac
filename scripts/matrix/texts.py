"""Situations of what a user writes: YAML that is wrong, hostile or merely odd."""

import re

from copies import NAME, ROOT, Copy

SITUATIONS = {}
BOMB = "a: &a0 [0]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)
)
NONE = ("", " ", "\0", "null", "[]", "3", "- a", "%", "a: b: c", "\ta: 1", "{", "&a [*a]", BOMB,
        "!!python/object/apply:os.system [exit]", "a: 1\na: 2", "\xef\xbb\xbf" * 2, "[" * 3000,
        "x" * 1_100_000, "--- 1\n--- 2", "? [a]\n: 1", "<<: 3", "caf\xe9: 1")  # fmt: skip
VALUES = (".nan", ".inf", "-1e999", "1e999", "true", "null", "''", "high", "[]", "{}", "[[[1]]]",
          "2020-01-01", "0x1f", "1_000", "!!binary aGk=", "!!set {a, b}", "-0.0", "1:30",
          "9" * 5000,
          "*nothing", "&a 3", "~", "'1'", "1.0.0", "1e-999", "!!str 1", "[1, .nan]")  # fmt: skip
ACCEPTED = {"0x1f", "1_000", "&a 3", "1:30", "9" * 5000, "2020-01-01"}  # YAML's own whole numbers


def situation(name):
    """Register a function under a name."""
    return lambda function: SITUATIONS.setdefault(name, function)


CHECK = """
import sys, json, io, contextlib
from pathlib import Path
from sngr_utils.__main__ import main
path, texts = Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text())
good = path.read_bytes()
for text in texts:
    path.write_bytes(text.encode("latin-1"))
    shown = io.StringIO()
    with contextlib.redirect_stderr(shown), contextlib.redirect_stdout(shown):
        try:
            status = main(["check"])
        except BaseException as error:
            status = repr(error)[:80]
    lines = shown.getvalue().splitlines()
    if status == 0 or len(lines) != 1 or sys.argv[1] not in lines[0] or len(lines[0]) > 2000:
        print(repr(text[:60]), status, [line[:120] for line in lines[:3]])
path.write_bytes(good)
"""


def check_each(copy: Copy, file: str, texts: list[str]) -> list[str]:
    """What a check does not refuse in one line that names the file, for each text in its place."""
    import json

    copy.write("check.py", CHECK)
    copy.write("texts.json", json.dumps(texts))
    done = copy.run(".venv/bin/python", "check.py", file, "texts.json", timeout=300)
    assert done.status == 0, done.text[-500:]
    return done.text.splitlines()


@situation("parameters that are no YAML, or no parameters")
def _(copy):
    for file in (f"params/{NAME}.yaml", f"params/quick/{NAME}.yaml", "paper/claims.yaml"):
        assert not (left := check_each(copy, file, list(NONE))), left


@situation("hostile values of each kind of parameter")
def _(copy):
    text = (copy.root / f"params/{NAME}.yaml").read_text()
    for key in ("range_sigma", "seed"):
        old = re.search(rf"^{key}:.*$", text, flags=re.M)[0]
        values = [value for value in VALUES if value not in ACCEPTED]
        if key == "range_sigma":
            values = [value for value in values if value not in ("9" * 5000, "1:30")]
        texts = [text.replace(old, f"{key}: {value}") for value in values]
        assert not (left := check_each(copy, f"params/{NAME}.yaml", texts)), left


@situation("a typo in each key of each YAML")
def _(copy):
    code = f"""
import sys
from pathlib import Path
from tempfile import mkdtemp
from sngr_utils import paths
paths.NOTEBOOKS = Path({str(ROOT / "notebooks")!r})
from sngr_utils.publish import parameters, notebooks
folder, tried = Path(mkdtemp()), 0
for path in sorted(Path({str(ROOT / "params")!r}).rglob("*.yaml")):
    lines = path.read_text().splitlines()
    for i, line in enumerate(lines):
        if not line[:1].isalpha():
            continue
        key, tried = line.split(":")[0], tried + 1
        for typo in (key[:-1], key + "s", key.upper(), "", key.replace("_", "-") + "x"):
            text = "\\n".join([*lines[:i], typo + line[len(key):], *lines[i + 1:]])
            (folder / path.name).write_text(text)
            try:
                parameters.read_params(path.stem, folder)
                print(path.name, repr(typo), "was taken")
            except notebooks.ProjectError as error:
                if "\\n" in str(error) or path.name not in str(error):
                    print(path.name, repr(typo), error)
assert tried > 100
"""
    copy.write("typos.py", code)
    done = copy.run(".venv/bin/python", "typos.py", timeout=300)
    assert (done.status, done.text) == (0, ""), done.text[-800:]


@situation("a parameters cell that is hostile")
def _(copy):
    file = f"notebooks/{NAME}.ipynb"
    text = (copy.root / file).read_text()
    (first,) = re.findall(r'"(seed: int = 0[^"]*)"', text)[:1]
    for source in ("seed: int = (", "seed: int = __import__('os').abort()", "seed = 0", "%run x",
                   "seed: __import__('os').abort() = 0", "seed: int = 10 ** 10 ** 10"):  # fmt: skip
        copy.write(file, text.replace(first, source + "\\n"))
        copy.refuses("check", names=NAME)
