"""Press a sensor on a pipe from below with one hand (Suarez 2020, section VI-B).

Nine phases as in the paper: take off, arms to the operation pose, navigate, approach, hand to the
contact, force, retract, return, land. Two tests precede the approach: how accurately the hand holds
a point in space, and how fast a swing of the passive link decays.
"""

import math

import numpy as np

from skywright.core.arrays import Array, Table
from skywright.core.rotations import rot_z
from skywright.core.types import TASK_FORCE, TASK_POSITION
from skywright.description.world.surface import level_axes
from skywright.missions.sensor_install.motion import CALM
from skywright.missions.sensor_install.operated_press import HAND_OVER, press_by_operator
from skywright.missions.sensor_install.plan import InstallPlan
from skywright.missions.sensor_install.surveyed import find_pipe, lead_to, place_platform
from skywright.missions.sensor_install.task import SensorInstall
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.operated import Lead
from skywright.missions.skills.ways import (
    differs,
    fly_way,
    reverse_way,
    slide_platform,
)
from skywright.run.flight import Flight
from skywright.run.orders import Detour
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import ArmModel, HandForce, Hands
from skywright.vehicle.rest_to_rest import quintic

CONTACT_N = 0.3  # N, estimated force that counts as contact
TOUCH_SPEED = 0.02  # m/s, of the hand towards the pipe
CONTACT_S = 0.1  # s, time for which the force must last
SEARCH = 0.1  # m, distance beyond the expected surface to which the hand moves
RAMP_S, SETTLE_S = 3.0, 4.0  # s, before the force is evaluated
SWING_FORCE, SWING_USUAL = 6.0, math.radians(10.0)  # N, rad: push and its swing angle
SWING_WAIT = 6.0  # s, observed after the link reverses
SLOW = 0.05  # the same fraction while the hand presses
STEADY_S = 1.0  # s, before the force is tared
TARE_S = 3.0  # s, over which the force in free air is tared
PARK_S = 3.0  # s of hover before a measurement
WATCH_S = 2.0  # s, over which the hand's position is averaged: a period of the link
CORRECTION_MAX = 0.06  # m, largest correction of the platform for the hand's position error
LOWER_S = 2.0  # s, in which the hand lowers from the pipe
LOST_S = 1.0  # s without contact before the press is aborted


def fly(s: Supervisor[SensorInstall], way: InstallPlan) -> Flight:
    """Fly the phases between take-off and landing."""
    task = s.task
    s.begin("arms to operation pose")
    s.arms.move_to(way.q_good)
    s.until_arrived()
    _tare(s)
    s.begin("navigate")
    fly_way(s, way.to_far, 1.0)
    s.wait(PARK_S)
    swings = task.swing_deg > 0.0 and s.vehicle.read(ArmModel).swing >= 0
    if swings and not _check_swing(s, math.radians(task.swing_deg), way):
        s.end("failed")
        _go_home(s, way)
        return Flight(False, f"the push did not turn the link to {task.swing_deg:g} deg")
    if task.hover_s > 0.0:
        s.begin("hover check")
        s.body.track(_hold_hand(s, way.hover_hand, task))
        s.hold(task.hover_s)
    s.begin("navigate on")
    s.arms.move_to(way.q)
    s.until_arrived()
    fly_way(s, way.to_below, CALM)
    s.wait(PARK_S)
    way, reason = _survey(s, way)
    if reason:
        _go_back(s, way)
        return Flight(False, reason)
    here = _watch_hand(s)
    correction = _limit(way.contact - task.approach_below_m * way.normal - here, CORRECTION_MAX)
    s.begin("approach")
    s.body.track(_hold_hand(s, here, task))
    ready = way.contact - task.stand_off_m * way.normal
    if s.operator is not None:  # offset: the operator has to find the place
        ready = ready + rot_z(way.yaw) @ HAND_OVER
    _move_with_hand(s, way.p_near + correction, ready)
    s.wait(PARK_S)
    if task.pose == "L":
        _tare(s)
    detour = Detour(
        lambda: _lower(s, task, way), lambda: _move_with_hand(s, way.p_near + correction, ready)
    )
    lead = None if s.operator is None else Lead(s, s.operator)

    def work() -> str:
        return _install(s, task, way) if lead is None else press_by_operator(s, lead, way)

    reason = s.orders.attempt("the sensor's place", work, "", detour)
    _retract(s, task, way)
    _go_back(s, way)
    return Flight(not reason, reason)


def _survey(s: Supervisor[SensorInstall], way: InstallPlan) -> tuple[InstallPlan, str]:
    """Locate the pipe by touch if its map may be wrong.

    Returns the plan for the pipe found, and the reason of a failure or "".
    """
    survey = way.survey
    if survey is None:
        return way, ""
    s.begin("survey_move")
    s.arms.move_to(way.q_survey)
    s.until_arrived()
    hand, row = survey.hand, s.vehicle.reference
    planned = np.array(row["p_WB"]) + rot_z(way.yaw) @ survey.p_BH[hand]
    here = _watch_hand(s, hand)
    correction = _limit(planned - here, CORRECTION_MAX)
    s.body.track(_hold_hand(s, here, s.task, hand))
    surveyed = find_pipe(s, survey, lambda p, end: _move_with_hand(s, p + correction, end, hand))
    s.begin("survey_leave")
    found = surveyed.found.cylinder
    up = level_axes(found.R_WP)[:, 2]
    contact = lead_to(survey, found, 0.0, 0.0)
    if not surveyed.reason:
        move = contact - way.contact
        way = way._replace(
            contact=contact, normal=up, p_below=way.p_below + move, p_near=way.p_near + move
        )
    low = place_platform(survey, contact - s.task.approach_below_m * up, hand)
    _move_with_hand(s, low + correction, contact - s.task.approach_below_m * up, hand)
    s.arms.move_to(way.q)
    s.until_arrived()
    s.body.track(slide_platform(s, way.p_below, CALM))
    s.until_arrived()
    s.wait(PARK_S)
    return way, surveyed.reason


def _go_back(s: Supervisor, way: InstallPlan) -> None:
    """Fly home along the path by which the robot came."""
    s.arms.move_to(way.q)
    s.until_arrived()
    s.begin("return")
    fly_way(s, reverse_way(way.to_below), CALM)
    if differs(s, way.q_good):
        s.arms.move_to(way.q_good)
        s.until_arrived()
    _go_home(s, way)


def _go_home(s: Supervisor, way: InstallPlan) -> None:
    """Fly home from the position in front of the pipe."""
    fly_way(s, reverse_way(way.to_far), 1.0)
    s.arms.move_to(way.folded)
    s.until_arrived()


def _hold_hand(s: Supervisor, p: Array, task: SensorInstall, hand: int = 0) -> Table:
    """Return a row in which the platform stays and a hand moves straight to p (3,) m."""
    row = set_rest(s.vehicle.reference)
    row["task"][hand], row["p_WH"][hand] = TASK_POSITION, p
    row["v_WH"][hand] = [task.hand_speed_mps, 0.0, 0.0]
    return row[None]


def _watch_hand(s: Supervisor, hand: int = 0) -> Array:
    """Return a hand's position (3,) m, averaged over a period of the link.

    The angle of the link and the deflection of the springs differ a little from the plan. The
    platform compensates the resulting error of the hand: a deflection of 20 deg in the elbow of a
    stretched arm changes its reach by 8 mm.
    """
    seen, end = [], s.clock + WATCH_S
    while s.clock < end - 1e-9:
        s.tick()
        seen.append(s.vehicle.read(Hands).p_WH[hand])
    mean: Array = np.mean(seen, axis=0)
    return mean


def _limit(vector: Array, most: float) -> Array:
    return vector * min(1.0, most / max(float(np.linalg.norm(vector)), 1e-9))


def _move_with_hand(s: Supervisor, p: Array, end: Array, hand: int = 0) -> None:
    """Move the platform to p and a hand to `end`, (3,) m each, at the same time, rest to rest."""
    table = slide_platform(s, p, CALM)
    first = table["p_WH"][0, hand].copy()
    shape, _, _ = quintic(table["t"] / table["t"][-1])
    table["p_WH"][:, hand] = first + shape[:, None] * (end - first)
    s.body.track(table)
    s.until_arrived()


def _check_swing(s: Supervisor, angle: float, way: InstallPlan) -> bool:
    """Push the link until it will swing to `angle` (rad), then observe it.

    Returns whether the link reached that angle. The platform yields and damps, so a given force
    swings the link to a bounded angle only: the force is proportional to the angle.

    The push lasts some tenths of a second. After a slow pull the platform would still return from
    its lean, which would disturb the measured decay. For a pendulum, (q - rest)^2 + (q' / w)^2 is
    the square of the angle at which it reverses.
    """
    s.begin("push the link")
    swing = int(s.vehicle.read(ArmModel).swing)
    rest, end = float(s.vehicle.estimate["q"][swing]), s.clock + SWING_WAIT
    force = SWING_FORCE * angle / SWING_USUAL
    s.devices.helper.push("pendulum", -force * rot_z(way.yaw)[:, 0])
    away, rate = 0.0, 0.0
    while math.hypot(away, rate / way.swing_rad_s) < angle and s.clock < end:
        s.tick()
        away = float(s.vehicle.estimate["q"][swing]) - rest
        rate = float(s.vehicle.estimate["qd"][swing])
    s.devices.helper.push("pendulum", np.zeros(3))
    if s.clock >= end:
        return False
    while rate * away > 0.0 and s.clock < end:
        s.tick()
        rate = float(s.vehicle.estimate["qd"][swing])
    s.begin("swing check")
    s.wait(SWING_WAIT)
    return True


def _install(s: Supervisor, task: SensorInstall, way: InstallPlan) -> str:
    """Touch and press; returns the reason of a failure, or ""."""
    if not _touch(s, task, way):
        return "the hand met no surface"
    return "" if _press(s, task, way) else "contact was lost while pressing"


def _touch(s: Supervisor, task: SensorInstall, way: InstallPlan) -> bool:
    """Move the hand up until its estimated force indicates contact."""
    s.begin("touch")
    start = s.vehicle.t
    goal = way.contact + SEARCH * way.normal
    row = set_rest(s.vehicle.reference)
    row["task"][0], row["v_WH"][0] = TASK_POSITION, [TOUCH_SPEED, 0.0, 0.0]
    row["p_WH"][0] = goal
    s.body.track(row[None])
    patience = (task.stand_off_m + SEARCH) / TOUCH_SPEED + 3.0
    free = start
    while s.vehicle.t - start < patience:
        t = s.tick().t
        if float(s.vehicle.read(HandForce).f_WH[0] @ way.normal) < CONTACT_N:
            free = t
        elif t - free > CONTACT_S - 1e-9:
            s.end("done")
            return True
    s.end("failed")
    return False


def _press(s: Supervisor, task: SensorInstall, way: InstallPlan) -> bool:
    """Ramp the force up, wait, hold it; returns whether the contact lasted to the end.

    With `leave_singularity` and a stretched arm, the platform moves until the elbow is at a right
    angle, while the hand continues to press.
    """
    row = set_rest(s.vehicle.reference)
    row["task"][0], row["p_WH"][0] = TASK_FORCE, s.vehicle.read(Hands).p_WH[0]
    row["v_WH"][0] = 0.0  # fed forward in this task
    table = np.repeat(row[None], 2)
    table["t"] = [0.0, RAMP_S]
    table["f_WH"][0, 0], table["f_WH"][1, 0] = CONTACT_N * way.normal, task.force_n * way.normal
    s.begin("press")
    s.body.track(table)
    if task.leave_singularity:
        s.tick()
        shift = s.arms.platform_shift("left")
        if np.any(shift != 0.0):
            s.begin("leave singularity")
            away = slide_platform(s, row["p_WB"] + shift, SLOW)
            away["f_WH"][:, 0] = np.linspace(table["f_WH"][0, 0], table["f_WH"][1, 0], len(away))
            s.body.track(away)
            s.until_arrived()
            table = away[-1:].copy()
            table["t"] = 0.0
            s.begin("press")
            s.body.track(table)
    if not _keep(s, RAMP_S + SETTLE_S, way):
        return False
    s.begin("force")
    return _keep(s, task.hold_s, way)


def _retract(s: Supervisor, task: SensorInstall, way: InstallPlan) -> None:
    """Lower the hand from the pipe, and move the platform to the start of the return path."""
    s.begin("retract")
    down = -task.approach_below_m * way.normal
    if task.leave_singularity:
        _lower(s, task, way)
        return
    s.body.track(_hold_hand(s, way.contact + down, task))
    s.wait(LOWER_S)
    _move_with_hand(s, way.p_below, way.contact + down)


def _lower(s: Supervisor, task: SensorInstall, way: InstallPlan) -> None:
    """Lower hand and platform with the present bend of the elbow.

    Stretched, the arm would overestimate the force.
    """
    down, here = -task.approach_below_m * way.normal, np.array(s.vehicle.read(Hands).p_WH[0])
    s.body.track(_hold_hand(s, here, task))
    _move_with_hand(s, np.array(s.vehicle.reference["p_WB"]) + down, here + down)


def _tare(s: Supervisor) -> None:
    """Tare the force in free air, in the L pose.

    In a stretched arm a small torque corresponds to a large force.
    """
    s.wait(STEADY_S)
    s.arms.tare()
    s.wait(TARE_S)
    s.arms.tare(False)


def _keep(s: Supervisor, seconds: float, way: InstallPlan) -> bool:
    """Tick for a time (s); returns False if the estimated force was absent for too long."""
    felt = s.vehicle.t
    for t, *_ in s.orders.passes(seconds):
        if float(s.vehicle.read(HandForce).f_WH[0] @ way.normal) > 0.1:
            felt = t
        elif t - felt > LOST_S:
            s.end("failed")
            return False
    return True
