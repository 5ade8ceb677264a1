"""The two ways of running, determinism, user laws, and what stops a flight."""

from __future__ import annotations

import numpy as np
import pytest

from exact_map import EXACT
from short_mission import HOP
from skywright.description.loader import load_description
from skywright.errors import InputError, SimulationError
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor
from skywright.vehicle.sensors.mocap import MotionCapture
from user_parts import HOVER, write_law

SHORT = [
    *EXACT,
    "mission.task.passes=1",
    "mission.task.pass_length_m=0.03",
    "mission.timestep_ms=2",
]


def fly(sets, fault=None):
    """Fly a short scan; `fault(vehicle, phase)` may disturb it. Returns (samples, supervisor)."""
    d = load_description("pipe-weld-scan", sets=[*SHORT, *sets])
    plan = plan_mission(d)
    assert plan.feasible, plan.blocked_by
    blocks = []
    vehicle = build_vehicle(d, blocks.append)
    supervisor = Supervisor(
        vehicle,
        d.mission,
        plan,
        d.robot.platform.gear_height_m,
        on_phase=lambda before, name: vehicle.set_phase(len(before)),
        on_tick=None if fault is None else lambda t, phase: fault(vehicle, phase),
    )
    flight = supervisor.fly()
    vehicle.flush()
    return np.concatenate(blocks), supervisor.phases, flight


class LoseContact:
    """Pulls the robot off the pipe once, so that the mission has to retry."""

    def __init__(self):
        self.left = 35

    def __call__(self, vehicle, phase):
        vehicle.sim.data.qfrc_applied[:3] = 0.0
        if phase == "scan" and self.left > 0:
            self.left -= 1
            vehicle.sim.data.qfrc_applied[0] = -8.0


@pytest.fixture(scope="module")
def retried():
    return fly(["mission.mode=fast"], LoseContact())


def test_fast_and_interactive_are_bit_identical_through_a_retry(retried):
    fast, phases, flight = retried
    slow, phases_slow, _ = fly(["mission.mode=interactive"], LoseContact())
    assert flight.completed
    assert "retry" in [p.outcome for p in phases]
    assert phases == phases_slow
    assert fast.tobytes() == slow.tobytes()


def test_same_seed_same_recording_other_seed_another(retried):
    a, _, _ = fly(["mission.seed=5"])
    b, _, _ = fly(["mission.seed=5"])
    c, phases, _ = retried  # of seed 1: the same flight until contact is lost
    assert a.tobytes() == b.tobytes()
    before = c["t"] < next(p.start_s for p in phases if p.name == "scan")
    assert before.sum() > 500
    assert a[: before.sum()].tobytes() != c[before].tobytes()


def test_a_plain_python_law_flies(tmp_path):
    d = load_description("waypoints", "othex", sets=[*HOP, *write_law(tmp_path, HOVER)])
    blocks = []
    vehicle = build_vehicle(d, blocks.append)
    assert vehicle.interactive
    Supervisor(vehicle, d.mission, plan_mission(d), d.robot.platform.gear_height_m).fly()
    vehicle.flush()
    s = np.concatenate(blocks)
    flying = s[(s["t"] > 5) & (s["t"] < s["t"][-1] - 8)]
    assert len(flying) > 200
    error = np.linalg.norm(flying["p_WB"] - flying["ref_p_WB"], axis=1)
    assert error.max() < 0.1


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise ValueError('no idea')", "no idea"),
        ("cmd.f_B[0] = float('nan')", r"control law law \(\w+\.step in my_law\.py\) returned NaN"),
        ("cmd.t_B[1] = float('inf')", "returned NaN or infinity"),
    ],
)
def test_a_law_that_raises_or_returns_nan_is_told(tmp_path, body, message):
    with pytest.raises(SimulationError, match=message):
        fly(write_law(tmp_path, body))


def test_a_coplanar_robot_cannot_fly_a_law_for_full_actuation():
    d = load_description("waypoints", sets=["mission.law=push_and_slide"])
    with pytest.raises(InputError, match="fully actuated"):
        build_vehicle(d)


def test_a_robot_that_no_longer_follows_is_told_at_once():
    """Thrown away from the pipe far beyond what its rotors can hold: no endless flight."""

    def throw(vehicle, phase):
        vehicle.sim.data.qfrc_applied[0] = -60.0 if phase == "scan" else 0.0

    samples, phases, flight = fly([], throw)
    assert not flight.completed
    assert "control was lost" in flight.reason
    assert "in scan" in flight.reason
    assert [p.outcome for p in phases if p.name == "scan"] == ["failed"]
    assert phases[-1].name == "land here"
    assert samples["p_WB"][-1, 2] < 0.3
    assert samples["t"][-1] < phases[-1].start_s + 15.0


def test_a_compiled_law_that_raises_is_told_with_its_line(tmp_path):
    body = "if est.t > 0.5:\n    raise ValueError('no idea')"
    with pytest.raises(SimulationError, match=r"my_law\.py:\d+"):
        fly(write_law(tmp_path, body, compiled=True))


@pytest.mark.parametrize("rate", [20, 50, 333, 2000])
def test_control_rates_that_do_not_fit_are_refused(rate):
    with pytest.raises(InputError, match="valid: 100, 125, 200, 250, 500, 1000"):
        load_description("pipe-weld-scan", sets=[f"robot.control.rate_hz={rate}"])


def test_lost_motion_capture_is_told():
    d = load_description("waypoints", "othex", sets=["world.mocap.dropout_fraction=1"])
    vehicle = build_vehicle(d)
    flight = Supervisor(vehicle, d.mission, plan_mission(d), d.robot.platform.gear_height_m).fly()
    assert not flight.completed
    assert "the localisation gave no position" in flight.reason


def test_motion_capture_lost_in_flight_is_told():
    d = load_description("waypoints", "othex")
    vehicle = build_vehicle(d)

    def lose(t: float, phase: str) -> None:
        if t > 6.0:
            vehicle.assembly.get(MotionCapture.Me, "mocap")["dropout"] = 1.0

    flight = Supervisor(
        vehicle, d.mission, plan_mission(d), d.robot.platform.gear_height_m, None, lose
    ).fly()
    assert not flight.completed
    assert "no localisation for" in flight.reason
