"""Live inputs: packets, lines, clocks, and the way from a recording over a stream to a result."""

from __future__ import annotations

import math
import socket
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.cli import main
from skywright.core.rotations import rot_from_quat
from skywright.errors import InputError
from skywright.inspection.scan_file import load_scan
from skywright.links.live.odometry import pack_odometry, parse_odometry
from skywright.links.live.packets import (
    LINES,
    SIZE,
    LineSplitter,
    Refused,
    Sample,
    check_name,
    format_line,
    pack_pose,
    parse_line,
    parse_pose,
)
from skywright.links.live.player import Target, Track, list_samples, make_name, play
from skywright.links.live.receiver import (
    FORGET_S,
    STALE_S,
    STREAMS_MAX,
    Arrived,
    DelayClock,
    LiveReceiver,
)
from skywright.links.live.recorder import LiveRecorder, record
from skywright.links.live.sources import load_run_tracks, load_scan_tracks
from skywright.links.mavlink.stream import MavlinkStream
from waiting import wait_for

finite = st.floats(-1e6, 1e6)
names = st.from_regex(r"[a-z][a-z0-9_-]{0,15}", fullmatch=True)
words = st.integers(0, 2**32 - 1)


def turn(q: list[float]) -> tuple[float, ...]:
    size = math.sqrt(sum(x * x for x in q))
    return tuple(x / size for x in q) if size > 1e-3 else (1.0, 0.0, 0.0, 0.0)


quaternions = st.lists(st.floats(-1, 1), min_size=4, max_size=4).map(turn)


def hear(receiver: LiveReceiver, count: int) -> list[Arrived]:
    """Poll until `count` samples have arrived: a terminal hands them over when it has time."""
    found: list[Arrived] = []
    wait_for(lambda: found.extend(receiver.poll()) or len(found) >= count)
    return found


@settings(max_examples=80)
@given(names, words, words, finite, st.tuples(finite, finite, finite), quaternions, st.booleans())
def test_poses_come_back(
    name: str, clock: int, n: int, t: float, p: tuple[float, ...], q: Any, turned: bool
) -> None:
    sample = Sample("pose" if turned else "position", name, clock, n, t, p + q if turned else p)
    data = pack_pose(sample)
    assert len(data) == SIZE and parse_pose(data) == sample


@settings(max_examples=80)
@given(st.sampled_from(sorted(LINES)), names, words, words, finite, st.data())
def test_lines_come_back(kind: str, name: str, clock: int, n: int, t: float, data: Any) -> None:
    count = len(LINES[kind])
    values = tuple(data.draw(st.lists(finite, min_size=count, max_size=count)))
    sample = Sample(kind, name, clock, n, t, values)
    assert parse_line(format_line(sample)) == sample


@settings(max_examples=150)
@given(st.integers(0, SIZE - 1), st.integers(1, 255), st.binary(max_size=120))
def test_changed_and_foreign_bytes_are_refused(at: int, change: int, junk: bytes) -> None:
    data = bytearray(pack_pose(Sample("position", "a", 1, 2, 3.0, (1.0, 2.0, 3.0))))
    data[at] ^= change
    for broken in (bytes(data), junk, bytes(data[:at])):
        with pytest.raises(Refused):
            parse_pose(broken)
    with pytest.raises(Refused):
        parse_line(junk)


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        (b"$SKYEC,1,a,1,2,3.0,4.0,5.0*00", "crc"),
        (b"$SKYEC,2,a,1,2,3.0,4.0,5.0*", "version"),
        (b"$SKYEC,1,a,1,2,3.0,4.0*", "fields"),
        (b"$SKYEC,1,a,1,2,3.0,nan,5.0*", "numbers"),
        (b"$SKYXX,1,a,1,2,3.0,4.0,5.0*", "fields"),
        (b"hello", "size"),
    ],
)
def test_lines_are_refused_by_their_cause(line: bytes, cause: str) -> None:
    if line.endswith(b"*"):
        check = 0
        for byte in line[1:-1]:
            check ^= byte
        line += b"%02X" % check
    with pytest.raises(Refused, match=cause):
        parse_line(line)


@settings(max_examples=60)
@given(st.integers(1, 30), st.integers(1, 5))
def test_lines_are_found_in_pieces_and_endless_ones_are_cut(cut: int, n: int) -> None:
    stream = b"".join(format_line(Sample("SKYEC", "a", 1, k, k, (1.0, 2.0))) for k in range(n))
    splitter = LineSplitter()
    found = [x for k in range(0, len(stream), cut) for x in splitter.feed(stream[k : k + cut])]
    assert [parse_line(x).sequence for x in found] == list(range(n))
    for _ in range(50):
        list(splitter.feed(b"x" * 100))
    assert len(splitter._rest) <= 500


@settings(max_examples=60)
@given(st.tuples(*[st.floats(-1e3, 1e3)] * 3), quaternions)
def test_odometry_messages_keep_the_pose(p: tuple[float, ...], q: Any) -> None:
    stream = MavlinkStream(9)
    sample = Sample("pose", "mocap", 9, 0, 12.345678, p + q)
    (message,) = MavlinkStream().feed(pack_odometry(stream, sample))
    assert (message.x, message.y, message.z) == pytest.approx((p[1], p[0], -p[2]), rel=1e-6)
    found = parse_odometry(message)
    assert (found.name, found.clock, found.t) == ("odometry9", 9, pytest.approx(12.345678))
    np.testing.assert_allclose(found.values[:3], p, rtol=1e-6, atol=1e-5)
    R, wanted = (rot_from_quat(np.array(x)) for x in (found.values[3:], q))
    np.testing.assert_allclose(R, wanted, atol=1e-5)
    message.frame_id = 0
    with pytest.raises(Refused, match="frame"):
        parse_odometry(message)


def test_age_needs_no_common_clock_and_follows_a_drift() -> None:
    clock, drift = DelayClock(), 1.0 + 50e-6
    ages = []
    for k in range(60000):  # ten minutes at 100 Hz
        t = 0.01 * k
        delay = 0.004 + (0.3 if k == 30000 else 0.0) + 0.002 * (k % 7)
        ages.append(clock.take(5e4 + t * drift, t + delay))
    assert ages[30000] == pytest.approx(0.3, abs=0.02)
    late = np.delete(np.array(ages), 30000)[1000:]
    assert np.all(late >= 0.0) and late.max() < 0.02
    assert len(clock._buckets) <= FORGET_S + 2


class Hand:
    """A clock that is turned by hand."""

    t = 100.0

    def __call__(self) -> float:
        return self.t


def test_old_stale_and_restarted_samples() -> None:
    hand, found = Hand(), list[Arrived]()
    receiver = LiveReceiver("udp:0", clock=hand)
    place = (0.0, 0.0, 0.0)

    def send(n: int, t: float, clock: int = 7, name: str = "a") -> None:
        receiver.feed(pack_pose(Sample("position", name, clock, n, t, place)), found)

    for k in range(10):
        hand.t = 100.0 + 0.1 * k
        send(k, 0.1 * k)
    send(9, 0.9)  # twice
    send(5, 0.5)  # overtaken
    send(10, 0.2)  # its clock goes back
    assert receiver.counts == {"old": 2, "clock": 1}
    stream = receiver.find("a")
    assert stream is not None and stream.count == 10 and receiver.measure_age(stream) < 1e-6
    hand.t = 101.9 + STALE_S
    send(11, 1.4)  # 0.75 s old: kept, and not the newest
    assert stream.stale == 1 and len(found) == 11 and stream.newest.sample.sequence == 9
    assert receiver.measure_age(stream) == pytest.approx(1.25)
    send(0, 900.0, clock=8)  # the sender has started again
    assert stream.restarts == 1 and stream.newest.sample.t == 900.0
    send(2**32 - 1, 0.0, name="b")
    send(0, 0.1, name="b")  # the sequence wraps
    assert receiver.find("b").count == 2
    for k in range(STREAMS_MAX + 5):
        send(0, 0.0, name=f"n{k}")
    assert len(receiver.streams) == STREAMS_MAX and receiver.counts["streams"] == 7
    receiver.feed(b"junk", found)
    says = "\n".join(receiver.describe_refused())
    assert "2 refused: a sample that came before" in says and "no pose packet" in says
    receiver.close()


def test_a_player_keeps_the_pace_and_each_source_its_clock() -> None:
    t = np.array([5.0, 5.5, 6.0])
    a = Track("position", "a", t, np.zeros((3, 3)), "one")
    b = Track("SKYEC", "b", t + 0.25, np.ones((3, 2)), "one")
    c = Track("position", "c", t + 1e6, np.zeros((3, 3)), "two")
    order = list(list_samples([a, b, c]))
    assert [round(due, 2) for due, _ in order] == [0, 0, 0.25, 0.5, 0.5, 0.75, 1, 1, 1.25]
    clocks = {s.name: s.clock for _, s in order}
    assert clocks["a"] == clocks["b"] != clocks["c"]
    hand, slept = Hand(), list[float]()

    def sleep(s: float) -> None:
        slept.append(s)
        hand.t += s

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        target = Target(f"udp:{s.getsockname()[1]}")
        assert play([a, b], target, 2.0, hand, sleep) == {"a": 3, "b": 3}
        target.close()
    assert sum(slept) == pytest.approx(1.25 / 2.0)


@pytest.mark.parametrize(("to", "says"), [("tcp:3", "valid: udp"), ("udp:x", "--to")])
def test_wrong_targets_are_refused(to: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Target(to)


@settings(max_examples=100)
@given(st.text(max_size=40))
def test_names_of_files_become_names_of_streams(text: str) -> None:
    assert check_name(make_name(text))
    assert make_name("camera") == "camera"


def stream(folder: Path, data: list[str], speed: float) -> tuple[LiveReceiver, list[Path]]:
    """Play files into a receiver over loopback; returns it and the files that it wrote."""
    receiver, recorder = LiveReceiver("udp:0"), LiveRecorder(folder)
    thread = threading.Thread(target=record, args=(receiver, recorder, 60.0, 0.7), daemon=True)
    thread.start()
    to = f"udp:{receiver.port}"
    out = CliRunner().invoke(main, ["play", *data, "--to", to, "--speed", str(speed)])
    assert out.exit_code == 0, out.output
    thread.join(20.0)
    files = recorder.finish()
    receiver.close()
    return receiver, files


def test_a_scan_takes_the_same_way_from_a_file_and_a_stream(
    tmp_path: Path, repository: Path
) -> None:
    file = repository / "examples" / "weld_data" / "pipe_scan.csv"
    receiver, _ = stream(tmp_path / "live", [str(file)], 100.0)
    assert receiver.describe_refused() == []
    before, after = load_scan(file), load_scan(tmp_path / "live" / "scan.csv")
    n = len(before.t)
    assert {s.name: s.count for s in receiver.streams.values()} == {"eddy": n, "tip": n}
    assert len(after.t) == n
    np.testing.assert_allclose(after.ec, before.ec, rtol=1e-8)
    np.testing.assert_allclose(after.p_WT, before.p_WT, atol=1e-6)
    np.testing.assert_allclose(after.axis_W, before.axis_W, atol=1e-6)


def test_station_and_camera_are_located_from_a_stream_as_from_files(tmp_path: Path) -> None:
    import skywright
    from skywright.analysis.locate.demo import write_demo

    station, camera, truth = write_demo(tmp_path / "demo")
    _, files = stream(tmp_path / "live", [str(station), str(camera)], 100.0)
    live = {f.stem: str(f) for f in files}
    results = [
        skywright.locate(a, b, reference=str(truth), compare="none").to_json()
        for a, b in ((str(station), str(camera)), (live["station"], live["camera"]))
    ]
    files_say, stream_says = results
    assert files_say["time_offset_s"] == pytest.approx(-41.3, abs=0.02)
    assert stream_says["time_offset_s"] == pytest.approx(files_say["time_offset_s"], abs=1e-4)
    assert stream_says["frame"]["scale"] == pytest.approx(files_say["frame"]["scale"], abs=1e-4)


def test_two_clocks_are_brought_together_by_their_smallest_delays(tmp_path: Path) -> None:
    """Signal and place from two senders: the place at a signal's time is right within a delay."""
    hand = Hand()
    receiver = LiveReceiver("udp:0", clock=hand)
    recorder = LiveRecorder(tmp_path / "live")
    rng = np.random.default_rng(1)
    for k in range(600):
        t = 0.01 * k
        x = math.sin(t)
        due = [
            (0.002 + 0.004 * rng.random(), Sample("SKYEC", "e", 1, k, t + 1000.0, (x, 0.0))),
            (0.002 + 0.004 * rng.random(), Sample("position", "tip", 2, k, t - 50.0, (x, 0, 0))),
        ]
        for delay, sample in sorted(due, key=lambda pair: pair[0]):
            hand.t = 100.0 + t + delay
            data = format_line(sample) if sample.kind in LINES else pack_pose(sample)
            found: list[Arrived] = []
            receiver.feed(data, found)
            for arrived in found:
                recorder.write(arrived)
    paths = recorder.finish()
    receiver.close()
    scan = np.genfromtxt(next(p for p in paths if p.name == "scan.csv"), delimiter=",", names=True)
    assert len(scan) > 590
    assert np.max(np.abs(scan["re"] - scan["x_m"])) < 0.002  # 1 m/s: 2 ms
    with pytest.raises(InputError, match="give an empty folder"):
        LiveRecorder(tmp_path / "live")


def test_lines_over_a_serial_port(tmp_path: Path, repository: Path) -> None:
    import os
    import pty
    import tty

    master, slave = pty.openpty()
    tty.setraw(slave)
    receiver = LiveReceiver(f"serial:{os.ttyname(slave)}:115200")
    file = repository / "examples" / "weld_data" / "pipe_scan.csv"
    (signal, _) = load_scan_tracks(file)
    lines = [format_line(s) for _, s in list_samples([signal._replace(t=signal.t[:50])])]
    os.write(master, lines[3][5:] + b"".join(lines))
    found = hear(receiver, 50)
    assert [a.sample.sequence for a in found] == list(range(50))
    assert receiver.counts == {"size": 1}  # the end of a line that began before
    receiver.close()
    os.close(master)
    os.close(slave)
    with pytest.raises(InputError, match="valid: serial"):
        LiveReceiver("serial:/dev/x:7")


def test_mavlink_poses_over_loopback(tmp_path: Path) -> None:
    receiver = LiveReceiver("udp:0")
    t = np.linspace(0.0, 1.0, 20)
    values = np.hstack([np.stack([t, 2 * t, -t], axis=1), np.tile([1.0, 0, 0, 0], (20, 1))])
    target = Target(f"mavlink:{receiver.port}")
    track = Track("pose", "mocap", t, values)
    play([track, Track("SKYEC", "e", t, values[:, :2])], target, 1000.0)
    found = hear(receiver, len(values))
    np.testing.assert_allclose([a.sample.values for a in found], values, atol=1e-6)
    receiver.feed(b"\xfd\x01\x02", [])
    with pytest.raises(InputError, match="takes none of"):
        play([Track("SKYEC", "e", t, values[:, :2])], target)
    target.close()
    receiver.close()


def test_the_receiver_says_when_nothing_came(tmp_path: Path) -> None:
    words = ["receive", "udp:0", "--out", str(tmp_path / "a"), "--seconds", "0.1"]
    assert CliRunner().invoke(main, words).exit_code == 1
    assert CliRunner().invoke(main, ["receive", "tcp:0", "--out", "x"]).exit_code == 2
    out = CliRunner().invoke(main, ["play", str(tmp_path / "no"), "--to", "udp:9"])
    assert out.exit_code == 2 and "no such file" in out.output


def test_a_flight_that_reached_no_scan_gives_its_platform(repository: Path) -> None:
    (track,) = load_run_tracks(repository / "tests" / "data" / "format_1.mcap")
    assert (track.kind, track.name, len(track.t)) == ("pose", "truth", 3)
    assert track.values.shape == (3, 7) and track.t[1] == pytest.approx(0.01)


def test_odometry_keeps_streams_apart() -> None:
    """The message has no name: each stream is a system of its own."""
    receiver = LiveReceiver("udp:0")
    t = np.linspace(0.0, 1.0, 20)
    turn = np.tile([1.0, 0, 0, 0], (20, 1))
    tracks = [
        Track("pose", name, t, np.hstack([np.full((20, 3), x), turn]), "one clock")
        for name, x in (("tip", 1.0), ("truth", 2.0))
    ]
    target = Target(f"mavlink:{receiver.port}")
    play(tracks, target, 1000.0)
    found = [(a.sample.name, a.sample.values[0]) for a in hear(receiver, 40)]
    assert set(found) == {("odometry1", 1.0), ("odometry2", 2.0)} and len(found) == 40
    early = tracks[0]._replace(t=t - 5.0)
    with pytest.raises(InputError, match="times from -5 to -4 s"):
        play([early], target)
    target.close()
    with pytest.raises(InputError, match="two streams have one name"):
        play([early, early._replace(source="other")], Target("udp:9"))
    receiver.close()


def test_samples_that_were_lost_are_counted() -> None:
    receiver = LiveReceiver("udp:0", clock=Hand())
    for n in (0, 1, 5, 6, 3, 0xFFFFFFF):
        receiver.feed(format_line(Sample("SKYEC", "e", 1, n, 0.0, (1.0, 2.0))), [])
    (stream,) = receiver.streams.values()
    assert (stream.count, stream.lost) == (5, 3 + 0xFFFFFFF - 7)
    receiver.close()


def test_a_serial_port_that_disappears_ends_the_recording_with_its_files(tmp_path: Path) -> None:
    import os
    import pty
    import tty

    master, slave = pty.openpty()
    tty.setraw(slave)
    receiver, recorder = LiveReceiver(f"serial:{os.ttyname(slave)}"), LiveRecorder(tmp_path / "a")
    os.write(
        master, b"".join(format_line(Sample("SKYEC", "e", 1, n, n, (1.0, 2.0))) for n in (0, 1))
    )
    found = hear(receiver, 2)
    for arrived in found:
        recorder.write(arrived)
    os.close(slave)
    os.close(master)
    record(receiver, recorder, 10.0, math.inf)
    assert "serial port has failed" in receiver.failure
    (file,) = recorder.finish()
    assert len(file.read_text().splitlines()) == 3
    receiver.close()


def test_mavlink_without_its_library_is_counted_and_the_recording_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    receiver, found = LiveReceiver("udp:0"), []
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    receiver.feed(b"\xfd" + bytes(20), found)
    receiver.feed(format_line(Sample("SKYEC", "e", 1, 0, 0.0, (1.0, 2.0))), found)
    assert len(found) == 1 and "pip install" in receiver.describe_refused()[0]
    receiver.close()
