"""The Plaza sets of the gtsam wheel, GOATS, and files that only look like them."""

import gtsam
import numpy as np
import pytest
from scipy import io

from sngr_utils.files import formats, plaza
from sngr_utils.world.dead_reckoning import dead_reckoning, wrap_angle

SETS = {"Plaza1": (3529, 3526), "Plaza2": (1816, 1816)}  # ranges, and times of them


def raw(name):
    return io.loadmat(plaza.wheel(name))


@pytest.mark.parametrize("name", SETS)
def test_all_ranges_come_sorted_each_at_its_own_time(name):
    found = plaza.read(plaza.wheel(name))
    log, table = found.log, raw(name)["TD"]
    count, heard = SETS[name]
    assert (len(log.ranges), len(np.unique(log.pose_of))) == (count, heard)
    np.testing.assert_array_equal(log.ranges, table[log.row_of, 3])
    np.testing.assert_array_equal(log.times[log.pose_of], table[log.row_of, 0])
    labels = [found.landmark_names[k] for k in log.label_of]
    assert labels == [str(int(radio)) for radio in table[log.row_of, 2]]
    assert np.diff(log.times).max() < 2 * plaza.SILENCE


@pytest.mark.parametrize("name", SETS)
def test_honest_odometry_leads_along_the_positions_of_dead_reckoning(name):
    log = plaza.read(plaza.wheel(name)).log
    way = raw(name)["DRp"]
    reckoned = dead_reckoning(log.x0_mean, log.odometry)
    for axis in (0, 1):
        there = np.interp(log.times, way[:, 0], way[:, 1 + axis])
        np.testing.assert_allclose(reckoned[:, axis], there, atol=1e-8)


def test_the_heading_in_plaza1_is_that_of_the_gps_and_the_course_is_not():
    apart = {}
    for heading in plaza.HEADINGS:
        found = plaza.read(plaza.wheel("Plaza1"), heading)
        reckoned = dead_reckoning(found.log.x0_mean, found.log.odometry)
        apart[heading] = np.abs(wrap_angle(reckoned[:, 2] - found.truth.poses[:, 2]))
    assert apart["leaked"].max() < 1e-3  # the clocks differ by hundredths of a second
    assert np.median(apart["course"]) > 0.1


@pytest.mark.parametrize("name", SETS)
def test_the_lengths_of_both_odometries_are_those_of_the_gps(name):
    table = raw(name)
    steps = [np.hypot(*np.diff(table[key][:, 1:3], axis=0).T) for key in ("DRp", "GT")]
    assert np.mean(np.abs(steps[0] - steps[1]) < 1e-4) > 0.8  # of .2 to .4 m each


def test_another_heading_is_refused():
    with pytest.raises(ValueError, match="heading is 'gps'"):
        plaza.read(plaza.wheel("Plaza1"), "gps")


def changed(tmp_path, **tables):
    path = tmp_path / "a.mat"
    kept = {name: raw("Plaza2")[name] for name in plaza.TABLES}
    io.savemat(path, {k: v for k, v in {**kept, **tables}.items() if v is not None})
    return path


def test_a_file_that_is_no_plaza_set_is_refused(tmp_path):
    table = raw("Plaza2")
    broken, backwards, other = table["TD"].copy(), table["GT"][::-1], table["TD"].copy()
    broken[7, 3], other[3, 2] = np.nan, 9
    zero, huge, late, still, again, part = (
        table[name].copy() for name in ("TD", "DRp", "TD", "DRp", "TL", "TL")
    )
    zero[5, 3], huge[4, 1], late[6, 0], still[:, 1:3] = 0, 1e300, 1e12, 0
    again[2, 0], part[1, 0] = again[0, 0], 0.5
    for tables, why in (
        ({"TD": None}, "no table TD of 4 columns"),
        ({"TD": table["TD"][:, :3]}, "no table TD"),
        ({"TD": broken}, r"TD\[7\] must be finite"),
        ({"TD": other}, r"TD\[3\] is from a radio"),
        ({"GT": backwards}, "the times of GT must grow"),
        ({"TD": zero}, r"ranges\[5\] is 0"),
        ({"DRp": huge}, r"DRp\[4\] must be finite and at most"),
        ({"TD": late}, r"TD\[6\] is at a time that DRp has not"),
        ({"GT": table["GT"][:100]}, r"TD\[\d+\] is at a time that GT has not"),
        ({"DRp": still}, "the positions of DRp never move"),
        ({"TL": again}, r"TL\[2\] must number a radio, once"),
        ({"TL": part}, r"TL\[1\] must number a radio, once"),
    ):
        path = changed(tmp_path, **tables)
        with pytest.raises(ValueError, match=why) as error:
            formats.read(path)
        assert str(error.value).startswith(f"{path}: ")


def test_steps_that_are_all_alike_have_a_course(tmp_path):
    straight = raw("Plaza2")["DRp"].copy()
    straight[:, 1:3] = np.arange(len(straight))[:, None] * [0.25, 0.0]
    found = formats.read(changed(tmp_path, DRp=straight))
    np.testing.assert_allclose(found.log.odometry[:, 1:], 0, atol=1e-9)


def test_a_truncated_set_is_refused(tmp_path):
    whole = plaza.wheel("Plaza2").read_bytes()
    for size in (10, 200, len(whole) // 2):
        (tmp_path / "a.mat").write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"a\.mat: not a") as error:
            formats.read(tmp_path / "a.mat")
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "size"), [("goats_15", (473, 786, 3)), ("goats_16", (201, 572, 4))]
)
def test_goats_has_no_truth_of_its_path_and_no_times(name, size):
    found = formats.read(plaza.Path(gtsam.findExampleDataFile(f"{name}.pyfg")))
    log = found.log
    assert (log.n_poses, len(log.ranges), log.n_landmarks) == size
    assert found.truth.poses is None
    assert log.times.tolist() == list(range(size[0]))
    assert set(log.range_sigmas) == {0.75}
