"""Fly into a padded obstacle with the left hand or with the passive link (Suarez 2020, table 3).

The robot flies at a constant speed and does not detect the obstacle: its reference continues for
the reaction time after the planned contact, stops, and backs off later. This is a flight rather
than an object thrown at a hovering robot. The energy that arm, springs and link absorb is then the
robot's own at that speed, no projectile's mass has to be assumed, and the flight law takes part.
"""

import numpy as np

from skywright.core.arrays import Table
from skywright.missions.impact.plan import (
    CRUISE_S,
    RECOIL_S,
    REST_S,
    RETREAT_M,
    SPEED_UP_S,
    ImpactPlan,
)
from skywright.missions.impact.task import Impact
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

CALM_S = 4.0  # s, of hover before the run-up
ZERO_S = 0.2  # s, before the planned contact, over which the gauges are tared


def _build_table(s: Supervisor, way: ImpactPlan) -> Table:
    """Return the reference rows of the run."""
    start = np.array(s.vehicle.reference)
    for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
        start[field] = 0.0
    table = np.repeat(start[None], len(way.run))
    table["t"] = way.run[:, 0]
    for field in ("p_WB", "p_WT"):
        table[field] += way.run[:, 1:2] * way.ahead
    for field in ("v_WB", "v_WT"):
        table[field] = way.run[:, 2:3] * way.ahead
    table["a_WB"] = way.run[:, 3:4] * way.ahead
    return table


def fly(s: Supervisor[Impact], way: ImpactPlan) -> Flight:
    """Fly into the pad, stop, fly back."""
    home = np.array(s.vehicle.reference["p_WB"])
    s.begin("impact pose")
    s.arms.move_to(way.q)
    s.until_arrived()
    s.begin("start point")
    s.uav.go_to(way.p_start, way.yaw)
    s.until_arrived()
    s.wait(CALM_S)
    s.begin("run-up")
    s.body.track(_build_table(s, way))
    s.wait(SPEED_UP_S + CRUISE_S - ZERO_S)
    s.devices.gauges.zero()
    s.begin("impact")
    s.until_arrived()
    s.wait(RECOIL_S)
    s.begin("retreat")
    s.uav.go_to(way.p_contact - RETREAT_M * way.ahead, way.yaw)
    s.until_arrived()
    s.wait(REST_S)
    s.begin("return")
    s.uav.go_to(way.p_start, way.yaw)
    s.until_arrived()
    s.uav.go_to(home, way.yaw)
    s.until_arrived()
    return Flight(True, "")
