"""What the paper leaves open, and our three presets of it."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sngr_utils.settings import READING, Checked, Positive


class Conventions(Checked):
    """What the paper leaves open. The defaults are preset B.

    x0_sigmas : prior on the first pose, centred on the truth, [m, m, rad]
    landmark_prior_sigma : weak prior on each landmark, centred on its start, [m]
    relinearize_threshold : iSAM2 relinearises a variable that moved by more than this
    relinearize_skip : iSAM2 looks for such variables every so many updates
    nees_frame : frame of the position block P in the NEES. GTSAM reports it in the body frame;
        "world" rotates it to the frame of the error, "body" takes it as it comes
    """

    x0_sigmas: Annotated[list[Positive], Field(min_length=3, max_length=3)] = [0.1, 0.1, 0.05]
    landmark_prior_sigma: Positive = 0.5
    relinearize_threshold: Positive = 0.1
    relinearize_skip: Annotated[int, Field(ge=1)] = 1
    nees_frame: Literal["world", "body"] = "world"


PRESETS = {
    "A": Conventions(x0_sigmas=[0.2, 0.2, 0.001], landmark_prior_sigma=10.0, relinearize_skip=10),
    "B": Conventions(),
    "C": Conventions(landmark_prior_sigma=5.0, relinearize_skip=10),
}

WHY = {
    "A": "shows what a known first heading changes",
    "B": "gives the printed trigger counts on clean data, seed 0",
    "C": "GTSAM's own iSAM2 settings: our reading",
}


def preset_conventions(preset: str, overrides: dict | None = None) -> Conventions:
    """The named preset ("A", "B" or "C") with single fields replaced.

    Raises
    ------
    ValueError : unknown preset, unknown field, or a value out of range
    """
    if preset not in PRESETS:
        raise ValueError(f"preset is {preset!r}: it must be one of {sorted(PRESETS)}")
    for field in overrides or {}:
        if field not in Conventions.model_fields:
            allowed = ", ".join(Conventions.model_fields)
            raise ValueError(f"conventions has no field {field!r}: it may set {allowed}")
    return Conventions(**{**PRESETS[preset].model_dump(), **(overrides or {})})


class OpenConventions(Checked):
    """preset, conventions : the named preset with single fields replaced"""

    preset: str = READING
    conventions: dict = {}

    @model_validator(mode="after")
    def _conventions_exist(self):
        preset_conventions(self.preset, self.conventions)
        return self

    @property
    def chosen(self) -> Conventions:
        return preset_conventions(self.preset, self.conventions)

    def under(self, preset: str) -> Self:
        """The same parameters under a preset as it stands."""
        return self.model_copy(update={"preset": preset, "conventions": {}})
