"""Base class of description tables, and the provenance of their numbers."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from skywright.core.ranges import check_range

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_. -]{0,63}$")]
"""Names become folder names: letters, digits, space, and ._- after the first character."""
Coordinate = Annotated[float, Field(ge=-1000, le=1000)]  # m
Length = Annotated[float, Field(ge=1e-6, le=100)]  # m, of a part
Offset = Annotated[float, Field(ge=-100, le=100)]  # m, of a part from another
Bandwidth = Annotated[float, Field(ge=1e-3, le=1000)]  # rad/s
Fraction = Annotated[float, Field(ge=0, le=1)]

SourceKind = Literal["paper", "derived", "datasheet", "assumed", "set", "imported", "asked"]


class Source(NamedTuple):
    """Provenance of a number; `assumed` has a plausible range."""

    kind: str
    note: str = ""
    range: tuple[float, float] | None = None


class Spec(BaseModel):
    """A frozen, strictly validated table of a description file; unknown keys are rejected."""

    inline_tables: ClassVar[tuple[str, ...]] = ()
    """Fields (dicts of tables) whose tables are written directly under this one in a file."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,  # no text or true/false where a number is meant
        extra="forbid",
        allow_inf_nan=False,
        str_strip_whitespace=True,
    )

    @field_validator("*")
    @classmethod
    def _is_plausible(cls, value: object, info: ValidationInfo) -> object:
        key = info.field_name or ""
        positive = any(hasattr(bound, "gt") for bound in cls.model_fields[key].metadata)
        check_range(key, value, may_vanish=not positive)
        return value
