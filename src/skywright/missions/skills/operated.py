"""Code shared by missions in which an operator moves a hand, a bar or the platform with a stick."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import Field

from skywright.core.arrays import Array, Samples
from skywright.description.mission.spec import Task
from skywright.errors import InputError
from skywright.missions.skills.assistance import Level
from skywright.recordings.columns import has_columns
from skywright.recordings.period import compute_period
from skywright.run.operator import Operator, Recording, Sight, Stick, find_recording, load_recording
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

GRACE_S = 3.0  # s, for which a button held at a recording's end stays held
LONGEST_S = 180.0  # s, longest duration of one stretch of operated work


class OperatedTask(Task):
    """Keys of a task that an operator may control."""

    # recorded operator: a packaged name or a CSV file
    operator: str | None = None
    # speed at full deflection of the stick, v_max of (24)
    stick_speed_mps: float = Field(default=0.03, gt=0, le=0.2)
    # assistance of the operator along the contact's axis: none, slow (speed limit near the
    # contact), guard (slower with the force, no further motion at 1.25 times the requested one),
    # hold (the robot holds the force)
    assistance: Level = "none"

    def find_files(self, folder: Path) -> Self:
        """Replace the name of the operator's recording by its path."""
        if self.operator is None:
            return self
        packaged = Path(str(sys.modules[type(self).__module__].__file__)).parent
        path = find_recording(self.operator, packaged, folder)
        return self.model_copy(update={"operator": path})

    def list_files(self) -> tuple[Path, ...]:
        """Return the operator's recording."""
        return () if self.operator is None else (Path(self.operator),)


def load_operator(task: OperatedTask) -> Recording | None:
    """Load the operator's recording; its speed must equal that of the task."""
    if task.operator is None:
        return None
    recording = load_recording(Path(task.operator))
    v_max = recording.v_max
    if v_max is not None and abs(v_max - task.stick_speed_mps) > 1e-9:
        raise InputError(
            f"{task.operator}: recorded with v_max_mps = {v_max:g}, but "
            f"mission.task.stick_speed_mps is {task.stick_speed_mps:g}; set it to {v_max:g}"
        )
    return recording


class OperatorGone(Exception):
    """The operator's input ended, or a stretch took longer than LONGEST_S."""


class Lead:
    """An operator during a flight: reads the stick and records it, tick by tick.

    Its time runs only while the operator has control, over several stretches of a flight.
    """

    def __init__(self, s: Supervisor, operator: Operator) -> None:
        self.s, self._operator = s, operator
        self._ticks, self._began, self._piece = 0, 0, -1
        self._last: Stick | None = None
        self._ended = 0.0  # s since the recording's end

    def begin(self) -> None:
        """Begin a stretch: its time starts at zero, and a recording replays its rows."""
        self._began, self._piece = self._ticks, self._piece + 1
        self._last, self._ended = None, 0.0
        t = self._ticks * MISSION_TICK
        self.s.stretches.append(t)
        if isinstance(self._operator, Recording):
            self._operator.begin(self._piece, t)

    def read(self, sight: Sight) -> Stick:
        """Return the stick of this tick. Raises OperatorGone."""
        s, t = self.s, self._ticks * MISSION_TICK
        if (self._ticks - self._began) * MISSION_TICK > LONGEST_S:
            raise OperatorGone(f"the operator took more than {LONGEST_S:g} s")
        stick = self._operator.read(t, sight)
        if stick is None:
            self._ended += MISSION_TICK
            if self._last is None or not self._last.button or self._ended > GRACE_S:
                raise OperatorGone("the operator's input ended")
            stick = Stick(np.zeros(3), True)
        s.sticks.append((t, stick))  # every tick: a recording has no gaps
        self._last = stick
        self._ticks += 1
        s.vehicle.set_stick(stick.axes, stick.button)
        return stick

    def end(self) -> None:
        """End a stretch: the recorded stick is at rest."""
        self.s.vehicle.set_stick(np.zeros(3), False)


def compute_velocity(axes: Array, v_max: float, goal: Array, fence: Array) -> Array:
    """Return the velocity (3,) m/s of (24), v_max [dx, dy, dz], limited by the fence.

    `goal` (3,) m is the present goal, `fence` (2, 3) m its lower and upper bounds. A component that
    would move the goal out of the fence is set to zero.
    """
    v = v_max * axes
    ahead = goal + MISSION_TICK * v
    out = ((ahead < fence[0]) & (v < 0.0)) | ((ahead > fence[1]) & (v > 0.0))
    return np.where(out, 0.0, v)


def measure_operated(samples: Samples, force: Array) -> dict[str, float]:
    """Return the duration of `samples` under operator control and the largest `force` (n,) N.

    The phases of `samples` need not be contiguous: other phases between them do not count.
    Returns {} if the stick did not move.
    """
    if not has_columns(samples, "operator_stick") or not np.any(samples["operator_stick"]):
        return {}
    return {
        "operator.time_s": compute_period(samples["t"]) * len(samples),
        "operator.force_max_n": float(np.max(force)),
    }


OPERATED_MEASURES = {
    "operator.time_s": ("s", "time under operator control"),
    "operator.force_max_n": ("N", "largest true contact force under operator control"),
}
