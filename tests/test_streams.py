"""Raw samples of sensors in the recording: each at its own time, whatever the link does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.recordings.recording import read_recording
from skywright.recordings.writer import RecordingWriter
from skywright.run.backends import build_vehicle

TICKS = 30  # mission ticks, 20 ms each: the robot stands on the ground
NAMES = ["/sensors/inertial", "/sensors/mocap/platform", "/sensors/mocap/tip", "/sensors/laser"]
LASER = {"robot.sensors.laser.kind": "tip_distance", "robot.sensors.laser.rate_hz": 25.0}


def record(path: Path, **sets: Any) -> Path:
    named = {key.replace("__", "."): value for key, value in sets.items()}
    vehicle = build_vehicle(load_description("waypoints", "othex", sets=LASER | named))
    with RecordingWriter(path, *vehicle.recorded) as writer:
        vehicle.on_samples, vehicle.on_stream = writer.append, writer.append_stream
        for _ in range(TICKS):
            vehicle.tick()
        vehicle.flush()
    return path


def test_raw_samples_come_at_the_rates_of_their_sensors(tmp_path: Path) -> None:
    near = read_recording(record(tmp_path / "near.mcap"), streams=NAMES)
    assert near.complete
    imu = near.streams["/sensors/inertial"]
    assert len(imu) >= 20 * TICKS - 10
    np.testing.assert_allclose(np.diff(imu["t"]), 0.001, atol=2e-9)
    assert np.linalg.norm(imu["accel"].mean(axis=0)) == pytest.approx(9.81, abs=0.3)
    mocap = near.streams["/sensors/mocap/platform"]
    steps = np.diff(mocap["t"]) / 0.01  # some samples are dropped out
    assert len(mocap) > 2 * TICKS - 6
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.median(steps) == pytest.approx(1.0)
    np.testing.assert_allclose(mocap["p_WB"].mean(axis=0), near.samples["p_WB"][-1], atol=1e-3)
    np.testing.assert_allclose(np.abs(mocap["q_WB"] @ near.samples["q_WB"][-1]), 1.0, atol=1e-4)
    laser = near.streams["/sensors/laser"]
    np.testing.assert_allclose(np.diff(laser["t"]), 0.04, atol=1e-9)

    late = read_recording(
        record(tmp_path / "late.mcap", world__link__delay_s=0.05, world__link__loss_fraction=0.3),
        streams=NAMES,
    )
    for name in NAMES:  # as the sensors made them: none late, none lost
        np.testing.assert_array_equal(late.streams[name]["t"], near.streams[name]["t"])
    # the first angles arrived before the start: no servo runs to what it takes for an error
    np.testing.assert_allclose(late.samples["cmd_qd"][:6], near.samples["cmd_qd"][:6], atol=0.1)
    # the same noise; what the servos are told late moves the robot a little
    seen = late.streams["/sensors/mocap/platform"]["p_WB"]
    np.testing.assert_allclose(seen, mocap["p_WB"], atol=2e-4)


def test_raw_samples_may_be_left_out(tmp_path: Path) -> None:
    path = record(tmp_path / "r.mcap", mission__record_raw=False)
    with pytest.raises(InputError, match="has no stream"):
        read_recording(path, streams=NAMES)
