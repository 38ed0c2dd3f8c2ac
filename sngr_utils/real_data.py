"""Driver of notebook 10: two drives of a mower among four radios, as they were recorded.

What takes minutes is a study with committed rows (`studies`); the rest is computed here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from sngr_utils.settings import Checked, Positive, Probability, Seed

# What runs is imported where it runs: a check of all parameters needs no GTSAM and no compiler.
if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from sngr_utils.experiments.real_stretch import Finder, Stretch
    from sngr_utils.files.recording import Recording
    from sngr_utils.world.log import Log

OTHER = {"Plaza1": "Plaza2", "Plaza2": "Plaza1"}
MIRRORED = range(10, 301, 10)  # poses after which the mirror images are tried
Poses = Annotated[int, Field(ge=50, le=400)]


class Config(Checked):
    """Parameters of the chapter.

    seed : of wrong labels, and of random maps to start from
    n_poses, p : of the stretch that is driven here, and the share of wrong labels on it
    prefixes : poses after which maps without labels are looked for
    n_starts : random maps to start from
    n_scales, scale_low, scale_high : range scales at which the cost is computed
    """

    seed: Seed = 100
    n_poses: Annotated[int, Field(ge=50, le=1500)] = 500
    p: Probability = 0.4
    prefixes: Annotated[list[Poses], Field(min_length=2)] = [80, 120, 160, 200, 240]
    n_starts: Annotated[int, Field(ge=2)] = 40
    n_scales: Annotated[int, Field(ge=3)] = 13
    scale_low: Positive = 1.04
    scale_high: Positive = 1.1

    @model_validator(mode="after")
    def _consistent(self):
        if self.prefixes != sorted(set(self.prefixes)):
            raise ValueError(f"prefixes is {self.prefixes}: each must be longer than the last")
        if self.scale_low >= self.scale_high:
            raise ValueError(f"scale_low is {self.scale_low}: it must be below scale_high")
        return self


def recording(name: str, heading: str = "course") -> Recording:
    """A Plaza set as `plaza.read` gives it."""
    from sngr_utils.files import plaza

    return plaza.read(plaza.wheel(name), heading)


def raw(name: str, table: str) -> np.ndarray:
    """A table of a Plaza set as its file has it: "DRp" is dead reckoning, "GT" is GPS."""
    from scipy import io

    from sngr_utils.files import plaza

    return io.loadmat(str(plaza.wheel(name)))[table]


def study(name: str) -> pd.DataFrame:
    """The committed rows of a study."""
    from sngr_utils.experiments import studies

    return studies.committed(name)


def found_in(name: str) -> dict:
    """What the study found in a Plaza set with its own labels: scale, offset, noise; no truth."""
    rows = study("plaza").query("set == @name and kind == 'labels' and p == 0")
    return rows[rows["method"] == "growing_map"].iloc[0].to_dict()


def calibrated(name: str) -> Log:
    """The log of a Plaza set, its ranges corrected by what was found in the other one."""
    from sngr_utils.experiments import real_online

    return real_online.calibrated(recording(name).log, found_in(OTHER[name]))


def scale_profile(config: Config, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(N,) range scales, and the least cost of a whole drive with each of them held, [nats].

    Labels are right, and the noise is what the study found.
    """
    import numpy as np

    from sngr_utils.experiments import real_stretch

    found = found_in(name)
    log = real_stretch.with_noise(recording(name).log, found)
    scales = np.linspace(config.scale_low, config.scale_high, config.n_scales)
    return scales, real_stretch.costs_of_scales(log, scales, found["offset"])


def drive(config: Config, name: str) -> Stretch:
    """The online estimator on the first poses of a drive, with wrong labels."""
    import numpy as np

    from sngr_utils.experiments import real_data, real_online, real_stretch

    rng = np.random.default_rng(config.seed)
    log, truth = real_data.changed(recording(name), "labels", config.p, rng=rng)
    log = real_online.handed(log, found_in(OTHER[name])).first(config.n_poses)
    found, seconds = real_stretch.drive(log, rng=rng)
    sources, there = truth.source_of[: len(log.ranges)], truth.poses[: log.n_poses, :2]
    return real_stretch.Stretch(log, there, truth.landmarks, sources, found, seconds)


def mirror_gaps(name: str) -> pd.DataFrame:
    """See `real_stretch.mirror_gaps`, with the set's own labels."""
    from sngr_utils.experiments import real_stretch

    return real_stretch.mirror_gaps(calibrated(name).first(MIRRORED[-1]), MIRRORED)


def maps_without_labels(config: Config, name: str, n_poses: int, find: Finder) -> list[tuple]:
    """See `real_stretch.maps_without_labels`; random numbers are those of the number of poses."""
    import numpy as np

    from sngr_utils.experiments import real_stretch

    rng = np.random.default_rng([config.seed, n_poses])
    log = calibrated(name)
    return real_stretch.maps_without_labels(log, n_poses, config.n_starts, find, rng=rng)


def runners_up(config: Config, find: Finder) -> pd.DataFrame:
    """By how much the second-best map without labels is worse: columns set, poses, gap [nats]."""
    import pandas as pd

    from sngr_utils.experiments import real_stretch

    rows = [
        (name, n, real_stretch.runner_up(maps_without_labels(config, name, n, find)))
        for name in OTHER
        for n in config.prefixes
    ]
    return pd.DataFrame(rows, columns=["set", "poses", "gap"])
