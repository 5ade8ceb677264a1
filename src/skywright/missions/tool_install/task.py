"""Keys of a mission of the kind "tool-install"."""

from pydantic import Field

from skywright.core.spec import Coordinate, NonNegative, Positive
from skywright.missions.skills.clearances import Clearances
from skywright.missions.skills.operated import OperatedTask


class ToolInstall(OperatedTask, Clearances):
    """Install the inspection tool on the pipe, wait, retrieve it (Suarez 2020, section VI-A)."""

    tool: str = "tool"  # name of the thing that is installed
    along_pipe_m: Coordinate = 0.0  # place on the pipe, along the axis from its middle
    # with an operator at the stick: whether the operator or the robot takes the tool from the pipe
    retrieve_by_hand: bool = True
    wait_s: NonNegative = 10.0  # time for which the tool stays on the pipe
    hover_s: NonNegative = 50.0  # time for which the hands track the grasp points before the grasp
    # largest mass of the tool; 0.3 kg each arm (Suarez 2020, table 2)
    payload_max_kg: Positive = 0.6
    # clearance to the tool until the hands hold it, with the lean and the motion in the wind: the
    # arm's length has an error of 4 mm, and 20 % more drag leans the robot by as much (plant)
    wind_clearance_m: float = Field(default=0.008, ge=-0.05, le=0.05)
    # clearance of the carried tool from all obstacles: in gusts (Dryden, 2 m/s) it deviates by up
    # to 0.04 m from its nominal position under the platform
    carried_clearance_m: float = Field(default=0.04, ge=0.005, le=0.5)
    retries: int = Field(default=2, ge=0, le=10)  # how often a failed grasp is repeated
    hand_speed_mps: float = Field(default=0.05, ge=0.01, le=0.2)  # speed limit of the hands
    # speed of the platform while the load passes to or from the hands
    lift_speed_mps: float = Field(default=0.03, ge=0.01, le=0.1)
