"""Time that the arm on its bench takes in addition to its moves: presses, waits."""

from skywright.missions.arm_test_bench.fly import SETTLE_S
from skywright.missions.arm_test_bench.task import BenchTask
from skywright.missions.skills.pressing import compute_feet_lag, compute_press_s
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[BenchTask], plan: MissionPlan[None]) -> float:
    """Return the time (s) of the staircase of forces and of the rests."""
    task, lag = setup.task, compute_feet_lag(setup.robot)
    return 4.0 * SETTLE_S + compute_press_s(task, len(task.forces_n), task.hold_s, lag)
