"""Keys of a mission of the kind "bar-insertion"."""

from typing import Literal

from pydantic import Field

from skywright.core.spec import Positive
from skywright.missions.skills.operated import OperatedTask


class BarInsertion(OperatedTask):
    """Insert the peg below a bar into the socket: (29) to (31) of Suarez 2020."""

    bar: str = "peg"  # name of the thing that is the bar with its peg
    rack: str = "rack"  # name of the thing in which the bar initially stands
    socket: str = "socket"  # name of the thing that has the hole
    # where the bar's pose comes from: hands and a marker, or hands alone
    bar_pose: Literal["marker", "hands"] = "marker"
    """(29), (30) compute the bar's pose from the hands; the marker on the bar corrects it always
    ("marker"), or only until the bar has left the rack ("hands")."""
    # largest mass of the bar; 0.3 kg each arm (Suarez 2020, table 2)
    payload_max_kg: Positive = 0.6
    tries: int = Field(default=6, ge=1, le=50)  # number of attempts to insert the peg
    grasp_retries: int = Field(default=2, ge=0, le=10)  # how often a failed grasp is repeated
    gamma: float = Field(default=0.3, gt=0, lt=1)  # share of force control in (31) of Suarez 2020
    lower_speed_mps: Positive = 0.03  # speed at which the platform lowers the peg
    # share of the bar's weight that presses the peg into the hole
    press_share: float = Field(default=0.7, gt=0, le=0.95)
    # largest error of the peg's tip across the hole before it is lowered
    align_m: Positive = 0.0015
    align_deg: Positive = 1.0  # largest error of the bar's direction before the peg is lowered
    hand_speed_mps: Positive = 0.05  # speed limit of the hands
    # clearance from all obstacles: a hand deviates by up to 0.012 m in hover (sensor-install,
    # tool-install)
    near_clearance_m: float = Field(default=0.02, ge=0.002, le=0.3)
    # speed of the platform while the load passes to or from the hands
    lift_speed_mps: Positive = 0.03
