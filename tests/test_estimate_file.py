"""The command `estimate`: what it prints and writes, and that it ends in one line."""

from dataclasses import replace
from pathlib import Path
from threading import current_thread, main_thread

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sngr_utils import __main__ as command_line
from sngr_utils import estimate_file
from sngr_utils.files import pyfg, table_writer
from sngr_utils.files.recording import Recording
from sngr_utils.robust import growing_map
from sngr_utils.world.log import NO_LABEL, LogWarning
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate


@pytest.fixture
def log_file(tmp_path):
    world = simulate(Scenario(n_poses=30, n_landmarks=3), 0.2, rng=np.random.default_rng(100))
    path = tmp_path / "mine.pyfg"
    pyfg.write(path, world.log([0.01, 0.01, 0.001]), world.poses, world.landmarks)
    return path


def test_a_summary_a_trajectory_and_a_picture_and_nothing_is_overwritten(log_file, capsys):
    assert command_line.main(["estimate", str(log_file)]) == 0
    said = capsys.readouterr().out
    assert "30 poses, 90 ranges, 3 landmarks" in said
    assert "aligned RMSE against the truth 0." in said
    assert "nothing speaks against it" in said or "IT MAY BE WRONG" in said
    assert np.loadtxt(log_file.with_name("mine_estimate.tum")).shape == (30, 8)
    assert log_file.with_name("mine_estimate.png").read_bytes()[:4] == b"\x89PNG"
    assert command_line.main(["estimate", str(log_file)]) == 1
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, b"", b"\x00\xff" * 100, b"VERTEX_SE2 0 A0 nan 0 0\n"])
def test_a_hostile_file_ends_in_one_line(tmp_path, capsys, content):
    path = tmp_path / "mine.pyfg"
    if content is not None:
        path.write_bytes(content)
    assert command_line.main(["estimate", str(path)]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"error: {path}")
    assert said.count("\n") == 1


def test_a_plaza_set_goes_by_its_name_and_a_file_of_that_name_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = []
    monkeypatch.setattr(estimate_file, "_places", lambda *of: given.append(of) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        estimate_file.run(Path("Plaza2"), None, False)
    assert given == [(Path("Plaza2"), None, False)]  # what is written stands here
    Path("Plaza2").touch()
    with pytest.raises(ValueError, match="Plaza2: neither one of"):
        estimate_file.run(Path("Plaza2"), None, False)


def test_no_picture_stays_open(log_file):
    before = plt.get_fignums()
    assert command_line.main(["estimate", str(log_file)]) == 0
    assert plt.get_fignums() == before


def test_what_only_the_estimator_can_refuse_names_the_file_too(log_file, capsys):
    lines = log_file.read_text().splitlines()
    kept = (line + "\n" for line in lines if not line.startswith("EDGE_RANGE"))
    log_file.write_text("".join(kept))
    assert command_line.main(["estimate", str(log_file)]) == 1
    assert capsys.readouterr().err == (
        f"error: {log_file}: there is nothing to estimate: no landmark or no range\n"
    )


def test_a_file_that_may_have_been_cut_off_says_so(log_file, capsys):
    text = log_file.read_text()
    log_file.write_text(text[:-2])  # within its last number, which stays one
    assert command_line.main(["estimate", str(log_file)]) == 0
    n = text.count("\n")
    assert f"{log_file}:{n}: this line has no end" in capsys.readouterr().err


def test_ranges_that_are_all_noise_or_numbers_beyond_all_measure_name_the_file(tmp_path, capsys):
    world = simulate(Scenario(n_poses=10, n_landmarks=3), 0.0, rng=np.random.default_rng(100))
    log = world.log([0.01, 0.01, 0.001])
    below = replace(log, ranges=np.full(30, -0.3))
    beyond = replace(log, odometry=1e19 * log.odometry)
    for changed, why in ((below, "no range is above zero"), (beyond, "are too large or too small")):
        table_writer.write(tmp_path, Recording(changed, None, list("abc")))
        assert command_line.main(["estimate", str(tmp_path)]) == 1
        said = capsys.readouterr().err
        assert said.startswith(f"error: {tmp_path}: ")
        assert why in said


def test_what_cannot_be_written_is_refused_before_the_work(log_file, capsys, monkeypatch):
    monkeypatch.setattr(growing_map, "estimate", None)  # it would be a TypeError
    dangling, folder = (log_file.with_name(f"mine_estimate.{end}") for end in ("tum", "png"))
    dangling.symlink_to("nowhere")
    assert command_line.main(["estimate", str(log_file)]) == 1
    assert f"{dangling} is there already" in capsys.readouterr().err
    folder.mkdir()
    assert command_line.main(["estimate", str(log_file), "--overwrite"]) == 1
    assert capsys.readouterr().err == f"error: {folder} is a folder: --out DIR writes elsewhere\n"

    def read_only(**where):
        raise PermissionError(13, "Permission denied", f"{where['dir']}/x")

    monkeypatch.setattr("tempfile.mkdtemp", lambda suffix, prefix, dir: read_only(dir=dir))
    out = log_file.parent / "out"
    assert command_line.main(["estimate", str(log_file), "--out", str(out)]) == 1
    assert capsys.readouterr().err == f"error: {out}: Permission denied\n"


def test_what_was_there_stays_whole_when_the_work_ends_half_way(log_file, monkeypatch):
    there = log_file.with_name("mine_estimate.tum")
    there.write_text("of yesterday")
    before = sorted(log_file.parent.iterdir())

    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("sngr_utils.estimate_file._draw", interrupted)
    with pytest.raises(KeyboardInterrupt):
        command_line.main(["estimate", str(log_file), "--overwrite"])
    assert there.read_text() == "of yesterday"
    assert sorted(log_file.parent.iterdir()) == before


def test_landmarks_in_doubt_are_called_as_in_the_file_and_labels_need_to_be_there(tmp_path, capsys):
    world = simulate(Scenario(n_poses=20, n_landmarks=3), 0.0, rng=np.random.default_rng(101))
    log = world.log([0.01, 0.01, 0.001])
    names = ["west", "7", "5"]
    table_writer.write(tmp_path / "a", Recording(log.keep(log.label_of != 1), None, names))
    assert command_line.main(["estimate", str(tmp_path / "a")]) == 0
    said = capsys.readouterr()
    assert said.err == "warning: landmarks 7 have no range\n"
    assert "IT MAY BE WRONG: landmarks 7 have hardly a range" in said.out
    assert "of the labels are wrong" in said.out
    unlabelled = replace(log, label_of=np.full(len(log.ranges), NO_LABEL))
    table_writer.write(tmp_path / "b", Recording(unlabelled, None, names))
    assert command_line.main(["estimate", str(tmp_path / "b")]) == 0
    said = capsys.readouterr().out
    assert "labels" not in said
    assert "of the ranges are from no landmark" in said
    assert "which name is whose is arbitrary" in said


def test_a_landmark_that_is_none_is_told(tmp_path, capsys):
    """Four names, and ranges from three: the fourth is found on top of another one."""
    world = simulate(Scenario(n_poses=60, n_landmarks=3), 0.2, rng=np.random.default_rng(102))
    log = world.log([0.01, 0.01, 0.001])
    label = np.where(np.arange(len(log.ranges)) % 10 == 0, 3, log.label_of)
    more = replace(
        log, n_landmarks=4, landmark_means=np.full((4, 2), np.nan),
        landmark_sigmas=np.full(4, np.nan), label_of=label,
    )  # fmt: skip
    table_writer.write(tmp_path / "a", Recording(more, None, ["a", "b", "c", "d"]))
    assert command_line.main(["estimate", str(tmp_path / "a")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "60 poses, 180 ranges, 4 landmarks"
    for name in "abcd":
        (line,) = (line for line in lines if line.startswith(f"landmark {name} "))
        assert ("or nowhere" in line) == (name == "d"), line
    assert "nothing speaks against it" not in lines


def test_names_that_labels_exchange_for_a_time_are_told(tmp_path, capsys):
    world = simulate(Scenario(n_poses=60, n_landmarks=3), 0.2, rng=np.random.default_rng(101))
    log = world.log([0.01, 0.01, 0.001])
    late = (log.pose_of >= 40) & (log.label_of < 2)
    turned = replace(log, label_of=np.where(late, 1 - log.label_of, log.label_of))
    table_writer.write(tmp_path / "a", Recording(turned, None, ["a", "b", "c"]))
    assert command_line.main(["estimate", str(tmp_path / "a")]) == 0
    said = capsys.readouterr().out
    assert "IT MAY BE WRONG: labels exchange landmarks a, b for a time" in said


def test_the_work_is_done_where_an_interrupt_is_not_raised(log_file, capsys, monkeypatch):
    """Signals are raised in the main thread; in numba's hands they would end it without a word."""

    def work(log, progress):
        raise ValueError(f"in the main thread: {current_thread() is main_thread()}")

    monkeypatch.setattr(growing_map, "estimate", work)
    assert command_line.main(["estimate", str(log_file)]) == 1
    assert capsys.readouterr().err == f"error: {log_file}: in the main thread: False\n"


def test_a_reader_of_the_summary_that_goes_away_costs_no_result(log_file, capsys, monkeypatch):
    def gone(*given):
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("sngr_utils.estimate_file.summary", gone)
    assert command_line.main(["estimate", str(log_file)]) == 1
    assert "error: Broken pipe" in capsys.readouterr().err
    assert log_file.with_name("mine_estimate.tum").exists()


def test_a_landmark_that_is_not_found_has_no_place(tmp_path, capsys):
    world = simulate(Scenario(n_poses=20, n_landmarks=2), 0.0, rng=np.random.default_rng(102))
    log = world.log([0.01, 0.01, 0.001])
    with pytest.warns(LogWarning, match="no range"):
        log = replace(log, n_landmarks=4, landmark_means=None, landmark_sigmas=None)
    table_writer.write(tmp_path, Recording(log, None, list("abcd")))
    assert command_line.main(["estimate", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "is not found\n" in said
    assert "nan" not in said


def test_labels_are_not_judged_where_chances_stand_for_them(tmp_path, capsys):
    world = simulate(Scenario(n_poses=20, n_landmarks=2), 0.0, rng=np.random.default_rng(103))
    log = world.log([0.01, 0.01, 0.001])
    chances = np.full((len(log.ranges), 2), 0.5)
    table_writer.write(
        tmp_path, Recording(replace(log, label_probabilities=chances), None, ["a", "b"])
    )
    assert command_line.main(["estimate", str(tmp_path)]) == 0
    assert "of the labels are wrong" not in capsys.readouterr().out


def test_a_name_in_the_file_does_not_command_the_terminal(tmp_path, capsys):
    world = simulate(Scenario(n_poses=20, n_landmarks=2), 0.0, rng=np.random.default_rng(104))
    names = ["\x1b[2Ja", "b"]
    table_writer.write(tmp_path, Recording(world.log([0.01, 0.01, 0.001]), None, names))
    assert command_line.main(["estimate", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "\x1b" not in said
    assert "landmark \\x1b[2Ja at" in said
