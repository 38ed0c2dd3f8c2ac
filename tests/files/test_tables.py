"""Tables of comma-separated values, and trajectories."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.files import formats, table_writer, tum
from sngr_utils.files.recording import Recording
from sngr_utils.world.log import Log
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate
from sngr_utils.world.truth import Truth

ODOMETRY = """\
time_s,dx_m,dy_m,dtheta_rad,sigma_x_m,sigma_y_m,sigma_theta_rad
10.0,1.0,2.0,0.5,0.1,0.1,0.05
11.0,1.0,0.0,0.1,0.2,0.3,0.01
12.0,1.0,0.1,0.0,0.2,0.3,0.01
"""
RANGES = """\
time_s, range_m, sigma_m, landmark
11.6, 3.0, 0.5, b
10.4, 2.0, 0.5, a
11.5, 4.0, 0.5,
"""
LANDMARKS = "landmark,x_m,y_m,sigma_m\nb,,,\na,4.0,5.0,0.2\nc,,,\n"


def folder_of(tmp_path, **changed):
    given = {"odometry": ODOMETRY, "ranges": RANGES, **changed}
    for name, text in given.items():
        (tmp_path / f"{name}.csv").write_text(text)
    return tmp_path


def test_the_first_row_is_the_first_pose_and_ranges_go_to_the_nearest_pose(tmp_path):
    found = formats.read(folder_of(tmp_path))
    log = found.log
    assert found.landmark_names == ["a", "b"]
    assert log.x0_mean.tolist() == [1, 2, 0.5]
    assert log.x0_sigmas.tolist() == [0.1, 0.1, 0.05]
    assert log.odometry.tolist() == [[1, 0, 0.1], [1, 0.1, 0]]
    np.testing.assert_allclose(log.odometry_covariances[0], np.diag([0.04, 0.09, 0.0001]))
    assert log.pose_of.tolist() == [0, 1, 2]  # halfway goes to the earlier
    assert log.ranges.tolist() == [2, 4, 3]
    assert log.label_of.tolist() == [0, -1, 1]
    assert log.row_of.tolist() == [1, 2, 0]
    assert found.truth is None


def test_landmarks_of_the_table_come_in_its_order_with_what_a_survey_says(tmp_path):
    with pytest.warns(UserWarning, match=r"\[2\] have no range"):
        found = formats.read(folder_of(tmp_path, landmarks=LANDMARKS))
    assert found.landmark_names == ["b", "a", "c"]
    assert found.log.landmark_sigmas[1] == 0.2
    assert np.isnan(found.log.landmark_means[0]).all()


def recording(seed=100):
    """A log with all that tables can say, and its truth."""
    drawn = simulate(Scenario(n_poses=8), 0.3, rng=np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(7, 3, 3)) * [0.05, 0.05, 0.01]
    count = len(drawn.ranges)
    chances = rng.dirichlet(np.ones(7), count)[:, :6]
    log = Log(
        odometry=drawn.odometry, odometry_covariances=root.swapaxes(1, 2) @ root,
        pose_of=drawn.pose_of, ranges=drawn.ranges, range_sigmas=rng.uniform(0.1, 0.2, count),
        label_of=np.where(rng.random(count) < 0.2, -1, drawn.label_of), n_landmarks=6,
        x0_mean=drawn.x0_mean, x0_sigmas=[0.1, 0.2, 0.05], times=np.cumsum(rng.random(8)),
        label_probabilities=chances, landmark_means=[[1, 2]] + [[np.nan, np.nan]] * 5,
        landmark_sigmas=[0.3] + [np.nan] * 5, scale=(1.05, 0.1), offset=(0.1, np.inf),
    )  # fmt: skip
    truth = Truth(poses=drawn.poses, landmarks=drawn.landmarks, source_of=drawn.source_of)
    return Recording(log, truth, [f"radio {k}" for k in range(6)])


def test_all_that_tables_can_say_comes_back(tmp_path):
    given = recording()
    table_writer.write(tmp_path / "new", given)
    found = formats.read(tmp_path / "new")
    assert found.landmark_names == given.landmark_names
    for name in vars(given.log):
        np.testing.assert_allclose(
            getattr(found.log, name), getattr(given.log, name), rtol=1e-12, err_msg=name
        )
    for name in ("poses", "landmarks", "source_of"):
        np.testing.assert_array_equal(getattr(found.truth, name), getattr(given.truth, name))


def test_a_log_without_truth_comes_back_without(tmp_path):
    table_writer.write(tmp_path / "new", replace(recording(), truth=None))
    assert formats.read(tmp_path / "new").truth is None


RANGES_WITH_CHANCES = "pose,range_m,sigma_m,landmark,p:a,p:b\n0,3,1,a,1,0\n1,3,1,a,0.6,0.6\n"
BAD = [
    ("odometry", "dx_m", "dx", "odometry.csv:1: no column dx_m"),
    ("odometry", "sigma_theta_rad", "sigma_theta_rad,x", "odometry.csv:1: 'x' is no column"),
    ("odometry", "dy_m", "dx_m,dy_m", "odometry.csv:1: column dx_m stands there twice"),
    ("odometry", "11.0,1.0,0.0", "11.0,1.0", "odometry.csv:3: 6 cells"),
    ("odometry", "11.0,1.0,0.0", "11.0,inf,0.0", "odometry.csv:3: dx_m: 'inf' is not a finite"),
    ("odometry", "0.2,0.3,0.01", "0.2,0,0.01", "odometry.csv:3: sigma_y_m is '0'"),
    ("odometry", "\n12.0", "\n9.0", "odometry.csv:4: time must not go back"),
    (
        "ranges",
        "3.0, 0.5",
        "-3.0, 0.5",
        "ranges.csv:2: ranges[0] is -3.: it must be positive, or bel",
    ),
    ("ranges", "3.0, 0.5", "0, 0.5", "ranges.csv:2: ranges[0] is 0.: it must be positive, or belo"),
    ("ranges", "landmark", "landmark, landmark", "ranges.csv:1: column landmark stands there twi"),
    ("ranges", ", b", ', "b', "ranges.csv:2: unexpected end of data"),
    ("ranges", ", b", ', "b"c', "ranges.csv:2: ',' expected after '\"'"),
    ("ranges", "time_s, range_m, ", "time_s; range_m; ", "ranges.csv:1: no column range_m"),
    ("ranges", "time_s", "# radios\ntime_s", "ranges.csv:1: no column range_m"),
    ("ranges", "11.6, 3.0", "# 11.6, 3.0", "ranges.csv:2: time_s: '# 11.6' is not a finite"),
    ("ranges", "11.6, 3.0", "11,6, 3,0", "ranges.csv:2: 6 cells: the header has 4"),
    ("odometry", "11.0,1.0,0.0", "1_1.0,1.0,0.0", "odometry.csv:3: time_s: '1_1.0' is not a fin"),
    ("odometry", "11.0,1.0,0.0", "11.0,1e21,0.0", "odometry.csv:3: dx_m: '1e21' is beyond 1e+20"),
    ("odometry", "11.0,1.0,0.0", "11.0,0x1,0.0", "odometry.csv:3: dx_m: '0x1' is not a finite"),
    ("odometry", "0.2,0.3,0.01", "0.2,1e-21,0.01", "odometry.csv:3: sigma_y_m is '1e-21'"),
    ("odometry", "11.0", '"11.0', "odometry.csv:3: unexpected end of data"),
    ("ranges", "11.6", "19.6", "ranges.csv:2: time_s is 19.6"),
    ("ranges", "time_s, ", "", "ranges.csv:2: 4 cells: the header has 3"),
    ("ranges", ", b", ", b; c", None),
    ("landmarks", "c,,,", "c,1.0,1.0,0", "landmarks.csv:4: landmark_means[2] is [1. 1.]: give a"),
    ("landmarks", "c,,,", "c,1.0,,", "landmarks.csv:4: y_m: '' is not a finite number"),
    ("landmarks", "c,,,", "a,,,", "landmarks.csv:4: landmark 'a'"),
    ("landmarks", "a,4.0", "d,4.0", "ranges.csv:3: landmark 'a': landmarks.csv has none such"),
]


@pytest.mark.parametrize(("table", "old", "new", "why"), BAD)
def test_tables_name_line_and_reason(tmp_path, table, old, new, why):
    given = {"odometry": ODOMETRY, "ranges": RANGES}
    if table == "landmarks":
        given["landmarks"] = LANDMARKS
    assert old in given[table]
    given[table] = given[table].replace(old, new, 1)
    if why is None:  # a name is what stands between commas
        assert formats.read(folder_of(tmp_path, **given)).landmark_names == ["a", "b; c"]
        return
    with pytest.raises(ValueError, match=re.escape(why)) as error:
        formats.read(folder_of(tmp_path, **given))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("table", "text", "why"),
    [
        ("calibration", "quantity,mean,sigma\nscale,1,0\nscale,2,0\n", "calibration.csv:2: quant"),
        (
            "ranges",
            RANGES_WITH_CHANCES,
            "ranges.csv:3: label_probabilities[1] is [0.6 0.6]: chances",
        ),
    ],
)
def test_what_contradicts_itself_is_refused_by_line(tmp_path, table, text, why):
    given = {"odometry": ODOMETRY, "ranges": RANGES, table: text}
    with pytest.raises(ValueError, match=re.escape(why)):
        formats.read(folder_of(tmp_path, **given))


@pytest.mark.parametrize(("times", "line"), [
    ((10.0, 11.0, 12.0), None), ((10.3, 10.9, 11.6), None), ((10.0, 12.0, 12.0), 3),
    ((11.0, 12.0, 13.0), 2), ((10.0, 11.0, 11.4), 4),
])  # fmt: skip
def test_times_of_the_truth_are_those_of_the_poses(tmp_path, times, line):
    truth = "time_s,x_m,y_m,theta_rad\n" + "".join(f"{t},{t},0,0\n" for t in times)
    folder = folder_of(tmp_path, truth=truth)
    if line is None:
        assert formats.read(folder).truth.poses[:, 0].tolist() == list(times)
        return
    with pytest.raises(ValueError, match=rf"truth.csv:{line}: time_s is .*: odometry.csv has"):
        formats.read(folder)


@pytest.mark.parametrize(("rows", "line"), [
    ("1,11.2\n0,10.4\n", None), ("1,11.2\n0,10.6\n", 3), ("2,10.0\n", 2),
    ("0,10.5\n1,10.5\n", None),
])  # fmt: skip
def test_a_range_that_names_a_pose_has_its_time(tmp_path, rows, line):
    rows = "".join(f"{row},3.0,0.5,a\n" for row in rows.split())
    folder = folder_of(tmp_path, ranges="pose,time_s,range_m,sigma_m,landmark\n" + rows)
    if line is None:
        assert len(formats.read(folder).log.ranges) == 2
        return
    with pytest.raises(ValueError, match=rf"ranges.csv:{line}: time_s is .*: odometry.csv has 1"):
        formats.read(folder)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_quotes_blank_lines_a_byte_order_mark_and_other_line_ends_do_no_harm(tmp_path, end):
    folder = folder_of(tmp_path)
    expected = formats.read(folder).log
    for name, text in (("odometry", ODOMETRY), ("ranges", RANGES)):
        quoted = re.sub(r"[^,\s]+", r'"\g<0>"', text).replace("\n", end + " " + end)
        (folder / f"{name}.csv").write_bytes(b"\xef\xbb\xbf" + quoted.encode())
    found = formats.read(folder).log
    for field in ("odometry", "pose_of", "ranges", "label_of"):
        np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))


def test_a_number_of_many_digits_is_read_in_time(tmp_path):
    text = ODOMETRY.replace("11.0", "1" * 200_000 + "x")
    with pytest.raises(ValueError, match=r"odometry.csv:3: time_s: '1{37}\.\.\.' is not a finite"):
        formats.read(folder_of(tmp_path, odometry=text))


@pytest.mark.parametrize("name", ["", " a", "a\n", "a\rb", "a\0", "\ud800"])
def test_a_name_that_would_not_come_back_is_not_written(tmp_path, name):
    given = recording()
    names = [*given.landmark_names[:5], name]
    with pytest.raises(ValueError, match=r"landmark_names\[5\] is"):
        table_writer.write(tmp_path / "new", replace(given, landmark_names=names))
    with pytest.raises(ValueError, match="6 landmarks need as many different names"):
        table_writer.write(tmp_path / "new", replace(given, landmark_names=["a"] * 6))
    assert not (tmp_path / "new").exists()


def test_an_older_table_that_would_be_read_with_the_new_ones_stops_writing(tmp_path):
    table_writer.write(tmp_path, recording())
    before = (tmp_path / "odometry.csv").read_bytes()
    with pytest.raises(ValueError, match=r"truth\.csv: it is there already"):
        table_writer.write(tmp_path, replace(recording(101), truth=None))
    assert (tmp_path / "odometry.csv").read_bytes() == before


def test_ranges_without_any_landmark_say_which_table_is_missing(tmp_path):
    text = "pose,range_m,sigma_m,landmark\n0,1.0,0.1,\n"
    with pytest.raises(ValueError, match=r"ranges\.csv: it names no landmark, and no landmarks"):
        formats.read(folder_of(tmp_path, ranges=text))


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ("scale,0,1", "scale has mean 0"),
        ("offset_m,0,-1", "sigma -1"),
        ("scale,inf,1", "'inf'"),
        ("scale,1,1e-300", "sigma 1e-300: too small"),
        ("scale,1e-300,1", "mean 1e-300"),
        ("offset_m,0,1e-21", "sigma 1e-21: too small"),
    ],
)
def test_a_calibration_that_is_none_is_refused_by_line(tmp_path, row, why):
    text = f"quantity,mean,sigma\n{row}\n"
    with pytest.raises(ValueError, match=rf"calibration\.csv:2: .*{why}"):
        formats.read(folder_of(tmp_path, calibration=text))


def test_a_table_that_may_be_missing_is_not_missing_if_its_link_leads_nowhere(tmp_path):
    folder = folder_of(tmp_path, odometry=ODOMETRY, ranges=RANGES)
    (folder / "landmarks.csv").symlink_to("nowhere.csv")
    with pytest.raises(ValueError, match=r"landmarks\.csv: No such file"):
        formats.read(folder)


def test_correlations_must_be_those_of_a_covariance(tmp_path):
    rows = ODOMETRY.splitlines()
    text = [rows[0] + ",rho_xy", rows[1] + ",0", rows[2] + ",1.5", rows[3] + ",0.5"]
    with pytest.raises(
        ValueError, match=r"odometry.csv:3: odometry_covariances\[0\] is .* positive definite"
    ):
        formats.read(folder_of(tmp_path, odometry="\n".join(text)))
    text[2] = rows[2] + ",0.5"
    log = formats.read(folder_of(tmp_path, odometry="\n".join(text))).log
    np.testing.assert_allclose(log.odometry_covariances[0, 0, 1], 0.5 * 0.2 * 0.3)


def test_a_trajectory_has_the_headings_as_quaternions(tmp_path):
    poses = np.array([[1, 2, 0.0], [3, 4, np.pi / 2], [5, 6, -3.0]])
    tum.write(tmp_path / "a.tum", np.array([0.5, 1.5, 2.5]), poses)
    table = np.loadtxt(tmp_path / "a.tum")
    assert table[:, :4].tolist() == [[0.5, 1, 2, 0], [1.5, 3, 4, 0], [2.5, 5, 6, 0]]
    np.testing.assert_allclose(2 * np.arctan2(table[:, 6], table[:, 7]), poses[:, 2])


@pytest.mark.parametrize(("factor", "warns"), [(1.0, False), (1000.0, True)])
def test_times_in_other_units_are_warned_of(tmp_path, factor, warns):
    made = recording()
    table_writer.write(tmp_path, made)
    path = tmp_path / "odometry.csv"
    head, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    rows = [",".join([repr(factor * float(time)), *more]) for time, *more in cells]
    path.write_text("\n".join([head, *rows]) + "\n")
    ranges = (tmp_path / "ranges.csv").read_text().splitlines()
    without = [",".join(row.split(",")[1:]) for row in ranges]  # the nearest pose in time
    (tmp_path / "ranges.csv").write_text("\n".join(without) + "\n")
    (tmp_path / "truth.csv").unlink()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        formats.read(tmp_path)
    assert any("are both in seconds?" in str(warning.message) for warning in told) == warns
