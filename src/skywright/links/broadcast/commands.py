"""Execution of the commands from the middleware (names: links/broadcast/table.py).

A vehicle under a script executes UAL's commands (vehicle/commands.py states which are valid in
which state). In a mission the commands are the pilot's switch and the operator's orders.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skywright.errors import InputError
from skywright.run.hand_flight import CLIMB, SPEED, Mode
from skywright.run.supervisor import Supervisor
from skywright.vehicle.commands import State
from skywright.vehicle.drives import TURN_MAX
from skywright.vehicle.results import Handle, Result
from skywright.vehicle.topics import MAP
from skywright.vehicle.uav import Uav

Args = dict[str, Any]


class Told(NamedTuple):
    """Reply to a command: its result, or its handle while it is executed."""

    result: Result | None
    handle: Handle | None = None


def read_frame(header: Any) -> None:
    """Raise InputError for a pose or velocity in another frame."""
    frame = header["frame_id"]
    if frame not in ("", MAP):
        raise InputError(f"frame_id {frame[:40]!r}; valid: {MAP!r} or empty")


def read_vector(v: Any) -> list[float]:
    """Return x, y, z of a point or vector."""
    return [float(v[axis]) for axis in "xyz"]


def read_yaw(q: Any) -> float | None:
    """Return the heading (rad) of an orientation; None if all its numbers are 0.

    Raises InputError for a quaternion whose length is not about 1.
    """
    w, x, y, z = (float(q[axis]) for axis in "wxyz")
    if w == x == y == z == 0.0:
        return None
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 < size < 1.1:
        raise InputError(f"orientation of length {size:.3g}; valid: a unit quaternion, or zeros")
    w, x, y, z = w / size, x / size, y / size, z / size
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


class VehicleCommands:
    """Executes commands on a vehicle under a script."""

    def __init__(self, uav: Uav, joints: tuple[str, ...]) -> None:
        self._uav, self._joints = uav, joints
        self._does: dict[str, Callable[[Args], Handle]] = {
            "/ual/take_off": lambda a: uav.take_off(float(a["height"]), wait=False),
            "/ual/land": lambda a: uav.land(wait=False),
            "/ual/go_to_waypoint": self._go_to,
            "/ual/go_to_waypoint_geo": self._go_to_geo,
            "/ual/set_home": lambda a: uav.set_home(),
            "/ual/recover_from_manual": lambda a: uav.recover_from_manual(wait=False),
            "/ual/take_over": lambda a: uav.take_over(),
            "/ual/arm": lambda a: uav.arm(wait=False),
            "/ual/disarm": lambda a: uav.disarm(),
            "/ual/hold": lambda a: uav.hold(wait=False),
            "/ual/go_home": lambda a: uav.go_home(wait=False),
            "/ual/set_pose": self._set_pose,
            "/ual/set_velocity": self._set_velocity,
            "/arms/set_joints": self._set_joints,
        }

    @property
    def state(self) -> State:
        """State of the vehicle."""
        return self._uav.state

    def call(self, name: str, args: Args) -> Told:
        """Start a command; raises InputError for wrong arguments."""
        does = self._does.get(name)
        if does is None:
            return Told(
                Result(False, f"{name} refused: no mission flies here", self._uav.backend.t)
            )
        handle = does(args)
        return Told(handle.result, None if handle.done else handle)

    def _go_to(self, a: Args) -> Handle:
        read_frame(a["waypoint"]["header"])
        at = a["waypoint"]["pose"]
        p, yaw = read_vector(at["position"]), read_yaw(at["orientation"])
        return self._uav.go_to(p, yaw, wait=False)

    def _go_to_geo(self, a: Args) -> Handle:
        fix = a["waypoint"]
        return self._uav.go_to_geo(fix["latitude"], fix["longitude"], fix["altitude"], wait=False)

    def _set_pose(self, a: Args) -> Handle:
        read_frame(a["header"])
        at = a["pose"]
        return self._uav.set_pose(read_vector(at["position"]), read_yaw(at["orientation"]))

    def _set_velocity(self, a: Args) -> Handle:
        read_frame(a["header"])
        v = read_vector(a["twist"]["linear"])
        return self._uav.set_velocity(v, float(a["twist"]["angular"]["z"]))

    def _set_joints(self, a: Args) -> Handle:
        names, q = list(a["name"]), [float(x) for x in a["position"]]
        if names:
            if len(names) != len(q):
                raise InputError(
                    f"set_joints: {len(names)} names, {len(q)} positions; valid: one for each name"
                )
            unknown = [n for n in names if n not in self._joints]
            if unknown:
                valid = ", ".join(self._joints) or "none: the robot has no arms"
                raise InputError(f"set_joints: joint {unknown[0][:40]!r}; valid: {valid}")
            now = [float(x) for x in self._uav.backend.reference_now["q"][: len(self._joints)]]
            told = dict(zip(names, q, strict=True))
            q = [told.get(n, now[i]) for i, n in enumerate(self._joints)]
        return self._uav.set_joints(q)


class MissionCommands:
    """Executes commands during a mission."""

    def __init__(self, s: Supervisor[Any]) -> None:
        self._s = s
        self._ours = False  # whether the switch was set by a command

    @property
    def state(self) -> State:
        """State of the vehicle in UAL's terms."""
        s = self._s
        if s.pilot.flies:
            return State.FLYING_AUTO if s.pilot.flown == Mode.POSITION else State.FLYING_MANUAL
        if s.senses.told("active") < 0.5:
            return State.LANDED_DISARMED if s.vehicle.localised else State.UNINITIALIZED
        return {"take_off": State.TAKING_OFF, "land": State.LANDING}.get(s.phase, State.FLYING_AUTO)

    def call(self, name: str, args: Args) -> Told:
        """Execute a command; raises InputError for wrong arguments."""
        s, now = self._s, self._s.vehicle.t
        last = name.rpartition("/")[2]
        if name == "/ual/take_over":
            s.choose_mode(Mode.POSITION)
            result = s.take_over()
            self._ours |= result.ok
        elif name == "/ual/recover_from_manual":
            result = s.give_back()
            self._ours &= not result.ok
        elif name in ("/ual/land", "/mission/abort"):
            result = self._end(last)
        elif name in ("/mission/next", "/mission/retry", "/mission/retract"):
            result = s.order(last)
        elif name == "/ual/set_velocity":
            result = self._move(args)
        else:
            says = (
                f"{last} refused: mission {s.mission.name!r} flies the robot; open the vehicle by "
                "skywright.fly to command it"
            )
            result = Result(False, says, now)
        return Told(result)

    def _end(self, order: str) -> Result:
        s = self._s
        says = ""
        if not s.kind.flies or s.senses.told("active") < 0.5:
            says = f"{order} refused: the robot does not fly"
        else:
            vehicle: Any = s.vehicle  # every vehicle flown here accepts orders
            vehicle.order = order
        return Result(not says, says, s.vehicle.t)

    def _move(self, a: Args) -> Result:
        s = self._s
        read_frame(a["header"])
        v, turn = np.array(read_vector(a["twist"]["linear"])), float(a["twist"]["angular"]["z"])
        if not (np.isfinite(v).all() and math.isfinite(turn)):
            raise InputError("set_velocity: every number must be finite")
        self._ours &= s.pilot.switch or s.pilot.flies  # the stick may be another pilot's later
        if not (self._ours and s.pilot.flies):
            says = "set_velocity refused: call /ual/take_over first"
            return Result(False, says, s.vehicle.t)
        R = s.vehicle.reference_now["R_WB"]
        yaw = math.atan2(R[1, 0], R[0, 0])
        ahead = math.cos(yaw) * v[0] + math.sin(yaw) * v[1]
        left = math.cos(yaw) * v[1] - math.sin(yaw) * v[0]
        axes = [-left / SPEED, ahead / SPEED, turn / TURN_MAX, v[2] / CLIMB]
        s.move_stick([min(max(x, -1.0), 1.0) for x in axes])
        return Result(True, "", s.vehicle.t)
