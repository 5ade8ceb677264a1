"""Estimates the duration of a flight before take-off.

The parts are those of `Supervisor.fly`: the time on the ground, take-off, the kind's work, landing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from skywright.run.faults._response import LANDED_S
from skywright.run.kind import load_kind
from skywright.run.setup import Setup
from skywright.vehicle.interface import build_limits
from skywright.vehicle.link_arc import compute_link_arc
from skywright.vehicle.motions import SPIN_S
from skywright.vehicle.moves import compute_landing_s, compute_take_off_s

if TYPE_CHECKING:
    from skywright.run.planning import MissionPlan

SPIN_UP = 1.0  # s, motors off on the ground while the estimator settles
RELEASE = 3.0  # s, after the robot was released in the air
HOVER = 1.0  # s, of hover after a take-off


class Duration(NamedTuple):
    """Parts of a flight (s)."""

    start: float  # on the ground before take-off
    ascent: float  # take-off or release, and hover
    work: float  # between take-off and landing
    landing: float

    @property
    def total(self) -> float:
        """Duration (s) of the whole flight."""
        return sum(self)


def estimate_duration(setup: Setup[Any], work_s: float) -> Duration:
    """Return the parts of a flight whose kind works for `work_s` (s) between take-off and landing.

    Repeated attempts, faults, pilots and operators are not included.
    """
    mission, robot = setup.description.mission, setup.robot
    kind, limits = load_kind(mission.kind), build_limits(robot)
    if not kind.flies:
        return Duration(0.0, 0.0, work_s, 0.0)
    arc = compute_link_arc(robot, setup.model)
    height = float(setup.hover[2])
    vertical = height - robot.platform.gear_height_m, height, limits, arc
    ascent = RELEASE if kind.held else compute_take_off_s(*vertical) + HOVER
    landing = compute_landing_s(*vertical) + LANDED_S if kind.lands else 0.0
    start = SPIN_UP + (SPIN_S if mission.checklist.spin else 0.0)
    return Duration(start, ascent, work_s, landing)


def estimate_work_s(setup: Setup[Any], plan: MissionPlan[Any]) -> float:
    """Return the time (s) between take-off and landing: the planned motion and what `fly` adds."""
    kind = load_kind(setup.description.mission.kind)
    return plan.duration_s + kind.compute_added_s(setup, plan)
