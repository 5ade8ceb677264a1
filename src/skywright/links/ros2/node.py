"""A ROS 2 node over Zenoh: publishers, UAL's services, and command topics.

The node connects as a client to the Zenoh router of the ROS 2 system. If no router answers at an
address of this computer, the node is the router itself, so that ROS 2 nodes find it at their
default address. It does not use multicast discovery.
"""

from __future__ import annotations

import json
import socket
import sys
import time
from collections import Counter
from typing import Any, NamedTuple

import zenoh

from skywright.errors import InputError
from skywright.links.broadcast.caller import Caller
from skywright.links.broadcast.options import read_endpoint
from skywright.links.broadcast.rows import Reader
from skywright.links.broadcast.table import SERVICE_TYPES, SERVICES, STREAMS, Service, Stream
from skywright.links.broadcast.topics import TEXTS, TYPES
from skywright.links.ros2.names import (
    PUBLISHER,
    SERVICE,
    SUBSCRIBER,
    Node,
    build_gid,
    name_key,
    pack_attachment,
    read_attachment,
)
from skywright.links.ros2.types import Types, list_definitions, name_service
from skywright.recordings.columns import Topic
from skywright.recordings.messages import full_name
from skywright.recordings.sample_rows import build_message

NAME = "skywright"
LARGEST = 4096  # bytes, largest request
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
DOMAINS = range(233)  # as in ROS 2


class Sending(NamedTuple):
    """A publisher and its token."""

    publisher: Any
    gid: bytes


class Ros2Node:
    """The node of a flight."""

    def __init__(self, endpoint: str, distro: str, domain: int, caller: Caller) -> None:
        """Open the session; raises InputError if the connection fails."""
        if domain not in DOMAINS:
            raise InputError(f"ROS_DOMAIN_ID={domain}; valid: 0 to {DOMAINS[-1]}")
        self._distro, self._domain, self._caller = distro, domain, caller
        self._types = Types(distro, {}, {})  # an unknown distribution raises first
        self._session = _open_session(endpoint)
        self._node = Node(domain, str(self._session.zid()), NAME)
        self._tokens: list[Any] = []
        self._kept: list[Any] = []
        self._sending: dict[str, Sending] = {}
        self._sequence = 0
        self.counts: Counter[str] = Counter()
        """Number of dropped requests, by cause."""

    def declare(self, reader: Reader) -> None:
        """Declare the topics of a flight, and the commands."""
        topics = [e.topic for e in reader.encoders.values()] + [g.topic for g in TEXTS]
        own = list_definitions([TYPES, *(t.types for t in topics)])
        self._types = Types(self._distro, own, SERVICE_TYPES)
        self._declare(self._node.token)
        for topic in topics:
            self._add_publisher(topic)
        for service in SERVICES:
            self._add_service(service)
        for stream in STREAMS:
            self._add_subscriber(stream)

    @property
    def watched(self) -> bool:
        """Whether any topic has a subscriber."""
        return any(s.publisher.matching_status.matching for s in self._sending.values())

    def publish(self, reader: Reader) -> None:
        """Publish the newest row on the topics with subscribers."""
        ns = time.time_ns()
        for name in reader.encoders:
            if self._sending[name].publisher.matching_status.matching:
                self._put(name, reader.encode(name), ns)

    def tell(self, name: str, text: str, ns: int) -> None:
        """Publish a text (std_msgs/String)."""
        sending = self._sending.get(name)
        if sending is not None and sending.publisher.matching_status.matching:
            topic = Topic(name, "std_msgs/String", "", {}, {"data": text})
            self._put(name, build_message(topic, ns), time.time_ns())

    def close(self) -> None:
        """Close the session."""
        if self.counts:
            said = ", ".join(f"{n} {cause}" for cause, n in sorted(self.counts.items()))
            print(f"ros2: dropped: {said}", file=sys.stderr)
        self._session.close()

    # --- declarations ----------------------------------------------------------------------

    def _declare(self, token: str) -> None:
        self._tokens.append(self._session.liveliness().declare_token(token))

    def _add_publisher(self, topic: Topic) -> None:
        full = full_name(topic.kind)
        digest = self._types.hash(full)
        publisher = self._session.declare_publisher(
            name_key(self._domain, topic.name, full, digest),
            congestion_control=zenoh.CongestionControl.DROP,
        )
        token = self._node.add(PUBLISHER, topic.name, full, digest)
        self._sending[topic.name] = Sending(publisher, build_gid(token))
        self._declare(token)

    def _add_service(self, service: Service) -> None:
        full = name_service(service.kind)
        digest = self._types.hash(full)

        def asked(query: Any) -> None:
            self._take_call(service, full, query)

        key = name_key(self._domain, service.name, full, digest)
        self._kept.append(self._session.declare_queryable(key, asked, complete=True))
        self._declare(self._node.add(SERVICE, service.name, full, digest))

    def _add_subscriber(self, stream: Stream) -> None:
        full = full_name(stream.kind)
        digest = self._types.hash(full)

        def heard(sample: Any) -> None:
            self._take_message(stream, full, sample)

        key = name_key(self._domain, stream.name, full, digest)
        self._kept.append(self._session.declare_subscriber(key, heard))
        self._declare(self._node.add(SUBSCRIBER, stream.name, full, digest))

    # --- received requests -----------------------------------------------------------------

    def _take_call(self, service: Service, full: str, query: Any) -> None:
        """Forward a call; an invalid request is answered with an error."""
        try:
            sequence, _, gid = read_attachment(_read(query.attachment))
            args = self._read_request(f"{full}_Request", query.payload)
        except ValueError as error:
            self.counts["malformed"] += 1
            query.reply_err(str(error).encode())
            return

        def answer(ok: bool, says: str) -> None:
            body = self._types.encode(f"{full}_Response", success=ok, message=says)
            attachment = pack_attachment(sequence, time.time_ns(), gid)
            query.reply(query.key_expr, body, attachment=attachment)
            query.drop()

        self._caller.call(service.name, args, answer)

    def _take_message(self, stream: Stream, full: str, sample: Any) -> None:
        try:
            _, stamp_ns, gid = read_attachment(_read(sample.attachment))
            args = self._read_request(full, sample.payload)
        except ValueError:
            self.counts["malformed"] += 1
            return
        if not self._caller.stream(stream.name, args, 1e-9 * stamp_ns, gid):
            self.counts["old"] += 1

    def _read_request(self, full: str, payload: Any) -> dict[str, Any]:
        data = _read(payload)
        if len(data) > LARGEST:
            raise ValueError(f"{len(data)} bytes; valid: at most {LARGEST}")
        args = self._types.decode(full, data)
        json.dumps(args, allow_nan=False)  # raises ValueError on NaN and infinity
        return args

    def _put(self, name: str, body: bytes, ns: int) -> None:
        sending = self._sending[name]
        self._sequence += 1
        sending.publisher.put(body, attachment=pack_attachment(self._sequence, ns, sending.gid))


def _read(data: Any) -> bytes:
    return b"" if data is None else bytes(data.to_bytes())


def _open_session(endpoint: str) -> Any:
    """Connect to the router at `endpoint`, or open one there; raises InputError."""
    host, port = read_endpoint(endpoint)
    there = _answers(host.strip("[]"), port)
    if not there and host not in LOOPBACK:
        raise InputError(
            f"--ros2 {endpoint}: no Zenoh router answers; start it there: ros2 run rmw_zenoh_cpp "
            "rmw_zenohd"
        )
    config = zenoh.Config()
    config.insert_json5("mode", '"client"' if there else '"router"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint] if there else []))
    config.insert_json5("listen/endpoints", json.dumps([] if there else [endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise InputError(f"--ros2 {endpoint}: {error}") from None
    role = "connected to the router" if there else "router"
    print(f"ros2: {role} at {endpoint}", file=sys.stderr, flush=True)
    return session


def _answers(host: str, port: int) -> bool:
    try:
        with socket.create_connection((host, port), 2.0):
            return True
    except (OSError, UnicodeError):  # also an invalid name
        return False
