"""Time that a tool's installation takes in addition to its moves: handling, waits."""

from skywright.missions.skills.tool_handling import STEADY_S
from skywright.missions.skills.tool_motion import Speeds, compute_put_down_s, compute_take_up_s
from skywright.missions.tool_install.motion import ABOVE
from skywright.missions.tool_install.plan import ToolPlan
from skywright.missions.tool_install.task import ToolInstall
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[ToolInstall], plan: MissionPlan[ToolPlan]) -> float:
    """Return the time (s) of two grasps, of setting the tool down twice, and of waits."""
    task = setup.task
    speeds = Speeds(task.hand_speed_mps, task.lift_speed_mps)
    handling = compute_take_up_s(speeds) + compute_put_down_s(speeds, ABOVE)
    return 2.0 * (STEADY_S + handling) + task.hover_s + task.wait_s
