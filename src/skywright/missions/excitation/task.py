"""Keys of a mission of the kind "excitation"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator, model_validator

from skywright.core.spec import NonNegative, Positive
from skywright.description.mission.spec import Task
from skywright.planning.excitation import (
    RAMP,
    Excitation,
    count_lines,
)

LINES = 3  # least number of sines per channel


class ExcitationTask(Task):
    """Motions and their peak amplitudes, which are reduced if the rotors require it."""

    # duration of the excitation in each pose
    duration_s: float = Field(default=40.0, ge=4 * RAMP, le=600)
    # arm poses in which the robot is excited
    poses: list[Literal["folded", "working"]] = Field(default=["folded"], min_length=1)
    tilt_deg: NonNegative = 4.0  # peak of roll and pitch, if the robot can tilt in place
    yaw_deg: NonNegative = 12.0  # peak of the heading
    acceleration_mps2: NonNegative = 0.8  # peak of the acceleration, each axis
    low_hz: Positive = 0.15  # lowest frequency
    high_hz: float = Field(default=1.2, gt=0, le=5)  # highest frequency
    joint_deg: NonNegative = 0.0  # peak of the joints' motion after each pose; 0: none
    # duration of the joints' motion
    joint_duration_s: float = Field(default=20.0, ge=4 * RAMP, le=600)

    @field_validator("poses")
    @classmethod
    def _poses_differ(cls, poses: list[str]) -> list[str]:
        if len(set(poses)) < len(poses):
            raise ValueError("a pose appears twice; valid: each one once")
        return poses

    @model_validator(mode="after")
    def _band_holds_lines(self) -> ExcitationTask:
        for name, channels in (("duration_s", 6), ("joint_duration_s", 2)):
            e = Excitation(getattr(self, name), 0, 0, 0, self.low_hz, self.high_hz)
            if count_lines(e, channels) < LINES:
                least = channels * LINES / max(self.high_hz - self.low_hz, 1e-9) + 2 * RAMP
                raise ValueError(
                    f"{name} = {getattr(self, name):g} with a band of {self.low_hz:g} to "
                    f"{self.high_hz:g} Hz gives too few frequencies to separate "
                    f"directions: use about {least:.0f} s or a wider band"
                )
        return self
