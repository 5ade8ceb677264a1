"""The three flight modes of Sanchez-Cuevas 2020, section 5.3, in sequence (Fig. 20).

Standard stabilisation is a linear cascade on attitude and height, as for a coplanar robot; it does
not control the position. Command position translates with a level attitude, command angle tilts at
a fixed position. The last two are one law with different references.
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import exp_so3
from skywright.core.types import MODE_POSE, MODE_STANDARD
from skywright.missions.flight_modes.plan import SPEED, ModesPlan
from skywright.missions.flight_modes.task import ModesTask
from skywright.missions.skills.moves import build_move, set_rest
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

STEADY_S, TAKE_OVER_S = 1.0, 3.0  # s, level, and after standard stabilisation


def fly(s: Supervisor[ModesTask], way: ModesPlan) -> Flight:
    """Fly standard stabilisation (in calm air), command position and command angle."""
    task, vehicle = s.task, s.vehicle
    level = np.array(vehicle.reference["R_WB"])
    home = np.array(vehicle.reference["p_WB"])

    def go(phase: str | None, p: Array, R: Array, mode: int = MODE_POSE) -> None:
        start = set_rest(vehicle.reference)
        end = np.array(start)
        end["p_WB"], end["R_WB"], end["mode"] = p, R, mode
        if phase is not None:
            s.begin(phase)
        move = build_move(vehicle.model, vehicle.n_joints, start, end, speed=SPEED)
        s.body.track(move)
        s.until_arrived()

    if way.calm:  # in wind this mode would drift, because it has no position control
        go("standard stabilisation", home, level, MODE_STANDARD)
        s.wait(STEADY_S)
        for sign in (1.0, -1.0, 0.0):
            tilted = turn_about(level, 1, sign * math.radians(task.standard_tilt_deg))
            go(None, home, tilted, MODE_STANDARD)
            s.wait(task.standard_s)
        drifted = np.array(vehicle.estimate["p_WB"])
        drifted[2] = home[2]
        s.begin("take over")  # at the present position
        row = set_rest(vehicle.reference)
        row["p_WB"], row["R_WB"], row["mode"] = drifted, level, MODE_POSE
        s.body.track(row[None])
        s.wait(TAKE_OVER_S)
        go(None, home, level)
        s.wait(task.hold_s)
    for axis in (0, 1):
        go("command position", home + task.distance_m * level[:, axis], level)
        s.wait(task.hold_s)
        go("command position", home, level)
        s.wait(task.hold_s)
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            go("command angle", home, turn_about(level, axis, sign * way.tilt))
            s.begin("hold angle")
            s.wait(task.hold_s)
        go("command angle", home, level)
        s.wait(STEADY_S)
    return Flight(True, "")


def turn_about(R: Array, axis: int, angle: float) -> Array:
    """Return R rotated by `angle` (rad) about its own axis."""
    turn, out = np.zeros(3), np.empty((3, 3))
    turn[axis] = angle
    exp_so3(turn, out)
    return np.asarray(R @ out)
