"""The recording: bit-exact, readable after a crash, and read alike by other people's tools."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
import time
from collections import Counter
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

from skywright.core import messages
from skywright.core.cdr import build_layout
from skywright.core.messages import EVENTS, TOPICS
from skywright.core.recording import Event, Recording, RecordingWriter, read_recording
from skywright.core.types import MAX_JOINTS, MAX_ROTORS, SAMPLE
from skywright.errors import InputError

JOINTS = ("link1", "link2")
ROTORS = 6
DOCS = Path(__file__).resolve().parent.parent / "docs"


def make_samples(n: int, n_joints: int = 2, n_rotors: int = 6, seed: int = 0) -> np.ndarray:
    """Samples of random bits (NaN with payloads, infinities, -0.0, denormals) at 100 Hz."""
    rng = np.random.default_rng(seed)
    samples = np.frombuffer(rng.bytes(n * SAMPLE.itemsize), SAMPLE).copy()
    samples["t"] = np.arange(n) * 0.01
    for field, used in (
        *dict.fromkeys(
            ("q", "qd", "ref_q", "cmd_qd", "theta", "deflection", "cmd_theta"), n_joints
        ).items(),
        *dict.fromkeys(("rotor_thrust", "rotor_speed"), n_rotors).items(),
    ):
        samples[field][:, used:] = 0.0
    return samples


def write(path: Path, samples: np.ndarray, batch: int = 100) -> None:
    """Write a recording with a note every batch and an attachment."""
    with RecordingWriter(path, JOINTS, ROTORS) as writer:
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
    n_rotors=st.integers(0, MAX_ROTORS),
    batches=st.lists(st.integers(0, 300), max_size=4),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_every_bit_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    n_joints: int,
    n_rotors: int,
    batches: list[int],
    seed: int,
) -> None:
    path = tmp_path_factory.mktemp("bits") / "recording.mcap"
    samples = make_samples(sum(batches), n_joints, n_rotors, seed)
    names = tuple(f"joint_{'x' * i}" for i in range(n_joints))  # any length shifts what follows
    with RecordingWriter(path, names, n_rotors) as writer:
        for part in np.split(samples, np.cumsum(batches)[:-1]) if batches else []:
            writer.append(part)
    read = read_recording(path)
    assert read.samples.dtype == SAMPLE
    assert read.samples.tobytes() == samples.tobytes()
    assert (read.joint_names, read.n_rotors, read.complete) == (names, n_rotors, True)


def test_every_field_is_on_exactly_one_topic() -> None:
    bound = Counter(f for t in TOPICS if not t.derived for f in t.fields.values())
    assert bound == Counter(SAMPLE.names)


@given(events=st.lists(st.tuples(st.integers(0, 2**31 * 1000 - 1), st.text()), max_size=5))
@settings(max_examples=25, deadline=None)
def test_events_and_attachments_are_read_back(
    tmp_path_factory: pytest.TempPathFactory, events: list[tuple[int, str]]
) -> None:
    path = tmp_path_factory.mktemp("events") / "recording.mcap"
    wanted = [Event(ms / 1000, text.replace("\0", "")) for ms, text in events if _encodes(text)]
    with RecordingWriter(path, JOINTS, ROTORS) as writer:
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
    contact = values["/tf"][7].transforms[2]
    assert (contact.header.frame_id, contact.child_frame_id) == ("map", "contact")
    assert _flatten(contact, "transform.rotation") == [0, 0, 0, 1]
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
        parsed = get_types_from_msg(messages.definition(topic.kind), name)
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
        from test_recording import JOINTS, ROTORS, make_samples
        from skywright.core.recording import RecordingWriter
        writer = RecordingWriter(Path({str(path)!r}), JOINTS, ROTORS)
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
        assert size < 260  # before the metadata, there is nothing to tell
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
        (b"t_s,re,im\n0,1,2\n", "is no MCAP file"),
        (b"\x89MCAP0\r\n", "was cut before the first sample"),
        (b"\x89MCA", "was cut before the first sample"),
    ],
)
def test_no_recording_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    assert said in one_line(path)


def test_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    assert "No such file" in one_line(tmp_path / "nothing.mcap")
    assert "Is a directory" in one_line(tmp_path)


def test_foreign_mcap_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "lidar.mcap"
    writer = Writer(str(path))
    writer.start("ros2")
    kind = writer.register_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"")
    channel = writer.register_channel("/lidar/points", "cdr", kind)
    writer.add_message(channel, 0, b"\0\1\0\0", 0)
    writer.finish()
    text = one_line(path)
    assert "no recording of Skywright" in text and "/lidar/points" in text


def test_other_versions_and_missing_topics_are_refused(
    recorded: tuple[Path, np.ndarray], tmp_path: Path
) -> None:
    path, _ = recorded
    copy_with_mcap(path, tmp_path / "new.mcap", metadata={"format": "99"})
    assert "recording format '99'; this version reads '1'" in one_line(tmp_path / "new.mcap")
    copy_with_mcap(path, tmp_path / "more.mcap", metadata={"n_rotors": "8"})
    assert "/rotors has messages of another version" in one_line(tmp_path / "more.mcap")
    copy_with_mcap(path, tmp_path / "odd.mcap", metadata={"n_rotors": "1e9"})
    assert "damaged metadata" in one_line(tmp_path / "odd.mcap")
    copy_with_mcap(path, tmp_path / "less.mcap", leave_out="/rotors")
    assert "topic /rotors has 0 messages" in one_line(tmp_path / "less.mcap")
    copy_with_mcap(path, tmp_path / "no_tf.mcap", leave_out="/tf")  # repeats others: not needed
    assert len(read_recording(tmp_path / "no_tf.mcap").samples) == 250


@pytest.mark.parametrize("t", [np.nan, np.inf, -0.01, 2.0**31])
def test_times_that_no_stamp_can_hold_are_refused(tmp_path: Path, t: float) -> None:
    samples = make_samples(3)
    samples["t"][1] = t
    with RecordingWriter(tmp_path / "r.mcap", JOINTS, ROTORS) as writer:
        with pytest.raises(InputError, match="a time of"):
            writer.append(samples)
        with pytest.raises(InputError, match="a time of"):
            writer.event(t, "never")


def test_unwritable_paths_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "no" / "folder" / "r.mcap"):
        with pytest.raises(InputError, match="cannot write"):
            RecordingWriter(path, JOINTS, ROTORS)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_told_and_told_again(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write /dev/full: No space left"):
        RecordingWriter(Path("/dev/full"), JOINTS, ROTORS)
    writer = RecordingWriter(tmp_path / "r.mcap", JOINTS, ROTORS)
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


def test_writing_costs_little(tmp_path: Path) -> None:
    """Far below 1 % of real time (100 us a sample): measured 4 us; 10 times that is a fault."""
    samples = make_samples(3000)
    with RecordingWriter(tmp_path / "r.mcap", JOINTS, ROTORS) as writer:
        costs = []
        for i in range(0, len(samples), 100):
            start = time.process_time()
            writer.append(samples[i : i + 100])
            costs.append(time.process_time() - start)
    assert np.median(costs) / 100 < 40e-6


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
    for name, text in messages._OWN.items():
        assert name in page and text in page


def test_examples_of_the_how_to_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's Python blocks, one after the other, beside a run's recording."""
    folder = tmp_path / "runs" / "pipe-weld-scan"
    folder.mkdir(parents=True)
    write(folder / "recording.mcap", np.zeros(100, SAMPLE))
    monkeypatch.chdir(tmp_path)
    page = (DOCS / "howto" / "read-a-recording.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    assert len(blocks) == 3
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)
    assert names["recording"].complete and names["message"].gap == 0
    header, *rows = (tmp_path / "scan.csv").read_text(encoding="utf-8").splitlines()
    assert header == "t_s,x_m,y_m,z_m,re,im,f_normal_n" and len(rows) == 100
