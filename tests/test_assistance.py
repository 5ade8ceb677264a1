"""Operated contact: what assistance does along its axis, computed operators, the operated press."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skywright
from skywright.ground.operator_model import MANNERS, ModelOperator
from skywright.missions.skills.assistance import (
    LIMIT,
    SLOW_MPS,
    SLOW_RATE,
    Assistance,
    Level,
)
from skywright.run.operator import Sight, Stick
from skywright.vehicle.plant import MISSION_TICK

UP = (0.0, 0.0, 1.0)
LEVELS: tuple[Level, ...] = ("none", "slow", "guard", "hold")
AXIS, GAP, FORCE = st.floats(-1.0, 1.0), st.floats(-0.05, 0.2), st.floats(0.0, 50.0)


@given(AXIS, GAP, FORCE)
def test_without_assistance_the_stick_is_followed(axis: float, gap: float, force: float) -> None:
    assert Assistance("none", 2.0).step(axis, 0.05, gap, force) == 0.05 * axis


@given(AXIS, GAP, FORCE)
def test_slow_limits_the_speed_into_the_contact_alone(
    axis: float, gap: float, force: float
) -> None:
    v = Assistance("slow", 2.0).step(axis, 0.05, gap, force)
    assert v == min(0.05 * axis, SLOW_MPS + SLOW_RATE * max(gap, 0.0))


@given(AXIS, GAP, FORCE)
def test_the_guard_never_adds_force_at_its_limit(axis: float, gap: float, force: float) -> None:
    v = Assistance("guard", 2.0).step(axis, 0.05, gap, force)
    assert v <= 0.05 * axis  # it takes speed away, never adds some
    if force >= LIMIT * 2.0:
        assert v <= 0.0
    if force == 0.0:
        assert v == 0.05 * axis


def _press(
    level: Level, stiffness: float, sticks: Any, seconds: float, lag: int = 0
) -> list[float]:
    """Press a spring with a hand that moves as it is told, felt `lag` ticks late; the forces."""
    help_, z, v_max, out = Assistance(level, 2.0), -0.02, 0.03, []
    felt = deque([0.0] * (lag + 1), maxlen=lag + 1)
    for k in range(round(seconds / MISSION_TICK)):
        z += MISSION_TICK * help_.step(sticks(k * MISSION_TICK), v_max, -z, felt[0])
        out.append(stiffness * max(z, 0.0))
        felt.append(out[-1])
    return out


@pytest.mark.parametrize("stiffness", [40.0, 80.0, 150.0, 300.0])
def test_hold_leads_the_force_to_what_is_asked_for_whatever_the_stick_does(
    stiffness: float,
) -> None:
    forces = _press("hold", stiffness, lambda t: 0.5, 25.0, lag=8)
    assert abs(forces[-1] - 2.0) < 0.1
    assert max(forces) < 1.3 * 2.0


@pytest.mark.parametrize("stiffness", [40.0, 80.0, 150.0, 300.0])
def test_the_guard_stops_a_stick_that_is_held_into_the_contact(stiffness: float) -> None:
    assert max(_press("guard", stiffness, lambda t: 1.0, 10.0)) <= LIMIT * 2.0 + 1e-6
    assert max(_press("none", stiffness, lambda t: 1.0, 10.0)) > 2.0 * LIMIT * 2.0


def test_pulling_the_stick_back_ends_the_hold() -> None:
    forces = _press("hold", 80.0, lambda t: 0.5 if t < 10.0 else -0.9, 15.0)
    assert forces[round(9.9 / MISSION_TICK)] > 1.8 and forces[-1] == 0.0


@pytest.mark.parametrize("manner", sorted(MANNERS))
@pytest.mark.parametrize("delay", [0.0, 0.15])
@pytest.mark.parametrize("level", LEVELS)
def test_a_computed_operator_presses_a_spring_and_says_when_it_is_done(
    manner: str, delay: float, level: Level
) -> None:
    operator, help_ = ModelOperator(manner, 3, 0.03), Assistance(level, 2.0)
    off, force, forces = np.array([-0.02, 0.02, -0.05]), 0.0, []
    late = round(delay / MISSION_TICK)
    sights = deque([Sight(off.copy(), False, UP, 0.0, 2.0, 5.0)] * (late + 1), maxlen=late + 1)
    sticks = deque([Stick(np.zeros(3), False)] * (late + 1), maxlen=late + 1)
    for k in range(round(60.0 / MISSION_TICK)):
        seen = operator.read(k * MISSION_TICK, sights[0])
        assert seen is not None
        sticks.append(seen)
        stick = sticks[0]
        axes = np.array(stick.axes)
        axes[2] = help_.step(float(axes[2]), 0.03, float(-off[2]), force) / 0.03
        off = off + MISSION_TICK * 0.03 * axes
        force = 80.0 * max(float(off[2]), 0.0)
        forces.append(force)
        sights.append(Sight(off.copy(), False, UP, force, 2.0, 5.0))
        if stick.button:
            break
    assert stick.button and abs(force - 2.0) < 1.0
    assert np.hypot(off[0], off[1]) < 0.012
    assert max(forces) < 2.0 * 2.0


# --- flights -----------------------------------------------------------------------------------

PRESS = {
    "mission.task.hover_s": 0, "mission.task.swing_deg": 0, "mission.task.survey": False,
    "mission.timestep_ms": 2,
}  # fmt: skip


def _count_phases(result: Any) -> list[str]:
    return [p.name for p in result.phases if p.name in ("touch", "press", "force", "retract")]


def test_an_operated_press_installs_the_sensor_and_repeats_bit_by_bit(tmp_path: Path) -> None:
    d = skywright.load("sensor-install", sets=PRESS | {"mission.task.assistance": "guard"})
    first = skywright.run(d, operator="model:careful", report=False, out=tmp_path / "first")
    assert first.outcome == "succeeded", first.reason
    assert _count_phases(first) == ["touch", "press", "force", "retract"]
    assert 1.5 < first.metrics["operator.force_max_n"] < 3.0
    assert first.metrics["sensor.installed"] == 1.0
    assert "force.mean_error_n" in first.waived  # a person does not hold 5 %
    again = skywright.run(first.directory, report=False, out=tmp_path / "again")
    assert again.metrics["operator.force_max_n"] == first.metrics["operator.force_max_n"]
    np.testing.assert_array_equal(again.samples["left_p_WH"], first.samples["left_p_WH"])


def test_the_stick_leads_the_force_where_control_is_force(tmp_path: Path) -> None:
    d = skywright.load("sensor-install", sets=PRESS | {"mission.task.control": "force"})
    result = skywright.run(d, operator="model:practised", report=False, out=tmp_path / "run")
    assert result.outcome == "succeeded", result.reason
    s = result.samples
    held = (s["t"] > result.phases[-4].start_s) & (s["t"] < result.phases[-4].end_s)
    assert float(np.max(np.abs(s["left_ref_f_W"][held]))) > 0.0
