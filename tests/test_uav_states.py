"""The table of commands as a state machine: any sequence, with every answer predicted by it."""

from __future__ import annotations

import functools

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

import skywright
from skywright.run.backends import build_vehicle
from skywright.vehicle.commands import TABLE, Command, State
from skywright.vehicle.motions import Arrival
from skywright.vehicle.uav import Uav

REACH = st.floats(-1.0, 1.0)
CALLS = {
    Command.ARM: lambda u, x: u.arm(),
    Command.DISARM: lambda u, x: u.disarm(),
    Command.TAKE_OFF: lambda u, x: u.take_off(1.5 + 0.5 * x),
    Command.GO_TO: lambda u, x: u.go_to((x, -x, 1.5 + 0.3 * x), 2.0 * x),
    Command.GO_HOME: lambda u, x: u.go_home(),
    Command.SET_POSE: lambda u, x: u.set_pose((x, x, 1.5), x),
    Command.SET_VELOCITY: lambda u, x: u.set_velocity((x, 0.3, 0.5 * x), x),
    Command.HOLD: lambda u, x: u.hold(),
    Command.LAND: lambda u, x: u.land(),
    Command.SET_HOME: lambda u, x: u.set_home(),
    Command.TAKE_OVER: lambda u, x: u.take_over(),
    Command.STICK: lambda u, x: u.stick(pitch=0.05 * x, climb=x),
    Command.RECOVER_FROM_MANUAL: lambda u, x: u.recover_from_manual(),
    Command.STOP_MOTORS: lambda u, x: u.stop_motors(confirm=True),
    Command.LIFT_OFF: lambda u, x: u.lift_off(),
    Command.GO_TO_GEO: lambda u, x: u.go_to_geo(37.4 + 1e-6 * x, -6.0, 20.0),
    Command.SET_ATTITUDE: lambda u, x: u.set_attitude(np.eye(3), (0.0, 0.0, 30.0 + 3.0 * x)),
    Command.SET_JOINTS: lambda u, x: u.set_joints(0.1 * x * np.ones(u.backend.n_joints)),
}


@functools.cache
def build_landed():
    """A vehicle on the ground that knows where it is, and its state."""
    vehicle = build_vehicle(skywright.load("waypoints"), backend="kinematic")
    for _ in range(60):
        vehicle.tick()
    return vehicle, vehicle.save()


class AnySequence(RuleBasedStateMachine):
    """Commands in any order, at any time; the table says what becomes of each."""

    def __init__(self):
        super().__init__()
        self.vehicle, landed = build_landed()
        self.vehicle.restore(landed)
        self.uav = Uav(self.vehicle, arrival=Arrival(dwell_s=0.1))
        self.under_way = None
        self.v = np.zeros(3)

    @rule(command=st.sampled_from(sorted(CALLS)), x=REACH)
    def give(self, command, x):
        before, entry = self.uav.state, TABLE[command]
        refused = self.uav.find_refusal(command) or (
            "no home" if command == Command.GO_HOME and self.uav.home is None else
            "no origin" if command == Command.GO_TO_GEO else ""
        )  # fmt: skip
        handle = CALLS[command](self.uav, x)
        if before not in entry.states:
            assert not handle and handle.done and str(before) in handle.result.reason
        if refused:
            assert not handle and self.uav.state == before  # nothing changes
            return
        if entry.interrupts and self.under_way is not None:
            assert self.under_way.done
        if handle.done:
            assert self.uav.state == (entry.after or before)
        else:
            assert self.uav.state == (entry.during or before)
            self.under_way = handle

    @rule(ticks=st.integers(1, 60))
    def fly(self, ticks):
        for _ in range(ticks):
            self.uav.tick()

    @rule()
    def finish(self):
        if self.under_way is not None and not self.under_way.done:
            entry = TABLE[self.under_way.command]
            assert self.under_way.wait(), self.under_way
            assert self.uav.state == entry.after

    @invariant()
    def motors_and_state_agree(self):
        landed = self.uav.state in (State.LANDED_DISARMED, State.UNINITIALIZED)
        assert landed != self.uav.is_turning
        row = self.vehicle.reference
        assert all(np.all(np.isfinite(row[name])) for name in row.dtype.names)

    @invariant()
    def a_reference_in_the_air_does_not_jump(self):
        assert np.linalg.norm(self.vehicle.reference["v_WB"]) <= 2.5 * self.vehicle.limits.speed


TestAnySequence = AnySequence.TestCase
TestAnySequence.settings = settings(
    max_examples=25, stateful_step_count=15, deadline=None, derandomize=True,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
