"""A row of the study is what notebook 08 would find in that world."""

import pytest

from sngr_utils import association_aware
from sngr_utils.experiments import peers_again


def test_a_row_is_what_notebook_08_finds_in_that_world():
    config = association_aware.Config(
        first_seed=101, n_seeds=2, p_levels=[0.4], p_peers=[0.4], n_slip=2
    )
    runs = association_aware.run(config).set_index(["seed", "method"])["pose_rmse"]
    (row,) = peers_again.rows(102)
    for name in ("online", *peers_again.PEERS):
        assert row[name] == pytest.approx(runs[102, name], rel=1e-6), name
