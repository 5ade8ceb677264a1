"""Live rows: filled by the flight, completed and encoded by the publishing process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_from_quat
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.links.broadcast.topics import EXTRA, STATES, list_live_topics, list_part_columns
from skywright.models.drawing import (
    Drawing,
    build_drawing,
    compute_part_poses,
    get_opening,
    list_object_poses,
)
from skywright.recordings.columns import Column, Topic, build_dtype
from skywright.recordings.mcap_file import build_message_header
from skywright.recordings.sample_rows import build_rows, compute_stamp
from skywright.vehicle.commands import State

Row = NDArray[Any]
ROW = b"row "
"""Prefix of the datagram of a row."""
HEADER = len(build_message_header(0, 0, 0))


class Setup(NamedTuple):
    """Data of a flight that the publishing process receives once."""

    mission: str
    robot: Robot
    world: World  # as it is
    error: NDArray[np.float64]  # argument of build_drawing
    columns: tuple[Column, ...]  # of a sample
    recorded: tuple[Topic, ...]
    joints: tuple[str, ...]
    urdf: str


class Filler:
    """Builds live rows from samples, without the columns that the publishing process computes."""

    def __init__(self, columns: Sequence[Column]) -> None:
        """`columns` are those of a sample."""
        self._sample = build_dtype(columns)
        self._extra = np.zeros(1, build_dtype(EXTRA))

    def fill(self, sample: Row, state: State, charge: float) -> bytes:
        """Return the bytes of the live row of a sample (1,)."""
        assert sample.dtype == self._sample
        self._extra["live_state"], self._extra["live_charge"] = STATES[state], charge
        return ROW + sample.tobytes() + self._extra.tobytes()


class Encoder:
    """Encodes one topic's message of a live row."""

    def __init__(self, topic: Topic, dtype: np.dtype[Any]) -> None:
        self.topic = topic
        self._rows = build_rows([(0, topic)], dtype)

    def encode(self, row: Row, ns: NDArray[np.uint64]) -> bytes:
        """Return the message of a row (1,) with its stamps at `ns` (1,)."""
        return self._rows.encode(row, ns).tobytes()[HEADER:]


class Reader:
    """Completes live rows, and encodes them by topic."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.drawing: Drawing = build_drawing(setup.robot, setup.world, setup.error)
        self._sent = build_dtype([*setup.columns, *EXTRA])
        parts = list_part_columns(self.drawing)
        dtype = build_dtype([*setup.columns, *EXTRA, *parts])
        self.row = np.zeros(1, dtype)
        topics = list_live_topics(setup.columns, setup.recorded, setup.joints, self.drawing)
        self.encoders = {t.name: Encoder(t, dtype) for t in topics}
        self.ns = np.zeros(1, np.uint64)

    def read(self, data: bytes) -> bool:
        """Accept a live row; return whether it is valid."""
        if len(data) != self._sent.itemsize:
            return False
        sent, row = np.frombuffer(data, self._sent), self.row
        t = float(sent["t"][0])
        place = "est_p_WB" if "est_p_WB" in row.dtype.names else "p_WB"
        if not (np.isfinite(t) and t >= 0.0 and np.isfinite(sent[place]).all()):
            return False
        for name in self._sent.names or ():
            row[name] = sent[name]
        self.ns[0] = round(1e9 * t)
        row["live_stamp"] = compute_stamp(self.ns)
        self._complete()
        return True

    def encode(self, name: str) -> bytes:
        """Return the message of a topic for the newest row."""
        return self.encoders[name].encode(self.row, self.ns)

    def _complete(self) -> None:
        """Fill in the estimated poses of the robot's parts."""
        row = self.row
        p, q = row["p_WB"], row["q_WB"]
        if "est_p_WB" in row.dtype.names:
            p, q = row["est_p_WB"], row["est_q_WB"]
            row["live_v_B"] = rot_from_quat(np.ascontiguousarray(q[0])).T @ row["est_v_WB"][0]
        poses = compute_part_poses(
            self.drawing,
            p,
            q,
            np.asarray(row["q"], float),
            row["spring"],
            list_object_poses(row),
            get_opening(row),
        )
        for i, (position, quaternion) in enumerate(poses):
            row[f"part{i}_p"], row[f"part{i}_q"] = position, quaternion
