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
    from skywright.description.loader import Description

KINDS = {
    "bar-insertion": "skywright.missions.bar_insertion.figures",
    "bar-transport": "skywright.missions.bar_transport.figures",
    "bimanual-bench": "skywright.missions.bimanual_bench.figures",
    "follow-plan": "skywright.missions.waypoints.figures",
    "impact": "skywright.missions.impact.figures",
    "scan": "skywright.missions.scan.figures",
    "sensor-install": "skywright.missions.sensor_install.figures",
    "tool-install": "skywright.missions.tool_install.figures",
    "waypoints": "skywright.missions.waypoints.figures",
    "excitation": "skywright.missions.excitation.figures",
    "bridge-contact": "skywright.missions.bridge_contact.figures",
    "arm-test-bench": "skywright.missions.bridge_contact.figures",
    "flight-modes": "skywright.missions.flight_modes.figures",
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
