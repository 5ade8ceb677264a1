"""The datagrams of Betaflight's SITL target (release 4.6): state and sticks in, outputs back.

Frames: Betaflight's body frame after reading a packet is FLU, that of B. The packet itself contains
the angular velocity and the quaternion with y and z negated, and the specific force with all signs
negated. With the quaternion of FLU a level hover works, but the first tilt turns the robot over; a
test therefore checks the signs with a step in each axis.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_from_rot
from skywright.vehicle.geodesy import Geodetic

Array = NDArray[np.float64]

OUTPUTS_PORT, STATE_PORT, STICKS_PORT = 9001, 9003, 9004
"""UDP ports, compiled into the firmware: one instance per computer."""
COMMAND_PORT = 5761
"""TCP port of its first serial port: command line and MSP."""
STATE = struct.Struct("<18d")
STICKS = struct.Struct("<d16H")
OUTPUTS = struct.Struct("<H2x16f")
LOW, MIDDLE, HIGH = 1000, 1500, 2000
"""us, of a channel and of an output."""
CHANNELS = 16
STAMP_S = 1.0
"""Time in each packet of the state. Betaflight scales its clock by the difference of the last two
packets' times over that of their arrivals. If a busy computer delivers two packets together, its
clock jumps ahead by seconds, which triggers its failsafe. Equal times keep its clock at the wall
clock.
"""
CAUSES = {
    "size": "a datagram that is no packet of outputs",
    "count": "outputs for another number of motors: the mixer is not that of this robot",
    "numbers": "outputs that are not finite or outside of 900 to 2100",
}
"""Cause of a refused packet -> description."""
FLIP = np.array([1.0, -1.0, -1.0])


class Sticks(NamedTuple):
    """Deflections; roll right, pitch forward and yaw clockwise from above are positive."""

    roll: float  # -1 to 1
    pitch: float
    throttle: float  # 0 to 1, above min_check
    yaw: float


IDLE = Sticks(0.0, 0.0, 0.0, 0.0)


def pack_state(
    w_WB_B: Array, accel: Array, R_WB: Array, v_W: Array, place: Geodetic, pressure: float
) -> bytes:
    """Return the packet of a state: rad/s and m/s^2 in B, m/s in W, Pa.

    `accel` is the specific force. Betaflight's virtual satellite receiver reads velocity and
    position.
    """
    return STATE.pack(
        STAMP_S, *(w_WB_B * FLIP), *(-accel), *(quat_from_rot(R_WB) * [1.0, 1.0, -1.0, -1.0]), *v_W,
        place.longitude_deg, place.latitude_deg, place.altitude_m, pressure,
    )  # fmt: skip


def pack_sticks(t: float, sticks: Sticks, min_check: int, armed: bool) -> bytes:
    """Return the packet of 16 channels: roll, pitch, throttle, yaw, arm switch, ANGLE switch.

    Throttle 0 is the end of the channel, below `min_check` (us), as arming requires.
    """
    span = HIGH - min_check
    throttle = LOW if sticks.throttle <= 0.0 else min_check + span * min(sticks.throttle, 1.0)
    axes = [MIDDLE + 0.5 * (HIGH - LOW) * _clip(x) for x in (sticks.roll, sticks.pitch, sticks.yaw)]
    values = [
        axes[0], axes[1], throttle, axes[2], HIGH if armed else LOW, HIGH,
        *([MIDDLE] * (CHANNELS - 6)),
    ]  # fmt: skip
    return STICKS.pack(t, *(round(v) for v in values))


def parse_outputs(data: bytes, n: int) -> Array | str:
    """Return the shares (n,) from 0 to 1 of the motors' ranges, or the cause of a refusal."""
    if len(data) != OUTPUTS.size:
        return "size"
    count, *values = OUTPUTS.unpack(data)
    if count != n:
        return "count"
    raw = np.array(values[:n])
    if not np.all((raw >= 900.0) & (raw <= 2100.0)):  # also false for NaN
        return "numbers"
    return np.clip((raw - LOW) / (HIGH - LOW), 0.0, 1.0)


def _clip(x: float) -> float:
    return min(max(x, -1.0), 1.0)
