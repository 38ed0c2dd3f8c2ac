"""Parameter sets that check themselves."""

from typing import Annotated

import pytest

from sngr_utils.settings import Checked, Distinct, Levels, Seed


class Study(Checked):
    seeds: Annotated[list[Seed], Distinct] = [0, 1]
    p_levels: Levels = [0.0, 0.3]


@pytest.mark.parametrize("changes", [{"seeds": [3, 4, 3]}, {"p_levels": [0.3, 0.3]}])
def test_a_value_that_is_repeated_is_refused_by_name(changes):
    with pytest.raises(ValueError, match="it must not repeat a value") as refused:
        Study(**changes)
    assert next(iter(changes)) in str(refused.value)


def test_distinct_values_are_kept_in_their_order():
    assert Study(p_levels=[0.4, 0.1]).p_levels == [0.4, 0.1]
    assert Study(seeds=[4, 2]).seeds == [4, 2]


@pytest.mark.parametrize("levels", [[], [0.0, 1.5], [-0.1]])
def test_levels_are_probabilities(levels):
    with pytest.raises(ValueError, match="p_levels"):
        Study(p_levels=levels)


class Counted(Study):
    first_seed: Seed = 0
    n_worlds: int = 30
    lengths: list[int] = [30]


@pytest.mark.parametrize(
    "changes", [{"n_worlds": 10**9}, {"n_worlds": 1 << 20_000}, {"lengths": [30, 10**7]}]
)
def test_what_would_take_years_is_refused_by_name(changes):
    (name,) = changes
    with pytest.raises(ValueError, match=f"{name} is beyond 1000000"):
        Counted(**changes)
    assert Counted(first_seed=10**9).first_seed == 10**9  # a seed counts nothing
