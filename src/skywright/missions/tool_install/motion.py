"""Duration of the straight moves of a tool's installation, as planned on the map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.tool_handling import DROP, LIFT, Place, find_platform
from skywright.missions.skills.tool_motion import behind, start_moves
from skywright.vehicle.arms_interface import compute_joints_s

if TYPE_CHECKING:
    from skywright.missions.tool_install.plan import ToolPlan

ABOVE = 0.10  # m, of a tool over its place before it is lowered
CALM_SPEED, CARRY_ACCELERATION = 0.4, 0.2  # m/s, m/s^2, with the tool: it swings by a / g, 1.2 deg


def sum_moves(way: ToolPlan, speed: float) -> float:
    """Return the duration (s) of the moves to bench and pipe and back; `speed` (m/s) is the limit.

    Grasps and set-downs are not included.
    """
    moves = start_moves(way.home)

    def follow(points: Array, speed: float) -> None:
        for point in points:
            R = rot_z(float(point[3]))
            moves.go(point[:3], R, speed=speed, acceleration=CARRY_ACCELERATION)

    def come(place: Place) -> None:  # and lift
        p = find_platform(way.grip, place)
        moves.go(behind(p, place.yaw), rot_z(place.yaw))
        moves.go(p - [0.0, 0.0, DROP], rot_z(place.yaw))
        moves.p = p + [0.0, 0.0, LIFT]

    def bring(place: Place) -> None:  # set down, and leave
        p = find_platform(way.grip, place)
        moves.go(p + [0.0, 0.0, ABOVE], rot_z(place.yaw))
        moves.p = p - [0.0, 0.0, DROP]
        moves.go(behind(p, place.yaw), rot_z(place.yaw))

    follow(way.to_bench, speed)
    come(way.bench)
    follow(way.to_pipe, CALM_SPEED)
    bring(way.seat)
    come(way.seat)
    moves.go(way.to_pipe[-1, :3], rot_z(way.seat.yaw))
    follow(way.to_pipe[::-1], CALM_SPEED)
    bring(way.bench)
    follow(way.to_bench[::-1], speed)
    return moves.seconds + 2.0 * compute_joints_s(way.grip.q_low - way.folded)
