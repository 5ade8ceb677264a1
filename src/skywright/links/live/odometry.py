"""Poses as MAVLink ODOMETRY messages, as sent from motion capture to an autopilot.

The message has NED (or a local FRD frame) for the world and FRD for the body; a sample has ENU and
FLU. `t` is the sender's `time_usec`. The message has no sequence number and no number of the
sender's clock: `OdometrySenders` adds both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from skywright.core.rotations import quat_from_rot, rot_from_quat
from skywright.links.live.packets import SEQUENCES, Refused, Sample
from skywright.links.mavlink.frames import FRD_FROM_FLU, NED_FROM_ENU, to_ned_quaternion
from skywright.links.mavlink.stream import MavlinkStream, is_finite

ODOMETRY = 331
LOCAL_NED, LOCAL_FRD, BODY_FRD = 1, 20, 12
MOCAP = 5  # MAV_ESTIMATOR_TYPE_MOCAP
SYSTEMS = 256  # number of system ids
RESTART_S = 1.0  # s by which the time of a sender goes back when it is started again


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


def parse_odometry(message: Any) -> Sample:
    """Return the sample of an ODOMETRY message; raises Refused.

    Its clock is the system id of the sender, its sequence number 0.
    """
    if message.frame_id not in (LOCAL_NED, LOCAL_FRD) or message.child_frame_id != BODY_FRD:
        raise Refused("frame")
    q = np.array(message.q, dtype=float)
    if not is_finite(message, "x", "y", "z", "q") or not 0.99 < np.linalg.norm(q) < 1.01:
        raise Refused("numbers")
    p = NED_FROM_ENU.T @ np.array([message.x, message.y, message.z])
    R = NED_FROM_ENU.T @ rot_from_quat(q / np.linalg.norm(q)) @ FRD_FROM_FLU
    system = int(message.get_srcSystem())
    values = tuple(float(x) for x in (*p, *quat_from_rot(R)))
    return Sample("pose", f"odometry{system}", system, 0, 1e-6 * message.time_usec, values)


@dataclass
class _Sender:
    newest: float = -math.inf  # s, newest time
    behind: float = math.inf  # s, time of the last sample if it was far behind, else infinite
    count: int = 0  # samples in order
    starts: int = 0


class OdometrySenders:
    """Clock numbers and sequence numbers of ODOMETRY samples, by the senders' system ids.

    A sender was started again if the times of two consecutive samples are more than RESTART_S
    behind its newest time, and in order. It then gets a new clock number. One such sample alone is
    a late packet.
    """

    def __init__(self) -> None:
        self._senders: dict[int, _Sender] = {}

    def number(self, sample: Sample) -> Sample:
        """Return a sample of `parse_odometry` with its clock number and sequence number.

        A sample that is behind the newest one gets the sequence number of that one.
        """
        sender = self._senders.setdefault(sample.clock, _Sender())
        far = sample.t < sender.newest - RESTART_S
        if far and sample.t >= sender.behind:
            sender.starts += 1
            sender.newest, far = -math.inf, False
        sender.behind = sample.t if far else math.inf
        if sample.t >= sender.newest:
            sender.newest = sample.t
            sender.count += 1
        clock = sample.clock + SYSTEMS * sender.starts
        return sample._replace(clock=clock % SEQUENCES, sequence=sender.count % SEQUENCES)
