"""A flight on ROS 2, heard and commanded by two independent clients; Foxglove by its protocol."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from ros2_pyterfaces.core import hash_rihs01
from ros2_pyterfaces.core.geometry_msgs import msg as geometry
from websockets.sync.client import connect

import skywright
from skywright.links.broadcast.caller import Caller
from skywright.links.broadcast.table import SERVICE_TYPES
from skywright.links.broadcast.topics import TYPES
from skywright.links.pair import build_pair
from skywright.links.ros2.names import name_key, pack_attachment
from skywright.links.ros2.types import Types
from skywright.recordings.messages import definition
from skywright.vehicle.commands import State

TYPED = Types("jazzy", TYPES, SERVICE_TYPES)
UAL = "uav_abstraction_layer"
TICKS = 600  # more than the socket holds, in less time than a Zenoh session may be silent


def _find_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


class Fleet:
    """One vehicle, its addresses, and plain Zenoh beside the ROS 2 library."""

    def __init__(self) -> None:
        self.port, self.foxglove = _find_port(), _find_port()
        live = skywright.Live(ros2=f"tcp/127.0.0.1:{self.port}", foxglove=self.foxglove)
        self.vehicle = skywright.fly("hexarotor", backend="kinematic", live=live)
        self.link: Any = self.vehicle.closing[0].__self__  # type: ignore[attr-defined]
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{self.port}"]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self.zenoh = zenoh.open(config)

    def tick_until(self, done: Callable[[], Any], limit_s: float = 300.0) -> Any:
        until = time.monotonic() + limit_s
        while time.monotonic() < until:
            self.vehicle.tick()
            found = done()
            if found:
                return found
            time.sleep(0.002)
        raise AssertionError("it did not happen")

    def call(self, name: str, kind: str, **values: Any) -> tuple[bool, str]:
        """Call a service by plain Zenoh."""
        full = f"{kind.partition('/')[0]}/srv/{kind.partition('/')[2]}"
        request = TYPED.encode(f"{full}_Request", **values) if values else b"\0\1\0\0\0"
        replies: list[Any] = []
        self.zenoh.get(
            name_key(0, name, full, TYPED.hash(full)), replies.append, payload=request,
            attachment=pack_attachment(1, time.time_ns(), bytes(16)),
        )  # fmt: skip
        self.tick_until(lambda: replies)
        found = TYPED.decode(f"{full}_Response", replies[0].ok.payload.to_bytes())
        return found["success"], found["message"]

    def fly(self) -> None:
        """Take off unless it flies: each test also runs without those before it."""
        if self.vehicle.state != State.FLYING_AUTO:
            done = self.call("/ual/take_off", f"{UAL}/TakeOff", height=1.2, blocking=True)
            assert done == (True, "")

    def stream(self, name: str, full: str, message: bytes, stamp_ns: int) -> None:
        self.zenoh.put(
            name_key(0, name, full, TYPED.hash(full)), message,
            attachment=pack_attachment(1, stamp_ns, bytes(16)),
        )  # fmt: skip


@pytest.fixture(scope="module")
def fleet() -> Iterator[Fleet]:
    fleet = Fleet()
    try:
        yield fleet
    finally:
        fleet.zenoh.close()
        fleet.vehicle.close()


def _twist(x: float, frame: str = "map") -> bytes:
    make = TYPED.store.types
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    vector = make["geometry_msgs/msg/Vector3"]
    header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](0, 0), frame)
    twist = make["geometry_msgs/msg/Twist"](vector(**{**zero, "x": x}), vector(**zero))
    return TYPED.encode("geometry_msgs/msg/TwistStamped", header=header, twist=twist)


def test_nobody_subscribed_costs_nothing(fleet: Fleet) -> None:
    """No row is built, and the flight is not held to the wall clock."""
    fleet.tick_until(lambda: not fleet.link.watched)
    sent, t = fleet.link.sent, fleet.vehicle.t
    for _ in range(100):
        fleet.vehicle.tick()
        assert fleet.link._anchor is None  # time does not wait for anybody
    assert fleet.link.sent == sent and fleet.vehicle.t - t == pytest.approx(2.0)


def test_ros2_library_lists_and_receives(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", "scouting/multicast/enabled=false")
    from zenoh_ros2_sdk.discovery import get_service_names_and_types, get_topic_names_and_types
    from zenoh_ros2_sdk.session import ZenohSession
    from zenoh_ros2_sdk.subscriber import ROS2Subscriber

    session = ZenohSession.get_instance("127.0.0.1", fleet.port)
    topics = dict(get_topic_names_and_types(0, "127.0.0.1", fleet.port, 5.0))
    assert topics["/ual/pose"] == ["geometry_msgs/msg/PoseStamped"]
    assert topics["/tf"] == ["tf2_msgs/msg/TFMessage"]
    assert topics["/ual/set_velocity"] == ["geometry_msgs/msg/TwistStamped"]
    services = dict(get_service_names_and_types(0, "127.0.0.1", fleet.port, 5.0))
    assert services["/ual/take_off"] == [f"{UAL}/srv/TakeOff"]
    got: list[Any] = []
    subscriber = ROS2Subscriber(
        "/ual/pose", "geometry_msgs/msg/PoseStamped", got.append,
        msg_definition=definition("geometry_msgs/PoseStamped"),
        type_hash=hash_rihs01(geometry.PoseStamped), router_ip="127.0.0.1",
        router_port=fleet.port, domain_id=0,
    )  # fmt: skip
    try:
        fleet.tick_until(lambda: len(got) > 5)
        p = got[-1].pose.position
        assert [p.x, p.y, p.z] == pytest.approx(fleet.vehicle.pose.p.tolist(), abs=1e-3)
        assert got[-1].header.frame_id == "map"
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in got]
        assert stamps == sorted(stamps) and abs(stamps[-1] - fleet.vehicle.t) < 1.0
    finally:
        subscriber.close()
        session.session.close()
        ZenohSession._instance = None


def test_ual_commands_with_states_and_refusals(fleet: Fleet) -> None:
    v = fleet.vehicle
    ok, says = fleet.call("/ual/hold", "std_srvs/Trigger")
    assert not ok and says.startswith("hold refused") and "landed_disarmed" in says
    ok, says = fleet.call("/mission/next", "std_srvs/Trigger")
    assert not ok and "no mission flies here" in says
    assert fleet.call("/ual/take_off", f"{UAL}/TakeOff", height=1.2, blocking=True) == (True, "")
    assert v.state == State.FLYING_AUTO and v.pose.p[2] == pytest.approx(1.2, abs=0.06)
    make = TYPED.store.types
    point, turn = make["geometry_msgs/msg/Point"], make["geometry_msgs/msg/Quaternion"]

    def goal(x: float, frame: str) -> Any:
        header = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](0, 0), frame)
        at = make["geometry_msgs/msg/Pose"](point(x, 0.0, 1.2), turn(0.0, 0.0, 0.0, 0.0))
        return make["geometry_msgs/msg/PoseStamped"](header, at)

    ok, says = fleet.call("/ual/go_to_waypoint", f"{UAL}/GoToWaypoint", waypoint=goal(0.5, "base"),
                          blocking=False)  # fmt: skip
    assert not ok and says == "frame_id 'base'; valid: 'map' or empty"
    began = v.pose.p[0]
    done = fleet.call("/ual/go_to_waypoint", f"{UAL}/GoToWaypoint", waypoint=goal(began + 0.4, ""),
                      blocking=True)  # fmt: skip
    assert done == (True, "") and v.pose.p[0] == pytest.approx(began + 0.4, abs=0.06)


def test_velocities_are_followed_and_old_ones_dropped(fleet: Fleet) -> None:
    v = fleet.vehicle
    fleet.fly()
    full, began = "geometry_msgs/msg/TwistStamped", v.pose.p[0]

    def push(age_s: float) -> Callable[[], bool]:
        def send() -> bool:
            stamp = time.time_ns() - round(1e9 * age_s)
            fleet.stream("/ual/set_velocity", full, _twist(0.5), stamp)
            return bool(v.pose.p[0] > began + 0.2)

        return send

    fleet.tick_until(push(0.0))
    fleet.tick_until(lambda: np.linalg.norm(v.odometry.v_WB) < 0.01)  # silent: it brakes
    at, until = v.pose.p[0], time.monotonic() + 1.0
    while time.monotonic() < until:
        push(2.0)()
        v.tick()
    assert v.pose.p[0] == pytest.approx(at, abs=0.02)


def test_junk_is_refused_and_the_flight_goes_on(fleet: Fleet) -> None:
    v, full = fleet.vehicle, f"{UAL}/srv/GoToWaypoint"
    fleet.fly()
    key, replies = name_key(0, "/ual/go_to_waypoint", full, TYPED.hash(full)), list[Any]()
    good = pack_attachment(1, time.time_ns(), bytes(16))
    for payload, attachment in ((b"junk", good), (b"", good), (bytes(5000), good), (b"x", b"no")):
        fleet.zenoh.get(key, replies.append, payload=payload, attachment=attachment)
    fleet.zenoh.get(key, replies.append)
    fleet.tick_until(lambda: len(replies) == 5)
    assert all(r.ok is None for r in replies)
    fleet.stream("/ual/set_velocity", "geometry_msgs/msg/TwistStamped", b"junk", time.time_ns())
    fleet.stream(
        "/ual/set_velocity", "geometry_msgs/msg/TwistStamped", _twist(np.nan), time.time_ns()
    )
    for _ in range(20):
        v.tick()
    assert v.state == State.FLYING_AUTO


def test_foxglove_client(fleet: Fleet) -> None:
    """The protocol by hand: advertised channels, a subscription, messages, the scene."""
    v = fleet.vehicle
    with connect(f"ws://127.0.0.1:{fleet.foxglove}", subprotocols=["foxglove.sdk.v1"]) as client:
        channels: dict[str, dict[str, Any]] = {}
        while "/tf" not in channels or "/scene" not in channels:
            message = client.recv(10.0)
            if isinstance(message, str) and json.loads(message)["op"] == "advertise":
                channels |= {c["topic"]: c for c in json.loads(message)["channels"]}
        assert channels["/ual/pose"]["encoding"] == "cdr"
        assert channels["/ual/pose"]["schemaName"] == "geometry_msgs/msg/PoseStamped"
        assert channels["/ual/pose"]["schemaEncoding"] == "ros2msg"
        assert channels["/scene"]["schemaName"] == "foxglove.SceneUpdate"
        wanted = {1: "/ual/pose", 2: "/tf", 3: "/scene"}
        asked = [{"id": n, "channelId": channels[t]["id"]} for n, t in wanted.items()]
        client.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
        found: dict[int, bytes] = {}

        def heard() -> bool:
            try:
                message = client.recv(0.001)
            except TimeoutError:
                return False
            if isinstance(message, bytes) and message[0] == 1:
                found[struct.unpack_from("<I", message, 1)[0]] = message[13:]
            return len(found) == 3

        fleet.tick_until(heard)
    pose = TYPED.decode("geometry_msgs/msg/PoseStamped", found[1])
    assert pose["pose"]["position"]["z"] == pytest.approx(v.pose.p[2], abs=0.02)
    tf = TYPED.decode("tf2_msgs/msg/TFMessage", found[2])["transforms"]
    assert tf[0]["header"]["frame_id"] == "map" and tf[0]["child_frame_id"] == "platform"
    frames = {t["child_frame_id"].encode() for t in tf}
    assert b"platform" in found[3] and len(found[3]) > 10_000
    assert all(f in found[3] for f in frames if f.startswith(b"platform"))


def test_a_stuck_process_never_holds_the_flight(fleet: Fleet) -> None:
    """Rows are dropped when nobody takes them, and the flight goes on."""
    link, got = fleet.link, list[Any]()
    subscriber = fleet.zenoh.declare_subscriber("0/ual/**", got.append)
    fleet.tick_until(lambda: link.watched and got)
    pid = link._process.pid
    os.kill(pid, signal.SIGSTOP)
    try:
        link._anchor, dropped, t = None, link.dropped, fleet.vehicle.t
        link._pace = lambda t: None  # as fast as it goes
        for _ in range(TICKS):
            fleet.vehicle.tick()
        assert link.dropped > dropped
        assert fleet.vehicle.t - t == pytest.approx(0.02 * TICKS)
    finally:
        os.kill(pid, signal.SIGCONT)
        del link._pace
        subscriber.undeclare()
    assert fleet.call("/ual/set_home", f"{UAL}/SetHome", set_z=False) == (True, "")


def test_address_that_is_taken_or_wrong_is_told() -> None:
    from skywright.links.foxglove.server import FoxgloveServer
    from skywright.links.ros2.node import Ros2Node

    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        s.listen()
        with pytest.raises(skywright.InputError, match=r"--foxglove .*: cannot listen"):
            FoxgloveServer(s.getsockname()[1])
    caller: Any = None
    with pytest.raises(skywright.InputError, match="no Zenoh router answers"):
        Ros2Node(f"tcp/{70 * 'a'}.com:7447", "jazzy", 0, caller)  # longer than a name can be
    for wrong in ("udp/127.0.0.1:7447", "tcp/127.0.0.1:0", "tcp/127.0.0.1:70000", "7447"):
        with pytest.raises(skywright.InputError, match="valid: tcp/HOST:PORT"):
            Ros2Node(wrong, "jazzy", 0, caller)
    with pytest.raises(skywright.InputError, match="no Zenoh router answers"):
        Ros2Node("tcp/127.0.0.2:9", "jazzy", 0, caller)  # never a router beyond this computer
    with pytest.raises(skywright.InputError, match="'noetic'; valid: humble"):  # of the process
        skywright.fly("hexarotor", live=skywright.Live(ros2=True, distro="noetic"))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"ros2": 7447}, "^ros2 7447; valid: tcp/HOST:PORT"),
        ({"ros2": "tcp/bad"}, "^ros2 'tcp/bad'; valid: tcp/HOST:PORT"),
        ({"foxglove": "8765"}, "^foxglove '8765'; valid: a port"),
        ({"foxglove": 70000}, "^foxglove 70000; valid: a port"),
        ({"foxglove": True, "wait_s": math.nan}, "^wait_s nan; valid: seconds"),
        ({"foxglove": True, "wait_s": -1.0}, "^wait_s -1.0; valid: seconds"),
    ],
)
def test_wrong_options_are_told_before_a_process_starts(options: dict[str, Any], says: str) -> None:
    with pytest.raises(skywright.InputError, match=says):
        skywright.Live(**options).check()


def test_a_sender_whose_clock_is_ahead_does_not_silence_the_others() -> None:
    ours, theirs = build_pair()
    caller, now = Caller(ours), time.monotonic()
    with ours, theirs:
        assert caller.stream("/ual/set_velocity", {}, now + 3600.0, b"ahead")
        assert caller.stream("/ual/set_velocity", {}, now, b"right")
        assert not caller.stream("/ual/set_velocity", {}, now - 1.0, b"right")
        for i in range(1000):  # who sends under ever new names costs no memory
            caller.stream("/ual/set_velocity", {}, now, b"%d" % i)
    assert len(caller._ages) <= 64


def test_mission_is_taken_over_and_landed_by_ros2(tmp_path: Path) -> None:
    """While a mission flies, UAL's motions are refused; switch, stick and orders are taken."""
    port, said = _find_port(), dict[str, tuple[bool, str]]()

    def operate() -> None:
        time.sleep(0.1)
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
        config.insert_json5("scouting/multicast/enabled", "false")
        session, ends = None, time.monotonic() + 300.0
        while session is None and time.monotonic() < ends:
            try:
                session = zenoh.open(config)
            except zenoh.ZError:
                time.sleep(0.1)
        assert session is not None

        def call(name: str, kind: str, **values: Any) -> tuple[bool, str]:
            full = f"{kind.partition('/')[0]}/srv/{kind.partition('/')[2]}"
            body = TYPED.encode(f"{full}_Request", **values) if values else b"\0\1\0\0\0"
            for reply in session.get(
                name_key(0, name, full, TYPED.hash(full)), payload=body,
                attachment=pack_attachment(1, time.time_ns(), bytes(16)),
            ):  # fmt: skip
                if reply.ok is not None:
                    found = TYPED.decode(f"{full}_Response", reply.ok.payload.to_bytes())
                    return found["success"], found["message"]
            return False, ""

        full, heights = "geometry_msgs/msg/PoseStamped", [0.0]

        def note(sample: Any) -> None:
            pose = TYPED.decode(full, sample.payload.to_bytes())["pose"]
            heights.append(pose["position"]["z"])

        session.declare_subscriber(name_key(0, "/ual/pose", full, TYPED.hash(full)), note)
        while heights[-1] < 0.8 and time.monotonic() < ends:
            time.sleep(0.02)
        said["over"] = call("/ual/take_over", "std_srvs/Trigger")
        said["take_off"] = call("/ual/take_off", f"{UAL}/TakeOff", height=1.0, blocking=False)
        twist = "geometry_msgs/msg/TwistStamped"
        speeds, moving = [0.0], name_key(0, "/ual/velocity", twist, TYPED.hash(twist))

        def note_speed(sample: Any) -> None:
            speeds.append(TYPED.decode(twist, sample.payload.to_bytes())["twist"]["linear"]["x"])

        session.declare_subscriber(moving, note_speed)
        while speeds[-1] < 0.25 and time.monotonic() < ends:
            session.put(
                name_key(0, "/ual/set_velocity", twist, TYPED.hash(twist)), _twist(0.4),
                attachment=pack_attachment(1, time.time_ns(), bytes(16)),
            )  # fmt: skip
            time.sleep(0.05)
        said["give"] = call("/ual/recover_from_manual", "std_srvs/Trigger")
        said["land"] = call("/ual/land", f"{UAL}/Land", blocking=False)
        session.close()

    thread = threading.Thread(target=operate)
    thread.start()
    live = skywright.Live(ros2=f"tcp/127.0.0.1:{port}", wait_s=120.0)
    result = skywright.run("waypoints", out=tmp_path / "run", report=False, backend="kinematic",
                           live=live)  # fmt: skip
    thread.join()
    assert not said["take_off"][0] and "mission 'waypoints' flies the robot" in said["take_off"][1]
    assert said["land"] == (True, "")
    assert "manual" in [p.name for p in result.phases]
    assert result.outcome == "aborted" and "the operator ordered a landing" in result.reason
    during = next(p for p in result.phases if p.name == "manual")
    rows = result.samples[
        (result.samples["t"] > during.start_s) & (result.samples["t"] < during.end_s)
    ]
    assert rows["v_WB"][:, 0].max() > 0.2
