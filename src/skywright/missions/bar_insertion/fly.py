"""Put the peg below a bar into a hole, the bar held by both hands, in flight.

The bar hangs in the hooks of both arms: contact alone, and only upward. The peg points down, so
that the bar's own weight presses it in: the hands let go of as much of it as (31) asks for, and
lead the bar by (29), (30) meanwhile. Where the hole is, motion capture says to a millimetre; the
rest is done by the chamfer, the springs of the arms, and trying again (docs/howto/insert-a-bar.md).
"""

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.bar_insertion.bar_leading import BarLeader
from skywright.missions.bar_insertion.insertion import build_hole, find_offset, insert, survey
from skywright.missions.bar_insertion.operated_insertion import insert_by_operator
from skywright.missions.bar_insertion.plan import BACK, InsertionPlan
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.tool_handling import (
    DROP,
    LIFT,
    LOW,
    NEAR_SPEED,
    STEADY_S,
    Grip,
    Place,
    find_platform,
    find_tool,
    hold_joints,
    lead_hands,
    let_go,
    move_platform,
    put_down,
    take_up_again,
)
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

RELEASE_S = 1.5  # s, in which the hands let the weight go
CARRY_SPEED, CARRY_ACCELERATION = 0.3, 0.2


def fly(s: Supervisor[BarInsertion], way: InsertionPlan) -> Flight:
    """Fly the phases between take-off and landing."""
    task = s.task
    speeds = (task.hand_speed_mps, task.lift_speed_mps)
    s.begin("approach rack")
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    _go_behind(s, way.grip, way.rack, s.vehicle.limits.speed)
    s.begin("survey")
    hole, R_WS = survey(s, s.task.socket)
    s.begin("reach under")
    move_platform(
        s, find_platform(way.grip, find_tool(s)) - [0.0, 0.0, DROP], way.rack.yaw, NEAR_SPEED
    )
    lead_hands(s, way.grip, -LOW, 0.05)
    s.wait(STEADY_S)
    weight = take_up_again(s, way.grip, way.most_n, task.grasp_retries, speeds)
    if weight is None:
        _return(s, way, way.rack)
        return Flight(False, "the bar could not be grasped")
    s.begin("carry")
    above = find_platform(way.grip, hole) + [0.0, 0.0, LIFT]
    move_platform(s, above, hole.yaw, CARRY_SPEED, CARRY_ACCELERATION)
    leader = BarLeader(s, way.grip, way.chains, weight)
    leader.correct = task.bar_pose == "marker"
    opening, missed, found = build_hole(s, hole.p_WO, R_WS, way.grip, s.task), 0, ""
    if s.operator is not None:
        found = insert_by_operator(s, s.operator, leader, opening)
    for _ in range(task.tries if s.operator is None else 0):
        found = insert(s, leader, opening, find_offset(missed, opening.capture), task)
        if found == "in" or leader.lost:
            break
        missed += found == "missed"
    if found != "in" and leader.lost:
        let_go(s, way.grip, speeds[0])  # hooks that are still in the mouths would take it along
        _return(s, way, hole)
        return Flight(False, "the bar was lost at the socket")
    if found != "in":
        laid_down = _lay_down(s, way, above, hole.yaw, weight, speeds)
        _return(s, way, way.rack)
        where = "is back in the rack" if laid_down else "did not reach the rack either"
        told = found if s.operator else f"the peg was not inserted in {task.tries} tries"
        return Flight(False, f"{told}: the bar {where}")
    _set_free(s, leader)
    let_go(s, way.grip, speeds[0])
    _return(s, way, hole)
    return Flight(True, "")


def _lay_down(
    s: Supervisor, way: InsertionPlan, above: Array, yaw: float, weight: float,
    speeds: tuple[float, float],
) -> bool:  # fmt: skip
    """Carry the bar from over the socket (`above` (3,) m, of the platform) back into the rack.

    Returns whether it stands there.
    """
    s.begin("carry back")
    hold_joints(s)
    move_platform(s, above, yaw, NEAR_SPEED)
    back = find_platform(way.grip, way.rack) + [0.0, 0.0, LIFT]
    move_platform(s, back, way.rack.yaw, CARRY_SPEED, CARRY_ACCELERATION)
    return put_down(s, way.grip, way.rack, weight, speeds, "lay down")


def _set_free(s: Supervisor, leader: BarLeader) -> None:
    """Let the weight pass from the hands to the socket."""
    s.begin("set free")
    hold_joints(s)
    steps = round(RELEASE_S / MISSION_TICK)
    for k in range(steps):
        row = np.array(s.vehicle.reference)
        row["t"], row["load"] = 0.0, 0.5 * leader.carried * (1.0 - (k + 1) / steps)
        s.body.track(row[None])
        s.tick()


def _go_behind(s: Supervisor, grip: Grip, place: Place, speed: float) -> None:
    p = find_platform(grip, place) - BACK * rot_z(place.yaw)[:, 0] - [0.0, 0.0, DROP]
    move_platform(s, p, place.yaw, speed)


def _return(s: Supervisor, way: InsertionPlan, place: Place) -> None:
    """Draw back from a bar that stands at `place`, fly home, and lift the arms."""
    s.begin("return")
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    _go_behind(s, way.grip, place, NEAR_SPEED)
    move_platform(s, way.home[:3], float(way.home[3]), s.vehicle.limits.speed)
    s.begin("lift arms")
    s.arms.move_to(way.folded)
    s.until_arrived()
