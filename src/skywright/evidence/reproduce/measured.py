"""What a measure takes and gives."""

from typing import NamedTuple

from skywright.evidence.reproduce.cache import Record
from skywright.evidence.reproduce.figures import ClaimFigure

Records = dict[str, list[Record]]
"""Role of a claim -> its flights, one a seed."""


class Measured(NamedTuple):
    """Quantities by name, and the figure that shows them."""

    values: dict[str, float]
    figure: ClaimFigure | None
