"""What a report shows of each kind of mission: its pictures and one sentence.

A kind's module has
- `FIGURES`: name -> function of a RunResult that returns a Figure, or None with nothing to show;
- `CAPTIONS`: name -> (title, caption), in the order of the page;
- `describe(result)`: what was done, as the beginning of a sentence ("ROBOT in world W ...").
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skywright.missions.loader import Description

KINDS = {
    "bar-insertion": "skywright.reports.figures.bar_insertion",
    "bar-transport": "skywright.reports.figures.bar_transport",
    "bimanual-bench": "skywright.reports.figures.bimanual_bench",
    "follow-plan": "skywright.reports.figures.waypoints",
    "impact": "skywright.reports.figures.impact",
    "scan": "skywright.reports.figures.inspection",
    "sensor-install": "skywright.reports.figures.sensor_install",
    "tool-install": "skywright.reports.figures.tool_install",
    "waypoints": "skywright.reports.figures.waypoints",
    "excitation": "skywright.reports.figures.excitation",
    "bridge-contact": "skywright.reports.figures.bridge_contact",
    "arm-test-bench": "skywright.reports.figures.bridge_contact",
    "flight-modes": "skywright.reports.figures.flight_modes",
}
"""Kind of mission -> module."""


def load_figures(kind: str) -> Any:
    """Return the module that draws a kind of mission."""
    return importlib.import_module(KINDS[kind])


def find_task(description: Description) -> Any:
    """Return the task of a mission, a table of its kind."""
    mission: Any = description.mission
    return mission.task


def list_figures() -> dict[str, Any]:
    """Return the figures of all kinds by name."""
    out: dict[str, Any] = {}
    for kind in KINDS:
        out |= load_figures(kind).FIGURES
    return out
