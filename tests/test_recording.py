"""The recording: bit-exact, readable after a crash, and read alike by other people's tools."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from recorded_columns import PARTS, Recorded, list_recorded
from skywright.core.rotations import rot_from_quat
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.link_frames import LinkFrames
from skywright.models.rigid_body import build_body_model, compute_tip, joint_names
from skywright.models.urdf import build_urdf
from skywright.recordings import messages
from skywright.recordings.cdr import build_layout
from skywright.recordings.columns import Column, Stream, Topic, build_dtype, choose_topics
from skywright.recordings.messages import EVENTS
from skywright.recordings.recording import Event, Recording, read_recording
from skywright.recordings.writer import RecordingWriter
from skywright.run.flight_recording import FlightRecording
from skywright.vehicle.topics import MIXED

JOINTS = ("link1", "link2")
ROTORS = 6
FULL = list_recorded(JOINTS, ROTORS, PARTS)
TOPICS = FULL.topics
DOCS = Path(__file__).resolve().parent.parent / "docs"
DATA = Path(__file__).parent / "data"


def make_samples(n: int, recorded: Recorded = FULL, seed: int = 0) -> np.ndarray:
    """Samples of random bits (NaN with payloads, infinities, -0.0, denormals) at 100 Hz."""
    rng, dtype = np.random.default_rng(seed), build_dtype(recorded.columns)
    samples = np.frombuffer(rng.bytes(n * dtype.itemsize), dtype).copy()
    samples["t"] = np.arange(n) * 0.01
    return samples


def write(path: Path, samples: np.ndarray, batch: int = 100) -> None:
    """Write a recording with a note every batch and an attachment."""
    with RecordingWriter(path, *FULL) as writer:
        writer.attach("mission.toml", b'name = "test"\n')
        for i in range(0, len(samples), batch):
            writer.event(float(samples["t"][i]), f"phase {i}")
            writer.append(samples[i : i + batch])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A finished recording of 250 samples, and the samples."""
    path = tmp_path_factory.mktemp("recording") / "recording.mcap"
    samples = make_samples(250)
    write(path, samples)
    return path, samples


def one_line(path: Path) -> str:
    """The error that reading a bad file gives; it must be one line that names the file."""
    with pytest.raises(InputError) as caught:
        read_recording(path)
    text = str(caught.value)
    assert "\n" not in text and str(path) in text
    return text


# What goes in comes out


@given(
    n_joints=st.integers(0, MAX_JOINTS),
    n_rotors=st.integers(1, MAX_ROTORS),
    parts=st.sets(st.sampled_from(PARTS)),
    batches=st.lists(st.integers(0, 300), max_size=4),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_every_bit_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    n_joints: int,
    n_rotors: int,
    parts: set[str],
    batches: list[int],
    seed: int,
) -> None:
    path = tmp_path_factory.mktemp("bits") / "recording.mcap"
    names = tuple(f"joint_{'x' * i}" for i in range(n_joints))  # any length shifts what follows
    recorded = list_recorded(names, n_rotors, parts)
    samples = make_samples(sum(batches), recorded, seed)
    with RecordingWriter(path, *recorded, info={"joint_names": names}) as writer:
        for part in np.split(samples, np.cumsum(batches)[:-1]) if batches else []:
            writer.append(part)
    read = read_recording(path)
    assert read.samples.dtype == samples.dtype
    assert read.samples.tobytes() == samples.tobytes()
    assert read.columns == recorded.columns
    assert read.topics == {t.name: dict(t.fields) for t in recorded.topics}
    assert read.complete and read.info == {"joint_names": list(names)}


def test_columns_that_no_topic_knows_get_their_own(tmp_path: Path) -> None:
    """A sensor of a user records what it likes; a topic that lacks a column is not written."""
    more = (Column("airspeed", unit="m/s"), Column("flow", (3,)), Column("count", dtype="<i8"))
    columns = tuple(c for c in FULL.columns if c.name not in ("gap", "theta")) + more
    topics = choose_topics(columns, FULL.topics)
    recorded = Recorded(columns, topics)
    names = {t.name for t in topics}
    assert not names & {"/contact/state", "/joints/shafts"}
    own = {n for n in names if n.startswith("/recorded/")}
    assert own == {f"/recorded/{n}" for n in (
        "airspeed", "flow", "count", "spring", "gap_max", "tilt", "f_normal", "f_collision",
            "off_s",
    )}  # fmt: skip
    samples = make_samples(50, recorded)
    with RecordingWriter(tmp_path / "r.mcap", *recorded) as writer:
        writer.append(samples)
    assert read_recording(tmp_path / "r.mcap").samples.tobytes() == samples.tobytes()
    with AnyReader([tmp_path / "r.mcap"]) as reader:
        [flow] = [c for c in reader.connections if c.topic == "/recorded/flow"]
        _, stamp, raw = next(reader.messages([flow]))
        assert stamp == 0 and len(reader.deserialize(raw, flow.msgtype).data) == 3


def test_columns_and_topics_that_do_not_fit_are_a_fault_of_ours(tmp_path: Path) -> None:
    t, path = Column("t"), tmp_path / "r.mcap"
    topic = Topic("/a", "geometry_msgs/Point", "", {"x": "t"})
    for columns, topics in (
        ((t, t), (topic,)),  # a name twice
        ((t, Column("b")), (topic,)),  # on no topic
        ((t,), (topic, topic)),
        ((t,), (topic._replace(fields={"x": "t", "y": "t"}),)),  # on two
        ((t,), (topic._replace(fields={"x": "t", "y": "c"}),)),  # unknown
    ):
        with pytest.raises(AssertionError):
            RecordingWriter(path, columns, topics)
    with pytest.raises(ValueError, match="no field w"):
        RecordingWriter(path, (t,), (topic._replace(fields={"w": "t"}),))


@given(events=st.lists(st.tuples(st.integers(0, 2**31 * 1000 - 1), st.text()), max_size=5))
@settings(max_examples=25, deadline=None)
def test_events_and_attachments_are_read_back(
    tmp_path_factory: pytest.TempPathFactory, events: list[tuple[int, str]]
) -> None:
    path = tmp_path_factory.mktemp("events") / "recording.mcap"
    wanted = [Event(ms / 1000, text.replace("\0", "")) for ms, text in events if _encodes(text)]
    with RecordingWriter(path, *FULL) as writer:
        writer.attach("a.bin", bytes(range(256)))
        for event in wanted:
            writer.event(event.t, event.text)
        writer.attach("empty", b"")
    read = read_recording(path)
    assert read.events == wanted
    assert read.attachments == {"a.bin": bytes(range(256)), "empty": b""}


def _encodes(text: str) -> bool:
    return not any("\ud800" <= c <= "\udfff" for c in text)


def test_repeated_and_decreasing_times_are_kept_in_order(tmp_path: Path) -> None:
    samples = make_samples(30)
    samples["t"] = np.tile([0.2, 0.1, 0.1], 10)
    write(tmp_path / "r.mcap", samples, batch=7)
    assert read_recording(tmp_path / "r.mcap").samples.tobytes() == samples.tobytes()


def test_streams_keep_their_own_times(tmp_path: Path) -> None:
    """Raw data at 1 kHz and 25 Hz beside the samples, in batches of any size."""
    imu = Stream(
        Topic("/imu", "sensor_msgs/Imu", "platform",
              {"angular_velocity": "w", "linear_acceleration": "a"}),
        (Column("t", unit="s"), Column("w", (3,), unit="rad/s"), Column("a", (3,))),
    )  # fmt: skip
    camera = Stream(
        Topic("/camera", "geometry_msgs/PoseStamped", "map", {"pose.orientation": "q"}),
        (Column("t"), Column("q", (4,))),
    )
    rng, rows = np.random.default_rng(1), {}
    for stream, n, period in ((imu, 1000, 0.001), (camera, 25, 0.04)):
        rows[stream.topic.name] = made = np.zeros(n, build_dtype(stream.columns))
        for name in made.dtype.names[1:]:
            made[name] = rng.standard_normal(made[name].shape)
        made["t"] = np.round(period * np.arange(n) + 0.0005, 9)
    samples = make_samples(100)
    with RecordingWriter(tmp_path / "r.mcap", *FULL[:2], (imu, camera)) as writer:
        writer.append(samples)
        for name, made in rows.items():
            for part in np.split(made, [3, 3, 20]):
                writer.append_stream(name, part)
    read = read_recording(tmp_path / "r.mcap", streams=("/imu", "/camera"))
    assert read.samples.tobytes() == samples.tobytes()
    for name, made in rows.items():
        assert read.streams[name].tobytes() == made.tobytes()
    assert read_recording(tmp_path / "r.mcap").streams == {}
    with pytest.raises(InputError, match=r"no stream '/lidar'; it has /imu, /camera"):
        read_recording(tmp_path / "r.mcap", streams=("/lidar",))
    with AnyReader([tmp_path / "r.mcap"]) as reader:
        for connection, stamp, raw in reader.messages():
            if connection.topic == "/imu":
                message = reader.deserialize(raw, connection.msgtype)
                row = rows["/imu"][round((stamp / 1e9 - 0.0005) / 0.001)]
                assert (message.angular_velocity.y, message.linear_acceleration.z) == (
                    row["w"][1], row["a"][2],
                )  # fmt: skip


def test_format_1_is_still_read() -> None:
    """A file of the version before: each number is 1000 column + 10 sample + index within."""
    read = read_recording(DATA / "format_1.mcap")
    assert read.complete and len(read.samples) == 3
    assert [e.text for e in read.events] == ["phase start", "phase land"]
    assert read.attachments == {"mission.toml": b'name = "old"\n'}
    assert read.info == {"joint_names": ["shoulder", "elbow"], "n_rotors": 6}
    parts = ("hands", "objects", "force", "localisation")
    now = list_recorded(("shoulder", "elbow"), 6, parts)
    assert {c.name: (c.shape, c.dtype) for c in read.columns} == {
        c.name: (c.shape, c.dtype)
        for c in now.columns
        if c.name != "off_s"  # younger
    }
    np.testing.assert_array_equal(read.samples["t"], [0.0, 0.01, 0.02])
    np.testing.assert_array_equal(read.samples["phase"], [0, 1, 2])
    seen = set()
    for name in read.samples.dtype.names[2:]:
        values = read.samples[name].reshape(3, -1)
        rest = values - 10.0 * np.arange(3)[:, None] - np.arange(values.shape[1])
        assert len(np.unique(rest)) == 1 and rest[0, 0] % 1000 == 0, name
        seen.add(rest[0, 0])
    assert len(seen) == len(read.samples.dtype.names) - 2


# The robot in a viewer


@pytest.mark.parametrize("name", ["othex", "bimanual-longreach", "hexarotor"])
def test_transforms_lead_to_every_link_of_the_urdf(name: str) -> None:
    """Chained from map, they put the tip where the kinematics do."""
    robot = load_robot(name)[0]
    joints, urdf = joint_names(robot), build_urdf(robot)
    recorded = list_recorded(joints, len(robot.rotors.azimuth_deg), ())
    frames = LinkFrames(urdf, joints, recorded.columns)
    links = re.findall(r'<link name="([^"]+)"', urdf)
    every = [*frames.moving, *frames.fixed]
    assert sorted(f.name for f in every) == sorted(links)
    rng = np.random.default_rng(2)
    samples = np.zeros(5, build_dtype(recorded.columns))
    samples["q"] = rng.uniform(-1, 1, samples["q"].shape)
    samples["p_WB"] = rng.uniform(-1, 1, (5, 3))
    samples["q_WB"] = rng.standard_normal((5, 4))
    samples["q_WB"] /= np.linalg.norm(samples["q_WB"], axis=1)[:, None]
    rows = frames.compute(samples)
    if "tip" not in links:
        return
    by_name, model = {f.name: f for f in every}, build_body_model(robot)
    for row, sample in zip(rows, samples, strict=True):
        p, at = np.zeros(3), by_name["tip"]
        while True:
            moved = at in frames.moving
            q = row[f"q {at.name}"] if moved else at.quaternion
            p = rot_from_quat(q) @ p + (row[f"p {at.name}"] if moved else at.position)
            if at.parent == "map":
                break
            at = by_name[at.parent]
        padded = np.zeros(MAX_JOINTS)
        padded[: len(joints)] = sample["q"]
        wanted = sample["p_WB"] + rot_from_quat(sample["q_WB"]) @ compute_tip(model, padded)[0]
        np.testing.assert_allclose(p, wanted, atol=1e-9)


def test_a_flight_shows_the_moving_robot(tmp_path: Path) -> None:
    """Read by an independent reader: URDF, frames, phases, and times that never decrease."""
    robot = load_robot("othex")[0]
    (tmp_path / "mission.toml").write_text("x = 1\n")
    recorded = list_recorded(joint_names(robot), len(robot.rotors.azimuth_deg), ())
    samples = make_samples(301, recorded)
    samples["spring"] = 0.002
    with FlightRecording(tmp_path, robot, recorded) as writer:
        writer.phase(0.0, "take_off")
        for part in np.split(samples, [100, 201]):
            writer.append(part)
        writer.phase(2.99, "land")
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([tmp_path / "recording.mcap"]) as reader:
        qos = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
    for topic, messages_ in found.items():
        stamps = [stamp for stamp, _ in messages_]
        assert stamps == sorted(stamps), topic
    [(_, text)] = found["/robot_description"]
    links = set(re.findall(r'<link name="([^"]+)"', text.data))
    [(_, static)] = found["/tf_static"]
    moving = found["/tf"]
    assert [stamp for stamp, _ in moving] == [20_000_000 * i for i in range(151)]
    frames = {
        t.child_frame_id: t.header.frame_id for t in (*static.transforms, *moving[7][1].transforms)
    }
    assert set(frames) == links | {"contact"}
    assert frames["platform"] == frames["contact"] == "map"
    assert frames["slider"] == "holder" and frames["tip"] == "slider"
    assert all(t.header.stamp.nanosec == 140_000_000 for t in moving[7][1].transforms)
    slider = next(t for t in moving[7][1].transforms if t.child_frame_id == "slider")
    assert slider.transform.translation.x == pytest.approx(-0.002)
    assert [m.data for _, m in found["/mission/phase"]] == ["take_off", "land"]
    assert qos["/robot_description"][0].durability.name == "TRANSIENT_LOCAL"
    assert not qos["/tf"]
    named = {m.header.frame_id for t in found for _, m in found[t] if hasattr(m, "header")}
    assert named - {"", MIXED} <= links | {"map", "contact"}
    assert read_recording(tmp_path / "recording.mcap").samples.tobytes() == samples.tobytes()


# Other people's tools


def test_rosbags_reads_every_message(recorded: tuple[Path, np.ndarray]) -> None:
    """An independent decoder sees our numbers, and encodes them to the same bytes."""
    path, samples = recorded
    values: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        assert {c.topic for c in reader.connections} == {t.name for t in (*TOPICS, EVENTS)}
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            again = reader.typestore.serialize_cdr(message, connection.msgtype)
            assert bytes(again) == bytes(raw), connection.topic
            header = getattr(message, "header", None)
            if header is not None:
                assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp
            values.setdefault(connection.topic, []).append(message)
    for topic in TOPICS:
        assert len(values[topic.name]) == len(samples)
        for message_path, field in topic.fields.items():
            want = samples[field]
            if "q_W" in field:
                want = want[:, [1, 2, 3, 0]]
            got = np.array([_flatten(m, message_path) for m in values[topic.name]])
            used = got.shape[1] if want.ndim == 2 else 1
            want = want.reshape(len(want), -1)[:, :used]
            np.testing.assert_array_equal(got, want, f"{topic.name} {message_path}")
    joints = values["/joints"][0]
    assert joints.name == list(JOINTS) and len(joints.effort) == 0
    assert [e.msg for e in values[EVENTS.name]] == ["phase 0", "phase 100", "phase 200"]


def _flatten(message: Any, path: str) -> list[float]:
    """All numbers below a path of a rosbags message, in order."""
    for part in path.split("."):
        name, _, index = part.partition("[")
        message = getattr(message, name)
        if index:
            message = message[int(index[:-1])]
    if isinstance(message, np.ndarray):
        return list(message)
    if hasattr(message, "__dataclass_fields__"):
        names = [n for n in message.__dataclass_fields__ if n != "__msgtype__"]
        return [x for n in names for x in _flatten(message, n)]
    return [message]


@pytest.mark.parametrize("store", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_standard_types_are_those_of_ros(store: Stores) -> None:
    """A type that differs from the installed one would be refused by ROS."""
    ros = get_typestore(store)
    for topic in (*TOPICS, EVENTS):
        name = messages.full_name(topic.kind)
        parsed = get_types_from_msg(messages.definition(topic.kind, topic.types), name)
        own = {n for n in parsed if n.startswith("skywright_msgs/")}
        for standard in parsed.keys() - own:
            ours = [(f, kind) for f, kind in parsed[standard][1]]
            assert ours == list(ros.get_msgdef(standard).fields), standard
    assert messages.full_name("std_msgs/Header") in ros.types


def test_mcap_library_finds_its_way(recorded: tuple[Path, np.ndarray]) -> None:
    """The index, the checksums and the summary are right: seeking by topic and time works."""
    path, samples = recorded
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        counts = summary.statistics.channel_message_counts
        topics = {i: c.topic for i, c in summary.channels.items()}
        assert {topics[i]: n for i, n in counts.items()} == {
            **{t.name: len(samples) for t in TOPICS},
            EVENTS.name: 3,
        }
        assert summary.statistics.message_end_time == 2_490_000_000
        assert [a.name for a in reader.iter_attachments()] == ["mission.toml"]
        times = [m.log_time for _, _, m in reader.iter_messages("/truth/tip") if m.log_time < 10**9]
        assert times == [i * 10**7 for i in range(100)]
        for index in summary.chunk_indexes:  # each points at its message index records
            for channel, offset in index.message_index_offsets.items():
                stream.seek(offset)
                head = stream.read(11)
                assert head[0] == 7 and int.from_bytes(head[9:11], "little") == channel


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_a_copy_by_another_tool_is_read_alike(
    recorded: tuple[Path, np.ndarray], tmp_path: Path, compression: CompressionType, chunked: bool
) -> None:
    path, samples = recorded
    copy_with_mcap(path, tmp_path / "copy.mcap", compression, chunked)
    read = read_recording(tmp_path / "copy.mcap")
    assert read.complete and read.samples.tobytes() == samples.tobytes()
    assert [e.text for e in read.events] == ["phase 0", "phase 100", "phase 200"]


def copy_with_mcap(
    source: Path,
    target: Path,
    compression: CompressionType = CompressionType.NONE,
    chunked: bool = True,
    leave_out: str = "",
    metadata: dict[str, str] | None = None,
) -> None:
    """Copy message by message with the mcap library, in chunks of another size."""
    with source.open("rb") as old, target.open("wb") as new:
        reader = make_reader(old)
        writer = Writer(new, 10_000, compression, use_chunking=chunked)
        writer.start("ros2")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata | (metadata or {}))
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.topic == leave_out:
                continue
            if channel.id not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", kind)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()


# Crashes, cuts and damage


def test_a_killed_process_leaves_all_that_was_appended(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    code = f"""
        import os, signal
        from pathlib import Path
        from test_recording import FULL, make_samples
        from skywright.recordings.writer import RecordingWriter
        writer = RecordingWriter(Path({str(path)!r}), *FULL)
        samples = make_samples(200)
        writer.append(samples[:100])
        writer.append(samples[100:])
        writer.event(2.0, "about to die")
        os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], cwd=Path(__file__).parent, timeout=300
    )
    assert done.returncode != 0
    read = read_recording(path)
    assert read.samples.tobytes() == make_samples(200).tobytes()
    assert read.events == [Event(2.0, "about to die")]
    assert not read.complete


@given(data=st.data())
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_cut_at_any_byte(
    recorded: tuple[Path, np.ndarray],
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
) -> None:
    path, samples = recorded
    content = path.read_bytes()
    size = data.draw(st.integers(0, len(content) - 1) | st.integers(0, 3000))
    cut = tmp_path_factory.getbasetemp() / "cut.mcap"
    cut.write_bytes(content[:size])
    read = _read_or_refuse(cut)
    if read is None:
        assert size < content.index(FULL.topics[0].name.encode(), 12_000)  # before the metadata
        return
    assert not read.complete
    assert len(read.samples) in (0, 100, 200, 250)
    assert read.samples.tobytes() == samples[: len(read.samples)].tobytes()


@given(data=st.data())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_damage_never_gives_wrong_samples(
    recorded: tuple[Path, np.ndarray],
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
) -> None:
    path, samples = recorded
    content = bytearray(path.read_bytes())
    ends = st.integers(0, 20_000) | st.integers(len(content) - 20_000, len(content) - 1)
    place = data.draw(st.integers(0, len(content) - 1) | ends)
    content[place] ^= data.draw(st.integers(1, 255))
    damaged = tmp_path_factory.getbasetemp() / "damaged.mcap"
    damaged.write_bytes(content)
    read = _read_or_refuse(damaged)
    if read is not None and read.complete:
        assert read.samples.tobytes() == samples.tobytes()
    elif read is not None:  # the end was damaged: as if it were cut
        assert read.samples.tobytes() == samples[: len(read.samples)].tobytes()


def _read_or_refuse(path: Path) -> Recording | None:
    try:
        return read_recording(path)
    except InputError as error:
        assert "\n" not in str(error)
        return None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"t_s,re,im\n0,1,2\n", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "ends before the first sample"),
        (b"\x89MCA", "ends before the first sample"),
    ],
)
def test_no_recording_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    assert said in one_line(path)


def test_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    assert "No such file" in one_line(tmp_path / "nothing.mcap")
    assert "is a directory; a file is needed" in one_line(tmp_path)


def test_foreign_mcap_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "lidar.mcap"
    writer = Writer(str(path))
    writer.start("ros2")
    kind = writer.register_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"")
    channel = writer.register_channel("/lidar/points", "cdr", kind)
    writer.add_message(channel, 0, b"\0\1\0\0", 0)
    writer.finish()
    text = one_line(path)
    assert "not a recording of Skywright" in text and "/lidar/points" in text


def test_other_versions_and_missing_topics_are_refused(
    recorded: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    path, _ = recorded
    copy_with_mcap(path, tmp_path / "new.mcap", metadata={"format": "99"})
    assert "recording format '99'; this version reads '1' and '2'" in one_line(
        tmp_path / "new.mcap"
    )
    for name in ("columns", "topics", "streams", "definitions", "crc32"):
        copy_with_mcap(path, tmp_path / "odd.mcap", metadata={name: "{ }"})
        assert "damaged metadata" in one_line(tmp_path / "odd.mcap")
    copy_with_mcap(path, tmp_path / "less.mcap", leave_out="/rotors")
    assert "topic /rotors has 0 messages" in one_line(tmp_path / "less.mcap")


@pytest.mark.parametrize("t", [np.nan, np.inf, -0.01, 2.0**31])
def test_times_that_no_stamp_can_hold_are_refused(tmp_path: Path, t: float) -> None:
    samples = make_samples(3)
    samples["t"][1] = t
    with RecordingWriter(tmp_path / "r.mcap", *FULL) as writer:
        with pytest.raises(InputError, match="a time of"):
            writer.append(samples)
        with pytest.raises(InputError, match="a time of"):
            writer.event(t, "never")


def test_unwritable_paths_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "no" / "folder" / "r.mcap"):
        with pytest.raises(InputError, match="cannot write"):
            RecordingWriter(path, *FULL)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_told_and_told_again(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write /dev/full: No space left"):
        RecordingWriter(Path("/dev/full"), *FULL)
    writer = RecordingWriter(tmp_path / "r.mcap", *FULL)
    full = Path("/dev/full").open("wb")  # noqa: SIM115  (the writer closes it)
    assert writer._stream is not None
    writer._stream.close()
    writer._stream = writer._mcap._stream = full
    for _ in range(2):  # a run tries to save what it has after the first error
        with pytest.raises(InputError, match="No space left"):
            writer.append(make_samples(100))
    writer.close()
    assert full.closed


# Cost, layout and documents


def test_commands_that_do_not_record_do_not_load_mcap() -> None:
    code = "import sys, skywright, skywright.cli; sys.exit('mcap' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_alignment_follows_the_standard() -> None:
    """A string of any length, an empty sequence, and a fixed array, placed by hand."""
    text = "string name\nuint8 a\nfloat64[] none\nint32[3] three\nfloat64 x # metres\n"
    layout = build_layout("p/T", text, {"name": "ab"}, {})
    # behind the 4-byte header: length 0, "ab\0" 4, a 7, count 8, three 12-24, x 24
    assert layout.leaves["a"].offset == 4 + 7
    assert layout.column("three")[1:] == (3, 4 + 12)
    assert layout.leaves["x"].offset == 4 + 24
    assert len(layout.template) == 4 + 32


def test_documents_list_every_topic_and_own_type() -> None:
    page = (DOCS / "reference" / "messages.md").read_text(encoding="utf-8")
    for topic in (*TOPICS, EVENTS):
        row = next(line for line in page.splitlines() if line.startswith(f"| `{topic.name}`"))
        assert topic.kind.partition("/")[2] in row
        for field in topic.fields.values():
            assert f"`{field}`" in row, (topic.name, field)
        for name, text in topic.types.items():
            assert name in page and text in page


def test_examples_of_the_how_to_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's Python blocks, one after the other, beside a run's recording."""
    folder = tmp_path / "runs" / "pipe-weld-scan"
    folder.mkdir(parents=True)
    (folder / "mission.toml").write_text("x = 1\n")
    robot = load_robot("othex")[0]
    imu = Stream(
        Topic("/sensors/inertial", "sensor_msgs/Imu", "platform",
              {"angular_velocity": "gyro", "linear_acceleration": "accel"}),
        (Column("t", unit="s"), Column("gyro", (3,)), Column("accel", (3,))),
    )  # fmt: skip
    raw = np.zeros(1000, build_dtype(imu.columns))
    raw["t"] = 0.001 * np.arange(1000)
    recorded = list_recorded(joint_names(robot), 6, ())._replace(streams=(imu,))
    with FlightRecording(folder, robot, recorded) as writer:
        writer.append(np.zeros(100, build_dtype(recorded.columns)))
        writer.append_stream("/sensors/inertial", raw)
    monkeypatch.chdir(tmp_path)
    page = (DOCS / "howto" / "read-a-recording.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    assert len(blocks) == 5
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)
    assert names["recording"].complete and names["message"].gap == 0
    assert len(names["imu"]) == 1000
    header, *rows = (tmp_path / "scan.csv").read_text(encoding="utf-8").splitlines()
    assert header == "t_s,x_m,y_m,z_m,re,im,f_normal_n" and len(rows) == 100
