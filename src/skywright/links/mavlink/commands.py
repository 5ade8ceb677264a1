"""COMMAND_LONG and COMMAND_INT of a simulated robot; each has an immediate answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skywright.description.world.origin import Origin
from skywright.errors import InputError
from skywright.links.mavlink import modes
from skywright.links.mavlink.frames import (
    GLOBAL_FRAMES,
    RELATIVE_FRAMES,
    find_height,
    swap_heading,
)
from skywright.links.mavlink.modes import Mode
from skywright.links.mavlink.robot import ACCEPTED, BUSY, DENIED, UNSUPPORTED, Reply, Robot
from skywright.vehicle.geodesy import Geodetic, to_local

FORCE = 21196.0
"""param2 of MAV_CMD_COMPONENT_ARM_DISARM that stops the motors in the air."""
SLOWEST = 0.05  # m/s


class Asked(NamedTuple):
    """A command: seven numbers, the fifth and sixth in degrees for a COMMAND_INT."""

    number: int
    p: tuple[float, ...]
    frame: int | None  # of a COMMAND_INT

    @classmethod
    def read(cls, m: Any) -> Asked:
        """Return the command of a message."""
        four = (m.param1, m.param2, m.param3, m.param4)
        if m.get_type() == "COMMAND_INT":
            unknown = m.x == 2**31 - 1 or m.y == 2**31 - 1
            at = (math.nan, math.nan) if unknown else (1e-7 * m.x, 1e-7 * m.y)
            return cls(m.command, (*four, *at, m.z), m.frame)
        return cls(m.command, (*four, m.param5, m.param6, m.param7), None)


class Commands:
    """The commands, by number."""

    def __init__(self, robot: Robot, origin: Origin) -> None:
        self.robot, self.origin = robot, origin
        self.table: dict[int, Callable[[Asked], Reply]] = {
            16: lambda a: Reply(BUSY, "way-points are flown by `skywright run`"),
            20: lambda a: robot.choose(modes.RETURN),
            21: lambda a: robot.choose(modes.LAND),
            22: self._take_off,
            176: self._set_mode,
            178: self._set_speed,
            179: self._set_home,
            185: self._terminate,
            192: self._reposition,
            241: lambda a: Reply(DENIED, "simulated sensors need no calibration"),
            246: lambda a: Reply(DENIED, "a simulated robot is not rebooted: start it again"),
            300: lambda a: Reply(BUSY, "Mission refused: missions are flown by `skywright run`"),
            400: self._arm,
        }

    def do(self, asked: Asked) -> Reply:
        """Execute a command; an unknown one is unsupported."""
        command = self.table.get(asked.number)
        return Reply(UNSUPPORTED) if command is None else command(asked)

    def _arm(self, a: Asked) -> Reply:
        if a.p[0] == 1.0:
            return self.robot.arm()
        if a.p[0] == 0.0:
            return self.robot.disarm(a.p[1] == FORCE)
        return Reply(DENIED, f"arm: {a.p[0]:g} is neither 1 nor 0")

    def _take_off(self, a: Asked) -> Reply:
        if not math.isfinite(a.p[6]):
            return self.robot.take_off(None)
        if says := self._find_foreign(a):
            return Reply(DENIED, says)
        return self.robot.take_off(self._find_height(a))

    @staticmethod
    def _find_foreign(a: Asked) -> str:
        """Return why the frame of a COMMAND_INT is refused, or ""."""
        if a.frame is None or a.frame in (*GLOBAL_FRAMES, *RELATIVE_FRAMES):
            return ""
        valid = ", ".join(map(str, (*GLOBAL_FRAMES, *RELATIVE_FRAMES)))
        return f"frame {a.frame} is refused; valid: {valid}"

    def _find_height(self, a: Asked) -> float:
        """Return the height z (m) in W of a command's altitude."""
        return find_height(a.p[6], a.frame, self.origin.altitude_m, float(self.robot.home[2]))

    def _set_mode(self, a: Asked) -> Reply:
        if not all(math.isfinite(x) for x in a.p[:3]) or not int(a.p[0]) & modes.CUSTOM:
            return Reply(DENIED, "set_mode: only PX4's custom modes are known")
        main, sub = int(a.p[1]), int(a.p[2])
        return self.robot.choose(Mode(main, sub if main == 4 else 0))

    def _set_speed(self, a: Asked) -> Reply:
        b: Any = self.robot.vehicle.backend
        most, speed = b.robot.control.speed_max_mps, a.p[1]
        if speed == -1.0:
            return Reply(ACCEPTED)
        if not SLOWEST <= speed <= most:
            return Reply(DENIED, f"speed {speed:g} m/s; valid: {SLOWEST:g} to {most:g}")
        b.limits = b.limits._replace(speed=speed)
        return Reply(ACCEPTED)

    def _set_home(self, a: Asked) -> Reply:
        if a.p[0] != 1.0:
            return Reply(DENIED, "set_home: only the place of now can become the home")
        handle = self.robot.vehicle.set_home()
        return Reply(ACCEPTED) if handle else Reply(BUSY, handle.result.reason)  # type: ignore[union-attr]

    def _terminate(self, a: Asked) -> Reply:
        if a.p[0] == 1.0:
            return self.robot.disarm(force=True)
        if a.p[0] == 0.0:
            return Reply(ACCEPTED)
        return Reply(DENIED, f"flight termination: {a.p[0]:g} is neither 1 nor 0")

    def _reposition(self, a: Asked) -> Reply:
        b = self.robot.vehicle.backend
        lat, lon, yaw = a.p[4], a.p[5], a.p[3]
        if says := self._find_foreign(a):
            return Reply(DENIED, says)
        p = np.array(b.reference_now["p_WB"])
        z = self._find_height(a) if math.isfinite(a.p[6]) else float(p[2])
        if math.isfinite(lat) and math.isfinite(lon):
            try:
                place = Geodetic.check(lat, lon, self.origin.altitude_m + z)
            except InputError as error:
                return Reply(DENIED, str(error))
            p = to_local(self.origin, place)
        p[2] = z
        return self.robot.reposition(p, swap_heading(yaw) if math.isfinite(yaw) else None)
