"""Names of rmw_zenoh: key expressions, liveliness tokens, attachments.

They follow its design document (rmw_zenoh, docs/design.md): a token makes an entity visible to
`ros2 topic list`, the key expression addresses the data, and the attachment contains sender, time
and sequence number.
"""

from __future__ import annotations

import hashlib
import struct

PUBLISHER, SUBSCRIBER, SERVICE = "MP", "MS", "SS"
QOS = "::,10:,:,:,,"
"""Reliable, volatile, depth 10; deadline, lifespan and liveliness are ROS's defaults."""
ATTACHMENT = struct.Struct("<qqB16s")
"""Sequence number, time (ns), length of the sender's GID, and the GID."""


def name_type(full: str) -> str:
    """Return the DDS name of a type (`pkg/msg/Type`): `pkg::msg::dds_::Type_`."""
    package, group, name = full.split("/")
    return f"{package}::{group}::dds_::{name}_"


def name_key(domain: int, name: str, full: str, digest: str) -> str:
    """Return the key expression of a topic or service."""
    return f"{domain}/{name.strip('/')}/{name_type(full)}/{digest}"


class Node:
    """A ROS 2 node and its tokens."""

    def __init__(self, domain: int, session: str, name: str) -> None:
        """`session` is the id of the Zenoh session."""
        self._start = f"@ros2_lv/{domain}/{session}/0"
        self._end = f"%/%/{name}"
        self._entities = 0

    @property
    def token(self) -> str:
        """The liveliness token of the node."""
        return f"{self._start}/0/NN/{self._end}"

    def add(self, kind: str, name: str, full: str, digest: str) -> str:
        """Return the token of a new entity of the node."""
        self._entities += 1
        place = f"{self._start}/{self._entities}/{kind}/{self._end}"
        return f"{place}/{name.replace('/', '%')}/{name_type(full)}/{digest}/{QOS}"


def build_gid(token: str) -> bytes:
    """Return the GID of an entity (16 bytes), computed from its token."""
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def pack_attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Return an attachment."""
    return ATTACHMENT.pack(sequence, time_ns, len(gid), gid)


def read_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Return sequence, time (ns) and sender; raises ValueError if it is no attachment."""
    if len(data) != ATTACHMENT.size:
        raise ValueError(f"an attachment of {len(data)} bytes")
    sequence, time_ns, length, gid = ATTACHMENT.unpack(data)
    if length != len(gid):
        raise ValueError(f"a sender's number of {length} bytes")
    return sequence, time_ns, gid
