"""What a mission of the kind "sensor-install" may say."""

from typing import Literal

from pydantic import Field

from skywright.description.mission.spec import Task


class SensorInstall(Task):
    """Press a sensor on a pipe from below with the left hand (Suarez 2020, section VI-B).

    `pose` is that of the pressing arm: "L" (upper arm down, forearm level: first trial) or
    "stretched" (elbow almost straight: second trial).
    """

    force_n: float = Field(default=2.0, gt=0, le=10)
    hold_s: float = Field(default=5.0, gt=0, le=600)
    pose: Literal["L", "stretched"] = "L"
    leave_singularity: bool = False  # the platform moves so that the arm returns to a good pose
    stand_off_m: float = Field(default=0.05, gt=0, le=0.3)  # hand below the pipe before touching
    approach_below_m: float = Field(default=0.25, gt=0, le=1)  # hand below the pipe on the way in
    hand_speed_mps: float = Field(default=0.05, gt=0, le=0.5)
    hover_s: float = Field(
        default=50.0, ge=0, le=3600
    )  # the hand tracks a fixed point for so long; 0: left out
    survey: bool | None = None  # touch the pipe first; default: where plant.map_error_* is not zero
    swing_deg: float = Field(default=10.0, ge=0, le=30)  # the link is let go from here; 0: left out
    # of the link's own motion in gusts, that a swing which dies out must leave room for
    swing_sigmas: float = Field(default=2.0, ge=0, le=6)
