"""ROS 2 types and names: the same as those of two independent libraries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from ros2_pyterfaces.core import Array, Sequence, hash_rihs01, make_srv_schema
from ros2_pyterfaces.core.std_srvs import srv as std_srvs
from rosbags.typesys import get_types_from_msg, get_typestore
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.keyexpr import topic_keyexpr
from zenoh_ros2_sdk.qos import DEFAULT_QOS_PROFILE

from skywright.errors import InputError
from skywright.links.broadcast.commands import read_yaw
from skywright.links.broadcast.options import Live
from skywright.links.broadcast.rows import Encoder
from skywright.links.broadcast.table import SERVICE_TYPES, STREAMS
from skywright.links.broadcast.topics import EXTRA, GIVEN, TYPES
from skywright.links.ros2.names import QOS, name_key, pack_attachment, read_attachment
from skywright.links.ros2.types import DISTROS, NO_HASH, Types, list_definitions, name_service
from skywright.recordings.cdr import PRIMITIVES, parse_definition
from skywright.recordings.columns import build_dtype
from skywright.recordings.messages import full_name
from skywright.vehicle.topics import _list_common

MORE = {
    "sensor_msgs/NavSatStatus": "int8 status\nuint16 service",
    "sensor_msgs/NavSatFix": (
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\n"
        "float64 latitude\nfloat64 longitude\nfloat64 altitude\n"
        "float64[9] position_covariance\nuint8 position_covariance_type"
    ),
}
ALL = list_definitions([TYPES, MORE, *(t.types for t in _list_common(4))])
"""Every type that a flight publishes, by its text."""


def _schema(name: str, text: str) -> dict[str, Any]:
    """The type as ros2-pyterfaces describes one."""
    out: dict[str, Any] = {"__typename": name}
    for field in parse_definition(name, text)[name]:
        kind: Any = field.kind
        if kind == "byte":
            kind = "uint8"
        elif kind not in PRIMITIVES and kind != "string":
            kind = _schema(full_name(kind), ALL[kind])
        if field.array is not None:
            kind = Sequence(kind) if field.array < 0 else Array(kind, field.array)
        out[field.name] = kind
    return out


def test_hashes_are_those_of_an_independent_library() -> None:
    types = Types("jazzy", list_definitions([TYPES, *(t.types for t in _list_common(4))]), {})
    kinds = [k for k in ALL if k not in ("rcl_interfaces/Log",)]
    assert len(kinds) > 25
    for kind in kinds:
        full = full_name(kind)
        assert types.hash(full) == hash_rihs01(_schema(full, ALL[kind])), kind


def test_hashes_of_services_are_those_of_an_independent_library() -> None:
    types = Types("jazzy", {}, SERVICE_TYPES)
    assert types.hash("std_srvs/srv/Trigger") == hash_rihs01(std_srvs.Trigger)
    for kind, (request, response) in SERVICE_TYPES.items():
        full = name_service(kind)
        sent = _schema(f"{full}_Request", request)
        answered = _schema(f"{full}_Response", response)
        assert types.hash(full) == hash_rihs01(make_srv_schema(sent, answered, full)), kind


@pytest.mark.parametrize("distro", DISTROS)
def test_definitions_are_those_of_every_distribution(distro: str) -> None:
    store = get_typestore(DISTROS[distro])
    standard = [k for k in ALL if full_name(k) in store.fielddefs]
    assert len(standard) > 20
    for kind in standard:
        ours = get_types_from_msg(ALL[kind], full_name(kind))[full_name(kind)][1]
        assert list(ours) == list(store.fielddefs[full_name(kind)][1]), kind
    for stream in STREAMS:
        assert full_name(stream.kind) in store.fielddefs


def test_humble_has_no_hashes_and_unknown_distributions_are_told() -> None:
    assert Types("humble", {}, SERVICE_TYPES).hash("geometry_msgs/msg/Pose") == NO_HASH
    with pytest.raises(InputError, match="'noetic'; valid: humble, jazzy, kilted, lyrical"):
        Types("noetic", {}, {})


def test_given_topics_decode_to_their_columns() -> None:
    """Every number of a live row arrives where ROS 2 looks for it."""
    types = Types("jazzy", TYPES, {})
    names = {f for g in GIVEN for f in g.topic.fields.values()}
    shapes = {"p": (3,), "q": (4,), "v": (3,), "w": (3,)}
    from skywright.recordings.columns import Column

    extra = {c.name for c in EXTRA}
    columns = [Column(n, shapes[n.split("_")[1]]) for n in sorted(names - extra)]
    dtype = build_dtype([*columns, *EXTRA])
    row = np.zeros(1, dtype)
    rng = np.random.default_rng(5)
    for c in columns:
        row[c.name] = rng.normal(size=c.shape)
    row["live_v_B"], row["live_state"], row["live_charge"] = [1.0, 2.0, 3.0], 4, 0.75
    row["live_stamp"] = 12 | (500_000_000 << 32)
    ns = np.array([12_500_000_000], np.uint64)
    found = {
        g.topic.name: types.decode(full_name(g.topic.kind), Encoder(g.topic, dtype).encode(row, ns))
        for g in GIVEN
    }
    assert found["/clock"]["clock"] == {"sec": 12, "nanosec": 500_000_000}
    odom = found["/ual/odom"]
    assert odom["child_frame_id"] == "platform" and odom["header"]["frame_id"] == "map"
    assert [odom["twist"]["twist"]["linear"][k] for k in "xyz"] == [1.0, 2.0, 3.0]
    q = found["/ual/pose"]["pose"]["orientation"]
    assert [q[k] for k in "wxyz"] == row["est_q_WB"][0].tolist()
    assert found["/ual/state"] == {"state": 4}
    battery = found["/battery"]
    assert battery["percentage"] == 0.75 and battery["present"] and np.isnan(battery["voltage"])


def test_key_attachment_and_qos_are_those_of_an_independent_library() -> None:
    full = "uav_abstraction_layer/srv/Land"
    key = name_key(7, "/ual/land", full, "RIHS01_00")
    assert key == topic_keyexpr(
        7, "/ual/land", "uav_abstraction_layer::srv::dds_::Land_", "RIHS01_00"
    )
    data = pack_attachment(3, 10**18, bytes(range(16)))
    assert data == Attachment(3, 10**18, bytes(range(16))).to_bytes()
    assert read_attachment(data) == (3, 10**18, bytes(range(16)))
    assert DEFAULT_QOS_PROFILE.encode() == QOS
    for wrong in (b"", data[:-1], data[:16] + b"\x00" + data[17:]):
        with pytest.raises(ValueError):
            read_attachment(wrong)


def test_decoder_refuses_junk() -> None:
    types = Types("jazzy", TYPES, SERVICE_TYPES)
    rng = np.random.default_rng(1)
    refused = 0
    for n in range(300):
        try:
            types.decode("uav_abstraction_layer/srv/GoToWaypoint_Request", rng.bytes(n))
        except ValueError:
            refused += 1
    assert refused > 290


def test_yaw_of_an_orientation() -> None:
    q = {"w": np.cos(0.3), "x": 0.0, "y": 0.0, "z": np.sin(0.3)}
    assert read_yaw(q) == pytest.approx(0.6)
    assert read_yaw(dict.fromkeys("wxyz", 0.0)) is None
    longer = {axis: 1.05 * value for axis, value in q.items()}
    assert read_yaw(longer) == pytest.approx(0.6)
    with pytest.raises(InputError, match=r"orientation of length 1\.41; valid: a unit quaternion"):
        read_yaw({"w": 1.0, "x": 0.0, "y": 0.0, "z": 1.0})


def test_options_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"^distro requires ros2$"):
        Live(distro="jazzy").check()
    with pytest.raises(InputError, match=r"^wait_s requires ros2 or foxglove$") as error:
        Live(wait_s=3.0).check()
    assert error.value.with_options == "--await requires --ros2 or --foxglove"  # of the commands
    monkeypatch.setenv("ROS_DOMAIN_ID", "233")
    with pytest.raises(InputError, match="ROS_DOMAIN_ID='233'; valid: 0 to 232"):
        Live(ros2=True).check()
    monkeypatch.setenv("ROS_DOMAIN_ID", "5")
    assert Live(ros2=True).check() == Live("tcp/127.0.0.1:7447", "jazzy", None, 0.0, 5)
    assert not Live().wanted and Live(foxglove=0).wanted


def test_tables_of_the_page_are_those_of_the_code() -> None:
    import importlib.util
    from pathlib import Path

    path = Path(__file__).parent.parent / "docs" / "generate_ros2.py"
    spec = importlib.util.spec_from_file_location("generate_ros2", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = module.PAGE.read_text("utf-8")
    assert module.build_page(text) == text, "run: python docs/generate_ros2.py"


def test_options_of_a_station_are_those_of_a_run() -> None:
    live = Live(ros2=True, foxglove=0, wait_s=2.0).check()
    assert live.list_arguments() == (
        "--ros2", "tcp/127.0.0.1:7447", "--ros2-distro", "jazzy", "--foxglove", "0",
        "--await", "2.0",
    )  # fmt: skip
