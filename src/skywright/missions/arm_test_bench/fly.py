"""Run of the mission on the arm's test bench (Sanchez-Cuevas 2020, section 5.2).

The arm of a clamped platform presses a staircase of forces: rest at gamma = (95, 152) deg,
inspection position (61, 55) deg near the surface, force control.
"""

from skywright.missions.arm_test_bench.plan import find_joints
from skywright.missions.arm_test_bench.task import BenchTask
from skywright.missions.skills.pressing import Presser
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

SETTLE_S = 1.0


def fly(s: Supervisor[BenchTask], way: None) -> Flight:
    """Execute rest, inspection position, staircase and rest; return the result."""
    task = s.task
    bench = Presser(s, task)
    s.begin("start")
    s.wait(SETTLE_S)
    bench.go("rest", q=find_joints(task.rest_deg))
    s.wait(SETTLE_S)
    bench.go("inspection position", q=find_joints(task.inspection_deg))
    s.wait(SETTLE_S)
    # the law treats a clamped platform as docked with unloaded feet
    reason = bench.press("bench", "clamped", task.forces_n, "", lambda _: {"docked": 1.0})
    bench.go("back to rest", q=find_joints(task.rest_deg))
    s.wait(SETTLE_S)
    return Flight(not reason, reason)
