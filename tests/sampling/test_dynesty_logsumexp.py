"""dynesty with the direct logsumexp: the same bits, and SciPy's wherever that is not sure."""

from contextlib import nullcontext

import numpy as np
import pytest
from dynesty import utils
from scipy.special import logsumexp

from sngr_utils.sampling import dynesty_logsumexp, dynesty_nested, engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sngr import refine


@pytest.mark.parametrize("t", [4, 12, 20])
def test_samples_and_evidence_are_those_of_scipys(noisy, monkeypatch, t):
    likelihood = refine.window_likelihood(noisy.solution, t, 0.5)
    settings = SamplerSettings(n_live=20, dlogz=2.0)

    def sampled():
        rng = np.random.default_rng(t)
        return engines.sample_window(likelihood, noisy.covariances[t], settings, "dynesty", rng=rng)

    direct = sampled()
    monkeypatch.setattr(dynesty_nested, "quick_logsumexp", nullcontext)
    slow = sampled()
    assert np.array_equal(direct.samples, slow.samples)
    for name in ("logz", "logzerr", "logwt", "logvol", "information", "ncall"):
        assert np.array_equal(direct.results[name], slow.results[name]), name


def test_dynesty_does_use_it(noisy, monkeypatch):
    """Every point of a run: a release of dynesty that asks otherwise fails here, not silently."""
    calls, honest = [], dynesty_logsumexp.logsumexp_of_two

    def counted(a, axis=None, b=None, **options):
        calls.append((len(a), b))
        return honest(a, axis=axis, b=b, **options)

    dynesty_logsumexp.is_exact()
    monkeypatch.setattr(dynesty_logsumexp, "logsumexp_of_two", counted)
    run = dynesty_nested.run_nested(
        lambda x: -0.5 * x @ x, lambda u: 4 * u - 2, 2, SamplerSettings(n_live=20),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert len(calls) >= len(run.samples) - 20
    assert all(call == (2, [0.5, -0.5]) for call in calls)
    assert utils.logsumexp is logsumexp


@pytest.mark.parametrize(
    ("a", "b"),
    [([-3.0, -2.0], [0.5, -0.5]), ([-2.0, -2.0], [0.5, -0.5]), ([-2.0, -np.inf], [0.5, -0.5]),
     ([np.inf, 1.0], [0.5, 0.5]), ([np.nan, 1.0], [0.5, 0.5]), ([1.0, 0.0], [0.5, -5.0]),
     ([1.0, 0.0], [-0.5, 0.5]), ([1.0, 0.0], [0.0, 0.5]), ([1.0, 2.0, 3.0], [1.0, 1.0, 1.0]),
     ([2.0, 1.0], None), (np.array([2.0, 1.0]), np.array([0.3, -0.2]))],
)  # fmt: skip
def test_every_other_input_is_scipys(a, b):
    with np.errstate(all="ignore"):
        assert np.array_equal(
            dynesty_logsumexp.logsumexp_of_two(a, b=b), logsumexp(a, b=b), equal_nan=True
        )
        options = {"axis": 0, "b": b, "return_sign": True}
        assert np.array_equal(
            dynesty_logsumexp.logsumexp_of_two(a, **options), logsumexp(a, **options),
            equal_nan=True,
        )  # fmt: skip


def test_it_steps_back_where_dynesty_has_changed(monkeypatch):
    """Its function moved, replaced by its own, or other bits: nothing is touched."""
    with dynesty_logsumexp.quick_logsumexp() as replaced:
        assert replaced == dynesty_logsumexp.is_exact()
    own = len
    monkeypatch.setattr(utils, "logsumexp", own)
    with dynesty_logsumexp.quick_logsumexp() as replaced:
        assert not replaced
        assert utils.logsumexp is own
    monkeypatch.delattr(utils, "logsumexp")
    with dynesty_logsumexp.quick_logsumexp() as replaced:
        assert not replaced
        assert not hasattr(utils, "logsumexp")
    monkeypatch.setattr(utils, "logsumexp", logsumexp, raising=False)
    monkeypatch.setattr(dynesty_logsumexp, "is_exact", lambda: False)
    with dynesty_logsumexp.quick_logsumexp() as replaced:
        assert not replaced
        assert utils.logsumexp is logsumexp


def test_an_error_within_puts_scipys_back():
    with pytest.raises(ZeroDivisionError), dynesty_logsumexp.quick_logsumexp():
        raise ZeroDivisionError
    assert utils.logsumexp is logsumexp
