"""Metrics of each kind of mission: one function a kind, imported when needed.

The function takes (samples, phases, plan, description) and returns its metrics and, of a scan, what
the processing made of the probe's signal. Names and meanings stand in run/names.py.
"""

from __future__ import annotations

import importlib
from typing import Any

from numpy.typing import NDArray

from skywright.description.loader import Description
from skywright.inspection.weld import WeldResult
from skywright.run.flight import PhaseRecord
from skywright.run.planning import MissionPlan

METRICS = {
    "bar-insertion": "skywright.missions.bar_insertion.metrics:compute_insertion_metrics",
    "bar-transport": "skywright.missions.bar_transport.metrics:compute_transport_metrics",
    "arm-test-bench": "skywright.missions.bridge_contact.metrics:compute_bench_metrics",
    "flight-modes": "skywright.missions.flight_modes.metrics:compute_modes_metrics",
    "bridge-contact": "skywright.missions.bridge_contact.metrics:compute_contact_metrics",
    "bimanual-bench": "skywright.missions.bimanual_bench.metrics:compute_bench_metrics",
    "follow-plan": "skywright.missions.bar_transport.metrics:compute_transport_metrics",
    "impact": "skywright.missions.impact.metrics:compute_impact_metrics",
    "scan": "skywright.run.metrics:compute_scan_metrics",
    "sensor-install": "skywright.missions.sensor_install.metrics:compute_install_metrics",
    "tool-install": "skywright.missions.tool_install.metrics:compute_tool_metrics",
    "waypoints": "skywright.run.metrics:compute_waypoint_metrics",
    "excitation": "skywright.run.metrics:compute_waypoint_metrics",
}
"""Kind of mission -> "module:function"."""


def compute_kind_metrics(
    samples: NDArray[Any],
    phases: list[PhaseRecord],
    plan: MissionPlan,
    description: Description,
) -> tuple[dict[str, float], WeldResult | None]:
    """Return the metrics of the mission's kind.

    Raises InputError when the samples do not allow them (a flight cut short).
    """
    module, _, name = METRICS[description.mission.kind].partition(":")
    found: tuple[dict[str, float], WeldResult | None] = getattr(
        importlib.import_module(module), name
    )(samples, phases, plan, description)
    return found
