import numpy as np
import pandas as pd
import pytest
from helpers import handed_on, read_notebook
from ruamel.yaml import YAML

from sngr_utils import audit, paths
from sngr_utils.experiments import isam2_over_worlds, sampler_numbers
from sngr_utils.metrics import summaries
from sngr_utils.publish import (
    cells,
    claims,
    notebooks,
    parameters,
    prediction,
    report,
    rules,
)
from sngr_utils.show import audit as show
from sngr_utils.show import audit_values
from sngr_utils.slam import conventions
from sngr_utils.sngr import noop_baseline


@pytest.fixture(scope="module")
def small():
    quick = parameters.read_params("05_audit", paths.PARAMS / "quick")
    return audit.Config(**{**quick, "jobs": 1, "n_poses": 15})


FEW = audit.Config(n_seeds=2, n_corrected=2, n_poses=8, jobs=1)  # with the levels of the YAML


@pytest.fixture(scope="module")
def sweep():
    return audit.run_sweep(FEW)


@pytest.fixture(scope="module")
def studies(small):
    return audit.run_windows(small.model_copy(update={"p_windows": 0.0, "n_windows": 3}))


def test_every_claim_gets_its_numbers(sweep, tmp_path):
    """With the levels of the YAML, all keys that claims.yaml asks of notebook 05 are there."""
    to = report.Report("05_audit", tmp_path)
    gaussian = audit.run_gaussian_ess(FEW)
    audit_values.record(FEW, sweep, sweep.refined.query("variant == 'paper'"), gaussian, to)
    samples = {key: entry for key, entry in handed_on(to).items() if "sample" in entry}
    assert all(len(entry["sample"]) == 2 for entry in samples.values())
    for preset in conventions.PRESETS:
        asked = {key for key in claims.needed(preset) if key.startswith("audit.")}
        assert asked <= set(samples)


def test_settled_windows_have_nothing_to_gain(studies):
    batch = studies.gains.query("base == 'batch'")["gain"]
    assert batch.max() < 1e-3
    assert batch.min() > -1e-3


def test_windows_of_clean_data_have_the_predicted_widths(studies):
    """Sampled over predicted standard deviation; 5 % is five standard errors of the mean."""
    for _, rows in studies.widths.groupby("reading"):
        ratio = rows["over_conditional"].mean() / rows["predicted_conditional"].mean()
        assert abs(ratio - 1) < 0.05


def test_corrected_evidence_agrees_with_importance_sampling(studies):
    """Each within 5 standard errors: a false alarm in about 2e-5 of runs; the bias at 4.5."""
    checks = studies.evidence
    assert len(checks) >= 20
    assert (checks["in_errors"].abs() < 5).all()
    assert abs(checks["in_errors"].mean()) < 4.5 / np.sqrt(len(checks))


def test_results_do_not_depend_on_the_number_of_processes(small, forked):
    one, two = (audit.run_gaussian_ess(small.model_copy(update={"jobs": n})) for n in (1, 2))
    pd.testing.assert_frame_equal(one, two)


def test_tables_are_whole(sweep, studies):
    runs, detections = sweep.runs, sweep.detections
    n_levels, n_presets = len(FEW.p_levels), len(conventions.PRESETS)
    printed = {0.0: 0.15}
    assert show.by_preset(runs, "pose_rmse", printed=printed).shape == (
        n_levels,
        2 + n_presets,
    )
    assert show.detection_table(detections, runs, FEW.tau).shape == (
        n_levels * n_presets,
        8,
    )
    assert len(show.silent_table(detections)) == len(FEW.taus)
    assert show.words_table(detections, FEW.tau).shape == (n_presets, 3)
    assert show.sampler_table(studies).shape == (7, 3)
    rows = isam2_over_worlds.auc_rows(sweep, rng=np.random.default_rng(0))
    assert len(show.auc_table(rows)) == n_levels * n_presets
    assert len(show.units_table(sweep.scores)) == n_presets
    for frame, make in (
        (studies.widths, show.widths_table), (studies.ratios, show.ratios_table),
        (studies.gains, show.convergence_table), (studies.gaussianity, show.gaussianity_table),
    ):  # fmt: skip
        assert len(make(frame)) >= 2
        assert not make(frame).isna().any().any()


def test_sign_test_from_scratch_is_the_librarys(from_scratch):
    for n in (0, 1, 5, 30):
        for less in range(n + 1):
            changes = np.concatenate([-np.ones(less), np.ones(n - less), np.zeros(2), [np.nan]])
            theirs = summaries.sign_test(changes)
            assert from_scratch["sign_test"](changes) == pytest.approx(theirs)


@pytest.mark.parametrize("log", [False, True])
def test_verdict_from_scratch_is_the_rule(from_scratch, log):
    rng = np.random.default_rng(0)
    natural, seen = prediction.Natural(low=0.1, high=10, log=log, why=""), set()
    for width in (0.01, 0.1, 1.0):
        worlds = np.exp(rng.normal(scale=width, size=45))
        low, high = prediction.world_interval(worlds)
        share = natural.covered(low, high, None)
        for printed in (1.0, 9.0):
            first, last, _, verdict = from_scratch["verdict"](worlds, printed, 0.1, 10, log)
            assert last - first == pytest.approx(share)
            inside = low <= printed <= high
            expected = rules.REPRODUCED if inside else rules.NOT
            assert verdict == (rules.UNTESTABLE if share > rules.MAX_SHARE else expected)
            seen.add(verdict)
    assert len(seen) == 3


def test_interval_and_its_absence():
    row = pd.Series({"mean": 1.0, "low": 0.5, "high": 1.5, "n": 9, "missing": 0})
    assert str(cells.interval(row)) == "1.00 [0.50, 1.50]"
    assert str(cells.interval(row.replace({0: 2}))) == "1.00 [0.50, 1.50] (9)"
    assert str(cells.interval(pd.Series({**row, "n": 4, "missing": 5}))) == "1.00 (4)"
    assert cells.interval(pd.Series({**row, "n": 0})) == "–"


def test_readings_of_the_noop_weight_hold_the_closed_form(noisy):
    table = sampler_numbers.noop_readings(
        noisy, 3.9, noop_baseline.TriggerOnly(), rng=np.random.default_rng(0)
    )
    t = int(table["window"].iloc[0])
    expected = noop_baseline.noop_expected_log_weight(noisy.covariances[t], 0.5)
    assert table["mean log, the window"].iloc[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "value"),
    [("tau", 3.97), ("n_seeds", 1), ("p_refined", [0.15]), ("p_windows", 0.15),
     ("p_levels", [0.0, 0.0, 0.2]), ("jobs", 0), ("taus", []), ("n_corrected", 31),
     ("p_corrected", [0.15])],
)  # fmt: skip
def test_bad_parameters_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        audit.Config(**{name: value})


def test_every_cell_that_decides_is_there():
    cells = {
        (name, tag)
        for name in notebooks.names()
        for cell in read_notebook(name).cells
        for tag in cell.metadata.get("tags", [])
    }
    listed = YAML(typ="safe", pure=True).load(paths.CLAIMS)
    for entry in [*listed["numbers"], *listed["prose"]]:
        assert (entry["notebook"], entry["cell"]) in cells


@pytest.mark.parametrize(
    "asked",
    [
        {"p_levels": [0.05, 0.2, 0.3], "p_refined": [0.3], "p_corrected": [0.3]},
        {"p_refined": [0.0], "p_corrected": [0.0]},  # nothing to refine, and no change to draw
    ],
)
def test_levels_that_the_paper_does_not_print_are_refused(asked):
    printed = tuple(report.printed_values()["baseline"])
    assert printed == audit.PRINTED
    with pytest.raises(ValueError, match=r"p_levels is .* must be printed"):
        audit.Config(**asked)
