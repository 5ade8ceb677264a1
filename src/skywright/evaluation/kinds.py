"""Metrics of each kind of mission: one function a kind, imported when needed.

The function takes (samples, phases, plan, description) and returns its metrics and, of a scan, what
the processing made of the probe's signal. Names and meanings stand in evaluation/names.py.
"""

from __future__ import annotations

import importlib
from typing import Any

from numpy.typing import NDArray

from skywright.inspection.weld import WeldResult
from skywright.missions.flight import PhaseRecord
from skywright.missions.loader import Description
from skywright.missions.planning import MissionPlan

METRICS = {
    "bar-insertion": "skywright.evaluation.bar_insertion:compute_insertion_metrics",
    "bar-transport": "skywright.evaluation.bar_transport:compute_transport_metrics",
    "arm-test-bench": "skywright.evaluation.bridge_contact:compute_bench_metrics",
    "flight-modes": "skywright.evaluation.flight_modes:compute_modes_metrics",
    "bridge-contact": "skywright.evaluation.bridge_contact:compute_contact_metrics",
    "bimanual-bench": "skywright.evaluation.bimanual_bench:compute_bench_metrics",
    "follow-plan": "skywright.evaluation.bar_transport:compute_transport_metrics",
    "impact": "skywright.evaluation.impact:compute_impact_metrics",
    "scan": "skywright.evaluation.metrics:compute_scan_metrics",
    "sensor-install": "skywright.evaluation.sensor_install:compute_install_metrics",
    "tool-install": "skywright.evaluation.tool_install:compute_tool_metrics",
    "waypoints": "skywright.evaluation.metrics:compute_waypoint_metrics",
    "excitation": "skywright.evaluation.metrics:compute_waypoint_metrics",
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
