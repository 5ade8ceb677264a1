"""Carry a long bar through pipe structures with both hands (Caballero et al. 2018).

Platform and arms are planned together, and the plan is flown unchanged. The flight begins in the
air: the robot is held at the first pose of the plan, with the bar in its closed grippers, and
released. It ends in hover at the goal. Take-off, landing and handing over the bar are not part of
it.
"""

from skywright.missions.bar_transport.task import BarTransport
from skywright.missions.skills.planned_path import fly_path
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

STEADY_S = 4.0  # s of hover before the transport: the integrals settle to wind and weight
SETTLE_S = 3.0  # s, at the goal


def fly(s: Supervisor[BarTransport], way: None) -> Flight:
    """Move to the plan's first pose, carry, settle."""
    return fly_path(s, "transport", STEADY_S, SETTLE_S)
