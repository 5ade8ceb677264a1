"""Poses as MAVLink ODOMETRY messages, as sent from motion capture to an autopilot.

The message has NED (or a local FRD frame) for the world and FRD for the body; a sample has ENU and
FLU. `clock` is the sender's system id, `t` its `time_usec`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.core.rotations import quat_from_rot, rot_from_quat
from skywright.links.live.packets import Refused, Sample
from skywright.links.mavlink.frames import FRD_FROM_FLU, NED_FROM_ENU, to_ned_quaternion
from skywright.links.mavlink.stream import MavlinkStream, is_finite

ODOMETRY = 331
LOCAL_NED, LOCAL_FRD, BODY_FRD = 1, 20, 12
MOCAP = 5  # MAV_ESTIMATOR_TYPE_MOCAP


def pack_odometry(stream: MavlinkStream, sample: Sample) -> bytes:
    """Return the packet of a pose; raises ValueError for a sample without orientation."""
    if sample.kind != "pose":
        raise ValueError(f"{sample.name!r} has no orientation, which ODOMETRY requires")
    values, nan = np.array(sample.values), math.nan
    q = to_ned_quaternion(rot_from_quat(values[3:]))
    message = stream.dialect.MAVLink_odometry_message(
        round(1e6 * sample.t), LOCAL_NED, BODY_FRD, *(NED_FROM_ENU @ values[:3]), list(q), nan, nan,
        nan, nan, nan, nan, [nan] * 21, [nan] * 21, 0, MOCAP, 100,
    )  # fmt: skip
    return stream.pack(message)


def parse_odometry(message: Any, sequence: int) -> Sample:
    """Return the sample of an ODOMETRY message; raises Refused."""
    if message.frame_id not in (LOCAL_NED, LOCAL_FRD) or message.child_frame_id != BODY_FRD:
        raise Refused("frame")
    q = np.array(message.q, dtype=float)
    if not is_finite(message, "x", "y", "z", "q") or not 0.99 < np.linalg.norm(q) < 1.01:
        raise Refused("numbers")
    p = NED_FROM_ENU.T @ np.array([message.x, message.y, message.z])
    R = NED_FROM_ENU.T @ rot_from_quat(q / np.linalg.norm(q)) @ FRD_FROM_FLU
    system = int(message.get_srcSystem())
    values = tuple(float(x) for x in (*p, *quat_from_rot(R)))
    return Sample("pose", f"odometry{system}", system, sequence, 1e-6 * message.time_usec, values)
