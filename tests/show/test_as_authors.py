"""Figure and table of the authors' conventions: the study's own levels, whatever is asked."""

import matplotlib.pyplot as plt
import pytest

from sngr_utils.show import as_authors


@pytest.mark.parametrize(
    ("asked", "shown"),
    [
        ([0.0, 0.3], ["p = 0", "p = 0.3"]),
        ([0.05, 0.3, 1.0], ["p = 0.3"]),
        ([0.0], ["p = 0"]),
        ([0.05, 1.0], ["p = 0", "p = 0.1", "p = 0.2", "p = 0.3", "p = 0.4"]),
    ],
)
def test_a_level_that_the_study_has_not_costs_no_result(asked, shown):
    assert as_authors.worlds_table(asked).columns.tolist() == ["", *shown]
    fig, axes = plt.subplots(1, 3)
    as_authors.draw_worlds(axes, asked)
    silent = axes[2].lines[0].get_xdata()
    assert [f"p = {p:g}" for p in silent] == shown
    fig.canvas.draw()
    plt.close(fig)
