"""`.pyfg` and `.fg`: what a line means, what comes back, what is refused and where."""

import os
import re
from dataclasses import fields

import numpy as np
import pytest

from sngr_utils.files import formats, nsfg, pyfg
from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.log import Log
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate

PYFG = """\
VERTEX_XY L2 5.0 6.0
EDGE_RANGE 2.0 A10 L2 3.5 0.25
VERTEX_SE2 2.0 A10 3.1 0.2 0.3
VERTEX_SE2 0.0 A1 1.0 0.0 0.0
VERTEX_SE2 1.0 A2 2.0 0.0 0.0

EDGE_SE2 1.0 A2 A10 1.0 0.1 0.2 0.04 0.001 0.002 0.05 0.003 0.06
EDGE_SE2 0.0 A1 A2 1.0 0.0 0.0 0.04 0.0 0.0 0.04 0.0 0.01
VERTEX_XY L1 -1.0 2.0
EDGE_RANGE 0.0 A1 L1 2.5 0.01
VERTEX_SE2:PRIOR 0.0 A1 1.0 0.0 0.0 0.01 0.0 0.0 0.04 0.0 0.0009
VERTEX_XY:PRIOR 0.0 L1 -1.1 2.1 0.09 0.0 0.09
"""
NSFG = """\
Variable Pose SE2 X0 0.0 0.0 1.5
Variable Pose SE2 X1 0.0 30.0 1.5
Variable Landmark R2 L1 30.0 -30.0
Variable Landmark R2 L2 60.0 -30.0
Factor UnarySE2ApproximateGaussianPriorFactor X0 0 0 1.5 covariance 0.04 0 0 0 0.01 0 0 0 0.0004
Factor SE2RelativeGaussianLikelihoodFactor X0 X1 30 0 0 covariance .04 0 0 0 .01 .0001 0 .0001 .0004
Factor SE2R2RangeGaussianLikelihoodFactor X0 L2 67.1 2
Factor AmbiguousDataAssociationFactor Observer X1 Observed L2 L1 Weights 3 1 Binary \
SE2R2RangeGaussianLikelihoodFactor Observation 67.2 Sigma 3
"""


def written(tmp_path, text, suffix=".pyfg"):
    path = tmp_path / f"log{suffix}"
    path.write_text(text)
    return path


def same(a: Log, b: Log) -> None:
    for field in fields(Log):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if x is None or y is None:
            assert x is y, field.name
        else:
            np.testing.assert_allclose(x, y, rtol=1e-12, atol=0, err_msg=field.name)


def test_pyfg_lines_in_any_order_and_the_last_number_of_a_range_is_a_variance(tmp_path):
    found = pyfg.read(written(tmp_path, PYFG))
    log = found.log
    assert found.landmark_names == ["L1", "L2"]
    assert log.times.tolist() == [0, 1, 2]
    assert log.odometry.tolist() == [[1, 0, 0], [1, 0.1, 0.2]]
    expected = [[0.04, 0.001, 0.002], [0.001, 0.05, 0.003], [0.002, 0.003, 0.06]]
    assert log.odometry_covariances[1].tolist() == expected
    # sorted by pose: the file's second range comes first
    assert log.row_of.tolist() == [1, 0]
    assert log.ranges.tolist() == [2.5, 3.5]
    np.testing.assert_allclose(log.range_sigmas, [0.1, 0.5])
    assert log.label_of.tolist() == [0, 1]
    np.testing.assert_allclose(log.x0_sigmas, [0.1, 0.2, 0.03])
    np.testing.assert_allclose(log.landmark_sigmas, [0.3, np.nan])
    assert found.truth.poses[2].tolist() == [3.1, 0.2, 0.3]
    assert found.truth.landmarks.tolist() == [[-1, 2], [5, 6]]


def test_pyfg_vertices_that_are_dead_reckoning_are_no_truth(tmp_path):
    text = PYFG.replace("A10 3.1 0.2 0.3", "A10 3.0 0.1 0.2")
    assert pyfg.read(written(tmp_path, text)).truth.poses is None


def test_pyfg_without_a_prior_or_times_has_a_frame_and_the_numbers_of_its_poses(tmp_path):
    text = re.sub(r"VERTEX_SE2 \S+", "VERTEX_SE2 7.0", re.sub(r".*PRIOR.*", "", PYFG))
    log = pyfg.read(written(tmp_path, text)).log
    assert log.x0_mean.tolist() == [1, 0, 0]
    np.testing.assert_allclose(log.x0_sigmas, [0.01, 0.01, 0.001])
    assert log.times.tolist() == [0, 1, 2]


def test_a_simulated_world_comes_back_from_pyfg(tmp_path):
    drawn = simulate(Scenario(n_poses=12), 0.3, rng=np.random.default_rng(100))
    log = drawn.log([0.1, 0.1, 0.05])
    pyfg.write(tmp_path / "a.pyfg", log, drawn.poses, drawn.landmarks)
    found = formats.read(tmp_path / "a.pyfg")
    same(found.log, log)
    np.testing.assert_array_equal(found.truth.poses, drawn.poses)
    np.testing.assert_array_equal(found.truth.landmarks, drawn.landmarks)


def test_pyfg_comes_back_from_pyfg(tmp_path):
    found = pyfg.read(written(tmp_path, PYFG))
    pyfg.write(tmp_path / "b.pyfg", found.log, found.truth.poses, found.truth.landmarks)
    again = pyfg.read(tmp_path / "b.pyfg").log
    same(again, pyfg.read(tmp_path / "b.pyfg").log)
    np.testing.assert_allclose(again.odometry_covariances, found.log.odometry_covariances)
    np.testing.assert_allclose(again.landmark_sigmas, found.log.landmark_sigmas)


def test_what_pyfg_cannot_express_is_not_written(tmp_path):
    log = simulate(Scenario(n_poses=3), 0.0, rng=np.random.default_rng(100)).log([1, 1, 1])
    args = dead_reckoning(log.x0_mean, log.odometry), np.zeros((6, 2))
    given = {field.name: getattr(log, field.name) for field in fields(Log)}
    for changed, why in (
        ({"label_of": np.full(18, -1)}, "without a label"),
        ({"scale": (1.0, np.inf)}, "scale: .pyfg has not a range scale"),
        ({"offset": (0.1, 0.0)}, "offset: .pyfg has not"),
        ({"label_probabilities": np.full((18, 6), 0.1)}, "chances of a label"),
        ({"times": [7.0] * 3}, "times: .pyfg has not"),
    ):
        with pytest.raises(ValueError, match=why):
            pyfg.write(tmp_path / "c.pyfg", Log(**{**given, **changed}), *args)
    with pytest.raises(ValueError, match=r"c.pyfg: landmarks\[0\]"):
        pyfg.write(tmp_path / "c.pyfg", log, args[0], np.full((6, 2), np.nan))
    assert not (tmp_path / "c.pyfg").exists()


def test_fg_weights_become_chances_and_the_last_number_of_a_range_is_a_sigma(tmp_path):
    found = nsfg.read(written(tmp_path, NSFG, ".fg"))
    log = found.log
    assert log.range_sigmas.tolist() == [2, 3]
    assert log.label_of.tolist() == [1, -1]
    assert log.label_probabilities.tolist() == [[0, 1], [0.25, 0.75]]
    assert log.odometry_covariances[0, 1, 2] == 0.0001
    np.testing.assert_allclose(log.x0_sigmas, [0.2, 0.1, 0.02])
    assert found.truth.poses.tolist() == [[0, 0, 1.5], [0, 30, 1.5]]


PYFG_BAD = [
    ("VERTEX_XY L2 5.0", "VERTEX_XYZ L2 5.0 1.0", ":1: VERTEX_XYZ: three dimensions"),
    ("VERTEX_SE2 1.0 A2", "VERTEX_SE2 1.0 B2", ":5: a pose of a second robot, B2"),
    ("A10 L2 3.5", "A10 A2 3.5", ":2: a range between poses"),
    ("A10 L2 3.5", "A10 L3 3.5", ":2: L3 is no landmark"),
    ("A10 L2 3.5", "A3 L2 3.5", ":2: A3 is no pose"),
    ("L2 3.5 0.25", "L2 -3.5 0.25", ":2: ranges[0] is -3.5: it must be positive, or below zero"),
    ("L2 3.5 0.25", "L2 3.5 0", ":2: a variance is '0'"),
    ("L2 3.5 0.25", "L2 nan 0.25", ":2: 'nan' is not a finite number"),
    ("L2 3.5 0.25", "L2 1e400 0.25", ":2: '1e400' is beyond"),
    ("L2 3.5 0.25", "L2 3.5 1e-300", ":2: a variance is"),
    ("L2 3.5 0.25", "L2 3.5", ":2: EDGE_RANGE has 4 fields"),
    ("L2 3.5 0.25", "L2 3.5 0.25" + " 1" * 1_000_000, ":2: a line of 2000030 characters"),
    ("EDGE_SE2 1.0 A2 A10", "EDGE_SE2 1.0 A1 A10", ":7: from A1 to A10"),
    ("EDGE_SE2 1.0 A2 A10 1.0 0.1 0.2 0.04 0.001 0.002 0.05 0.003 0.06\n", "", "from A2 to A10"),
    ("EDGE_SE2 1.0 A2 A10 1", "EDGE_SE2 1.0 A1 A2 1", ":8: A1 to A2 again: first in line 7"),
    ("0.04 0.001 0.002 0.05", "0.04 1.0 0.002 0.05", ":7: odometry_covariances[1] is"),
    ("PRIOR 0.0 A1", "PRIOR 0.0 A2", ":11: a prior on A2"),
    ("0.09 0.0 0.09", "0.09 0.0 0.08", ":12: a prior on a landmark must be alike"),
    ("0.09 0.0 0.09", "-0.09 0.0 -0.09", ":12: a variance of a prior is -0.09"),
    ("0.09 0.0 0.09", "0.0 0.0 0.0", ":12: a variance of a prior is 0: it must be positive"),
    ("0.09 0.0 0.09", "0.09 0.01 0.09", ":12: a prior with correlations"),
    ("VERTEX_XY L1", "EDGE_SE2_XY 0.0 A1 L1", ":9: EDGE_SE2_XY: a landmark seen in x and y"),
    ("VERTEX_XY L1", "FIX L1", ":9: 'FIX' is no kind of line"),
    ("VERTEX_SE2 0.0 A1", "VERTEX_SE2 9.0 A1", ":5: times[1] is 1.: time must not go back"),
    ("VERTEX_SE2 0.0 A1", "VERTEX_SE2 0.0 1", ":4: '1' is not a name"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "why"), PYFG_BAD)
def test_pyfg_names_line_and_reason(tmp_path, old, new, why):
    assert old in PYFG
    path = written(tmp_path, PYFG.replace(old, new))
    with pytest.raises(ValueError, match=re.escape(why)) as error:
        formats.read(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


FG_BAD = [
    ("Observed L2 L1", "Observed L2", ":8: it must be: Observer"),
    ("Weights 3 1", "Weights 0 0", ":8: weights"),
    ("Weights 3 1", "Weights 3 1 Weights 2 2", ":8: Weights twice"),
    ("Weights 3 1", "Weights -1 1", ":8: weights"),
    ("Binary SE2R2Range", "Binary SE2Relative", ":8: ambiguous SE2Relative"),
    ("Observed L2 L1", "Observed L2 X0", ":8: a range between poses"),
    ("Variable Landmark R2 L1", "Variable Landmark R3 L1", ":3: a variable must be"),
    ("Factor SE2R2Range", "Factor SE3R3Range", ":7: a factor 'SE3R3RangeGaussian"),
    ("Factor SE2R2Range", "Fact SE2R2Range", ":7: 'Fact' is no kind of line"),
    (".0001 .0004", ".0002 .0004", ":6: odometry_covariances[0] is"),
    ("covariance .04", "variance .04", ":6: after the names"),
]


@pytest.mark.parametrize(("old", "new", "why"), FG_BAD)
def test_fg_names_line_and_reason(tmp_path, old, new, why):
    assert old in NSFG
    with pytest.raises(ValueError, match=re.escape(why)) as error:
        formats.read(written(tmp_path, NSFG.replace(old, new), ".fg"))
    assert "\n" not in str(error.value)


HOSTILE = {
    "empty": b"",
    "blank": b" \n\n",
    "binary": bytes(range(256)),
    "UTF-16": PYFG.encode("utf-16"),
    "Latin-1": b"VERTEX_XY L1 1 2 \xe9\n",
    "truncated": PYFG[:200].encode(),
    "one line": b"A" * 5_000_000,
    "no pose": b"VERTEX_XY L1 1 2\n",
}


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("suffix", [".pyfg", ".fg", ".mat"])
def test_a_hostile_file_ends_in_one_line(tmp_path, kind, suffix):
    path = tmp_path / f"log{suffix}"
    path.write_bytes(HOSTILE[kind])
    with pytest.raises(ValueError, match=re.escape(str(path))) as error:
        formats.read(path)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    "name", ["missing.pyfg", "missing.txt", "folder", "pipe.pyfg", "pipe.mat", "pipes"]
)
def test_what_is_no_file_is_refused(tmp_path, name):
    (tmp_path / "folder").mkdir()
    (tmp_path / "pipes").mkdir()
    for pipe in ("pipe.pyfg", "pipe.mat", "pipes/odometry.csv"):
        os.mkfifo(tmp_path / pipe)  # whoever opens it waits for ever
    with pytest.raises(ValueError, match=name):
        formats.read(tmp_path / name)


@pytest.mark.parametrize("end", ["\r\n", "\r"])
def test_a_byte_order_mark_other_line_ends_and_capitals_do_no_harm(tmp_path, end):
    path = tmp_path / "LOG.PYFG"
    path.write_bytes(b"\xef\xbb\xbf" + PYFG.replace("\n", end).encode())
    assert formats.read(path).log.n_poses == 3
