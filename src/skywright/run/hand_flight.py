"""Flight by a pilot's stick: it commands the platform's velocity, tilt in place, or attitude."""

from __future__ import annotations

import math
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skywright.core.rotations import rot_z
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.vehicle.commands import Command, Need, State
from skywright.vehicle.conditions import find_lack
from skywright.vehicle.drives import TURN_MAX, Stick
from skywright.vehicle.results import Handle
from skywright.vehicle.uav import Uav

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

TILT_DEG, SPEED, CLIMB = 15.0, 0.5, 0.5
"""At full deflection: deg (at most the robot's limit), m/s horizontally and m/s upward."""
ANGLE_SHARE = 0.6
"""Share of the hover tilt that the robot can hold in calm air, at full deflection in angle mode."""
LEAST_TILT = math.radians(1.0)
"""Smaller values count as no tilt in place."""


class Mode(StrEnum):
    """What the stick commands."""

    POSITION = "position"
    ANGLE = "angle"
    ATTITUDE = "attitude"


MODES: dict[Mode, str] = {
    Mode.POSITION: "the stick is a velocity along the heading; let go, the robot brakes and holds",
    Mode.ANGLE: "the stick tilts the platform in place; only robots whose rotors push sideways",
    Mode.ATTITUDE: "the stick tilts the platform, which accelerates; let go, it drifts on level",
}


class HandFlight:
    """A period of flight by a pilot's stick."""

    def __init__(self, s: Supervisor, mode: Mode) -> None:
        """Hand control to the stick: in attitude mode first, then in `mode` if it is available."""
        self._s, self.mode = s, mode
        self.uav = Uav(s.vehicle, tick=lambda: s.tick_by_hand())
        self.says = ""
        """Why `mode` is not in effect; "" if it is."""
        self.uav.take_over()

    @property
    def flown(self) -> Mode:
        """The mode that is in effect now."""
        return Mode.ATTITUDE if self.uav.state == State.FLYING_MANUAL else self.mode

    @cached_property
    def tilt_max(self) -> float:
        """Tilt (rad) at full deflection in angle mode; 0 for a robot that cannot tilt in place."""
        return find_tilt_in_place(self._s)

    def step(self, axes: list[float] | None) -> None:
        """Fly one mission tick; `axes` are new stick axes, if any: right, ahead, turn, climb."""
        self._choose()
        if axes is not None:
            self._tell(axes)
        self.uav.tick()

    def _choose(self) -> None:
        """Enter the selected mode if it can be flown, and leave it if not."""
        uav, self.says = self.uav, ""
        if self.mode == Mode.ATTITUDE:
            if uav.state == State.FLYING_AUTO:
                uav.take_over()
            return
        lack = find_lack(Need.ESTIMATE, self._s.vehicle, None, None)
        if lack and uav.state == State.FLYING_AUTO:
            uav.take_over()
        elif not lack and uav.state == State.FLYING_MANUAL:
            lack = self._explain(uav.recover_from_manual())
        if lack:
            self.says = f"no {self.mode} mode, the stick tilts the robot: {lack}"

    def _explain(self, handle: Handle) -> str:
        return "" if handle or handle.result is None else handle.result.reason.split(": ", 1)[-1]

    def _tell(self, axes: list[float]) -> None:
        right, ahead, turn, climb = axes
        if self.uav.state == State.FLYING_MANUAL:
            self.uav.stick(**scale_stick(self._s, axes)._asdict())
        elif self.uav.state == State.FLYING_AUTO:
            R = self._s.vehicle.reference_now["R_WB"]
            level = np.zeros(3) if self.mode == Mode.ANGLE else SPEED * np.array([ahead, -right, 0])
            v = rot_z(math.atan2(R[1, 0], R[0, 0])) @ level + [0.0, 0.0, CLIMB * climb]
            tilt = self.tilt_max if self.mode == Mode.ANGLE else 0.0
            self.uav.set_velocity(v, TURN_MAX * turn, roll=tilt * right, pitch=tilt * ahead)

    def find_refusal(self) -> str:
        """Return why the position loops cannot take over now, "" if they can."""
        if self.uav.state == State.FLYING_AUTO:
            return ""
        return self.uav.find_refusal(Command.RECOVER_FROM_MANUAL)

    def settle(self) -> Handle:
        """Brake and hold position."""
        manual = self.uav.state == State.FLYING_MANUAL
        return self.uav.recover_from_manual() if manual else self.uav.hold()


def find_tilt_in_place(s: Supervisor) -> float:
    """Return the tilt (rad) at full deflection in angle mode; 0 if the robot has no such mode."""
    v = s.vehicle
    q = np.array(v.reference["q"][: v.n_joints])
    tilt = ANGLE_SHARE * compute_hover_tilt(v.robot, q, v.world.gravity_mps2)
    tilt = min(tilt, math.radians(v.robot.control.tilt_max_deg))
    return tilt if tilt >= LEAST_TILT else 0.0  # NaN gives 0


def scale_stick(s: Supervisor, axes: list[float]) -> Stick:
    """Convert four axes from -1 to 1 to a stick command: right, ahead, turn to the left, climb."""
    tilt = math.radians(min(TILT_DEG, s.vehicle.robot.control.tilt_max_deg))
    right, ahead, turn, climb = axes
    return Stick(tilt * right, tilt * ahead, TURN_MAX * turn, CLIMB * climb)
