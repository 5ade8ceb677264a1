"""Insert the peg below a bar into a hole in flight, with the bar held by both hands.

The bar is suspended in the hooks of both arms, which support it only upward. The peg points down,
so that the bar's own weight presses it in: the hands reduce the weight that they carry by the force
of (31), and control the bar by (29), (30). Motion capture measures the hole to a millimetre. The
chamfer, the springs of the arms and repeated attempts tolerate the rest
(docs/howto/insert-a-bar.md).
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.bar_insertion.bar_leading import BarLeader
from skywright.missions.bar_insertion.insertion import (
    READY,
    Hole,
    build_hole,
    draw_out,
    find_offset,
    insert,
    survey,
)
from skywright.missions.bar_insertion.motion import CARRY_ACCELERATION, CARRY_SPEED
from skywright.missions.bar_insertion.operated_insertion import insert_by_operator
from skywright.missions.bar_insertion.plan import InsertionPlan
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.operated import Lead
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
from skywright.missions.skills.tool_motion import BACK, behind
from skywright.missions.skills.tool_pose import measure_tool
from skywright.models.things.peg import Peg
from skywright.run.flight import Flight
from skywright.run.orders import Detour
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

RELEASE_S = 1.5  # s, in which the weight passes from the hands
SEATED = 0.5  # of the peg's length, from which a released bar stands in its hole
BESIDE = 0.04  # m, across, from the estimated rack or socket
CALM = 0.05  # m/s, of the platform when it raises a bar out of a hole


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
    opening = build_hole(s, hole.p_WO, R_WS, way.grip, s.task)
    lead = None if s.operator is None else Lead(s, s.operator)

    def work() -> str:
        if lead is not None:
            return insert_by_operator(s, lead, leader, opening)
        return _insert_again(s, leader, opening, task)

    def draw_back() -> None:
        ready = opening.p + READY * opening.R[:, 2]
        draw_out(s, leader, opening, ready, task.lower_speed_mps)
        move_platform(s, above, hole.yaw, CALM)

    detour = Detour(draw_back, lambda: move_platform(s, above, hole.yaw, CALM))
    found = s.orders.attempt("the hole", work, "the peg was not inserted", detour)
    if found != "in" and leader.lost:
        let_go(s, way.grip, speeds[0])  # hooks still below the handle would take the bar along
        _return(s, way, hole)
        return Flight(False, "the bar was lost at the socket")
    if found != "in":
        laid_down = _lay_down(s, way, above, hole.yaw, weight, speeds)
        _return(s, way, way.rack)
        where = "is back in the rack" if laid_down else "did not reach the rack either"
        return Flight(False, f"{found}: the bar {where}")
    _set_free(s, leader)
    let_go(s, way.grip, speeds[0])
    _return(s, way, hole)
    return Flight(True, "")


def _insert_again(s: Supervisor, leader: BarLeader, hole: Hole, task: BarInsertion) -> str:
    """Insert in up to `task.tries` attempts; returns "in", or the reason of the failure."""
    missed = 0
    for _ in range(task.tries):
        found = insert(s, leader, hole, find_offset(missed, hole.capture), task)
        if found == "in" or leader.lost:
            return found
        missed += found == "missed"
    return f"the peg was not inserted in {task.tries} tries"


def withdraw(s: Supervisor[BarInsertion], way: InsertionPlan) -> None:
    """Leave a bar that stands in rack or socket: its weight passes, and the hooks are drawn out.

    A bar that has hardly entered is raised first, and a suspended bar stays on the hooks.
    """
    peg, load = s.vehicle.world.find_thing(s.task.bar, Peg), 2.0 * float(s.senses.told("load")[0])
    deep = _find_depth(s, way, peg)
    if load > 0.0 and deep < SEATED * peg.length_m:
        if deep > -LIFT:
            hold_joints(s)
            move_platform(s, s.vehicle.reference["p_WB"] + [0.0, 0.0, LIFT], _find_yaw(s), CALM)
        return
    hold_joints(s)
    _pass_weight(s, load)
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    back = BACK * rot_z(_find_yaw(s))[:, 0]
    move_platform(s, s.vehicle.reference["p_WB"] - back, _find_yaw(s), NEAR_SPEED)


def _find_yaw(s: Supervisor) -> float:
    R = s.vehicle.reference["R_WB"]
    return math.atan2(R[1, 0], R[0, 0])


def _find_depth(s: Supervisor, way: InsertionPlan, peg: Peg) -> float:
    """Return the depth (m) of the peg in rack or socket, by the marker; -inf above neither."""
    p, R = measure_tool(s)
    tip, found = p + R @ peg.list_frames()["tip"].p, -math.inf
    for place in (way.rack, way.socket):
        if float(np.linalg.norm((tip - place.p_WO)[:2])) < BESIDE:
            found = max(found, float(place.p_WO[2] - tip[2]))
    return found


def _lay_down(
    s: Supervisor, way: InsertionPlan, above: Array, yaw: float, weight: float,
    speeds: tuple[float, float],
) -> bool:  # fmt: skip
    """Carry the bar from above the socket (`above` (3,) m, of the platform) back into the rack.

    Returns whether it stands there.
    """
    s.begin("carry back")
    hold_joints(s)
    move_platform(s, above, yaw, NEAR_SPEED)
    back = find_platform(way.grip, way.rack) + [0.0, 0.0, LIFT]
    move_platform(s, back, way.rack.yaw, CARRY_SPEED, CARRY_ACCELERATION)
    must = "the bar would stay on the hooks"
    return not put_down(s, way.grip, way.rack, weight, speeds, "lay down", must)


def _set_free(s: Supervisor, leader: BarLeader) -> None:
    """Pass the weight from the hands to the socket."""
    s.begin("set free")
    hold_joints(s)
    _pass_weight(s, leader.carried)


def _pass_weight(s: Supervisor, carried: float) -> None:
    """Reduce the feedforward from `carried` (N) to zero: the hooks sink until the bar stands."""
    steps = round(RELEASE_S / MISSION_TICK)
    for k in range(steps):
        row = np.array(s.vehicle.reference)
        row["t"], row["load"] = 0.0, 0.5 * carried * (1.0 - (k + 1) / steps)
        s.body.track(row[None])
        s.tick()


def _go_behind(s: Supervisor, grip: Grip, place: Place, speed: float) -> None:
    p = behind(find_platform(grip, place), place.yaw)
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
