"""Both ends of the gateway: sessions, operations, control; over memory and over sockets."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from skywright.errors import InputError
from skywright.links.udp.address import KEY_VARIABLE, load_key, open_socket, parse_address
from skywright.links.udp.client import ArmsClient, NoAnswer
from skywright.links.udp.codec import Packet, decode, encode
from skywright.links.udp.packets import CODES, RESULTS
from skywright.links.udp.server import LEASE_S, PEERS, PENDING, SILENT_S, Operation, Server
from waiting import wait_for

KEY = b"0123456789abcdef"
ME, OTHER = ("127.0.0.1", 1001), ("127.0.0.1", 1002)
OFFERED = frozenset(CODES[n][0] for n in ("hold", "rest", "joints", "stick", "land"))


class Wire:
    """A socket in memory, and a clock."""

    def __init__(self) -> None:
        self.inbox: deque[tuple[bytes, Any]] = deque()
        self.sent: list[tuple[bytes, Any]] = []
        self.now = 50.0

    def recvfrom(self, size: int) -> tuple[bytes, Any]:
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.popleft()

    def sendto(self, data: bytes, address: Any) -> None:
        self.sent.append((data, address))

    def getsockname(self) -> tuple[str, int]:
        return ("127.0.0.1", 1)


class Sender:
    """An operator who sends packets one by one."""

    def __init__(self, wire: Wire, server: Server, address: Any, key: bytes = KEY) -> None:
        self.wire, self.server, self.address, self.key = wire, server, address, key
        self.session = self.sequence = self.number = 0

    def make(self, name: str, values: dict[str, Any]) -> bytes:
        self.sequence += 1
        stamp = int(1e6 * self.wire.now)
        return encode(name, self.session, self.sequence, stamp, values, self.key)

    def send(self, name: str, **values: Any) -> list[Any]:
        return self.deliver(self.make(name, values))

    def deliver(self, data: bytes, address: Any = None) -> list[Any]:
        self.wire.inbox.append((data, address or self.address))
        return self.server.poll()

    def ask(self, code: str) -> str:
        """Ask for an operation; returns the name of the result, "" without an answer."""
        self.number += 1
        self.wire.sent.clear()
        self.send("operation", operation=self.number, code=CODES[code][0])
        for data, address in self.wire.sent:
            packet = decode(data, self.key)
            if address == self.address and isinstance(packet, Packet):
                if packet.kind.name == "acknowledgement" and code == "connect":
                    self.session = packet.values["opened"]
                if packet.kind.name == "acknowledgement":
                    known = {n: name for name, (n, _) in RESULTS.items()}
                    return known[packet.values["result"]]
        return ""


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.fixture
def server(wire: Wire) -> Server:
    made = Server(wire, KEY, clock=lambda: wire.now)  # type: ignore[arg-type]
    made.offered = OFFERED
    return made


@pytest.fixture
def sender(wire: Wire, server: Server) -> Sender:
    made = Sender(wire, server, ME)
    assert made.ask("connect") == "accepted" and made.session != 0
    return made


def test_a_command_arrives_with_its_age(sender: Sender) -> None:
    (stick,) = sender.send("stick", axes=[0.5], buttons=1)
    assert stick.packet.values["axes"] == (0.5, 0.0, 0.0, 0.0, 0.0, 0.0) and stick.age == 0.0


def test_recorded_packets_open_no_session_and_move_nothing_later(
    wire: Wire, server: Server, sender: Sender
) -> None:
    """Who heard a whole flight and sends it again, from any address, is not heard."""
    hello = encode("operation", 0, 1, 1, {"operation": 1, "code": CODES["connect"][0]}, KEY)
    sticks = [sender.make("stick", {"axes": [0.1 * k]}) for k in range(5)]
    for data in sticks:
        assert len(sender.deliver(data)) == 1
    for address in (ME, OTHER):
        for data in (hello, *sticks):
            assert sender.deliver(data, address) == []
    again = Server(wire, KEY, clock=lambda: wire.now)  # type: ignore[arg-type]  # next flight
    for data in (hello, *sticks):
        wire.inbox.append((data, ME))
        assert again.poll() == []
    assert again.counts["session"] == 5 and server.counts["session"] == 5
    assert server.counts["replayed"] == 5 and not again.peers
    assert len(sender.send("stick", axes=[0.3])) == 1  # the true one was not disturbed


def test_an_operation_is_executed_once_and_acknowledged_each_time(
    wire: Wire, sender: Sender
) -> None:
    code = CODES["rest"][0]
    assert sender.send("operation", operation=7, code=code) == [Operation(code, 7)]
    wire.sent.clear()
    assert sender.send("operation", operation=7, code=code) == []
    assert len(wire.sent) == 1  # its acknowledgement may have been lost
    assert sender.send("operation", operation=6, code=code) == []
    assert sender.server.counts["replayed"] == 1 and sender.server.accepted == 7


def test_what_the_flight_does_not_offer_is_told(sender: Sender) -> None:
    assert sender.ask("grasp") == "unavailable"
    sender.server.offered = frozenset()
    assert sender.ask("rest") == "unavailable"


def test_one_controls_others_watch_and_a_lease_ends(
    wire: Wire, server: Server, sender: Sender
) -> None:
    other = Sender(wire, server, OTHER)
    assert other.ask("connect") == "accepted"
    assert sender.ask("joints") == "accepted" and other.ask("rest") == "not in control"
    assert other.send("joints", n=1, q_ref=[0.1]) == []
    assert server.counts["controller"] == 1
    wire.sent.clear()
    server.publish("state", {"t": 1.0})
    assert {address for _, address in wire.sent} == {ME, OTHER}
    wire.now += LEASE_S + 0.01
    assert other.ask("rest") == "accepted" and sender.ask("rest") == "not in control"


def test_a_session_that_watches_does_not_lead(wire: Wire, server: Server, sender: Sender) -> None:
    """The one in control falls silent while another still sends `alive`."""
    monitor = Sender(wire, server, OTHER)
    assert monitor.ask("connect") == "accepted" and monitor.ask("alive") == "accepted"
    assert server.watched and not server.led
    assert sender.ask("hold") == "accepted"
    for _ in range(6):
        assert server.led
        wire.now += 0.4 * SILENT_S
        assert monitor.ask("alive") == "accepted"
        if wire.now < 50.0 + 2.0 * SILENT_S:
            sender.ask("alive")
    wire.now += 0.7 * SILENT_S
    monitor.ask("alive")
    assert server.watched and not server.led


def test_silence_ends_the_stream_of_states(wire: Wire, server: Server, sender: Sender) -> None:
    sender.send("stick", axes=[0.0])
    wire.now += SILENT_S + 0.1
    assert not server.watched
    assert sender.ask("alive") == "accepted" and server.watched


def test_a_restart_on_the_same_port_replaces_the_session(sender: Sender) -> None:
    sender.ask("joints")
    again = Sender(sender.wire, sender.server, ME)
    assert again.ask("connect") == "accepted" and again.session != sender.session
    assert again.ask("rest") == "accepted"  # takes over its own control
    assert sender.send("stick", axes=[1.0]) == [] and len(sender.server.peers) == 1


def test_sessions_are_few_and_those_that_are_silent_make_room(wire: Wire, server: Server) -> None:
    def come(port: int) -> str:
        sender = Sender(wire, server, ("127.0.0.1", port))
        sender.ask("connect")
        return sender.ask("alive")

    assert [come(2000 + k) for k in range(PEERS + 2)] == ["accepted"] * PEERS + ["", ""]
    wire.now += SILENT_S + 1.0
    assert come(3000) == "accepted" and len(server.peers) == PEERS
    for port in range(4000, 4000 + 3 * PENDING):  # asks, and never uses the answer
        Sender(wire, server, ("127.0.0.1", port)).ask("connect")
    assert len(server._pending) == PENDING and len(server.peers) == PEERS


def test_a_session_of_this_side_is_no_session_of_that(wire: Wire, server: Server) -> None:
    """A packet that comes back from where it was sent to is not heard."""
    sender = Sender(wire, server, ME)
    sender.ask("connect")
    sender.ask("alive")
    wire.sent.clear()
    server.publish("state", {"t": 1.0})
    assert sender.deliver(wire.sent[0][0]) == [] and server.counts["kind"] == 1


class Talk(RuleBasedStateMachine):
    """Two operators and someone who repeats what was sent: commands obey their rules."""

    def __init__(self) -> None:
        super().__init__()
        self.wire = Wire()
        self.server = Server(self.wire, KEY, clock=lambda: self.wire.now)  # type: ignore[arg-type]
        self.server.offered = OFFERED
        self.senders = [Sender(self.wire, self.server, a) for a in (ME, OTHER)]
        self.taken: list[bytes] = []
        self.done: set[tuple[int, int]] = set()
        self.control: tuple[int, float] | None = None

    def check_control(self, who: int, commanded: bool) -> None:
        held = self.control is not None and self.wire.now < self.control[1]
        if commanded:
            assert not held or self.control is None or self.control[0] == who
            self.control = (who, self.wire.now + LEASE_S)

    @rule(who=st.integers(0, 1))
    def connect(self, who: int) -> None:
        self.senders[who].number += 1000
        old, self.senders[who].session = self.senders[who].session, 0
        assert self.senders[who].ask("connect") == "accepted"
        assert self.senders[who].session != old
        if self.control is not None and self.control[0] == who:
            self.control = None

    @rule(who=st.integers(0, 1), x=st.floats(-1.0, 1.0, width=32))
    def move(self, who: int, x: float) -> None:
        data = self.senders[who].make("stick", {"axes": [x]})
        found = self.senders[who].deliver(data)
        assert len(found) <= 1 and all(f.packet.values["axes"][0] == x for f in found)
        self.check_control(who, bool(found))
        self.taken.append(data)

    @rule(who=st.integers(0, 1), code=st.sampled_from(["rest", "joints", "force"]))
    def ask(self, who: int, code: str) -> None:
        before = self.server.accepted
        result = self.senders[who].ask(code)
        assert result in ("", "accepted", "not in control") or code == "force"
        self.check_control(who, result == "accepted")
        if result == "accepted":
            assert self.server.accepted == self.senders[who].number
        else:
            assert self.server.accepted == before

    @rule(at=st.integers(0, 50), where=st.sampled_from([ME, OTHER, ("10.0.0.1", 5)]))
    def repeat(self, at: int, where: Any) -> None:
        if self.taken:
            found = self.senders[0].deliver(self.taken[at % len(self.taken)], where)
            assert found == []

    @rule(seconds=st.floats(0.0, 5.0))
    def wait(self, seconds: float) -> None:
        self.wire.now += seconds

    @rule()
    def publish(self) -> None:
        self.wire.sent.clear()
        self.server.publish("state", {"t": 1.0})
        assert len(self.wire.sent) <= len(self.server.peers)

    @invariant()
    def small(self) -> None:
        assert len(self.server.peers) <= PEERS and len(self.server._pending) <= PENDING


Talk.TestCase.settings = settings(max_examples=40, stateful_step_count=40, deadline=None)
TestTalk = Talk.TestCase


# --- where it listens, with which key ------------------------------------------------------------


@pytest.mark.parametrize("text", ["udp", "udp:", "udp:x", "tcp:1", "udp:99999", "udp:h:1:2x", ""])
def test_a_wrong_address_is_told(text: str) -> None:
    with pytest.raises(InputError, match="valid: udp:PORT, udp:HOST:PORT"):
        parse_address(text, "--gateway")


def test_other_computers_need_a_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    assert load_key(None) == b""
    with pytest.raises(InputError, match="requires a key"):
        open_socket(parse_address("udp:0.0.0.0:0", "--gateway"), b"", "--gateway")
    open_socket(parse_address("udp:0", "--gateway"), b"", "--gateway").close()
    path = tmp_path / "key"
    path.write_bytes(KEY + b"\n")
    path.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        load_key(path)
    path.chmod(0o600)
    assert load_key(path) == KEY
    monkeypatch.setenv(KEY_VARIABLE, "short")
    with pytest.raises(InputError, match="16 to 4096 bytes, this one has 5"):
        load_key(None)
    monkeypatch.setenv(KEY_VARIABLE, KEY.decode())
    assert load_key(None) == KEY
    with pytest.raises(InputError, match="cannot be read"):
        load_key(tmp_path / "nowhere")
    open_socket(parse_address("udp:0.0.0.0:0", "--gateway"), KEY, "--gateway").close()
    with pytest.raises(InputError, match="no address"):
        parse_address(f"udp:{'ä' * 80}:99", "--gateway")


# --- over sockets --------------------------------------------------------------------------------


class Arms:
    """An arms program that answers in a thread of its own."""

    def __init__(self, key: bytes) -> None:
        opened = open_socket(parse_address("udp:0", "--gateway"), key, "--gateway")
        self.server = Server(opened, key)
        self.server.offered = OFFERED
        self.heard: list[Any] = []
        self.stops = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self) -> None:
        k = 0
        while not self.stops.wait(0.005):
            k += 1
            self.heard += self.server.poll()
            state = {"t": 0.02 * k, "n": 8, "q": [0.1] * 8, "phase": "external joints"}
            self.server.publish("state", state)
            self.server.publish("deflection", {"t": 0.02 * k, "n": 8})

    def close(self) -> None:
        self.stops.set()
        self.thread.join()
        self.server.close()


@pytest.fixture(params=[b"", KEY], ids=["open", "sealed"])
def arms(request: pytest.FixtureRequest) -> Iterator[tuple[Arms, bytes]]:
    program = Arms(request.param)
    yield program, request.param
    program.close()


def test_the_client_moves_arms_and_hears_them(arms: tuple[Arms, bytes]) -> None:
    program, key = arms
    with ArmsClient("127.0.0.1", program.server.port, key) as client:
        assert client.operate("joints") == "accepted"
        assert client.operate("visual") == "unavailable"
        for k in range(20):
            client.send_joints([0.01 * k] * 8)
            client.send_stick([0.1, 0.2, 0.3], buttons=1)
            time.sleep(0.01)
            client.poll()
        with pytest.raises(ValueError, match="valid: connect"):
            client.operate("dance")
        with pytest.raises(ValueError, match="q_ref"):
            client.send_joints([float("nan")])
    assert client.state["phase"] == "external joints" and client.state["n"] == 8
    assert client.state["q"][0] == pytest.approx(0.1) and len(client.deflections) > 5
    end = time.monotonic() + 60.0
    while program.server.peers and time.monotonic() < end:
        time.sleep(0.01)
    assert not program.server.peers  # it said good-bye
    joints = [h for h in program.heard if getattr(h, "packet", None) is not None]
    assert {h.packet.kind.name for h in joints} == {"joints", "stick"}
    now = time.monotonic()  # stamps of a clock that nobody sets back
    assert all(abs(1e-6 * h.packet.time_us - now) < 300.0 for h in joints)
    assert set(program.server.counts) == {"accepted"} == set(client.counts)


def test_another_key_and_nobody_are_told_in_time(arms: tuple[Arms, bytes]) -> None:
    program, key = arms
    with pytest.raises(NoAnswer, match="check host, port and key"):
        ArmsClient("127.0.0.1", program.server.port, key + b"x" * 16, timeout_s=0.5)
    assert program.server.counts["tag"] >= 2  # at 5 Hz
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(NoAnswer):
        ArmsClient("127.0.0.1", port, timeout_s=0.3)


def test_the_example_in_c_leads_the_arms(arms: tuple[Arms, bytes], tmp_path: Path) -> None:
    program, key = arms
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler (cc) on PATH")
    if key and not Path("/usr/include/openssl/hmac.h").exists():
        pytest.skip("no header of OpenSSL (libssl-dev)")
    source = Path(__file__).parent.parent / "examples" / "gateway" / "move_arms.c"
    options = ["-DWITH_KEY", source, "-lm", "-lcrypto"] if key else [source, "-lm"]
    subprocess.run(
        [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", *options, "-o", tmp_path / "move"],
        check=True,
    )
    (tmp_path / "key").write_bytes(key + b"\n")
    more = [tmp_path / "key"] if key else []
    out = subprocess.run(
        [tmp_path / "move", "127.0.0.1", str(program.server.port), "1", *more],
        capture_output=True, text=True, timeout=300, env=dict(os.environ),
    )  # fmt: skip
    assert out.returncode == 0, out.stderr
    assert "land: result 0" in out.stdout and "phase external joints" in out.stdout

    def hear() -> list[int]:
        return [h.code for h in program.heard if isinstance(h, Operation)]

    wait_for(lambda: CODES["land"][0] in hear())  # the program answers before it notes
    codes = hear()
    # on a loaded machine an operation may be asked for again before its answer arrives
    assert list(dict.fromkeys(codes)) == [CODES["joints"][0], CODES["land"][0]]
    led = [h.packet.values["q_ref"] for h in program.heard if not isinstance(h, Operation)]
    assert len(led) >= 45 and led[0][0] == pytest.approx(0.1)
    assert set(program.server.counts) == {"accepted"}
