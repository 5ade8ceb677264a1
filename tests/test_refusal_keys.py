"""Refusals whose limit is a margin name its key and value, and the key moves the limit."""

from __future__ import annotations

import pytest

from skywright.description.loader import load_description
from skywright.run.planning import plan_mission

CASES = [
    ("sensor-install", "mission.task.way_clearance_m=0.9", "0.9 m"),
    ("sensor-install", "mission.task.near_clearance_m=0.2", "0.2 m"),
    ("tool-install", "mission.task.carried_clearance_m=0.3", "0.3 m"),
    ("tool-install", "mission.task.near_clearance_m=0.2", "0.2 m"),
    ("bar-insertion", "mission.task.near_clearance_m=0.2", "0.2 m"),
    ("bridge-contact", "mission.task.way_clearance_m=0.9", "0.9 m"),
    ("bridge-contact", "mission.task.near_clearance_m=0.2", "0.2 m"),
    ("wall-contact", "mission.task.turn_clearance_m=0.5", "0.5 m"),
    ("excitation", "mission.clearance_m=1.0", "1 m"),
    ("excitation", "mission.self_clearance_m=0.1", "0.1 m"),
]


@pytest.mark.parametrize(("mission", "sets", "value"), CASES)
def test_a_margin_names_its_key(mission: str, sets: str, value: str) -> None:
    """The built-in mission is feasible (tests of its kind); the larger margin forbids it."""
    low = ["mission.hover_height_m=1"] if mission == "excitation" else []
    found = plan_mission(load_description(mission, sets=[sets, *low]))
    key = sets.split("=")[0]
    assert not found.feasible
    assert f"({key})" in str(found.blocked_by) and value in str(found.blocked_by)


def test_a_docked_press_names_its_reserves() -> None:
    known = ["plant.map_error_m=0", "plant.map_error_deg=0"]  # else it is judged after the survey
    slope = ["world.structure.slope_deg=3", "mission.task.forces_n=[4.0]", *known]
    assert plan_mission(load_description("bridge-contact", sets=slope)).feasible
    more = "mission.task.dock_rotor_reserve=0.45"
    told = str(plan_mission(load_description("bridge-contact", sets=[*slope, more])).blocked_by)
    assert "keep 45% of its range (mission.task.dock_rotor_reserve)" in told
    assert "use 50% of its friction (mission.task.dock_friction_fraction)" in told
