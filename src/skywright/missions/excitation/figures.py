"""What a report shows of an excitation flight: nothing that other flights lack."""

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
    moves = sum(name.startswith("excite") for name in result.plan.segments)
    seconds = format_value(result.metrics.get("flight.duration_s"))
    return (
        f"{d.robot.name} in world {d.world.name} shook itself in {moves} postures of its arm "
        f"within {seconds} s (`skywright identify` learns from it)"
    )
