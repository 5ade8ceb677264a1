"""Input and output of a measure."""

from typing import NamedTuple

from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import ClaimFigure

Records = dict[str, list[Record]]
"""Role of a claim -> its flights, one per seed."""


class Measured(NamedTuple):
    """Quantities by name, and their figure."""

    values: dict[str, float]
    figure: ClaimFigure | None
