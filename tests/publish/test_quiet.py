"""How busy a machine was while something was timed, and that who times is told."""

import subprocess
import sys
from collections import namedtuple

import psutil
import pytest

from sngr_utils.publish import execution, files, quiet

Times = namedtuple("Times", "user nice system idle iowait steal guest guest_nice")


def test_others_are_what_ran_beside_us_on_all_cores(monkeypatch):
    """Of ten seconds on two cores four are ours, three others', one another machine's."""
    clocks = iter([Times(*[0.0] * 8), Times(6.0, 1.0, 0.0, 10.0, 2.0, 1.0, 5.0, 1.0)])
    spent = iter([(1.0, 0.0, 2.0, 0.0, 9.0), (2.0, 1.0, 4.0, 0.0, 19.0)])
    monkeypatch.setattr(psutil, "cpu_times", lambda: next(clocks))
    monkeypatch.setattr(quiet.os, "times", lambda: next(spent))
    assert quiet.others(quiet.read(), quiet.read()) == pytest.approx((6 + 1 + 1 - 4) / 20)


def test_a_process_of_our_own_is_not_another_and_one_that_goes_on_is():
    """Once waited for, its second of work is ours; until then, it is somebody else's."""
    work = "import time\nwhile time.process_time() < 1: pass\nprint(flush=True)\ninput()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    before = quiet.read()
    with subprocess.Popen([sys.executable, "-c", work], **pipes) as child:
        child.stdout.readline()  # it has worked for a second
        meanwhile = quiet.read()
        child.communicate(b"\n")
    after = quiet.read()
    assert meanwhile.own - before.own < 0.3
    assert after.own - before.own > 0.9


@pytest.mark.parametrize("timed", [True, False])
def test_who_hands_on_times_says_how_busy_the_machine_was(tmp_path, timed):
    clocks = tmp_path / "04_x.timings.json"
    if timed:
        files.write_json(clocks, {"notebook": "04_x", "values": {}, "tables": {}})
    execution._note_others(clocks, 0.25)
    assert clocks.exists() == timed
    if timed:
        assert files.entries(files.read_json(clocks))["clock.04_x.others"]["value"] == 0.25
