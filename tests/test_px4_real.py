"""Flights of a real PX4, where SKYWRIGHT_PX4 names its SITL binary (BUILD/bin/px4).

Without it they are deselected (marker px4). They take a minute each, at real time.
"""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from skywright.core.rotations import rot_from_quat
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.links.px4.parameters import build_airframe
from skywright.recordings.recording import read_recording
from skywright.run.run import run_mission

pytestmark = pytest.mark.px4
FIRST_S = 1.0
"""s, PX4's clock at the start of the plant."""
POSITION_AND_YAW = 0b100111111000  # type_mask of a set-point
OFFBOARD_PORT = 14540
EAST = 0.5 * math.pi
POINTS = [
    (0.0, 0.0, 1.5, EAST), (1.0, 0.0, 1.5, EAST), (1.0, 1.0, 2.0, EAST + 0.8),
    (0.0, 0.0, 1.2, EAST),
]  # fmt: skip
"""North, east, up (m), heading (rad)."""


class Offboard:
    """An offboard program."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", OFFBOARD_PORT))
        self.socket.settimeout(0.02)
        self.mav, self.parser = common.MAVLink(None, 255, 190), common.MAVLink(None)
        self.parser.robust_parsing = True
        self.peer: Any = None
        self.position: Any = None
        self.t, self.armed, self.heard = 0.0, False, list[str]()

    def poll(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                data, self.peer = self.socket.recvfrom(4096)
            except TimeoutError:
                continue
            for m in self.parser.parse_buffer(data) or []:
                kind = m.get_type()
                if kind == "LOCAL_POSITION_NED":
                    self.t, self.position = 1e-3 * m.time_boot_ms - FIRST_S, (m.x, m.y, -m.z)
                elif kind == "HEARTBEAT" and m.get_srcComponent() == 1:
                    self.armed = bool(m.base_mode & 128)
                elif kind == "STATUSTEXT":
                    self.heard.append(m.text)

    def send(self, message: Any) -> None:
        if self.peer is not None:
            self.socket.sendto(message.pack(self.mav), self.peer)
            self.mav.seq = (self.mav.seq + 1) % 256

    def lead(self, point: tuple[float, ...]) -> None:
        north, east, up, heading = point
        self.send(common.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, POSITION_AND_YAW, north, east, -up, 0, 0, 0, 0, 0, 0, heading, 0
        ))  # fmt: skip

    def command(self, number: int, *values: float) -> None:
        full = [*values, *([0.0] * (7 - len(values)))]
        self.send(common.MAVLink_command_long_message(1, 1, number, 0, *full))

    def wait(self, what: Any, seconds: float, point: tuple[float, ...] | None = None) -> bool:
        end = time.monotonic() + seconds
        while not what():
            if time.monotonic() > end:
                return False
            if point is not None:
                self.lead(point)
            self.poll(0.04)
        return True

    def arm(self) -> bool:
        """Change to offboard and arm, again and again until PX4 is ready."""
        for _ in range(40):
            for _ in range(10):
                self.lead(POINTS[0])
                self.poll(0.05)
            self.command(176, 1, 6)
            self.command(400, 1)
            if self.wait(lambda: self.armed, 1.0, POINTS[0]):
                return True
        return False


def start_px4(tmp_path: Path, own: list[str], speed: float) -> subprocess.Popen[bytes]:
    """Start PX4 with the parameters that the command `own` prints."""
    binary = Path(os.environ["SKYWRIGHT_PX4"])
    px4 = tmp_path / "px4"
    (px4 / "params").mkdir(parents=True)
    script = subprocess.run([*own, "--params", "script"], check=True, capture_output=True)
    (px4 / "params" / "px4-rc.params").write_bytes(script.stdout)
    environment = os.environ | {
        "PATH": f"{px4 / 'params'}{os.pathsep}{os.environ['PATH']}", "PX4_SIM_MODEL": "none_iris",
        "PX4_SIM_SPEED_FACTOR": str(speed),
    }  # fmt: skip
    with (tmp_path / "px4.log").open("wb") as log:
        return subprocess.Popen(
            [binary, "-d", binary.parent.parent / "etc", "-w", px4], cwd=px4, env=environment,
            stdin=subprocess.DEVNULL, stdout=log, stderr=log,
        )  # fmt: skip


@contextmanager
def running(tmp_path: Path, robot: str, *more: str, speed: float = 1.0) -> Iterator[None]:
    """Run the simulator and PX4; both have ended afterwards."""
    own = [sys.executable, "-m", "skywright", "sitl", robot, *more]
    simulator = subprocess.Popen([*own, "--speed", str(speed), "--out", str(tmp_path / "run")])
    autopilot = start_px4(tmp_path, own, speed)
    try:
        yield
    finally:
        simulator.send_signal(signal.SIGINT)
        code = simulator.wait(60.0)
        autopilot.kill()
        autopilot.wait(10.0)
    assert code == 0


def test_px4_flies_a_mission_in_the_loop(tmp_path: Path) -> None:
    """With the requirements of its simulated version."""
    mission = "waypoints"
    d = load_description(mission)
    own = [sys.executable, "-m", "skywright", "sitl", d.robot.name, "--mission", mission]
    autopilot = start_px4(tmp_path, [*own, "--world", d.world.name], 1.0)
    try:
        result = run_mission(d, backend="px4?speed=max", out=tmp_path / "run")
    finally:
        autopilot.kill()
        autopilot.wait(10.0)
    print({r.name: r.value for r in result.requirements})
    assert result.outcome == "succeeded", result.reason


@pytest.mark.parametrize(
    ("robot", "speed", "more"),
    [
        ("hexarotor", 1.0, ()),
        ("hexarotor", 3.0, ()),
        ("othex", 1.0, ()),
        ("bimanual-longreach", 1.0, ()),
    ],
)
def test_px4_takes_off_reaches_four_set_points_and_lands(
    tmp_path: Path, robot: str, speed: float, more: tuple[str, ...]
) -> None:
    windows = []
    with running(tmp_path, robot, *more, speed=speed):
        offboard = Offboard()
        assert offboard.wait(lambda: offboard.position is not None, 180.0)
        assert offboard.arm(), offboard.heard
        for point in POINTS:
            end = offboard.t + 12.0
            assert offboard.wait(lambda end=end: offboard.t > end, 120.0, point)
            windows.append((end - 3.0, end, point))
        offboard.command(21)
        assert offboard.wait(lambda: not offboard.armed, 120.0)
        offboard.socket.close()
    samples = read_recording(tmp_path / "run" / "recording.mcap").samples
    p_BC = build_airframe(load_robot(robot, [])[0], load_world("open")[0]).p_BC
    for start, end, (north, east, up, _) in windows:
        held = samples[(samples["t"] > start) & (samples["t"] < end)]
        centre = held["p_WB"] + np.array([rot_from_quat(q) @ p_BC for q in held["q_WB"]])
        far = np.linalg.norm(centre - [east, north, up], axis=1)
        print(f"{robot} x{speed}: {far.max():.3f} m from ({north}, {east}, {up})")
        assert far.max() < 0.2
    assert samples["p_WB"][-1, 2] < 0.4  # landed
    flown = samples[(samples["autopilot_armed"] > 0.5) & (samples["autopilot_heard"] > 0.5)]
    off = np.linalg.norm(flown["autopilot_p_WB"] - flown["p_WB"], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.05  # the estimate beside the truth
