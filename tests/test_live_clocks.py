"""Clocks of live streams: restarts, wrong times, Unix time, and many clock numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from skywright.analysis.locate.trajectory_file import load_trajectory
from skywright.links.live.odometry import pack_odometry
from skywright.links.live.packets import Sample, format_line, pack_pose
from skywright.links.live.receiver import CLOCKS_MAX, Arrived, LiveReceiver
from skywright.links.live.recorder import ROWS_MIN, LiveRecorder, record
from skywright.links.mavlink.stream import MavlinkStream

PLACE = (0.0, 0.0, 0.0)
STILL = (*PLACE, 1.0, 0.0, 0.0, 0.0)


class Bench:
    """A receiver with a clock that is turned by hand."""

    def __init__(self) -> None:
        self.t = 100.0
        self.receiver = LiveReceiver("udp:0", clock=lambda: self.t)

    def send(self, data: bytes) -> list[Arrived]:
        found: list[Arrived] = []
        self.receiver.feed(data, found)
        return found

    def send_pose(self, name: str, n: int, t: float, clock: int = 5) -> list[Arrived]:
        return self.send(pack_pose(Sample("pose", name, clock, n, t, STILL)))


def pack(stream: MavlinkStream, t: float) -> bytes:
    return pack_odometry(stream, Sample("pose", "x", 1, 0, t, STILL))


@pytest.mark.parametrize("clocks", [(7, 7), (7, 8)])
def test_a_scan_keeps_its_times_in_unix_time(tmp_path: Path, clocks: tuple[int, int]) -> None:
    bench, recorder = Bench(), LiveRecorder(tmp_path / "a")
    bench.t = 1.7e9
    for k in range(400):
        t, x = 1.7e9 + 0.005 * k, 4.5e6 + 0.001 * k  # m, as in a national grid
        bench.t += 0.005
        tip = Sample("position", "tip", clocks[0], k, t, (x, 0.0, 0.0))
        signal = Sample("SKYEC", "eddy", clocks[1], k, t, (1.0, 2.0))
        for data in (pack_pose(tip), format_line(signal)):
            for arrived in bench.send(data):
                recorder.write(arrived)
    scan = np.genfromtxt(recorder.finish()[-1], delimiter=",", names=True)
    bench.receiver.close()
    assert len(scan) > 390
    np.testing.assert_allclose(np.diff(scan["t_s"]), 0.005, atol=2e-6)
    np.testing.assert_allclose(np.diff(scan["x_m"]), 0.001, atol=1e-4)


@pytest.mark.parametrize("ahead", [1.505, 1e6])
def test_a_scan_omits_a_time_that_later_ones_disprove(tmp_path: Path, ahead: float) -> None:
    bench, recorder = Bench(), LiveRecorder(tmp_path / "a")
    for k in range(400):
        t, s = 0.01 * k, 0.01 * k + 0.004
        bench.t += 0.01
        sent = [Sample("position", "tip", 7, 2 * k, t, (t, 0.0, 0.0))]
        if k in (200, 201):  # the signal between them is right
            sent.append(Sample("position", "tip", 7, 2 * k + 1, t + ahead, (t, 0.0, 0.0)))
        for data in (*map(pack_pose, sent), format_line(Sample("SKYEC", "e", 7, k, s, (s, 0.0)))):
            for arrived in bench.send(data):
                recorder.write(arrived)
    scan = np.genfromtxt(recorder.finish()[-1], delimiter=",", names=True)
    bench.receiver.close()
    assert len(scan) > 390
    np.testing.assert_allclose(scan["x_m"], scan["re"], atol=1e-6)
    path = load_trajectory(str(tmp_path / "a" / "tip.csv"))
    np.testing.assert_allclose(path.p[:, 0] - path.p[0, 0], path.t - path.t[0], atol=1e-6)


def test_a_stream_that_ends_when_its_clock_is_set_ahead_moves_no_other(tmp_path: Path) -> None:
    """Its last sample is held until the end. The tip's newer offset remains."""
    bench, recorder = Bench(), LiveRecorder(tmp_path / "a")
    for k in range(200):
        bench.t, t = 100.0 + 0.01 * k, 0.01 * k + (3600.0 if k >= 100 else 0.0)
        sent = [
            format_line(Sample("SKYEC", "eddy", 8, k, 0.01 * k, (0.01 * k, 0.0))),
            pack_pose(Sample("position", "tip", 7, k, t, (0.01 * k, 0.0, 0.0))),
        ]
        if k <= 100:
            sent.append(format_line(Sample("SKYFT", "wrench", 7, k, t, (0.0,) * 6)))
        for data in sent:
            for arrived in bench.send(data):
                recorder.write(arrived)
    wrench, scan = (
        np.genfromtxt(
            next(p for p in recorder.finish() if p.name == name), delimiter=",", names=True
        )
        for name in ("wrench.csv", "scan.csv")
    )
    bench.receiver.close()
    assert wrench["t_s"][-1] == pytest.approx(3601.0)
    assert len(scan) > 97 and scan["t_s"][0] == pytest.approx(101.0, abs=0.011)
    np.testing.assert_allclose(scan["x_m"], scan["re"], atol=1e-6)


def test_a_dropped_time_is_refused_and_no_sample(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, recorder = Bench(), LiveRecorder(tmp_path / "a")
    polls = [[], *([("tip", k, 1e6 if k == 3 else 0.01 * k)] for k in range(6))]

    def poll() -> list[Arrived]:
        if not polls:
            raise KeyboardInterrupt
        bench.t += 0.01
        return [a for name, n, t in polls.pop(0) for a in bench.send_pose(name, n, t)]

    monkeypatch.setattr(bench.receiver, "poll", poll)
    record(bench.receiver, recorder, math.inf, math.inf)
    (file,) = recorder.finish()
    bench.receiver.close()
    stream = bench.receiver.find("tip")
    assert stream is not None and stream.count == len(file.read_text().splitlines()) - 1 == 5
    assert bench.receiver.counts == {"clock": 1}
    assert bench.receiver.describe_refused()[0].startswith("1 refused: a sample whose time")


def test_an_interrupt_writes_no_row_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C comes after the first of three rows was written."""
    bench, recorder = Bench(), LiveRecorder(tmp_path / "a")
    append = LiveRecorder._append

    def interrupt(self: LiveRecorder, arrived: Arrived) -> None:
        append(self, arrived)
        monkeypatch.undo()
        raise KeyboardInterrupt

    times = [0.0, 0.01, 50.0, 50.0, 50.01]  # the clock is set ahead
    for k, t in enumerate(times):
        bench.t += 0.01
        (arrived,) = bench.send_pose("tip", k, t)
        if k < 4:
            recorder.write(arrived)
    monkeypatch.setattr(LiveRecorder, "_append", interrupt)
    with pytest.raises(KeyboardInterrupt):
        recorder.write(arrived)
    (file,) = recorder.finish()
    bench.receiver.close()
    written = np.genfromtxt(file, delimiter=",", names=True)
    np.testing.assert_allclose(written["t_s"], times)


def test_a_scan_is_written_after_more_clock_numbers_than_the_receiver_keeps(
    tmp_path: Path,
) -> None:
    bench, recorder = Bench(), LiveRecorder(tmp_path / "a")
    starts = CLOCKS_MAX + 6
    for k in range(starts * ROWS_MIN):
        bench.t += 0.01
        clock, t = k // ROWS_MIN, 0.01 * (k % ROWS_MIN)  # each start begins at 0
        tip = Sample("position", "tip", 1000, k, bench.t, (bench.t, 0.0, 0.0))
        signal = Sample("SKYEC", "e", clock, k % ROWS_MIN, t, (bench.t, 0.0))
        for data in (pack_pose(tip), format_line(signal)):
            for arrived in bench.send(data):
                recorder.write(arrived)
    scan = np.genfromtxt(recorder.finish()[-1], delimiter=",", names=True)
    bench.receiver.close()
    assert len(scan) > 0.99 * starts * ROWS_MIN
    np.testing.assert_allclose(scan["re"], scan["x_m"], atol=1e-6)


def test_a_restarted_odometry_sender_is_accepted_with_a_new_clock() -> None:
    bench, sender = Bench(), MavlinkStream(3)
    for k in range(100):
        bench.t += 0.01
        bench.send(pack(sender, 600.0 + 0.01 * k))
    ages = list[float]()
    for k in range(100):
        bench.t += 0.01
        ages += [arrived.age for arrived in bench.send(pack(sender, 0.01 * k))]
    (stream,) = bench.receiver.streams.values()
    assert (len(ages), stream.restarts, stream.lost) == (99, 1, 0) and max(ages) < 1e-3
    assert bench.receiver.counts == {"old": 1}  # the first: it could be a late packet
    assert stream.newest is not None and stream.newest.sample.clock % 256 == 3
    bench.receiver.close()


def test_late_odometry_and_a_second_sender_of_the_same_id_are_no_restart() -> None:
    """A second sender's times are behind; in between come those of the first."""
    bench, sender = Bench(), MavlinkStream(3)
    for k in range(100):
        bench.t += 0.01
        assert len(bench.send(pack(sender, 600.0 + 0.01 * k))) == 1
        assert bench.send(pack(sender, 0.01 * k if k != 50 else 598.0)) == []
    (stream,) = bench.receiver.streams.values()
    assert (stream.count, stream.restarts, stream.lost) == (100, 0, 0)
    bench.receiver.close()


def test_two_odometry_senders_lose_nothing() -> None:
    bench, senders = Bench(), [MavlinkStream(1), MavlinkStream(2)]
    for k in range(50):
        bench.t += 0.01
        for sender in senders:
            bench.send(pack(sender, 0.01 * k))
    assert [(s.count, s.lost) for s in bench.receiver.streams.values()] == [(50, 0)] * 2
    bench.receiver.close()


@pytest.mark.parametrize("name", ["tip", "other"])
def test_one_wrong_time_disturbs_no_stream(name: str) -> None:
    """Its checksum is right. It is kept, and is not the newest sample of its stream."""
    bench = Bench()
    for k in range(1000):
        bench.t += 0.01
        if k == 500:
            for each in (name, "beside"):  # streams of one frame share the time
                (wrong,) = bench.send_pose(each, 2 * k, 1e6)
                assert wrong.age < 0.0
        bench.send_pose("tip", 2 * k + 1, 0.01 * k)
    stream = bench.receiver.find("tip")
    assert stream is not None and stream.stale == 0 and stream.newest is not None
    assert stream.newest.sample.t == pytest.approx(9.99) and stream.restarts == 0
    assert stream.count == (1001 if name == "tip" else 1000)
    bench.receiver.close()


def test_a_clock_that_is_set_ahead_counts_from_the_second_sample() -> None:
    bench = Bench()
    ages = list[float]()
    for k in range(100):
        bench.t += 0.01
        t = 0.01 * k + (3600.0 if k >= 50 else 0.0)
        ages += [arrived.age for arrived in bench.send_pose("tip", k, t)]
    assert ages[50] < -3599.0
    np.testing.assert_allclose(np.delete(ages, 50), 0.0, atol=1e-6)
    bench.receiver.close()


def test_a_refused_sample_does_not_change_its_clock() -> None:
    bench = Bench()
    bench.send_pose("tip", 10, 1.0)
    offset = bench.receiver.clocks[5].offset
    assert bench.send_pose("tip", 9, 1.5) == []  # an old number, with a time that is ahead
    assert bench.receiver.clocks[5].offset == offset
    bench.receiver.close()
