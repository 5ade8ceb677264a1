"""Two compliant arms on a bench (Suarez 2020, equations (29) to (33)).

Trials, each at its own station: squeeze and lift a box without handles; pull a plug and detect its
release; control a bar held by both hands; measure the base's drift with the arms. The platform is
clamped; the bench moves it between the stations.
"""

import math
from collections.abc import Callable

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.things import find_first, locate_thing
from skywright.missions.bimanual_bench.plan import (
    ABOVE,
    BAR_AHEAD,
    BAR_UP,
    ELBOWS_OUT,
    GRIP_BELOW,
    STATIONS,
    TRAVEL_S,
    BenchPlan,
)
from skywright.missions.bimanual_bench.task import BimanualBench
from skywright.models.bimanual import is_unplugged
from skywright.models.things.bench import Bench
from skywright.models.things.box import Box
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import ArmModel, Hands

START_S = 1.0  # s, before the first trial
APART = 0.05  # m, between a hand and the surface before it presses
GAP = 0.015  # m, from the surface, where the press begins
ARRIVED_S = 1.0  # s, at rest at a station
APART_S, TARE_S, NEAR_S = 5.0, 0.5, 2.5  # s, of an approach: to a distance, tare, to the gap
PART_S = 2.0  # s, in which the hands part
SETTLE_S = 2.0
GRASP_S = 2.0  # s, ramp of the force of a grasp
LIFT_S = 8.0  # s, of a lift: the springs yield centimetres, which a slow loop corrects
PULL = 0.12  # m, largest pull of the plug
PULL_S = 10.0  # s, within which it must come free
PULL_SPEED = 0.03  # m/s
DRIFT_PERIODS = 2.0
BAR_POSES = 4  # to which a bar is moved


def fly(s: Supervisor[BimanualBench], way: BenchPlan) -> Flight:
    """Run the trials in sequence."""
    trials: dict[str, Callable[[Supervisor[BimanualBench], BenchPlan], str]] = {
        "squeeze": _squeeze, "unplug": _unplug, "bar": _lead_bar,
        "position-sensor": _feel_drift,
    }  # fmt: skip
    s.begin("start")
    s.wait(START_S)
    reason = ""
    for trial in s.task.trials:
        s.begin(f"to {trial}")
        _travel(s, way, STATIONS[trial])
        reason = trials[trial](s, way) or reason
    return Flight(not reason, reason)


def _travel(s: Supervisor, way: BenchPlan, y: float) -> None:
    """Move the clamped platform to another station, hands back first."""
    bench = find_first(way.world.things, Bench)
    assert bench is not None
    s.arms.move_to(way.folded)
    s.until_arrived()
    here = float(s.vehicle.reference["p_WB"][1])
    steps = max(round(TRAVEL_S / 0.02), 1)
    for i in range(1, steps + 1):
        u = i / steps
        shape = u**3 * (10 - 15 * u + 6 * u**2)
        s.devices.bench.move(np.array([bench.x_m, here + shape * (y - here), bench.z_m]))
        s.tick()
    row = np.array(s.vehicle.reference)
    row["t"], row["p_WB"] = 0.0, [bench.x_m, y, bench.z_m]
    s.vehicle.track(row[None])
    s.wait(ARRIVED_S)


def _approach(s: Supervisor, left: Array, right: Array) -> None:
    """Move the hands from outside to two points, first to a distance from them, elbows out."""
    away, near = np.array([0.0, APART, 0.0]), np.array([0.0, GAP, 0.0])
    s.arms.hands_to({"left": left + away, "right": right - away}, roll=ELBOWS_OUT)
    s.wait(APART_S)
    s.arms.tare()
    s.wait(TARE_S)
    s.arms.tare(on=False)
    s.arms.hands_to({"left": left + near, "right": right - near}, speed=PULL_SPEED)
    s.wait(NEAR_S)


def _leave(s: Supervisor, left: Array, right: Array, force: float = 0.1) -> None:
    """Reduce the grasp to `force` (N) before the hands part: deflected springs would snap back."""
    away = np.array([0.0, 2.0 * APART, 0.0])
    s.begin("release")
    s.arms.squeeze(force, left, right, ramp_s=GRASP_S)
    s.wait(GRASP_S)
    s.arms.hands_to({"left": left + away, "right": right - away})
    s.wait(PART_S)


def _faces(s: Supervisor, way: BenchPlan, name: str, above: float = 0.0) -> tuple[Array, Array]:
    """Return the positions (left, right) in W at which hands press on two faces of an object.

    They are at mid-height, or `above` (m) it. A ball touches with its side: the hand's point, at
    the end of a forearm that points forward, is a ball radius off the face and a ball radius ahead.
    """
    half = 0.5 * way.world.find_thing(name, Box).size_y_m
    ball = float(np.max(s.vehicle.read(ArmModel).pad))
    p = locate_thing(way.world.things, name).p
    centre = np.array([p[0] + ball, p[1], p[2] + above])
    away = np.array([0.0, half + ball, 0.0])
    return centre + away, centre - away


def _squeeze(s: Supervisor[BimanualBench], way: BenchPlan) -> str:
    task = s.task
    # two balls act as a hinge: gripped above its centre of mass the box is stable
    left, right = _faces(
        s, way, task.box, above=ABOVE * way.world.find_thing(task.box, Box).size_z_m
    )
    s.begin("approach box")
    _approach(s, left, right)
    s.begin("squeeze")
    s.arms.squeeze(task.squeeze_n, left, right, ramp_s=GRASP_S)
    s.wait(GRASP_S + SETTLE_S)
    up = np.array([0.0, 0.0, task.lift_m])
    s.begin("lift")
    s.arms.squeeze(task.squeeze_n, left + up, right + up)
    s.wait(LIFT_S)
    s.begin("hold box")
    s.wait(task.hold_s)
    s.begin("lower")
    s.arms.squeeze(task.squeeze_n, left, right)
    s.wait(LIFT_S)
    _leave(s, left, right)
    return ""


def _unplug(s: Supervisor[BimanualBench], way: BenchPlan) -> str:
    """Pull until both hands have moved by more than the threshold since the grasp: (33)."""
    task = s.task
    left, right = _faces(s, way, task.plug)
    s.begin("approach plug")
    _approach(s, left, right)
    s.begin("grasp plug")
    s.arms.squeeze(task.squeeze_n, left, right, ramp_s=GRASP_S)
    s.wait(GRASP_S + SETTLE_S)
    grasp = np.array(s.vehicle.read(Hands).p_WH)
    s.begin("pull")
    start, noticed = s.vehicle.t, False
    back = np.array([-PULL, 0.0, 0.0])
    s.arms.squeeze(task.squeeze_n, left + back, right + back, speed=PULL_SPEED)
    while s.vehicle.t - start < PULL_S and not noticed:
        s.tick()
        hands = s.vehicle.read(Hands).p_WH
        noticed = all(is_unplugged(grasp[h], hands[h], task.unplug_threshold_m) for h in (0, 1))
    s.begin("unplugged" if noticed else "stuck")
    here = np.array(s.vehicle.read(Hands).p_WH)
    s.arms.squeeze(task.squeeze_n, here[0], here[1])
    s.wait(SETTLE_S)
    _leave(s, here[0], here[1])
    return "" if noticed else "the plug did not come free"


def _lead_bar(s: Supervisor[BimanualBench], way: BenchPlan) -> str:
    """Move a bar between the hands through poses: (29), (30) with (31), (32)."""
    task = s.task
    left, right = _faces(
        s, way, task.bar, above=ABOVE * way.world.find_thing(task.bar, Box).size_z_m
    )
    centre, width = 0.5 * (left + right), float(np.linalg.norm(left - right))
    s.begin("approach bar")
    _approach(s, left, right)
    s.begin("hold bar")
    s.arms.squeeze(task.squeeze_n, left, right, ramp_s=GRASP_S)
    s.wait(GRASP_S + SETTLE_S)
    turn = math.radians(task.bar_turn_deg)
    for name, by, angle in (
        ("lift bar", [0.0, 0.0, BAR_UP], 0.0),
        ("turn bar", [0.0, 0.0, BAR_UP], turn),
        ("bar forward", [BAR_AHEAD, 0.0, BAR_UP], 0.0),
        ("lower bar", [0.0, 0.0, 0.0], 0.0),
    ):
        s.begin(name)
        n = np.array([-math.sin(angle), math.cos(angle), 0.0])
        s.arms.bar_to(centre + by, n, width, force=task.squeeze_n)
        s.wait(LIFT_S)
    # without force they would slip over the bar's top and collide: they lift by friction
    _leave(s, left, right, force=0.4 * task.squeeze_n)
    return ""


def _feel_drift(s: Supervisor[BimanualBench], way: BenchPlan) -> str:
    """Press the hands on a post while the base drifts: the joint angles measure the drift."""
    task = s.task
    bench, post = find_first(way.world.things, Bench), locate_thing(way.world.things, task.post)
    assert bench is not None
    left, right = _faces(s, way, task.post, above=bench.z_m - GRIP_BELOW - float(post.p[2]))
    s.begin("approach post")
    _approach(s, left, right)
    s.begin("grasp post")
    s.arms.squeeze(task.squeeze_n, left, right, ramp_s=GRASP_S)
    s.wait(GRASP_S + SETTLE_S)
    s.begin("drift")
    home = np.array([bench.x_m, STATIONS["position-sensor"], bench.z_m])
    start = s.vehicle.t
    while s.vehicle.t - start < DRIFT_PERIODS * task.drift_period_s:
        phase = 2.0 * math.pi * (s.vehicle.t - start) / task.drift_period_s
        drift = task.drift_m * np.array([math.sin(phase), 0.0, 0.5 * math.sin(2.0 * phase)])
        s.devices.bench.move(home + drift)
        s.tick()
    s.devices.bench.move(home)
    _leave(s, left, right)
    return ""
