"""Message 82 (SET_ATTITUDE_TARGET) with its extension `thrust_body`, which pymavlink lacks.

The payload is that of MAVLink's common.xml: the base fields in the order of their size, then the
extension, 51 bytes. A receiver without the extension reads the base fields.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ID = 82
PAYLOAD = struct.Struct("<I4f3ffBBB3f")
"""time_boot_ms, q, body rates, thrust, target system, component, type_mask, thrust_body."""
IGNORE_RATES, THRUST_BODY, IGNORE_THRUST, IGNORE_ATTITUDE = 0x07, 0x20, 0x40, 0x80
"""Bits of type_mask."""
HEADER = 10  # bytes before the payload of a packet of MAVLink 2


class AttitudeTarget(NamedTuple):
    """An attitude of FRD in NED and the thrust command."""

    time_ms: int
    type_mask: int
    q: tuple[float, float, float, float]  # wxyz
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad/s
    thrust: float = 0.0  # 0 to 1
    thrust_body: tuple[float, float, float] = (0.0, 0.0, 0.0)  # -1 to 1 along FRD
    system: int = 1
    component: int = 1

    def pack(self, sender: Any) -> bytes:
        """Return the MAVLink 2 packet; `sender` (pymavlink's MAVLink) provides sequence number and
        ids."""
        from pymavlink.dialects.v20.common import MAVLink_set_attitude_target_message as Message

        payload = PAYLOAD.pack(
            self.time_ms % 2**32, *self.q, *self.rates, self.thrust, self.system, self.component,
            self.type_mask, *self.thrust_body,
        )  # fmt: skip
        message = Message(0, 0, 0, 0, [0.0] * 4, 0, 0, 0, 0)
        packet: bytes = message._pack(sender, Message.crc_extra, payload)
        return packet

    @classmethod
    def read(cls, message: Any) -> AttitudeTarget | None:
        """Return the content of a received message 82; None if a number in it is invalid.

        A field that type_mask excludes may have any value.
        """
        packet = bytes(message.get_msgbuf())
        payload = packet[HEADER : HEADER + packet[1]].ljust(PAYLOAD.size, b"\0")[: PAYLOAD.size]
        time_ms, *rest = PAYLOAD.unpack(payload)
        q, rates, thrust = tuple(rest[:4]), tuple(rest[4:7]), rest[7]
        system, component, mask = rest[8:11]
        body = tuple(rest[11:14])
        used: list[float] = []
        used += [] if mask & IGNORE_ATTITUDE else q
        used += [rate for i, rate in enumerate(rates) if not mask & 1 << i]
        if mask & THRUST_BODY:
            used += body
        elif not mask & IGNORE_THRUST:
            used.append(thrust)
        if not all(math.isfinite(x) for x in used):
            return None
        return cls(time_ms, mask, q, rates, thrust, body, system, component)
