"""Situations of files: each below build/, figures/, params/ and paper/ damaged in turn."""

import shutil

from copies import NAME, Copy, need

SITUATIONS = {}
DAMAGE = """
import contextlib, functools, io, os, shutil, sys
from pathlib import Path
from sngr_utils.__main__ import main
from sngr_utils.publish import dependencies, claims, printed
dependencies.import_graph = functools.cache(dependencies.import_graph)
NAME, FOLDER = sys.argv[1:]
PRECIOUS = Path("precious")
KINDS = {
    "missing": lambda path: None,
    "empty": lambda path: path.write_bytes(b""),
    "null": lambda path: path.write_text("null"),
    "a list": lambda path: path.write_text("[1]"),
    "not text": lambda path: path.write_bytes(b"\\xff\\xfe\\0"),
    "half": lambda path: path.write_bytes(good[: len(good) // 2]),
    "a folder": lambda path: (path / "in it").mkdir(parents=True),
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to another file": lambda path: path.symlink_to(PRECIOUS.resolve()),
}

def ask(*command):
    for read in (claims.read, printed.leaves):
        read.cache_clear()
    shown = io.StringIO()
    with contextlib.redirect_stderr(shown), contextlib.redirect_stdout(shown):
        try:
            return main(list(command)), shown.getvalue()
        except BaseException as error:
            return repr(error)[:150], shown.getvalue()

def remove(path):
    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)

tried = 0
for path in sorted(p for p in Path(FOLDER).rglob("*") if p.is_file() and "cache" not in p.parts):
    good = path.read_bytes()
    for kind, spoil in KINDS.items():
        PRECIOUS.write_text("precious")
        remove(path)
        spoil(path)
        tried += 1
        for command in (["check"], ["stale"], ["notebook", NAME], ["latex"]):
            status, text = ask(*command)
            lines = [line for line in text.splitlines() if "error: " in line]
            if status not in (0, 1) or (status == 1) != (len(lines) == 1) or len(text) > 2000:
                print(path, kind, command[0], status, text[:200])
        if PRECIOUS.read_text() != "precious":
            print(path, kind, "the link was written through")
        remove(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(good)
    if ask("notebook", NAME)[0] != 0:
        print(path, "cannot be brought back", ask("notebook", NAME))
assert tried > 5, tried
"""


def damage(folder: str) -> None:
    """Register the damage of each file of a folder as a situation."""

    def each(copy: Copy) -> None:
        copy.write("damage.py", DAMAGE)
        done = copy.run(".venv/bin/python", "damage.py", NAME, folder, timeout=400)
        assert done.status == 0, done.text[-600:]
        said = [line for line in done.text.splitlines() if "Warning" not in line]
        assert not said, "\n".join(said[:8])

    SITUATIONS[f"each file of {folder}/ damaged in turn"] = each


for folder in ("build/results", "build/runs", "build/executed", "figures", "params", "paper"):
    damage(folder)


def spoil_typesetting(copy: Copy) -> None:
    """Damage all that LaTeX has left, in one way after the other; the PDF is made all the same."""
    need("latexmk", "--version", reason="TeX is missing")
    precious = copy.write("precious", "precious")
    ways = {
        "empty": lambda path: path.write_bytes(b""),
        "not text": lambda path: path.write_bytes(b"\xff\xfe\0"),
        "a folder": lambda path: (path / "in it").mkdir(parents=True),
        "a link to itself": lambda path: path.symlink_to(path.name),
        "a link to another file": lambda path: path.symlink_to(precious),
    }
    for way, spoil in ways.items():
        left = [path for path in (copy.root / "build/paper").iterdir() if path.is_file()]
        assert left
        for path in left:
            path.unlink()
            spoil(path)
        try:
            copy.works("pdf")
            copy.same_as_template()
        except AssertionError as error:
            raise AssertionError(f"{way}: {error}") from error
        assert precious.read_text() == "precious", f"{way} was written through"
    shutil.rmtree(copy.root / "build/paper")
    copy.write("build/paper", "a file")
    copy.works("pdf")


SITUATIONS["each file of build/paper/ damaged, and the folder a file"] = spoil_typesetting


def no_folder(copy: Copy) -> None:
    """A file or a link to nothing where a folder belongs: one line that says so, or it works."""
    folders = ("build", "build/results", "build/runs", "build/executed", "build/cache", "figures",
               "paper/generated", "params/quick")  # fmt: skip
    ways = {
        "a file": lambda path: path.write_text("a file"),
        "a link to nothing": lambda path: path.symlink_to("nowhere"),
    }
    for folder in folders:
        path, aside = copy.root / folder, copy.root / "aside"
        for way, spoil in ways.items():
            path.rename(aside)
            spoil(path)
            for target in ("check", f"run/{NAME}", "pdf"):
                done = copy.run("make", target)
                where = f"{way} in place of {folder}: make {target}: {done.text[-300:]}"
                assert "Traceback" not in done.text, where
                assert done.status == 0 or "error: " in done.text, where
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            path.unlink(missing_ok=True)
            aside.rename(path)
    copy.works("check", f"run/{NAME}", "pdf")
    copy.same_as_template()


SITUATIONS["a file or a dangling link where a folder belongs"] = no_folder
