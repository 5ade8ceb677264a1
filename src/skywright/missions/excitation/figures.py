"""Figures of a report on an excitation flight: only those of any flight."""

from skywright.missions.excitation.task import ExcitationTask
from skywright.reports.explain import format_value
from skywright.run.kind import Figures
from skywright.run.result import RunResult


def describe(result: RunResult[ExcitationTask, None]) -> str:
    """Return a sentence on the flight."""
    d = result.description
    moves = sum(name.startswith("excite") for name in result.plan.segments)
    seconds = format_value(result.metrics.get("flight.duration_s"))
    return (
        f"{d.robot.name} in world {d.world.name} excited its dynamics in {moves} postures "
        f"of its arm within {seconds} s (for `skywright identify`)"
    )


FIGURES = Figures(
    describe,
    phases={
        "excite *": "Platform or arm follow sums of sines in all directions.",
        "rest *": "The robot hovers, so that the oscillation decays.",
    },
)
