"""The recording of a flight: the vehicle's columns and topics, and the transforms for viewers."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from skywright.description.robot.spec import Robot
from skywright.models.link_frames import LinkFrames
from skywright.models.rigid_body import joint_names
from skywright.models.urdf import build_urdf
from skywright.recordings.writer import RecordingWriter
from skywright.run.faults._rule import Acted
from skywright.vehicle.simulated import Recorded

EVERY = 2
"""Samples between transforms of the links: 50 Hz; viewers interpolate."""


class Pace:
    """Schedule of writes: every 1 s to 5 s of flight, 0.5 s of wall time apart."""

    SOON_S, LATE_S, WALL_S = 1.0, 5.0, 0.5

    def __init__(self) -> None:
        self._t, self._wall = 0.0, time.monotonic()

    def is_due(self, t: float) -> bool:
        """Whether a write is due at mission time `t` (s)."""
        since = t - self._t
        if since < self.SOON_S:
            return False
        now = time.monotonic()
        if since < self.LATE_S and now < self._wall + self.WALL_S:
            return False
        self._t, self._wall = t, now
        return True


class FlightRecording(RecordingWriter):
    """recording.mcap in a run's directory, with its mission.toml."""

    def __init__(self, folder: Path, robot: Robot, recorded: Recorded) -> None:
        joints, urdf = joint_names(robot), build_urdf(robot)
        self._frames = LinkFrames(urdf, joints, recorded.columns)
        self._skip = 0  # samples before the next transforms
        super().__init__(
            folder / "recording.mcap", recorded.columns, recorded.topics,
            [self._frames.stream, *recorded.streams],
            {"joint_names": joints, "n_rotors": len(robot.rotors.azimuth_deg)},
        )  # fmt: skip
        self.attach("mission.toml", (folder / "mission.toml").read_bytes())
        self.text("/robot_description", 0.0, urdf, latched=True)
        if self._frames.fixed:
            self.message(self._frames.static, 0.0, self._frames.list_static(), latched=True)

    def append(self, samples: NDArray[Any]) -> None:
        """Append samples, and the transforms at every EVERY-th of them."""
        super().append(samples)
        shown = samples[self._skip :: EVERY]
        self._skip = (self._skip - len(samples)) % EVERY
        if len(shown):
            self.append_stream("/tf", self._frames.compute(shown))

    def phase(self, t: float, name: str, ended: str = "done") -> None:
        """Record that a phase began at `t` (s), and how the one before it `ended`."""
        if ended != "done":
            self.event(t, f"ended {ended}")
        self.text("/mission/phase", t, name)
        self.event(t, f"phase {name}")

    def acted(self, acted: Acted) -> None:
        """Record that a rule acted."""
        self.text("/mission/fault", acted.t_s, f"{acted.rule}: {acted.response}")
        self.event(acted.t_s, f"rule {acted.rule}: {acted.says}")
