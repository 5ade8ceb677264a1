"""The operator's end of the gateway: client of an arms program, Skywright's or another."""

from __future__ import annotations

import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any

from skywright.errors import SkywrightError
from skywright.links.udp.codec import encode
from skywright.links.udp.packets import CODES, MAX_SIZE, RESULTS
from skywright.links.udp.receiver import Arrived, Receiver, read_packet

REPEAT_S = 0.2  # s between repetitions of an operation
ALIVE_S = 3.0  # s without a sent packet after which a keep-alive is sent
KEPT = 400  # number of deflection packets kept: two seconds
AT_ONCE = 1000


class NoAnswer(SkywrightError):
    """The arms program does not answer."""

    exit_code = 3


class ArmsClient:
    """Sends operations, sticks and joint references to an arms program, and receives its state.

        with ArmsClient("127.0.0.1", 9870) as arms:
            arms.operate("joints")
            arms.send_joints([0.0] * 8)

    `state` contains the fields of the newest state packet. Units and frames: docs/howto/gateway.md.
    """

    def __init__(
        self,
        host: str,
        port: int,
        key: bytes = b"",
        *,
        timeout_s: float = 10.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open a session. Raises NoAnswer if none is granted within `timeout_s`.

        `clock` (s) stamps the packets. It must not go back: the arms program drops later packets.
        """
        self.counts: Counter[str] = Counter()
        self.state: dict[str, Any] = {}
        self.age = 0.0
        """Age (s) of the newest state packet when it arrived."""
        self.deflections: deque[dict[str, Any]] = deque(maxlen=KEPT)
        """Newest packets of the deflection board, oldest first."""
        self._key, self._clock = key, clock
        self._answers: dict[int, Arrived] = {}
        self._session = self._sequence = self._number = self._stamp = 0
        self._stamps: set[int] = set()
        self._sent = 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((host, port))
        self._socket.setblocking(False)
        self._receiver: Receiver | None = None
        try:
            answer = self._request("connect", timeout_s)
        except BaseException:
            self.close()
            raise
        self._session = int(answer["opened"])

    def __enter__(self) -> ArmsClient:
        return self

    def __exit__(self, *_: object) -> None:
        if self._socket.fileno() >= 0:
            self._send("operation", {"operation": self._number + 1, "code": CODES["disconnect"][0]})
        self.close()

    def operate(self, name: str, timeout_s: float = 2.0) -> str:
        """Request an operation at 5 Hz until it is acknowledged; return its result.

        Raises NoAnswer after `timeout_s`, and ValueError on an unknown name.
        """
        if name not in CODES:
            raise ValueError(f"operation {name!r} is unknown; valid: {', '.join(CODES)}")
        result = self._request(name, timeout_s)["result"]
        known = {number: says for says, (number, _) in RESULTS.items()}
        return known.get(result, f"result {result}")

    def send_stick(self, axes: Sequence[float], buttons: int = 0) -> None:
        """Send a stick: up to six axes from -1 to 1. Raises ValueError on others."""
        self._send("stick", {"axes": axes, "buttons": buttons})

    def send_joints(self, q: Sequence[float]) -> None:
        """Send joint references (n,) rad. Raises ValueError on invalid angles."""
        self._send("joints", {"n": len(q), "q_ref": q})

    def poll(self) -> bool:
        """Process received packets; return whether a state was among them."""
        fresh = False
        for _ in range(AT_ONCE):
            try:
                data = self._socket.recv(MAX_SIZE + 1)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:  # no program listens there
                continue
            fresh |= self._take(data)
        if self._session and time.monotonic() - self._sent > ALIVE_S:
            self._number += 1
            self._send("operation", {"operation": self._number, "code": CODES["alive"][0]})
        return fresh

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _take(self, data: bytes) -> bool:
        packet = read_packet(data, self._key, self.counts)
        if packet is None:
            return False
        if self._receiver is None or self._receiver.session != packet.session:
            if packet.kind.name != "acknowledgement" or not self._opens(packet.values):
                self.counts["session"] += 1
                return False
            self._receiver = Receiver(packet.session, self.counts, to_arms=False)
        arrived = self._receiver.take(packet, self._clock())
        if arrived is None:
            return False
        if packet.kind.name == "acknowledgement":
            self._answers = {packet.values["operation"]: arrived}
        elif packet.kind.name == "deflection":
            self.deflections.append(packet.values)
        elif packet.kind.name == "state":
            self.state, self.age = packet.values, arrived.age
            return True
        return False

    def _opens(self, values: dict[str, Any]) -> bool:
        """Whether an acknowledgement answers this client's own request for a session."""
        asked = self._session == 0 and values["code"] == CODES["connect"][0]
        return asked and values["echo_us"] in self._stamps

    def _request(self, name: str, timeout_s: float) -> dict[str, Any]:
        self._number += 1
        self._stamps = set()
        end, again = time.monotonic() + timeout_s, 0.0
        while True:
            if time.monotonic() >= again:
                again = time.monotonic() + REPEAT_S
                self._send("operation", {"operation": self._number, "code": CODES[name][0]})
                self._stamps.add(self._stamp)
            self.poll()
            answer = self._answers.get(self._number)
            if answer is not None:
                return answer.packet.values
            if time.monotonic() > end:
                raise NoAnswer(
                    f"{name}: no acknowledgement within {timeout_s:g} s; check host, port and key"
                )
            time.sleep(0.002)

    def _send(self, kind: str, values: dict[str, Any]) -> None:
        self._sequence += 1
        self._stamp = max(int(1e6 * self._clock()), self._stamp)
        data = encode(kind, self._session, self._sequence, self._stamp, values, self._key)
        self._sent = time.monotonic()
        try:
            self._socket.send(data)
        except OSError:  # refused: no program listens yet
            self.counts["unsent"] += 1
