"""What a mission of the kind "bar-insertion" may say."""

from typing import Literal

from pydantic import Field

from skywright.core.spec import Positive
from skywright.description.mission.spec import Task


class BarInsertion(Task):
    """Put the peg below a bar into the socket: (29) to (31) of Suarez 2020."""

    bar: str = "peg"  # names of the things: the bar with its peg, where it stands, where it goes
    rack: str = "rack"
    socket: str = "socket"
    bar_pose: Literal["marker", "hands"] = "marker"
    """(29), (30) of the hands tell the bar's pose; the marker on the bar corrects them all the time
    ("marker"), or only until the bar has left the rack ("hands")."""
    payload_max_kg: Positive = 0.6  # Table 2: 0.3 kg each arm
    tries: int = Field(default=6, ge=1, le=50)  # of the insertion
    grasp_retries: int = Field(default=2, ge=0, le=10)
    gamma: float = Field(default=0.3, gt=0, lt=1)  # of (31)
    lower_speed_mps: Positive = 0.03  # of the platform, with the peg over the hole
    press_share: float = Field(default=0.7, gt=0, le=0.95)  # of the bar's weight, in the hole
    align_m: Positive = 0.0015  # of the peg's tip across the hole, before it is lowered
    align_deg: Positive = 1.0  # of the bar's direction
    hand_speed_mps: Positive = 0.05
    lift_speed_mps: Positive = 0.03  # of the platform, while the load passes from or to the hands
