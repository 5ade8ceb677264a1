"""Flies the response of a rule that acted, until the robot is down."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import exp_so3, log_so3
from skywright.core.types import TASK_JOINTS
from skywright.models.geometry import ClearanceQuery, compute_clearance
from skywright.models.self_contact import is_apart
from skywright.run.faults._room import (
    PACE,
    SINK,
    WAY_MARGIN,
    find_open,
    find_room,
    hold_stuck,
)
from skywright.run.faults._rule import LET_GO, Response
from skywright.run.faults._trail import Crumb, goal_joints
from skywright.vehicle.rest_to_rest import ROW_PERIOD, duration, quintic

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

Array = NDArray[np.float64]
Table = NDArray[Any]

RETRACT_M, RETRACT_SPEED, RETRACT_ACCELERATION = 0.25, 0.4, 1.5  # m, m/s, m/s^2
CALM = (0.15, 0.15)  # m/s, m/s^2, if no rule has acted
SHORTCUTS = 16  # crumbs of the flown path to which a straight shortcut is tried, at a time
STEP_M = 0.05  # m (or rad) between samples of a shortcut
SPEED, TURN, JOINT = 0.4, 0.5, 0.5  # m/s, rad/s, rad/s on the return path
FOLDED, FOLDING = 0.5, 1.5  # m above the ground at which the arm is folded, and rad/s^2 of folding
BELOW, DEEPER, FASTER = 0.3, 12.0, 2.0  # m, m, -: below the ground, for errors of the estimate
DOWN_M, DOWN_S = 0.2, 0.3  # m that the robot stays above its reference, and s: it has landed
FALL_S, LANDED_S, FALL_MAX_S = 3.0, 1.0, 15.0  # s, after the motors were stopped
STILL, STILL_S = 0.1, 0.5  # rad/s and s: the gyroscope's reading of a robot at rest
TURNS_S = 0.2  # s, after which the command takes over a heading that is not controlled
WAIT_S = 30.0  # s, of holding before the return
AGREES_S = 1.0  # s, for which a value must be within its limit again


def respond(s: Supervisor, response: Response) -> None:
    """Fly a response; returns when the robot is down."""
    if response == "let_go":
        s.begin(LET_GO)
        s.uav.motors(False)
        wait_until_still(s, FALL_S)
        return
    v = s.senses
    v.carrying = v.carrying or max(v.told("load")) > 0.0
    if response != "land_here":
        leaves = v.engaged
    else:  # a jolt may register as contact, and the descent must not be delayed
        leaves = v.leads_hands or (v.means_to_touch and not v.carrying)
        if not v.hands or v.means_to_touch or v.find_pressed() is not None:
            v.left = v.away
        _anchor(s)
    if leaves:
        s.begin("retract")
        s.kind.withdraw(s, s.way)
    v.left = None
    if response == "hold":
        s.begin("hold")
        _wait_until_good(s)
    if response == "land_here":
        s.begin("land here")
        for a, b in pairwise(find_room(s, row := build_rest(s))):
            _fly(s, [a, b], row, *PACE)
    else:
        s.begin("come home")
        fly_back(s, s.trail.crumbs)
    _descend(s, here=response == "land_here")
    s.uav.motors(False)
    wait_until_still(s, LANDED_S)


def wait_until_still(s: Supervisor, least: float) -> None:
    """Wait until the robot is at rest, for at least `least` (s): it may roll after a fall."""
    began = since = s.vehicle.t
    while (t := s.vehicle.t) < began + FALL_MAX_S - 1e-9:
        if not float(np.linalg.norm(s.vehicle.estimate["w_WB_B"])) < STILL:
            since = t
        if min(t - began - least, t - since - STILL_S) > -1e-9:
            return
        s.tick()


def build_rest(s: Supervisor) -> Any:
    """Return a REFERENCE row at rest that does not press, carry or grasp anything."""
    row = np.array(s.vehicle.reference)
    row["q"] = goal_joints(s.senses)
    for field in (
        "t", "v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT", "track_tip", "dead_zone", "tare",
        "press", "force", "docked", "f_feet_B", "t_feet_B", "load", "f_WH", "v_WH", "mode",
    ):  # fmt: skip
        row[field] = 0.0
    row["R_WS"], row["active"], row["task"] = np.eye(3), 1.0, TASK_JOINTS
    row["R_WB"] = _hold(s, row["R_WB"])
    return row


def _hold(s: Supervisor, R: Array) -> Array:
    """Return the attitude, with the heading of R, at which the remaining rotors hold the robot.

    R itself if no rotor is lost.
    """
    return R if s.R_hold is None else _level(R @ s.R_hold.T) @ s.R_hold


def retract(s: Supervisor) -> None:
    """Retreat from the touched object along its normal, with the arm's posture unchanged.

    Hands that touch nothing may be below or beside an object: the robot then moves away from the
    nearest object of the map.
    """
    v, row = s.senses, build_rest(s)
    away = v.away if v.left is None else v.left
    if v.left is None and v.hands and not v.means_to_touch and v.find_pressed() is None:
        away = find_open(s, row, away, RETRACT_M)
    back_off(s, away, RETRACT_M)


def back_off(
    s: Supervisor, away: Array, far: float, acceleration: float = RETRACT_ACCELERATION
) -> None:
    """Fly `far` (m) along `away` (3,) from the commanded position, the arm's posture unchanged.

    A robot that was pushed away starts from its estimated position instead: returning to the
    commanded one would push it against the object that it must leave. The motion is fast after a
    rule has acted; on an operator's order it is so slow that a long arm feels no inertial force.
    """
    row, pace = build_rest(s), CALM
    start = np.array(row["p_WB"])
    goal = start + far * away
    if s.senses.responding:
        pace = RETRACT_SPEED, acceleration
        here = np.array(s.vehicle.estimate["p_WB"])
        if (here - start) @ away > 0.0:
            start = here
    _fly(s, [start, start + max(float((goal - start) @ away), 0.0) * away], row, *pace)


def _fly(s: Supervisor, way: list[Array], row: Any, speed: float, acceleration: float) -> None:
    """Fly a straight line; all other fields are those of `row`."""
    total = duration(float(np.linalg.norm(way[1] - way[0])), speed, acceleration)
    n = max(math.ceil(total / ROW_PERIOD), 1)
    u = np.linspace(0.0, 1.0, n + 1)
    points = way[0] + quintic(u)[0][:, None] * (way[1] - way[0])
    table = _build_table(s, row, u * n * ROW_PERIOD, points)
    table["a_WB"] = quintic(u)[2][:, None] * (way[1] - way[0]) / (n * ROW_PERIOD) ** 2
    s.body.track(table)
    s.until_arrived()


def _build_table(
    s: Supervisor, row: Any, t: Array, p: Array, R: Array | None = None, q: Array | None = None
) -> Table:
    """Return rows like `row` along points p (n, 3), attitudes R (n, 3, 3) and joints q."""
    table = np.repeat(row[None], len(t))
    table["t"], table["p_WB"] = t, p
    if R is not None:
        table["R_WB"] = R
    if q is not None:
        table["q"] = q
    if len(t) > 1:
        table["v_WB"] = np.gradient(p, t, axis=0)
        table["qd"] = np.gradient(table["q"], t, axis=0)
    for r in table:
        r["p_WT"], r["R_WT"] = s.vehicle.tip_of(r)
    if len(t) > 1:
        table["v_WT"] = np.gradient(table["p_WT"], t, axis=0)
    return table


def _wait_until_good(s: Supervisor) -> None:
    """Hover until the rules that acted are within their limits, at most for WAIT_S."""
    s.body.track(build_rest(s)[None])
    names = {acted.rule for acted in s.faults.acted}
    rules = [rule for rule in s.faults.rules if rule.name in names]
    start = bad = s.vehicle.t
    while s.vehicle.t - start < WAIT_S and s.vehicle.t - bad < AGREES_S:
        s.tick()
        if any(rule.value > rule.table.limit for rule in rules):
            bad = s.vehicle.t


def list_way_back(
    trail: list[Crumb], here: Crumb, is_free: Callable[[Crumb, Crumb], bool]
) -> list[Crumb]:
    """Return the path from `here` to the first crumb: straight where that is free, else as flown.

    Crumbs of contact are shifted by RETRACT_M away from the touched object.
    """
    clear = [c._replace(p_WB=c.p_WB + RETRACT_M * c.away) for c in trail]
    out, k = [here], len(clear)
    while k > 0:
        tried = np.unique(np.linspace(0, k - 1, SHORTCUTS).astype(int))
        k = next((int(j) for j in tried[:-1] if is_free(out[-1], clear[j])), k - 1)
        out.append(clear[k])
    return out


def _is_way_free(s: Supervisor, query: ClearanceQuery | None, a: Crumb, b: Crumb) -> bool:
    """Whether the straight path of platform and arm keeps WAY_MARGIN in the nominal scene."""
    if query is None:
        return False
    far = max(float(np.linalg.norm(b.p_WB - a.p_WB)), float(np.max(np.abs(b.q - a.q))))
    row = {"R_WB": a.R_WB, "q": a.q}
    for u in np.linspace(0.0, 1.0, max(math.ceil(far / STEP_M), 1) + 1):
        row["q"] = a.q + u * (b.q - a.q)
        if _gap(s, query, a.p_WB + u * (b.p_WB - a.p_WB), row) < WAY_MARGIN:
            return False
    return True


def fly_back(s: Supervisor, trail: list[Crumb]) -> None:
    """Fly back over crumbs to the first of them, as one motion."""
    row = build_rest(s)
    here = Crumb(np.array(row["p_WB"]), np.array(row["R_WB"]), np.array(row["q"]), np.zeros(3))
    query = s.surroundings() if s.surroundings is not None else None
    trail = [c._replace(R_WB=_hold(s, c.R_WB)) for c in trail]
    if s.senses.carrying:
        trail = [c._replace(q=here.q) for c in trail]
    elif s.senses.stuck:
        trail = _pose_stuck(s, query, trail, here.q)
    way = list_way_back(trail, here, partial(_is_way_free, s, query))
    if len(way) < 2:
        return
    p, q = np.array([c.p_WB for c in way]), np.array([c.q for c in way])
    turn, turns = np.empty(3), np.zeros((len(way) - 1, 3))
    for i, (a, b) in enumerate(pairwise(way)):
        log_so3(np.ascontiguousarray(a.R_WB.T @ b.R_WB), turn)
        turns[i] = turn
    cost = np.maximum.reduce([
        np.linalg.norm(np.diff(p, axis=0), axis=1) / SPEED,
        np.linalg.norm(turns, axis=1) / TURN,
        np.max(np.abs(np.diff(q, axis=0)), axis=1) / JOINT,
        np.full(len(way) - 1, 1e-6),
    ])  # fmt: skip
    at = np.concatenate([[0.0], np.cumsum(cost)])
    total = 1.875 * float(at[-1]) + 1.0
    n = math.ceil(total / ROW_PERIOD)
    u = np.linspace(0.0, 1.0, n + 1)
    done = quintic(u)[0] * at[-1]
    leg = np.clip(np.searchsorted(at, done, side="right") - 1, 0, len(way) - 2)
    share = (done - at[leg]) / cost[leg]
    rotation, R = np.empty((3, 3)), np.empty((n + 1, 3, 3))
    for i in range(n + 1):
        exp_so3(share[i] * turns[leg[i]], rotation)
        R[i] = way[leg[i]].R_WB @ rotation
    p_t = p[leg] + share[:, None] * (p[leg + 1] - p[leg])
    q_t = q[leg] + share[:, None] * (q[leg + 1] - q[leg])
    s.body.track(_build_table(s, row, u * n * ROW_PERIOD, p_t, R, q_t))
    s.until_arrived()


def _pose_stuck(
    s: Supervisor, query: ClearanceQuery | None, trail: list[Crumb], q: Array
) -> list[Crumb]:
    """Return the trail with stuck joints at their present angles and the others as flown.

    If the arm would then collide with its robot or reduce the clearance, the arm stays at q.
    """
    n = s.vehicle.n_joints
    as_flown = [c._replace(q=hold_stuck(s.senses, c.q)) for c in trail]
    as_is = [c._replace(q=q) for c in trail]
    ways = [*reversed(as_flown)]
    before = [q, *(c.q for c in ways)]
    if not all(is_apart(query, a[:n], b.q[:n]) for a, b in zip(before, ways, strict=False)):
        return as_is

    def measure(way: list[Crumb]) -> float:
        places = ((c.p_WB + RETRACT_M * c.away, {"R_WB": c.R_WB, "q": c.q}) for c in way)
        assert query is not None  # is_apart returned True, so there is a query
        return min((_gap(s, query, p, row) for p, row in places), default=math.inf)

    return as_flown if measure(as_flown) >= min(measure(as_is), WAY_MARGIN) else as_is


def _anchor(s: Supervisor) -> None:
    """Set the position reference to the estimated position."""
    row, est = build_rest(s), s.vehicle.estimate
    row["p_WB"] = est["p_WB"]
    s.body.track(row[None])
    s.tick()


def _gap(s: Supervisor, query: ClearanceQuery, p: Array, row: Any) -> float:
    n = s.vehicle.n_joints
    return float(compute_clearance(query, p, row["R_WB"], np.array(row["q"][:n])).distance)


def _descend(s: Supervisor, here: bool) -> None:
    """Descend until the robot stays above its reference, which means that it has landed.

    The arm folds on the way. The estimated height may be wrong by more than a meter: the descent
    continues below the expected ground, and faster, as the estimated speed may be wrong as well. If
    the remaining rotors cannot control the heading, it is not commanded: at half a turn from the
    commanded heading the attitude error does not represent the tilt. The robot waits at a height at
    which the arm can fold FOLDED above the ground. `here`: the space ahead has not been checked.
    """
    s.faults.land()
    row = build_rest(s)
    start, q = np.array(row["p_WB"]), np.array(row["q"])
    home = hold_stuck(s.senses, s.trail.crumbs[0].q) if s.trail.crumbs else q
    if s.senses.carrying:  # a load would swing against the robot
        home = q
    elif s.senses.stuck:
        query, n = s.surroundings() if s.surroundings is not None else None, s.vehicle.n_joints
        home = home if is_apart(query, q[:n], home[:n]) else q
    if s.uav.arc is not None:  # a link that hangs below the platform is laid down along an arc
        s.arms.move_to(home[: s.vehicle.n_joints])
        s.until_arrived()
        s.uav.land(s.ground_height, here)
        s.until_arrived()
        return
    z_end = s.ground_height - BELOW
    way = max(float(start[2]) - z_end, 0.1)
    sink_s = max(way / SINK, 2.0)
    folding = float(np.max(np.abs(home - q)))
    fold_s = max(duration(folding, s.vehicle.limits.joint_speed, FOLDING), ROW_PERIOD)
    wait_s = max(fold_s - (float(start[2]) - s.ground_height - FOLDED) / SINK, 0.0)
    total = wait_s + sink_s + DEEPER / (FASTER * SINK)
    n = math.ceil(total / ROW_PERIOD)
    t = np.linspace(0.0, total, n + 1)
    p = np.repeat(start[None], n + 1, axis=0)
    p[:, 2] -= np.clip((t - wait_s) / sink_s, 0.0, 1.0) * (start[2] - z_end)
    p[:, 2] -= np.maximum(t - wait_s - sink_s, 0.0) * FASTER * SINK
    arm = quintic(np.minimum(t / fold_s, 1.0))[0][:, None]
    R = _level(row["R_WB"]) if s.R_hold is None else row["R_WB"]
    table = _build_table(s, row, t, p, np.repeat(R[None], n + 1, axis=0), q + arm * (home - q))
    s.body.track(table)
    begun = behind = turned = s.vehicle.t
    while not s.tick().arrived:
        if s.turns and s.vehicle.t - turned > TURNS_S:
            turned = s.vehicle.t
            rest = table[np.searchsorted(table["t"], turned - begun) :].copy()
            rest["t"] += begun - turned
            rest["R_WB"] = _hold(s, s.senses.estimate["R_WB"])
            s.body.track(rest)
        ref, est = s.senses.reference, s.senses.estimate
        if float(est["p_WB"][2] - ref["p_WB"][2]) < DOWN_M:
            behind = s.vehicle.t
        if s.vehicle.t - behind > DOWN_S:
            return


def _level(R: Array) -> Array:
    """Return the level attitude with the heading of R."""
    c, sn = R[0, 0], R[1, 0]
    size = max(math.hypot(c, sn), 1e-9)
    c, sn = c / size, sn / size
    return np.array([[c, -sn, 0.0], [sn, c, 0.0], [0.0, 0.0, 1.0]])
