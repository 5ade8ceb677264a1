"""Result of a flight under an autopilot."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class SitlResult(NamedTuple):
    """Result of a flight."""

    outcome: str  # finished, aborted (the autopilot failed), diverged
    reason: str
    directory: Path
    metrics: dict[str, float]
    real_time_factor: float
    refused: list[str]
    """One line for each kind of refused packet."""

    @property
    def exit_code(self) -> int:
        """0, or 3 if the simulation or the autopilot failed."""
        return 0 if self.outcome == "finished" else 3
