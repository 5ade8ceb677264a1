"""Keys of a mission of the kind "sensor-install"."""

from typing import Literal

from pydantic import Field

from skywright.missions.skills.clearances import Clearances
from skywright.missions.skills.operated import OperatedTask


class SensorInstall(OperatedTask, Clearances):
    """Press a sensor on a pipe from below with the left hand (Suarez 2020, section VI-B).

    `pose` is that of the pressing arm: "L" (upper arm down, forearm level: first trial) or
    "stretched" (elbow almost straight: second trial).
    """

    force_n: float = Field(default=2.0, gt=0, le=10)  # pressing force
    hold_s: float = Field(default=5.0, gt=0, le=600)  # time for which the force is held
    pose: Literal["L", "stretched"] = "L"  # pose of the pressing arm
    # what an operator's stick commands in contact: the hand's position, or its force
    control: Literal["position", "force"] = "position"
    leave_singularity: bool = False  # the platform moves so that the arm leaves a singular pose
    # distance of the hand below the pipe before contact
    stand_off_m: float = Field(default=0.05, gt=0, le=0.3)
    # distance of the hand below the pipe on the approach path
    approach_below_m: float = Field(default=0.25, gt=0, le=1)
    hand_speed_mps: float = Field(default=0.05, gt=0, le=0.5)  # speed of the hand
    hover_s: float = Field(
        default=50.0, ge=0, le=3600
    )  # time for which the hand tracks a fixed point before; 0: none
    survey: bool | None = None  # touch the pipe first; default: if plant.map_error_* is not 0
    # initial angle of the released link in the swing test; 0: no test
    swing_deg: float = Field(default=10.0, ge=0, le=30)
    # margin of the decaying swing, in standard deviations of the link's motion in gusts
    swing_sigmas: float = Field(default=2.0, ge=0, le=6)
