"""Carry a long bar through pipe structures with both hands (Caballero et al. 2018).

Platform and arms are planned together and the plan is flown as it is. The flight begins in the
air: the robot is held where the plan begins, the bar in its closed grippers, and let go. It ends
hovering at the goal: neither take-off and landing nor handing the bar over is part of it.
"""

from skywright.missions.bar_transport.task import BarTransport
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

STEADY_S = 4.0  # s, of hovering before the bar is carried: wind and weight are felt out
SETTLE_S = 3.0  # s, at the goal


def fly(s: Supervisor[BarTransport], way: None) -> Flight:
    """Take the plan's first pose, carry, settle."""
    table = s.segments["transport"]
    n = s.vehicle.n_joints
    s.begin("start pose")
    s.arms.move_to(table[0]["q"][:n])
    s.until_arrived()
    s.body.track(table[:1])
    s.wait(STEADY_S)
    s.begin("transport")
    s.body.track(table)
    s.until_arrived()
    s.begin("settle")
    s.wait(SETTLE_S)
    return Flight(True, "")
