"""Base of every validated description, and the provenance of its numbers."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]

SourceKind = Literal["paper", "derived", "datasheet", "assumed", "set"]


class Source(NamedTuple):
    """Where a number comes from; `assumed` carries the plausible range."""

    kind: str
    note: str = ""
    range: tuple[float, float] | None = None


class Spec(BaseModel):
    """A frozen, strictly validated table of a description file; unknown keys are rejected."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, str_strip_whitespace=True
    )
