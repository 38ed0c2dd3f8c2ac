"""Parameter sets that check themselves, and the types of their fields."""

from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator


def _distinct(values: list) -> list:
    if len(set(values)) < len(values):
        raise ValueError("it must not repeat a value")
    return values


# A length, an angle, a factor: far beyond any that is meant, near enough that squares are numbers.
Positive = Annotated[float, Field(ge=1e-9, le=1e9)]
Probability = Annotated[float, Field(ge=0, le=1)]
Seed = Annotated[int, Field(ge=0, le=2**53)]
PosesOfWindows = Annotated[int, Field(ge=5)]  # fewer have no window that may trigger
Distinct = AfterValidator(_distinct)  # of a list: Annotated[list[Seed], Distinct]
Levels = Annotated[list[Probability], Field(min_length=1), Distinct]  # the p of a study

# Of whatever is counted: a larger study ends in no year, or in no memory
MOST = {"n_poses": 100_000, "n_landmarks": 1_000, "jobs": 1_024, "others": 1_000_000}

PRESET_NAMES = ("A", "B", "C")  # names of `conventions.PRESETS`: what the paper leaves open
READING = "C"  # the preset that is our reading of the paper: GTSAM's own iSAM2 settings


class Checked(BaseModel):
    """Base of all parameter sets: frozen, strictly typed, no unknown names, no NaN.

    A value out of range raises `pydantic.ValidationError` (a ValueError) that names the
    parameter, the value and what is allowed.
    """

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", allow_inf_nan=False, validate_default=True
    )

    @model_validator(mode="after")
    def _can_be_done(self) -> Self:
        for name, value in self:
            counts = value if isinstance(value, list) else [value]
            most = max((n for n in counts if isinstance(n, int)), default=0)
            limit = MOST.get(name, MOST["others"])
            if most > limit and not name.endswith("seed"):
                raise ValueError(f"{name} is beyond {limit}: it would take years")
        return self

    @classmethod
    def pick(cls, names: dict[str, object]) -> Self:
        """The set whose fields are looked up in `names`, e.g. a notebook's ``globals()``."""
        return cls(**{field: names[field] for field in cls.model_fields})

    def part(self, model: type["Checked"]) -> "Checked":
        """The fields of this set that `model` declares, as a `model`."""
        return model(**{name: getattr(self, name) for name in model.model_fields})
