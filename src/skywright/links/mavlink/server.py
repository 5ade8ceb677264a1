"""MAVLink server of a simulated robot: receives requests, answers, and reports at its rates.

It never blocks, and of the received messages it keeps only the newest set-point and stick.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from weakref import WeakKeyDictionary

from skywright.description.world.origin import Origin
from skywright.links.mavlink.commands import Asked, Commands
from skywright.links.mavlink.endpoint import Endpoint, Peer
from skywright.links.mavlink.parameters import Parameters, read_name, read_value
from skywright.links.mavlink.reports import Reports
from skywright.links.mavlink.robot import ACCEPTED, DENIED, UNSUPPORTED, Robot, Stick
from skywright.links.mavlink.schedule import Schedule
from skywright.links.mavlink.setpoints import (
    Scale,
    SetPoint,
    read_attitude,
    read_global,
    read_local,
)
from skywright.links.mavlink.stream import is_finite
from skywright.vehicle.commands import State

SYSTEM, COMPONENT = 1, 1
PER_TICK = 25  # parameters sent per tick (20 ms) to one peer
TEXT = 50  # characters of a STATUSTEXT
LONGEST = 249  # characters of a text: five chunks, of which the last contains a NUL
REPEAT_S = 2.0  # s for which the same text is not repeated
WARNING, INFO = 4, 6  # MAV_SEVERITY
REQUEST_MESSAGE, SET_INTERVAL, GET_INTERVAL, REQUEST_VERSION = 512, 511, 510, 520
NO_MISSION, INVALID = 3, 13  # MAV_MISSION_RESULT: unsupported, an invalid sequence
CAUSES = {
    "checksum": "packets with a wrong checksum or definition",
    "version": "packets of MAVLink 1",
    "unknown": "messages that the dialect common does not have",
    "garbage": "stretches of bytes that belong to no packet",
    "numbers": "messages with numbers that are not finite",
    "target": "messages to another system",
    "peers": "messages of more senders than are answered",
    "set-points": "set-points that were refused",
}
"""Cause of dropped messages -> description."""


class Server:
    """Answers on endpoints for one robot."""

    def __init__(
        self, endpoints: Sequence[Endpoint], dialect: Any, robot: Robot, reports: Reports,
        parameters: Parameters, scale: Scale, origin: Origin,
    ) -> None:  # fmt: skip
        self.endpoints, self.d, self.robot, self.reports = endpoints, dialect, robot, reports
        self.parameters, self.scale, self.origin = parameters, scale, origin
        self.commands = Commands(robot, origin)
        self.counts: Counter[str] = Counter()
        """Number of dropped messages by CAUSES, and of `accepted` messages."""
        reports.unix_us = lambda: time.time_ns() // 1000
        self._schedules: WeakKeyDictionary[Peer, Schedule] = WeakKeyDictionary()
        self._lists: dict[int, tuple[Endpoint, Peer, Iterator[Any]]] = {}
        self._told: dict[str, float] = {}
        self._shown: tuple[int, int, State] | None = None
        self._handlers: dict[str, Callable[[Any, Endpoint, Peer], None]] = {
            "COMMAND_LONG": self._command, "COMMAND_INT": self._command,
            "SET_MODE": self._set_mode,
            "PARAM_REQUEST_LIST": self._list_parameters,
            "PARAM_REQUEST_READ": self._read_parameter, "PARAM_SET": self._set_parameter,
            "MISSION_REQUEST_LIST": self._mission_list, "MISSION_COUNT": self._mission_upload,
            "MISSION_CLEAR_ALL": self._mission_clear,
            "MISSION_REQUEST_INT": self._mission_item, "MISSION_REQUEST": self._mission_item,
            "SET_POSITION_TARGET_LOCAL_NED": self._point,
            "SET_POSITION_TARGET_GLOBAL_INT": self._point, "SET_ATTITUDE_TARGET": self._point,
            "MANUAL_CONTROL": self._stick, "TIMESYNC": self._timesync, "PING": self._ping,
            "FILE_TRANSFER_PROTOCOL": self._refuse_file,
        }  # fmt: skip

    # --- ticks -------------------------------------------------------------------------------

    def poll(self) -> None:
        """Process and answer received messages."""
        for endpoint in self.endpoints:
            for message, peer in endpoint.poll():
                self.take(message, endpoint, peer)

    def report(self) -> None:
        """Send reports that are due, and requested parameters."""
        t = self.robot.vehicle.t
        shown = (self.robot.mode.custom, int(self.robot.armed), self.robot.vehicle.state)
        changed, self._shown = shown != self._shown, shown
        built: dict[int, Any] = {}
        for endpoint in self.endpoints:
            for peer in list(endpoint.peers.values()):
                schedule = self._get_schedule(peer)
                if changed:
                    schedule.hurry(0, t)  # heartbeat
                    schedule.hurry(245, t)  # extended state
                for number in schedule.list_due(t):
                    if number not in built:
                        built[number] = self.reports.build(number)
                    if built[number] is not None:
                        endpoint.send(built[number], peer)
        for key, (endpoint, peer, messages) in list(self._lists.items()):
            for _ in range(PER_TICK):
                message = next(messages, None)
                if message is None:
                    del self._lists[key]
                    break
                endpoint.send(message, peer)

    def _get_schedule(self, peer: Peer) -> Schedule:
        return self._schedules.setdefault(peer, Schedule())

    def say(self, text: str, severity: int = INFO) -> None:
        """Send a text to all peers; the same one at most every two seconds."""
        now = time.monotonic()
        if now - self._told.get(text, -REPEAT_S) < REPEAT_S:
            return
        self._told = {k: at for k, at in self._told.items() if now - at < REPEAT_S}
        if len(self._told) < 100:
            self._told[text] = now
        data = text.encode("ascii", "replace")[:LONGEST]
        number = (hash(text) & 0x7FFF) + 1 if len(data) > TEXT else 0
        end = len(data) + 1 if number else TEXT  # the last of several chunks contains a NUL
        for k in range(0, end, TEXT):
            part = data[k : k + TEXT]
            self._send(self.d.MAVLink_statustext_message(severity, part, number, k // TEXT))

    def describe_dropped(self) -> list[str]:
        """Return one line for each cause of dropped messages."""
        found = sum((e.counts for e in self.endpoints), Counter[str]()) + self.counts
        return [f"{found[c]} {says}" for c, says in CAUSES.items() if found[c]]

    def close(self) -> None:
        """Close all endpoints."""
        for endpoint in self.endpoints:
            endpoint.close()

    def _send(self, message: Any) -> None:
        if message is not None:
            for endpoint in self.endpoints:
                endpoint.send(message)

    # --- received messages ---------------------------------------------------------------------

    def take(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        """Answer a message."""
        handler = self._handlers.get(m.get_type())
        if handler is None:
            return
        target = getattr(m, "target_system", getattr(m, "target", 0))
        if target not in (0, SYSTEM) or getattr(m, "target_component", 0) not in (0, COMPONENT):
            self.counts["target"] += 1
            return
        handler(m, endpoint, peer)

    def _command(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        asked = Asked.read(m)
        if asked.number in (REQUEST_MESSAGE, REQUEST_VERSION):
            number = 148.0 if asked.number == REQUEST_VERSION else asked.p[0]
            known = is_finite(m, "param1") and int(number) in self.reports.numbers
            message = self.reports.build(int(number)) if known else None
            self._acknowledge(m, UNSUPPORTED if message is None else ACCEPTED, endpoint, peer)
            if message is not None:
                endpoint.send(message, peer)
            return
        if asked.number in (SET_INTERVAL, GET_INTERVAL):
            self._acknowledge(m, self._set_interval(asked, endpoint, peer), endpoint, peer)
            return
        reply = self.commands.do(asked)
        self._acknowledge(m, reply.result, endpoint, peer)
        if reply.says:
            self.say(reply.says, WARNING)

    def _acknowledge(self, m: Any, result: int, endpoint: Endpoint, peer: Peer) -> None:
        ack = self.d.MAVLink_command_ack_message(
            m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
        )
        endpoint.send(ack, peer)

    def _set_interval(self, asked: Asked, endpoint: Endpoint, peer: Peer) -> int:
        """Change or report the interval of a message to this peer."""
        if not (asked.p[0] == asked.p[0] and abs(asked.p[0]) < 2**24):
            return DENIED
        number, interval = int(asked.p[0]), asked.p[1]
        if number not in self.reports.numbers:
            return UNSUPPORTED
        schedule = self._get_schedule(peer)
        if asked.number == GET_INTERVAL:
            us = schedule.get_interval_us(number)
            endpoint.send(self.d.MAVLink_message_interval_message(number, us), peer)
            return ACCEPTED
        return ACCEPTED if schedule.set_interval_us(number, interval) else DENIED

    def _set_mode(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        from skywright.links.mavlink.modes import Mode

        reply = self.robot.choose(Mode.read(m.custom_mode))
        if reply.says:
            self.say(reply.says, WARNING)

    def _list_parameters(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        if len(self._lists) < 16:
            self._lists[id(peer)] = (endpoint, peer, self.parameters.list_messages(self.d))

    def _read_parameter(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        names, k = self.parameters.names, m.param_index
        name = names[k] if 0 <= k < len(names) else read_name(m)
        if name in self.parameters:
            endpoint.send(self.parameters.build(self.d, name), peer)
        else:
            self._refuse_parameter(name, m, endpoint, peer)

    def _set_parameter(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        name = read_name(m)
        if name not in self.parameters:
            self._refuse_parameter(name, m, endpoint, peer)
            return
        value = read_value(m)
        says = self.parameters.set(name, value) if value != self.parameters[name] else ""
        if says:
            self.say(says, WARNING)
        self._send(self.parameters.build(self.d, name))  # the current value, also after a refusal

    def _refuse_parameter(self, name: str, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        make = getattr(self.d, "MAVLink_param_error_message", None)  # of a newer dialect
        if make is not None:
            endpoint.send(
                make(m.get_srcSystem(), m.get_srcComponent(), name.encode()[:16], -1, 1), peer
            )

    def _mission_list(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        count = self.d.MAVLink_mission_count_message(
            m.get_srcSystem(), m.get_srcComponent(), 0, m.mission_type
        )
        endpoint.send(count, peer)

    def _answer_mission(self, m: Any, result: int, endpoint: Endpoint, peer: Peer) -> None:
        ack = self.d.MAVLink_mission_ack_message(
            m.get_srcSystem(), m.get_srcComponent(), result, m.mission_type
        )
        endpoint.send(ack, peer)

    def _mission_upload(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        self._answer_mission(m, NO_MISSION if m.count else 0, endpoint, peer)
        if m.count:
            self.say("missions, fences and rally points are refused: use `skywright run`", WARNING)

    def _mission_clear(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        self._answer_mission(m, 0, endpoint, peer)

    def _mission_item(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        self._answer_mission(m, INVALID, endpoint, peer)

    def _point(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        b = self.robot.vehicle.backend
        point: SetPoint | str
        kind = m.get_type()
        if kind == "SET_ATTITUDE_TARGET":
            point = read_attitude(m, b, self.scale)
        elif kind == "SET_POSITION_TARGET_GLOBAL_INT":
            point = read_global(m, self.origin, float(self.robot.home[2]))
        else:
            point = read_local(m, b)
        if isinstance(point, str):
            self.counts["set-points"] += 1
            self.say(point, WARNING)
        else:
            self.robot.take(point)

    def _stick(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        if any(abs(v) > 1000 for v in (m.x, m.y, m.z, m.r)):  # 32767: not given
            self.counts["numbers"] += 1
            return
        up = 2.0 * max(m.z, 0) / 1000.0 - 1.0
        self.robot.take_stick(Stick(m.x / 1000.0, m.y / 1000.0, up, m.r / 1000.0))

    def _timesync(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        if m.tc1 == 0:
            now = time.monotonic_ns()
            endpoint.send(self.d.MAVLink_timesync_message(now, m.ts1), peer)

    def _ping(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        if m.target_system == 0:
            answer = self.d.MAVLink_ping_message(
                m.time_usec, m.seq, m.get_srcSystem(), m.get_srcComponent()
            )
            endpoint.send(answer, peer)

    def _refuse_file(self, m: Any, endpoint: Endpoint, peer: Peer) -> None:
        """Answer a file request with "unknown command": there is no file system."""
        asked = bytes(m.payload).ljust(251, b"\0")
        if asked[3] == 0 or asked[3] >= 128:
            return
        sequence = (int.from_bytes(asked[:2], "little") + 1) % 65536
        answer = sequence.to_bytes(2, "little") + bytes([asked[2], 129, 1, asked[3], 0, 0])
        answer += asked[8:12] + bytes([7])
        endpoint.send(
            self.d.MAVLink_file_transfer_protocol_message(
                0, m.get_srcSystem(), m.get_srcComponent(), list(answer.ljust(251, b"\0"))
            ),
            peer,
        )
