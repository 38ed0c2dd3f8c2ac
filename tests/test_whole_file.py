"""A file is there whole or as it was before."""

import os
from multiprocessing import Process
from pathlib import Path

import pytest

from sngr_utils import whole_file


@pytest.fixture
def full_disk(monkeypatch):
    """The second file that is written finds no space for its second half."""
    written, write = [], Path.write_text

    def fails(path: Path, text: str, **options) -> None:
        written.append(path)
        write(path, text if len(written) == 1 else text[: len(text) // 2], **options)
        if len(written) > 1:
            raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_text", fails)


def test_what_cannot_be_written_whole_leaves_all_as_it_was(tmp_path, full_disk):
    before = {tmp_path / name: f"old {name}" for name in "ab"}
    for path, text in before.items():
        with open(path, "w") as file:
            file.write(text)
    with pytest.raises(OSError, match="No space"):
        whole_file.write_texts(dict.fromkeys(before, "new " * 10))
    assert {path: path.read_text() for path in before} == before
    assert len(list(tmp_path.iterdir())) == 2


def test_a_link_is_replaced_and_not_followed(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("kept")
    (tmp_path / "link").symlink_to(precious)
    whole_file.write_text(tmp_path / "link", "new")
    (tmp_path / "other").symlink_to(precious)
    whole_file.copy(tmp_path / "link", tmp_path / "other")
    assert precious.read_text() == "kept"
    assert [(tmp_path / name).read_text() for name in ("link", "other")] == ["new", "new"]


def test_two_writers_leave_one_whole_file(tmp_path):
    path, texts = tmp_path / "file", [letter * 1_000_000 for letter in "ab"]
    writers = [Process(target=_write_often, args=(path, text)) for text in texts]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert not path.exists() or path.read_text() in texts
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert path.read_text() in texts
    assert os.listdir(tmp_path) == ["file"]


def _write_often(path: Path, text: str) -> None:
    for _ in range(20):
        whole_file.write_text(path, text)
