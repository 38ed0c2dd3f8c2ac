"""dynesty with its random walk compiled, through dynesty's public sampler interface.

The proposals are those of `dynesty_nested.CanonicalWalk`, the likelihood is `compiled.energy`;
dynesty keeps the live points, the bounding ellipsoid, the step size and the evidence.
"""

import math

import numpy as np
from dynesty.internal_samplers import SamplerReturn
from dynesty.utils import get_random_generator

from sngr_utils.numerics.jit import compile_once
from sngr_utils.numerics.normal import normal_quantile
from sngr_utils.sampling.dynesty_nested import CanonicalWalk
from sngr_utils.sampling.targets.compiled import Factors, energy


@compile_once
def _walk(factors, cholesky, u, limit, axes, scale, walks, rng):
    """dynesty's walk: uniform steps in an ellipsoid, kept inside the cube and below the limit.

    Returns
    -------
    u, xi, steps accepted, likelihood calls; without an accepted step xi is not set
    """
    d = len(u)
    poses, points = factors.poses.copy(), factors.points.copy()
    at, x = u.copy(), np.empty(d)
    ball, new, z, new_x = np.empty(d), np.empty(d), np.empty(d), np.empty(d)
    accepted, calls = 0, 0
    for _ in range(walks):
        norm = 0.0
        for i in range(d):
            ball[i] = rng.standard_normal()
            norm += ball[i] * ball[i]
        length = scale * rng.random() ** (1 / d) / math.sqrt(norm)
        inside = True
        for i in range(d):
            step = 0.0
            for j in range(i + 1):
                step += axes[i, j] * ball[j]
            new[i] = at[i] + length * step
            inside = inside and 0 < new[i] < 1
        if not inside:
            continue
        for i in range(d):
            z[i] = normal_quantile(new[i])
        for i in range(d):
            total = 0.0
            for j in range(i + 1):
                total += cholesky[i, j] * z[j]
            new_x[i] = total
        calls += 1
        if energy(factors, new_x, poses, points, limit) < limit:
            for i in range(d):
                at[i], x[i] = new[i], new_x[i]
            accepted += 1
    return at, x, accepted, calls


class CompiledWalk(CanonicalWalk):
    """`dynesty_nested.CanonicalWalk` with its loop compiled.

    Parameters
    ----------
    factors : what the log-likelihood given to dynesty is made of
    cholesky : (d, d) L of the prior transform given to dynesty
    walks : steps of each walk
    """

    def __init__(self, factors: Factors, cholesky: np.ndarray, **options):
        super().__init__(**options)
        self.sampler_kwargs |= {"factors": factors, "cholesky": cholesky}
        self.input_kwargs |= {"factors": factors, "cholesky": cholesky}

    @staticmethod
    def sample(args):
        rng, options = get_random_generator(args.rseed), args.kwargs
        walks = options["walks"]
        u, xi, accepted, calls = _walk(
            options["factors"], options["cholesky"], np.asarray(args.u), -args.loglstar,
            np.asarray(args.axes), float(args.scale), walks, rng,  # which is 1, an int, at first
        )  # fmt: skip
        if accepted == 0:  # dynesty sees that the point has not moved, and tries again
            u, xi = args.u, args.prior_transform(args.u)
        logl = args.loglikelihood(xi)
        tuning = {"accept": accepted, "reject": walks - accepted, "scale": args.scale}
        return SamplerReturn(
            u=u, v=xi, logl=logl, tuning_info=tuning, ncalls=calls + 1, evaluation_history=[],
            proposal_stats={"n_accept": accepted, "n_reject": walks - accepted},
        )  # fmt: skip
