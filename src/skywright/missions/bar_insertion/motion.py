"""Straight moves of an insertion: places behind rack and socket, and the moves' duration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.tool_handling import DROP, LIFT, find_platform
from skywright.missions.skills.tool_motion import Moves
from skywright.vehicle.arms_interface import compute_joints_s

if TYPE_CHECKING:
    from skywright.missions.bar_insertion.plan import InsertionPlan

BACK = 0.35  # m, behind rack and socket, where the platform arrives and departs
CARRY_SPEED, CARRY_ACCELERATION = 0.3, 0.2


def behind(p: Array, yaw: float) -> Array:
    """Return the platform's position before the approach; at p (3,) m its hands hold the bar."""
    return np.asarray(p - BACK * rot_z(yaw)[:, 0] - [0.0, 0.0, DROP])


def sum_moves(way: InsertionPlan, speed: float) -> float:
    """Return the duration (s) of the moves to rack and socket and back; `speed` (m/s) is the limit.

    Grasp and insertion are not included.
    """
    moves, up = Moves(way.home), np.array([0.0, 0.0, LIFT])
    rack, socket = (find_platform(way.grip, place) for place in (way.rack, way.socket))
    moves.go(behind(rack, way.rack.yaw), way.rack.yaw, speed)
    moves.go(rack - [0.0, 0.0, DROP], way.rack.yaw)
    moves.p = rack + up
    moves.go(socket + up, way.socket.yaw, CARRY_SPEED, CARRY_ACCELERATION)
    moves.p = socket
    moves.go(behind(socket, way.socket.yaw), way.socket.yaw)
    moves.go(way.home[:3], float(way.home[3]), speed)
    return moves.seconds + 2.0 * compute_joints_s(way.grip.q_low - way.folded)
