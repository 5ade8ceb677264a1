"""The estimated duration of a flight: its parts, and the whole against the flight."""

import math
from pathlib import Path

import numpy as np
import pytest

from skywright.core.types import REFERENCE
from skywright.description.dump import dump_description
from skywright.description.loader import load_description
from skywright.missions.skills.survey import (
    BACK_SPEED,
    SPEED,
    build_travel,
    compute_touch_s,
)
from skywright.run.duration import estimate_duration
from skywright.run.kind import MissionKind, load_kind
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup
from skywright.vehicle.rest_to_rest import duration

CLEAR = ["plant.map_error_m=0", "plant.map_error_deg=0", "plant.map_error_size_m=0"]


def _predict(mission: str, *sets: str) -> float:
    return plan_mission(load_description(mission, sets=sets)).flight_s


def test_ground_take_off_hover_and_landing_follow_from_height_and_speed_limits() -> None:
    d = load_description("waypoints", sets=["mission.hover_height_m=2.5"])
    gear, c = d.robot.platform.gear_height_m, d.robot.control
    parts = estimate_duration(Setup(d), 10.0)
    climb = duration(2.5 - gear, c.speed_max_mps, c.acceleration_max_mps2)
    assert parts.start == 1.0 and parts.work == 10.0
    assert parts.ascent == pytest.approx(climb + 1.0)
    assert parts.landing == pytest.approx((2.5 - gear + 0.05) / 0.15 + 1.0)
    assert parts.total == pytest.approx(sum(parts))
    checked = load_description("waypoints", sets=["mission.checklist.spin=true"])
    assert estimate_duration(Setup(checked), 10.0).start == 1.5


def test_a_held_robot_is_released_and_a_bench_only_works() -> None:
    held = estimate_duration(Setup(load_description("bar-transport")), 10.0)
    assert held == (1.0, 3.0, 10.0, 0.0)
    assert estimate_duration(Setup(load_description("arm-test-bench")), 10.0).total == 10.0


def test_a_kind_that_states_nothing_adds_nothing() -> None:
    setup = Setup(load_description("waypoints"))
    plan, kind = plan_mission(setup.description, setup), load_kind("waypoints")
    assert MissionKind.compute_added_s(kind, setup, plan) == 0.0
    assert kind.compute_added_s(setup, plan) == 0.0
    assert plan.flight_s == estimate_duration(setup, plan.duration_s).total
    assert plan.need is not None and 60.0 * plan.need.minutes == pytest.approx(plan.flight_s)


def test_a_touch_is_tare_travel_rest_and_return() -> None:
    row = np.zeros(1, REFERENCE)[0]
    row["R_WS"] = np.eye(3)
    there, back = (build_travel(row, 0.05, speed, 0.0)["t"][-1] for speed in (SPEED, BACK_SPEED))
    assert compute_touch_s(0.05) == pytest.approx(1.0 + there + 1.0 + back, abs=0.021)


def test_a_longer_hold_lengthens_the_flight_by_as_much() -> None:
    flights = [_predict("bridge-contact", f"mission.task.hold_s={hold}") for hold in (3.0, 5.0)]
    assert flights[1] - flights[0] == pytest.approx(2.0 * 6)  # three forces, docked and in flight
    flights = [_predict("flight-modes", f"mission.task.hold_s={hold}") for hold in (2.0, 3.0)]
    assert flights[1] - flights[0] == pytest.approx(9.0)


def test_a_survey_adds_its_touches() -> None:
    without, with_survey = _predict("wall-contact", *CLEAR), _predict("wall-contact")
    assert with_survey - without > 6 * 5.0  # a tunnel is touched at six places


def test_a_request_that_cannot_be_flown_has_no_duration() -> None:
    plan = plan_mission(load_description("flight-modes", sets=["mission.task.tilt_deg=30"]))
    assert not plan.feasible and math.isnan(plan.flight_s) and plan.to_json()["flight_s"] is None


@pytest.mark.parametrize("mission", ["arm-test-bench", "excitation", "flight-modes", "waypoints"])
def test_the_flight_takes_as_long_as_estimated(mission: str) -> None:
    result = fly_and_evaluate(load_description(mission))
    flown = result.metrics["flight.duration_s"]
    assert result.plan.flight_s == pytest.approx(flown, abs=max(5.0, 0.1 * flown))


def test_a_hover_below_the_standing_height_is_refused() -> None:
    """Its climb would be negative; f550-bridge stands on feet of 0.2 m."""
    plan = plan_mission(load_description("flight-modes", sets=["mission.hover_height_m=0.12"]))
    assert not plan.feasible
    assert "mission.hover_height_m = 0.12" in (plan.blocked_by or "")
    assert "is at 0.2 m where it stands" in (plan.blocked_by or "")


def test_a_run_from_before_the_mount_of_a_pendulums_arm_was_refused_loads(tmp_path: Path) -> None:
    """The key had no effect, and is dropped from complete descriptions."""
    d = load_description("impact", robot="bimanual-longreach")
    text = dump_description(d)
    old = text.replace("[robot.arm.mount_z_m]\nvalue = 0.0", "[robot.arm.mount_z_m]\nvalue = -0.11")
    assert old != text
    (tmp_path / "mission.toml").write_text(old, encoding="utf-8")
    assert load_description(tmp_path / "mission.toml").robot == d.robot
