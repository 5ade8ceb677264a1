"""What a report shows of a flight through way-points: nothing that other flights lack."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from skywright.reports.explain import format_value

if TYPE_CHECKING:
    from skywright.run.run import RunResult

FIGURES: dict[str, Callable[[RunResult], Figure | None]] = {}
CAPTIONS: dict[str, tuple[str, str]] = {}


def describe(result: RunResult) -> str:
    """Say what was flown."""
    d = result.description
    seconds = format_value(result.metrics.get("flight.duration_s"))
    return (
        f"{d.robot.name} in world {d.world.name} flew {len(d.mission.waypoints)} way-points in "
        f"{seconds} s"
    )
