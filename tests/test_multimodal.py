"""Driver of notebook 09: its parameters, and what must hold on any worlds."""

import joblib
import numpy as np
import pandas as pd
import pytest
from helpers import handed_on, signatures

from sngr_utils import multimodal
from sngr_utils.detection import mirror_image
from sngr_utils.experiments import multimodality, sampler_contest, warm_up
from sngr_utils.publish import report
from sngr_utils.show import multimodal as show

QUICK = multimodal.Config(
    n_seeds=2, n_sampled=2, poses_seen=[2, 8], poses_sampled=[2], ranges_per_pose=[1],
    n_live_landmark=100, n_live_window=50, n_particles=500, jobs=1,
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("poses_seen", {"poses_seen": [40]}),
        ("ranges_per_pose", {"ranges_per_pose": [7]}),
        ("n_sampled", {"n_sampled": 11}),
        ("weak", {"weak": 0.0}),
        ("n_poses", {"n_poses": 5, "poses_seen": [2], "poses_sampled": [2]}),
        ("poses_seen", {"poses_seen": [1]}),  # one circle: no second place to look for
        ("p\n", {"p": 1.0}),
    ],
)
def test_bad_parameters_are_named(name, change):
    with pytest.raises(ValueError, match=name):
        multimodal.Config(**change)


@pytest.fixture(scope="module")
def study():
    """Landmarks, windows and samplers of a small study; what was compiled before, and after."""
    warm_up.compile_all(jobs=1)  # here, where the signatures are
    before = signatures()
    multimodal.view(QUICK, 0, 1)
    runs = (multimodal.run_landmarks, multimodal.run_windows, multimodal.run_samplers)
    return *(run(QUICK) for run in runs), before, signatures()


@pytest.fixture(scope="module")
def landmarks(study):
    return study[0]


def test_no_gaussian_beats_the_one_with_the_posteriors_moments(landmarks):
    """The divergence from a law to Gaussians is least at the moments of the law."""
    assert (landmarks["kl_moments"] <= landmarks["kl"] + 1e-3).all()
    assert landmarks["kl_error"].max() < 0.01


def test_landmarks_of_two_poses_have_two_places_and_of_eight_one(landmarks):
    """On twelve landmarks of development seeds; deterministic."""
    few, many = landmarks.query("n == 2"), landmarks.query("n == 8")
    assert (few["kl"] > 1).all()
    assert few["second"].median() > 0.3
    assert many["kl"].median() < 0.1
    assert (few["gap"] < 3).mean() > 0.8
    assert (many["gap"] > 3).all()
    assert few["window_score"].isna().all()


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_the_mirror_test_from_scratch_is_that_of_the_library(from_scratch, n):
    for label in range(QUICK.n_landmarks):
        target = multimodal.landmark(QUICK, label, n)
        data = target.positions, target.ranges, target.variances
        start = multimodal.view(QUICK, label, n).gaussian[0]
        gap, here, there = from_scratch["mirror_test"](*data, start)
        library = mirror_image.mirror_test(*data, start)
        assert (gap == np.inf) == (not library.distinct)
        assert here == pytest.approx(library.landmark, abs=1e-5)
        if library.distinct:
            assert gap == pytest.approx(library.gap, rel=1e-5, abs=1e-6)
            assert there == pytest.approx(library.image, abs=1e-5)


def test_the_share_of_the_image_falls_from_one_half_to_almost_nothing_after_five_poses(
    from_scratch,
):
    config, shares = multimodal.Config(), {}
    for n in (2, 3, 5, 6):
        target = multimodal.landmark(config, 0, n)
        data = target.positions, target.ranges, target.variances
        gap, *_ = from_scratch["mirror_test"](*data, multimodal.view(config, 0, n).gaussian[0])
        shares[n] = 1 / (1 + np.exp(gap))
    assert shares[2] == pytest.approx(0.5, abs=0.01)
    assert shares[3] > 0.45
    assert max(shares[5], shares[6]) < 0.03


def test_results_do_not_depend_on_the_number_of_workers(landmarks):
    with joblib.parallel_config(backend="threading"):
        again = multimodal.run_landmarks(QUICK.model_copy(update={"jobs": 2}))
    pd.testing.assert_frame_equal(landmarks, again)


def test_a_study_needs_nothing_more_compiled(study):
    *_, before, after = study
    assert after == before


def test_the_window_score_is_that_of_the_poses():
    """A chain without ranges: its covariance by noises is that of graph and windows."""
    target = QUICK.windows.window(100, 1)
    jacobian = multimodality.pose_jacobian(target, np.zeros(9))
    covariance = jacobian @ jacobian.T
    assert covariance[:2, :2] == pytest.approx(0.25 * np.eye(2), abs=1e-6)
    turned = np.sqrt(np.diag(covariance)[[2, 5, 8]])
    assert turned == pytest.approx(0.1 * np.sqrt([1, 2, 3]), rel=1e-5)


def test_every_case_is_counted_once_and_every_method_judged(study, tmp_path):
    landmarks, found, runs, *_ = study
    rows = show.detection_rows(QUICK, landmarks, found)
    counted = rows[["found", "missed", "false", "silent"]].sum(axis=1)
    assert set(counted[rows["case"] == "landmark"]) == {len(landmarks)}
    assert set(counted[rows["case"] == "window"]) == {len(found)}
    for case in ("landmark", "window", "two anchors, from the saddle"):
        assert set(runs.loc[runs["case"] == case, "method"]) == set(sampler_contest.METHODS)
    assert runs["mass_error"].between(0, 1).all()
    paper = report.Report("09_multimodal", tmp_path)
    show.record(QUICK, landmarks, found, runs, paper)
    show.record_strong(found, paper)
    assert handed_on(paper)["multimodal.landmark.starts.within"]["n"] == 2
    assert list(show.summary_table(runs)["method"]) == list(sampler_contest.METHODS)
    assert set(show.mass_errors(runs)) == {"landmark, few poses", "window"}
    narrow = runs.query("case == 'two anchors, from the mode' and method == 'c = 1'")
    assert (narrow["mass_error"] > 0.45).all()
    anchors = runs.query("case == 'two anchors, from the saddle'")
    assert (anchors.query("method == 'ancestral'")["mass_error"] < 0.25).all()
