"""Duration of the straight moves of an insertion, as planned on the map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skywright.core.rotations import rot_z
from skywright.missions.skills.tool_handling import DROP, LIFT, find_platform
from skywright.missions.skills.tool_motion import behind, start_moves
from skywright.vehicle.arms_interface import compute_joints_s

if TYPE_CHECKING:
    from skywright.missions.bar_insertion.plan import InsertionPlan

CARRY_SPEED, CARRY_ACCELERATION = 0.3, 0.2


def sum_moves(way: InsertionPlan, speed: float) -> float:
    """Return the duration (s) of the moves to rack and socket and back; `speed` (m/s) is the limit.

    Grasp and insertion are not included.
    """
    moves, up = start_moves(way.home), np.array([0.0, 0.0, LIFT])
    rack, socket = (find_platform(way.grip, place) for place in (way.rack, way.socket))
    R_rack, R_socket = rot_z(way.rack.yaw), rot_z(way.socket.yaw)
    moves.go(behind(rack, way.rack.yaw), R_rack, speed=speed)
    moves.go(rack - [0.0, 0.0, DROP], R_rack)
    moves.p = rack + up
    moves.go(socket + up, R_socket, speed=CARRY_SPEED, acceleration=CARRY_ACCELERATION)
    moves.p = socket
    moves.go(behind(socket, way.socket.yaw), R_socket)
    moves.go(way.home[:3], rot_z(float(way.home[3])), speed=speed)
    return moves.seconds + 2.0 * compute_joints_s(way.grip.q_low - way.folded)
