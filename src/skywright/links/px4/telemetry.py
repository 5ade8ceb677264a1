"""PX4's estimate and set-points, received on a separate UDP link.

PX4's SITL sends to four ports. 14540 (offboard programs) and 14550 (ground stations) stay free for
others; this one is intended for a gimbal, and its three messages are requested. PX4's position is
that of the centre of mass: it is converted to that of B with PX4's own attitude.
"""

from __future__ import annotations

import socket
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_from_quat
from skywright.errors import InputError
from skywright.links.mavlink.frames import FRD_FROM_FLU, NED_FROM_ENU, move_point, swap_body
from skywright.links.mavlink.stream import MavlinkStream, is_finite

Array = NDArray[np.float64]

PORT = 13280
"""UDP port of PX4's gimbal link; instance N uses 13280 + N."""
ATTITUDE, POSITION, TARGET = 31, 32, 85  # message ids
RATE_HZ = 20.0
ASK_EVERY_S = 2.0  # s of the plant's time between requests until the messages arrive
SET_MESSAGE_INTERVAL = 511
SYSTEM, COMPONENT = 245, 191  # an onboard computer
AT_ONCE = 100  # datagrams per read
IGNORE_POSITION, IGNORE_VELOCITY = 0x7, 0x38  # bits of type_mask


class Telemetry:
    """Records PX4's estimate and set-points."""

    def __init__(self, host: str, port: int, notes: Any, p_BC: Array) -> None:
        """`notes` are those of SitlPlant, `p_BC` (3,) m is the centre of mass in PX4's parameters.

        Raises InputError if the port is in use.
        """
        self.stream = MavlinkStream(SYSTEM, COMPONENT)
        self._notes, self._p_BC = notes, p_BC
        self._asked, self._came = -ASK_EVERY_S, set[int]()
        self._shift: Array | None = None
        self._w_WB_B = np.zeros(3)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"--telemetry {port} on {host}: {error.strerror or error}; valid: a free port, or "
                "0 for none"
            ) from None
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])

    def restart(self) -> None:
        """Request the messages again after a restart of PX4, which has a new local frame."""
        self._asked, self._came, self._shift = -ASK_EVERY_S, set(), None
        self._notes.heard = 0.0

    def poll(self, t: float, p_WB: Array, local_origin: bool) -> None:
        """Process received messages; `t` (s) is the plant's time, `p_WB` (3,) m the true position.

        With a `local_origin` PX4's frame begins at the start of its estimator: it is shifted by the
        error of its first estimate.
        """
        for _ in range(AT_ONCE):
            try:
                data, address = self._socket.recvfrom(2048)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # a closed port at the other end
                continue
            for message in self.stream.feed(data):
                self._take(message, p_WB, local_origin)
            if len(self._came) < 3 and t - self._asked >= ASK_EVERY_S:
                self._asked = t
                self._ask(address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _ask(self, address: Any) -> None:
        d = self.stream.dialect
        beat = d.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)  # onboard controller, active
        asked = [
            d.MAVLink_command_long_message(
                1, 1, SET_MESSAGE_INTERVAL, 0, kind, 1e6 / RATE_HZ, 0, 0, 0, 0, 0
            )
            for kind in (ATTITUDE, POSITION, TARGET)
        ]
        for message in (beat, *asked):
            try:
                self._socket.sendto(self.stream.pack(message), address)
            except OSError:  # requested again later
                return

    def _take(self, m: Any, p_WB: Array, local_origin: bool) -> None:
        kind = m.get_msgId()
        if kind == POSITION and is_finite(m, "x", "y", "z", "vx", "vy", "vz"):
            p, v = (NED_FROM_ENU @ x for x in ([m.x, m.y, m.z], [m.vx, m.vy, m.vz]))
            p, v = move_point(p, v, self._notes.R_WB, self._w_WB_B, -self._p_BC)
            if self._shift is None:
                self._shift = p_WB - p if local_origin else np.zeros(3)
            self._notes.p_WB[:], self._notes.v_WB[:] = p + self._shift, v
            self._notes.heard = 1.0
        elif kind == ATTITUDE and is_finite(m, "q1", "q2", "q3", "q4"):
            q = np.array([m.q1, m.q2, m.q3, m.q4])
            if not 0.9 < np.linalg.norm(q) < 1.1:
                return
            R = rot_from_quat(q / np.linalg.norm(q))
            self._notes.R_WB[:] = NED_FROM_ENU @ R @ FRD_FROM_FLU
            if is_finite(m, "rollspeed", "pitchspeed", "yawspeed"):
                self._w_WB_B = swap_body(np.array([m.rollspeed, m.pitchspeed, m.yawspeed]))
        elif kind == TARGET:
            self._take_target(m)
        else:
            return
        self._came.add(kind)

    def _take_target(self, m: Any) -> None:
        """Record a set-point of B's origin; parts that PX4 does not control are NaN."""
        nan = np.full(3, np.nan)
        given = m.type_mask & IGNORE_POSITION == 0 and is_finite(m, "x", "y", "z")
        p = NED_FROM_ENU @ np.array([m.x, m.y, m.z]) if given else nan
        given = m.type_mask & IGNORE_VELOCITY == 0 and is_finite(m, "vx", "vy", "vz")
        v = NED_FROM_ENU @ np.array([m.vx, m.vy, m.vz]) if given else nan
        p, v = move_point(p, v, self._notes.R_WB, self._w_WB_B, -self._p_BC)
        self._notes.p_WB_des[:] = p if self._shift is None else p + self._shift
        self._notes.v_WB_des[:] = v
