"""Fault rules in a session that a script flies: between a pilot, a response and a second flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import skywright
from skywright.run.session import Vehicle
from skywright.run.supervisor import Supervisor
from skywright.vehicle.commands import State
from skywright.vehicle.ended import VehicleEnded
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.motions import Arrival

QUICK = Arrival(tolerance_m=0.3, dwell_s=0.1, yaw_rad=0.3)
FENCED: dict[str, Any] = {"mission.fence.x_max_m": 0.4}


def fly(backend: str = "kinematic", **sets: Any) -> Vehicle:
    sets = {"mission.timestep_ms": 2} | sets
    return skywright.fly(backend=backend, arrival=QUICK, checklist=False, sets=sets)


def get_supervisor(v: Vehicle) -> Supervisor[Any]:
    assert v._supervisor is not None
    return v._supervisor


def tick_until(v: Vehicle, done: Callable[[], bool], seconds: float = 30.0) -> None:
    end = v.t + seconds
    while not done():
        assert v.t < end, (v.state, v.acted)
        v.tick()


def test_what_a_pilot_was_told_acts_after_the_pilot_gave_back() -> None:
    v = fly(**FENCED)
    assert v.take_off(1.0) and v.take_over()
    while v.pose.p[0] < 0.9:
        v.stick(pitch=0.1)
        v.tick()
    assert v.state == State.FLYING_MANUAL and not v.acted  # it is only reported
    assert get_supervisor(v).faults.told == {"geofence"}
    v.recover_from_manual(wait=False)
    tick_until(v, lambda: v.state == State.LANDED_DISARMED)
    assert len(v.acted) == 1 and "geofence" in v.acted[0]
    assert np.hypot(*v.pose.p[:2]) < 0.2


def test_no_rule_of_free_flight_acts_on_the_ground_or_in_the_next_take_off() -> None:
    v = fly("physics")
    assert v.take_off(0.8)
    while v.state == State.FLYING_AUTO:
        v.set_velocity((0.0, 0.0, -0.4))
        v.tick()
    v.wait(2.0)
    assert v.state == State.LANDED_DISARMED
    assert all(rule.from_take_off for rule in get_supervisor(v).faults._begun)
    assert v.take_off(0.8) and not v.acted


def test_nothing_of_a_response_remains_in_the_next_flight() -> None:
    v = fly(**FENCED)
    s = get_supervisor(v)
    for k in (1, 2):
        assert v.take_off(1.0), v.acted
        assert not s.senses.responding and not s.faults.acted and len(s.faults._begun) > 20
        s.senses.stuck, s.senses.posture, s.senses.carrying = {0}, np.zeros(2), True
        s.senses.doubt = np.ones(3)
        old = list(s.faults.rules)
        while v.state == State.FLYING_AUTO:
            v.set_velocity((0.4, 0.0, 0.0))
            v.tick()
        assert v.state == State.LANDED_DISARMED and len(v.acted) == k
        assert s.faults.rank == -1 and not s.senses.responding and not s.senses.carrying
        assert not s.senses.stuck and s.senses.posture is None and not s.senses.doubt.any()
        assert not set(old) & set(s.faults.rules)  # with new baselines and hold times
        assert [r.table for r in old] == [r.table for r in s.faults.rules]


def test_a_restart_of_the_estimator_counts_in_its_own_flight_only() -> None:
    jump: dict[str, Any] = {"kind": "sensor", "jump": [0.3, 0.0, 0.0], "start_s": 6.0}
    v = fly("physics", **{f"plant.faults.a.{k}": x for k, x in jump.items()})
    assert v.take_off(0.8)
    tick_until(v, lambda: v.state == State.LANDED_DISARMED)
    assert len(v.acted) == 1 and "estimator inconsistent" in v.acted[0]
    v.wait(3.0)  # the estimator restarts with the shifted samples
    assert v.backend.look(EstimatorState).restarts > 0
    assert v.take_off(0.8) and len(v.acted) == 1


def test_a_vehicle_that_is_lost_during_a_response_ends_the_flight_with_both_reasons() -> None:
    v = fly(**FENCED)
    s = get_supervisor(v)
    assert v.take_off(1.0)
    tick = v.backend.tick

    def lose(guards: int = 0) -> Any:
        if s.phase == "come home":
            raise VehicleEnded("the link to the autopilot is lost")
        return tick(guards)

    v.backend.tick = lose  # type: ignore[method-assign]
    while not v.acted:
        v.set_velocity((0.4, 0.0, 0.0))
        v.tick()
    fence, link = v.acted
    assert "geofence" in fence and link == "the link to the autopilot is lost"
    assert not s.senses.responding and s.phase == ""
