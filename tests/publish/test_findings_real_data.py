"""Sentences of notebook 10 about signs, orders and all rows, on the committed studies."""

import numpy as np
import pytest

from sngr_utils import real_data

BATCH, ONLINE = real_data.study("plaza"), real_data.study("plaza_online")
OURS = BATCH[BATCH["method"] == "growing_map"]
LABELLED = OURS[OURS["kind"] == "labels"]


@pytest.mark.parametrize(("name", "most"), [("Plaza1", 0.2), ("Plaza2", 0.22)])
def test_batch_is_level_in_the_share_of_wrong_labels(name, most):
    mine = LABELLED[LABELLED["set"] == name]
    assert mine["rmse"].max() < most
    assert mine["rmse"].max() < 1.1 * mine["rmse"].min()
    assert (mine["precision"] > 0.96).all()
    found = mine.groupby("p")["share_wrong"].median()
    assert (found - found.index).abs().max() < 0.03  # of binomial errors of .012 and less
    assert not mine["doubtful"].any()


def test_no_labels_are_as_good_as_right_ones():
    for _, mine in OURS.groupby("set"):
        of = mine.set_index("kind")["rmse"]
        right = mine.query("kind == 'labels' and p == 0")["rmse"].item()
        for kind in ("no labels", "shuffled", "stretched"):
            assert of[kind] < 1.05 * right


def test_what_fails_is_doubted_and_nothing_else():
    failed = OURS["rmse"] > 1.0
    assert failed.sum() == 2
    assert (OURS["kind"][failed] == "cut").all()
    assert (OURS["doubtful"].astype(bool) == failed).all()


def test_the_scale_is_near_that_of_the_gps_and_a_little_too_sure():
    for name in real_data.OTHER:
        drive = real_data.recording(name)
        at = drive.truth.poses[drive.log.pose_of, :2]
        distances = np.linalg.norm(at - drive.truth.landmarks[drive.log.label_of], axis=1)
        true = np.polyfit(distances, drive.log.ranges, 1)[0]
        found = real_data.found_in(name)
        assert abs(found["scale"] - true) < 0.005
        assert 1 < (true - found["scale"]) / found["scale_sigma"] < 3


def test_believers_of_labels_are_lost():
    rows = BATCH[BATCH["method"] == "least_squares"].groupby(["set", "p"])["rmse"].median()
    assert (rows.xs(0.0, level="p") < 0.25).all()
    assert (rows.drop(0.0, level="p") > 2).all()


def test_online_is_level_too_and_nested_sampling_adds_nothing():
    labelled = ONLINE[ONLINE["kind"] == "labels"].set_index(["method", "p", "set"]).sort_index()
    driven = labelled.loc["online"]
    assert (driven["final"] < 0.23).all()
    assert driven["filtered"].between(0.5, 1.0).all()
    assert (driven.query("p <= 0.4")[["landmark_samples", "position_samples"]] == 0).all(axis=None)
    assert driven.loc[0.6, "landmark_samples"].between(1, 20).all()
    without = labelled.loc[("no nested sampling", 0.6), "final"]
    np.testing.assert_allclose(without, driven.loc[0.6, "final"][without.index], rtol=0.01)


def test_online_doubts_lost_odometry_and_not_a_wrong_scale():
    of = ONLINE.set_index("kind")
    assert of.loc["cut", "doubtful"].all()
    assert (of.loc["stretched", "final"] > 4).all()
    assert not of.loc["stretched", "doubtful"].any()


def test_some_peers_are_lost_with_right_labels_and_truncated_squares_never():
    rmse = real_data.study("plaza_peers").set_index(["method", "set", "p"])["rmse"]
    for method in ("dcs", "geman_mcclure", "max_mixture_null"):
        assert (rmse.loc[method].xs(0.0, level="p") > 9).all()
    assert rmse["em", "Plaza2", 0.0] > 9
    assert (rmse.loc["gnc_tls"] < 0.24).all()
    assert (rmse.loc["isam2"].xs(0.4, level="p") > 4).all()
