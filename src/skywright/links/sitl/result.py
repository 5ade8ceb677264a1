"""How a flight that an autopilot flew has ended."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class SitlResult(NamedTuple):
    """How a flight ended."""

    outcome: str  # finished, aborted (the autopilot failed), diverged
    reason: str
    directory: Path
    metrics: dict[str, float]
    real_time_factor: float
    refused: list[str]
    """A line for each kind of packet that was refused."""

    @property
    def exit_code(self) -> int:
        """0, or 3 where the simulation or the autopilot failed."""
        return 0 if self.outcome == "finished" else 3
