"""What one may set about the samplers of a window."""

from typing import Annotated

from pydantic import Field, field_validator

from sngr_utils.settings import Checked, Positive


class SamplerSettings(Checked):
    """Settings of a nested sampling run; the defaults are the paper's.

    n_live : live points
    min_walks : steps of each random walk, raised to the dimension where that is larger
    dlogz : stop when the live points can add no more than this to log Z, [nats]
    prior_scale : c in the prior N(MAP, c Sigma_w)
    likelihood_factor : factor on GTSAM's error(). error() is already r^2 / (2 sigma^2), so 1
        gives the likelihood and the paper's 1/2 its square root
    """

    n_live: Annotated[int, Field(ge=20)] = 100
    min_walks: Annotated[int, Field(ge=1)] = 9
    dlogz: Positive = 0.5
    prior_scale: Positive = 1.0
    likelihood_factor: Positive = 0.5

    def walks(self, dimension: int) -> int:
        """Steps of each random walk in that many dimensions: max(d, min_walks)."""
        return max(dimension, self.min_walks)


ENGINES = ("dynesty", "nested", "fast")


class EngineChoice(Checked):
    """engine : what draws the samples of a window

    dynesty : dynesty, GTSAM's likelihood; the reference
    nested : compiled nested sampler
    fast : many-start optimisation and importance sampling; where its own diagnostics or a
        random audit object, the compiled nested sampler
    """

    engine: str = "dynesty"

    @field_validator("engine")
    @classmethod
    def _known(cls, engine: str) -> str:
        if engine not in ENGINES:
            raise ValueError(f"engine is {engine!r}: it must be one of {', '.join(ENGINES)}")
        return engine


class FastSettings(Checked):
    """Settings of the fast path.

    n_draws is multiplied by `MORE` where too few of the draws are effective.

    n_starts : optimisations, the first at the MAP, the others at draws from the prior
    n_draws : importance samples
    """

    n_starts: Annotated[int, Field(ge=1)] = 32
    n_draws: Annotated[int, Field(ge=100)] = 600
