"""Types of ROS 2 messages and services, and their hashes, by distribution.

Standard types are those of rosbags for a distribution; Skywright's types are registered in
addition. Hashes are RIHS01 (REP 2011): SHA-256 over the description of a type and of all types that
it uses. rmw_zenoh on Humble has none and uses a fixed word instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from skywright.errors import InputError
from skywright.recordings.messages import STANDARD, full_name

NO_HASH = "TypeHashNotSupported"
DISTROS = {
    "humble": Stores.ROS2_HUMBLE, "jazzy": Stores.ROS2_JAZZY, "kilted": Stores.ROS2_KILTED,
    "lyrical": Stores.ROS2_LYRICAL,
}  # fmt: skip
INFO = "service_msgs/msg/ServiceEventInfo"
EVENT_INFO = (
    "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number"
)


class Types:
    """The types of one distribution and those of Skywright."""

    def __init__(
        self, distro: str, own: Mapping[str, str], services: Mapping[str, tuple[str, str]]
    ) -> None:
        """`own` defines types (`pkg/Type`), `services` request and response of services.

        Types of the distribution are not registered again. Raises InputError for an unknown
        distribution.
        """
        if distro not in DISTROS:
            raise InputError(f"ROS 2 distribution {distro[:40]!r}; valid: {', '.join(DISTROS)}")
        self.store: Any = get_typestore(DISTROS[distro])
        self._hashed = distro != "humble"
        # rosbags hashes a `char`, which is uint8 in ROS 2, as the character of IDL
        self.store.fielddefs.pop(INFO, None)
        self.store.register(get_types_from_msg(EVENT_INFO, INFO))
        for kind, text in own.items():
            if full_name(kind) not in self.store.fielddefs:
                self.store.register(get_types_from_msg(text, full_name(kind)))
        for kind, (request, response) in services.items():
            self._register_service(kind, request, response)

    def _register_service(self, kind: str, request: str, response: str) -> None:
        package, _, name = kind.partition("/")
        full = name_service(kind)
        for text, suffix in ((request, "Request"), (response, "Response")):
            parsed = get_types_from_msg(text, f"{package}/msg/{name}_{suffix}")
            (definition,) = parsed.values()
            self.store.register({f"{full}_{suffix}": definition})
        sent, answered = f"{full}_Request", f"{full}_Response"
        event = [
            ("info", (Nodetype.NAME, INFO)),
            ("request", (Nodetype.SEQUENCE, ((Nodetype.NAME, sent), 1))),
            ("response", (Nodetype.SEQUENCE, ((Nodetype.NAME, answered), 1))),
        ]
        whole = [
            ("request_message", (Nodetype.NAME, sent)),
            ("response_message", (Nodetype.NAME, answered)),
            ("event_message", (Nodetype.NAME, f"{full}_Event")),
        ]
        self.store.register({f"{full}_Event": ([], event), full: ([], whole)})

    def hash(self, full: str) -> str:
        """Return the hash of a type by its full name, or the fixed word."""
        return str(self.store.hash_rihs01(full)) if self._hashed else NO_HASH

    def decode(self, full: str, data: bytes) -> dict[str, Any]:
        """Return a message as plain values; raises ValueError if it is invalid."""
        if not self.store.fielddefs[full][1]:
            return {}
        try:
            return _plain(self.store, self.store.deserialize_cdr(data, full))
        except Exception as error:  # any error of the decoder on invalid bytes
            raise ValueError(f"no {full}: {type(error).__name__}") from None

    def encode(self, full: str, **values: Any) -> bytes:
        """Return a message with these values."""
        return bytes(self.store.serialize_cdr(self.store.types[full](**values), full))


def list_definitions(kinds: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Return the definitions of all types of recordings and of `kinds`."""
    out = dict(STANDARD)
    for more in kinds:
        out |= more
    return out


def name_service(kind: str) -> str:
    """Return the ROS 2 name of a service type: `pkg/srv/Type`."""
    package, _, name = kind.partition("/")
    return f"{package}/srv/{name}"


def _plain(store: Any, value: Any) -> Any:
    """Return a message's values as JSON types."""
    if hasattr(value, "__msgtype__"):
        names = [name for name, _ in store.fielddefs[value.__msgtype__][1]]
        return {name: _plain(store, getattr(value, name)) for name in names}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [_plain(store, v) for v in value]
    return value.item() if isinstance(value, np.generic) else value
