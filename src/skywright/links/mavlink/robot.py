"""A simulated robot with the interface of an autopilot: PX4's modes over the vehicle layer's
states.

It uses no socket. Each request returns a `Reply`: a MAV_RESULT and the reason of a refusal, which
comes from the vehicle layer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.errors import InputError
from skywright.links.mavlink import modes
from skywright.links.mavlink.modes import Mode
from skywright.links.mavlink.parameters import Parameters
from skywright.links.mavlink.setpoints import SetPoint, follow
from skywright.run.session import Vehicle
from skywright.vehicle.commands import NEEDS, Need, State
from skywright.vehicle.conditions import find_lack
from skywright.vehicle.drives import TURN_MAX
from skywright.vehicle.results import Handle

Array = NDArray[np.float64]

ACCEPTED, BUSY, DENIED, UNSUPPORTED, FAILED = range(5)
"""MAV_RESULT."""
AUTO_MODES = frozenset({modes.TAKEOFF, modes.HOLD, modes.RETURN, modes.LAND, modes.OFFBOARD})
LONGEST_S = 600.0  # s, longest motion: its table is held in memory
STICK_S = 0.5  # s for which a pilot's stick command is valid
TILT, CLIMB, LEVEL = math.radians(15.0), 0.5, 0.5
"""Command of a full stick axis: rad, m/s up, m/s level."""
RISE = 0.05  # m above the ground: least height of a set-point that starts a take-off


class Reply(NamedTuple):
    """Reply to a request."""

    result: int  # MAV_RESULT
    says: str = ""


class Stick(NamedTuple):
    """MANUAL_CONTROL, from -1 to 1: ahead, right, up (-1 to 1 about the middle), turn right."""

    ahead: float
    right: float
    up: float
    turn: float


class Robot:
    """Modes, arming and set-points of one vehicle."""

    def __init__(self, vehicle: Vehicle, parameters: Parameters, say: Callable[[str], None]):
        """`say` receives one line per event."""
        self.vehicle, self.parameters, self._say = vehicle, parameters, say
        self.mode = modes.HOLD
        self.stick: tuple[float, Stick] | None = None  # s, time of arrival, and stick
        self.point: tuple[float, SetPoint] | None = None
        self._return: Handle | None = None
        self._armed_at: float | None = None
        self._state = vehicle.state
        self._acted = 0
        self._rises = False  # whether arming is followed by a take-off: its mode was chosen before
        self.terminated = False  # whether a flight termination interrupts a rule's response
        self._ground = np.array(vehicle.backend.estimate["p_WB"])
        """(3,) m in W, last position with the motors off."""

    # --- state -------------------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """Whether the motors turn."""
        return self.vehicle.is_turning

    @property
    def home(self) -> Array:
        """Home (3,) m in W; before the first take-off the place on the ground."""
        home = self.vehicle.home
        return self._ground if home is None else home

    @property
    def ready(self) -> str:
        """Return why it cannot be armed now, or ""; this runs the checklist."""
        if self.armed:
            return ""
        if self.vehicle.state != State.LANDED_DISARMED:
            return f"the state is {self.vehicle.state}"
        from skywright.vehicle.commands import Command

        return self.vehicle.find_refusal(Command.ARM)

    @property
    def flies_itself(self) -> bool:
        """Whether a rule for faults controls the robot."""
        return bool(self.vehicle.flying_rules)

    def _fresh(self, of: tuple[float, object] | None, limit: float) -> bool:
        return of is not None and self.vehicle.t - of[0] <= limit + 1e-9

    # --- requests ----------------------------------------------------------------------------

    def arm(self) -> Reply:
        """Turn the motors."""
        if self.armed:
            return Reply(ACCEPTED)
        return self._answer(self.vehicle.arm(wait=False))

    def disarm(self, force: bool) -> Reply:
        """Stop the motors, in the air only with `force`."""
        if not self.armed:
            return Reply(ACCEPTED)
        if force and self.flies_itself:  # its response would start the motors again
            self.terminated = True
            return Reply(ACCEPTED)
        if force:
            return self._answer(self.vehicle.stop_motors(confirm=True))
        return self._answer(self.vehicle.disarm())

    def take_off(self, height: float | None) -> Reply:
        """Rise to `height` (m in W), or by MIS_TAKEOFF_ALT; the motors must turn."""
        v = self.vehicle
        if rules := self._find_flying_rules():
            return Reply(BUSY, f"take_off refused: {rules}")
        if not self.armed:
            return Reply(BUSY, "take_off refused: the motors are off, arm first")
        z = height
        if z is None:
            z = float(v.backend.estimate["p_WB"][2]) + float(self.parameters["MIS_TAKEOFF_ALT"])
        far = self._find_far("take_off", np.array([*v.backend.estimate["p_WB"][:2], z]))
        if far:
            return Reply(DENIED, far)
        reply = self._try(lambda: v.take_off(z, wait=False))
        if reply.result == ACCEPTED:
            self._enter(modes.TAKEOFF)
        return reply

    def reposition(self, p: Array, yaw: float | None) -> Reply:
        """Fly to p (3,) m in W and hold there."""
        if rules := self._find_flying_rules():
            return Reply(BUSY, f"go_to refused: {rules}")
        far = self._find_far("go_to", p)
        if far:
            return Reply(DENIED, far)
        v = self.vehicle
        outside = find_lack(Need.FENCE, v.backend, v.fence, p)
        if outside:  # before the pilot loses control
            return Reply(BUSY, f"go_to refused: {outside}")
        reply = self._leave_stick() or self._try(lambda: self.vehicle.go_to(p, yaw, wait=False))
        if reply.result == ACCEPTED:
            self._enter(modes.HOLD)
        return reply

    def _find_far(self, what: str, p: Array) -> str:
        """Return a message if a motion would take too long, or ""."""
        b = self.vehicle.backend
        seconds = float(np.linalg.norm(p - b.estimate["p_WB"])) / b.limits.speed
        if seconds <= LONGEST_S:
            return ""
        return f"{what} refused: it takes {seconds:.3g} s; valid: up to {LONGEST_S:g} s"

    def choose(self, mode: Mode) -> Reply:
        """Change the mode."""
        if rules := self._find_flying_rules():
            return Reply(BUSY, f"{mode} refused: {rules}")
        if mode in (modes.MISSION, modes.ACRO) or mode not in modes.NAMES or mode == modes.READY:
            why = "missions are flown by `skywright run`" if mode == modes.MISSION else "unknown"
            return Reply(BUSY if mode == modes.MISSION else DENIED, f"{mode} refused: {why}")
        if mode == modes.OFFBOARD and not self._fresh(self.point, self._offboard_s):
            return Reply(BUSY, "Offboard refused: no stream of set-points")
        state = self.vehicle.state
        if state in (State.UNINITIALIZED, State.LANDED_DISARMED):
            self._enter(modes.HOLD if mode in (modes.LAND, modes.RETURN) else mode)
            self._rises = mode == modes.TAKEOFF
            return Reply(ACCEPTED)
        reply = self._begin(mode, state)
        if reply.result == ACCEPTED:
            self._enter(mode)
        return reply

    def _begin(self, mode: Mode, state: State) -> Reply:
        v = self.vehicle
        if mode in (modes.ALTITUDE, modes.MANUAL, modes.STABILIZED):
            if state == State.FLYING_MANUAL:
                return Reply(ACCEPTED)
            return self._answer(v.take_over())
        if state == State.LANDED_ARMED:
            return self.take_off(None) if mode == modes.TAKEOFF else Reply(ACCEPTED)
        if mode == modes.TAKEOFF:
            return Reply(BUSY, f"Takeoff refused: the state is {state}")
        if mode == modes.RETURN:  # what refuses it, before the pilot loses control
            if v.home is None:
                return Reply(BUSY, f"go_home refused: it requires that {NEEDS[Need.HOME]}")
            far = self._find_far("go_home", v.home)
            if far:
                return Reply(BUSY, far)
        reply = self._leave_stick()
        if reply is not None and reply.result != ACCEPTED:
            return reply
        if mode == modes.LAND:
            return self._try(lambda: v.land(wait=False))
        if mode == modes.RETURN:
            handle = v.go_home(wait=False)
            self._return = handle if handle else None
            return self._answer(handle)
        if state == State.FLYING_MANUAL or (mode == self.mode and mode != modes.HOLD):
            return Reply(ACCEPTED)  # it brakes, or the mode goes on
        return self._answer(v.hold(wait=False))

    def _leave_stick(self) -> Reply | None:
        """Take over from the pilot; return None if no pilot flies."""
        if self.vehicle.state != State.FLYING_MANUAL:
            return None
        reply = self._answer(self.vehicle.recover_from_manual(wait=False))
        return None if reply.result == ACCEPTED else reply

    def _enter(self, mode: Mode) -> None:
        if mode != modes.RETURN:
            self._return = None
        if mode != self.mode:
            self.mode = mode
            self._say(f"mode {mode}")

    def _try(self, command: Callable[[], Handle]) -> Reply:
        try:
            return self._answer(command())
        except InputError as error:
            return Reply(DENIED, str(error))

    @staticmethod
    def _answer(handle: Handle) -> Reply:
        if handle:
            return Reply(ACCEPTED)
        return Reply(BUSY, "" if handle.result is None else handle.result.reason)

    @property
    def _offboard_s(self) -> float:
        return float(self.parameters["COM_OF_LOSS_T"])

    # --- ticks -------------------------------------------------------------------------------

    def take(self, point: SetPoint) -> None:
        """Accept a set-point of the offboard stream."""
        self.point = (self.vehicle.t, point)

    def take_stick(self, stick: Stick) -> None:
        """Accept the pilot's stick command."""
        self.stick = (self.vehicle.t, stick)

    def step(self) -> None:
        """Apply the mode before a tick of the vehicle."""
        v, state = self.vehicle, self.vehicle.state
        if state != self._state:
            self._state = state
            self._say(f"state {state}")
        self._watch_ground(state)
        if not self.armed:
            self._ground = np.array(v.backend.estimate["p_WB"])
        if self.mode == modes.OFFBOARD and self.armed:
            self._follow(state)
        elif self.mode in modes.BY_STICK and self.armed:
            self._follow_stick(state)
        elif self.mode == modes.TAKEOFF and state == State.FLYING_AUTO:
            self._enter(modes.HOLD)
        elif self.mode == modes.LAND and state == State.FLYING_AUTO:
            self._enter(modes.HOLD)  # the ground was not found
        elif self._return is not None and self._return.done:
            arrived, self._return = bool(self._return), None
            reply = self.choose(modes.LAND) if arrived else self.choose(modes.HOLD)
            if reply.says:
                self._say(reply.says)
        for says in v.acted[self._acted :]:
            self._say(says)
        self._acted = len(v.acted)

    def _watch_ground(self, state: State) -> None:
        """Disarm a robot that has been armed on the ground for COM_DISARM_PRFLT."""
        waits = self.mode == modes.TAKEOFF and self._rises
        if state == State.LANDED_DISARMED and self.mode in AUTO_MODES - {modes.OFFBOARD}:
            if not waits:
                self._enter(modes.HOLD)
        elif state == State.LANDED_ARMED and self.mode == modes.TAKEOFF:
            self._rises = False
            reply = self.take_off(None) if waits else Reply(BUSY, "the take-off failed")
            if reply.result != ACCEPTED:
                self._enter(modes.HOLD)
                self._say(reply.says)
        if state != State.LANDED_ARMED:
            self._armed_at = None
            return
        if self._armed_at is None:
            self._armed_at = self.vehicle.t
        limit = float(self.parameters["COM_DISARM_PRFLT"])
        if 0.0 < limit < self.vehicle.t - self._armed_at and self.vehicle.disarm():
            self._say(f"disarmed: no take-off within {limit:g} s")

    def _follow(self, state: State) -> None:
        """Follow the offboard stream; without one, hold."""
        if not self._fresh(self.point, self._offboard_s) or self.point is None:
            self._say(f"no set-point for {self._offboard_s:g} s: Offboard is left, it holds")
            if state == State.FLYING_AUTO:
                self.vehicle.hold(wait=False)
            self._enter(modes.HOLD)
            return
        point = self.point[1]
        if state == State.LANDED_ARMED:
            ground = float(self.vehicle.backend.estimate["p_WB"][2])
            if not point.lifts(ground + RISE) or not self.vehicle.lift_off():
                return
        elif state != State.FLYING_AUTO:
            return
        says = follow(self.vehicle, point)
        if says:
            self._say(says)
            self.vehicle.hold(wait=False)
            self._enter(modes.HOLD)

    def _follow_stick(self, state: State) -> None:
        """Command the robot by the pilot's stick; without messages the stick is released."""
        fresh = self._fresh(self.stick, STICK_S)
        stick = self.stick[1] if fresh and self.stick is not None else Stick(0, 0, 0, 0)
        v = self.vehicle
        if state == State.FLYING_MANUAL:
            thrust = None
            if self.mode in (modes.MANUAL, modes.STABILIZED) and fresh:
                thrust = 0.5 * (stick.up + 1.0) / float(self.parameters["MPC_THR_HOVER"])
            v.stick(
                TILT * stick.right, TILT * stick.ahead, -TURN_MAX * stick.turn, CLIMB * stick.up,
                thrust,
            )  # fmt: skip
        elif state == State.FLYING_AUTO and self.mode == modes.POSITION and fresh:
            R = v.backend.reference_now["R_WB"]
            level = LEVEL * np.array([stick.ahead, -stick.right, 0.0])
            turned = rot_z(math.atan2(R[1, 0], R[0, 0])) @ level
            v.set_velocity(turned + [0.0, 0.0, CLIMB * stick.up], -TURN_MAX * stick.turn)
        elif state == State.LANDED_ARMED and self.mode == modes.POSITION:
            if stick.up > 0.3:
                v.lift_off()
        elif state == State.LANDED_ARMED and stick.up > 0.3:  # the mode was chosen before arming
            v.take_over()

    def _find_flying_rules(self) -> str:
        """Return which rules control the robot, or ""."""
        rules = self.vehicle.flying_rules
        return f"a rule flies: {'; '.join(rules)}" if rules else ""
