"""The inspection tool in the scene, and tool-install on its requirements."""

from __future__ import annotations

import itertools
import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.core.record import View
from skywright.core.rotations import quat_from_rot, rot_y, rot_z
from skywright.description.loader import Description, load_description
from skywright.description.world.thing import Solid
from skywright.description.world.things import locate_thing
from skywright.errors import InputError
from skywright.missions.skills.hook_grip import build_grip
from skywright.missions.skills.tool_handling import find_platform
from skywright.missions.tool_install.plan import (
    ToolPlan,
    find_places,
    plan,
)
from skywright.models.arm_body import Deviation
from skywright.models.compliant_arms import find_hands
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.rigid_body import build_body_model
from skywright.models.scene import Scene, build_scene
from skywright.models.things.tool import Tool, compute_diameters, compute_seat
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup
from skywright.vehicle.bus import Clock
from skywright.vehicle.readings import TargetCapture
from skywright.vehicle.sensors.tracked_target import TrackedTarget
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.targets import NEVER, Target, TargetEstimate

DESCRIPTION = load_description("tool-install")
TOOL = DESCRIPTION.world.find_thing("tool", Tool)
QUICK = ["mission.task.hover_s=0", "mission.task.wait_s=1", "mission.timestep_ms=2"]
"""Where what the robot decides is tested, not how well it flies."""


def list_solids(tool: Tool) -> list[Solid]:
    return list(tool.list_parts()[0].solids)


def build(**sets: float) -> tuple[Scene, mujoco.MjData, int]:
    """The plant with the robot standing, and the address of the tool's pose."""
    d = load_description("tool-install", sets=[f"{k}={v}" for k, v in sets.items()])
    scene = build_scene(d.robot, d.world, Deviation())
    data = mujoco.MjData(scene.model)
    data.qpos[2] = d.robot.platform.gear_height_m
    return scene, data, int(scene.model.joint("object tool").qposadr[0])


def settle(scene: Scene, data: mujoco.MjData, seconds: float) -> float:
    """Step on; return the largest speed of the tool at the end (m/s, rad/s)."""
    mujoco.mj_step(scene.model, data, round(seconds / scene.model.opt.timestep))
    dof = int(scene.model.joint("object tool").dofadr[0])
    return float(np.max(np.abs(data.qvel[dof : dof + 6])))


def test_the_tool_rests_on_the_bench() -> None:
    scene, data, at = build()
    p, _ = locate_thing(DESCRIPTION.world.things, "tool")
    assert settle(scene, data, 1.0) < 1e-4
    np.testing.assert_allclose(data.qpos[at : at + 3], p, atol=2e-4)


@pytest.mark.parametrize("diameter", [0.12, 0.2, 0.26])
def test_the_tool_rests_on_the_pipe_where_the_feet_fit(diameter: float) -> None:
    scene, data, at = build(
        **{"world.pipe.diameter_m": diameter, "world.things.tool.friction": 0.2}
    )
    pipe = DESCRIPTION.world.pipe
    assert pipe is not None
    height = compute_seat(TOOL, diameter).height
    seat = np.array([pipe.x_m, pipe.y_m, pipe.z_m + height])
    data.qpos[at : at + 3] = seat + [0.0, 0.0, 0.003]
    assert settle(scene, data, 2.0) < 1e-3
    np.testing.assert_allclose(data.qpos[at : at + 3], seat, atol=1e-3)


@pytest.mark.parametrize(("friction", "stays"), [(0.2, True), (0.05, False)])
def test_on_the_pipe_friction_holds_a_tool_that_is_tilted(friction: float, stays: bool) -> None:
    """It holds up to sin(tilt) = mu sqrt(2) R / h, h of the centre of mass over the axis."""
    pipe = DESCRIPTION.world.pipe
    assert pipe is not None
    height = compute_seat(TOOL, pipe.diameter_m).height
    com = (
        sum(
            s.mass_kg * float(np.mean([e[2] for e in s.ends or [s.frame.p]]))
            for s in list_solids(TOOL)
        )
        / TOOL.mass_kg
    )
    limit = math.asin(friction * math.sqrt(2.0) * 0.5 * pipe.diameter_m / (height + com))
    tilt = math.radians(5.0)
    assert (tilt < limit) == stays
    scene, data, at = build(**{"world.things.tool.friction": friction})
    R = rot_y(tilt)
    axis = np.array([pipe.x_m, pipe.y_m, pipe.z_m])
    data.qpos[at : at + 3] = axis + R[:, 2] * (height + 0.0005)
    data.qpos[at + 3 : at + 7] = quat_from_rot(R)
    settle(scene, data, 2.0)
    now = 2.0 * math.asin(float(data.qpos[at + 5]))
    assert (abs(now - tilt) < math.radians(1.0)) == stays


@pytest.mark.parametrize("friction", [0.2, 1.0])
def test_in_two_hooks_the_tool_hangs_still(friction: float) -> None:
    """Platform and joints held where they hold it: contact alone carries the tool."""
    d = DESCRIPTION
    grip = build_grip(d.robot, TOOL, d.world.gravity_mps2)
    scene, data, at = build(**{"world.things.tool.friction": friction})
    dof = int(scene.model.joint("object tool").dofadr[0])
    home = np.array([0.0, 0.0, 2.0])
    data.qpos[scene.places.joint_qpos] = grip.q
    middle = home + np.mean(grip.hands, axis=0) + grip.cradle
    data.qpos[at : at + 3] = middle - grip.handle + [0.0, 0.0, 0.002]
    data.qpos[:3] = home
    others = [i for i in range(scene.model.nv) if not dof <= i < dof + 6]
    scene.model.dof_armature[others] = 1e6  # nothing but the tool moves
    settle(scene, data, 3.0)
    assert np.max(np.abs(data.qvel[dof : dof + 3])) < 5e-3
    np.testing.assert_allclose(data.qpos[at : at + 3], middle - grip.handle, atol=0.01)
    sensors = [scene.model.sensor(f"touch hand{h}").adr[0] for h in (0, 1)]
    up = sum(float(data.sensordata[a + 2]) for a in sensors)
    assert up == pytest.approx(TOOL.mass_kg * 9.81, rel=0.02)


@given(st.floats(0.02, 0.06), st.floats(0.08, 0.16), st.floats(30.0, 60.0), st.floats(0.05, 0.4))
@settings(max_examples=60, deadline=None)
def test_a_seat_touches_with_both_legs(
    plate: float, leg: float, angle: float, diameter: float
) -> None:
    tool = Tool(on="b", plate_m=plate, leg_length_m=leg, leg_angle_deg=angle)
    seat = compute_seat(tool, diameter)
    a = math.radians(angle)
    top = np.array([0.5 * plate, 0.0])
    touch = top + seat.along * np.array([math.sin(a), -math.cos(a)])
    away = touch + [0.0, seat.height]  # from the pipe's axis
    assert np.linalg.norm(away) == pytest.approx(0.5 * diameter + 0.5 * tool.profile_m)
    assert away @ [math.sin(a), -math.cos(a)] == pytest.approx(0.0, abs=1e-9)
    low, high = compute_diameters(tool)
    if abs(diameter - low) > 1e-6 and abs(diameter - high) > 1e-6:
        assert seat.fits == (low < diameter < high)


def test_the_parts_weigh_what_the_tool_weighs() -> None:
    assert sum(s.mass_kg for s in list_solids(TOOL)) == pytest.approx(TOOL.mass_kg)


def test_the_mean_of_a_tracked_pipe_is_better_than_a_sample() -> None:
    records = (TargetEstimate.Me, Clock, TargetCapture, Target)
    me, clock, sample, pipe = (View(np.zeros(1, r.dtype)[0]) for r in records)
    me.memory, clock.dt, pipe.age = 1.0, 0.01, NEVER
    rng, R = np.random.default_rng(1), rot_z(0.4)
    sample.fresh = 1.0
    for _ in range(100):
        sample.p_WO = [1.0, 2.0, 3.0] + 1e-3 * rng.standard_normal(3)
        sample.R_WO = R @ rot_y(2e-3 * rng.standard_normal())
        TargetEstimate.step(me, clock, sample, pipe)
    np.testing.assert_allclose(pipe.p_WO, [1.0, 2.0, 3.0], atol=4e-4)
    np.testing.assert_allclose(pipe.R_WO, R, atol=1e-3)
    for _ in range(600):  # somebody moves it
        sample.p_WO, sample.R_WO = [1.1, 2.0, 3.0], R
        TargetEstimate.step(me, clock, sample, pipe)
    np.testing.assert_allclose(pipe.p_WO, [1.1, 2.0, 3.0], atol=1e-3)


def test_the_platform_stands_where_the_hands_hold_the_handle() -> None:
    found = plan(Setup(load_description("tool-install"))).way
    assert isinstance(found, ToolPlan)
    model = build_body_model(DESCRIPTION.robot)
    hands = find_hands(model, found.grip.q) + find_platform(found.grip, found.seat)
    handle = found.seat.p_WO + found.grip.handle
    np.testing.assert_allclose(np.mean(hands, axis=0) + found.grip.cradle, handle, atol=1e-9)
    assert found.grip.cradle[2] > 0.0 and found.grip.mouth[2] > 0.9


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (["world.things.tool.mass_kg=0.8"], "more than the payload limit"),
        (["world.things.tool.mass_kg=0.05"], "cannot measure whether it is carried or seated"),
        (["world.pipe.diameter_m=0.4"], "feet fit pipes of"),
        (["world.things.tool.handle_length_m=0.32"], "the handle has room"),
        (["world.things.bench.y_m=1.2"], "come within"),
    ],
)
def test_what_cannot_be_is_told(sets: list[str], message: str) -> None:
    found = plan(Setup(load_description("tool-install", sets=sets)))
    assert not found.feasible and found.blocked_by is not None
    assert message in found.blocked_by


def test_wind_that_leans_the_robot_onto_the_tool_is_refused() -> None:
    """Flown: 4 m/s steady and 2 m/s Dryden touch nothing, 5 and 3 m/s do (one seed of two)."""
    limits = []
    for kind in ("steady", "dryden"):
        wind = [f"world.wind.kind={kind}", "world.wind.mean_mps=6"]
        told = plan(Setup(load_description("tool-install", sets=wind))).blocked_by
        assert told is not None and "elbow_pitch shell and tool handle come within" in told
        limits.append(float(told.split("largest wind: ")[1].split(" m/s")[0]))
        wind[1] = f"world.wind.mean_mps={limits[-1] - 0.2}"
        found = plan(Setup(load_description("tool-install", sets=wind)))
        assert found.feasible, found.blocked_by
    assert 4.0 < limits[0] < 5.0 and 2.0 < limits[1] < 3.0


@pytest.mark.parametrize(("yaw", "keeps"), [(0.0, 0.1), (90.0, 0.1), (180.0, 0.25)])
def test_the_way_to_the_bench_keeps_clear_of_the_tool(yaw: float, keeps: float) -> None:
    """By MuJoCo's own distances, which planning does not use: the planner has to see the tool."""
    sets = {"world.things.tool.yaw_deg": yaw, "mission.task.way_clearance_m": keeps}
    d = load_description("tool-install", sets=sets)
    found = plan(Setup(d))
    assert found.feasible and isinstance(found.way, ToolPlan)
    query = build_clearance(build_scene(d.robot, d.world), with_ground=True)
    least = math.inf
    for a, b in itertools.pairwise(found.way.to_bench):
        for u in np.linspace(0.0, 1.0, 201):
            x = (1.0 - u) * a + u * b
            at = compute_clearance(query, x[:3], rot_z(float(x[3])), found.way.grip.q_low)
            least = min(least, at.distance)
    assert least > keeps - 0.002  # between two rows of the check


def test_a_tool_under_a_shelf_is_out_of_reach() -> None:
    shelf = {"kind": "box", "x_m": 2.0, "y_m": -1.0, "z_m": 1.45, "size_x_m": 0.4, "size_y_m": 0.6,
             "size_z_m": 0.05}  # fmt: skip
    found = plan(Setup(load_description("tool-install", sets={"world.things.shelf": shelf})))
    assert not found.feasible and "shelf come within" in str(found.blocked_by)


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (["world.things.tool.on=shelf"], "shelf"),
        (["plant.map_error_m=1"], "map_error_m"),
        (["world.things.tool.handle_height_m=0.05"], "inside the box"),
        (["mission.task.hand_speed_mps=1e-9"], "hand_speed_mps"),  # it would never arrive
        (["mission.task.lift_speed_mps=9"], "lift_speed_mps"),
    ],
)
def test_wrong_worlds_are_input_errors(sets: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_description("tool-install", sets=sets)


@pytest.mark.parametrize(
    ("robot", "sets", "message"),
    [
        ("bimanual-longreach", [], "passive joint"),
        ("hexarotor", [], r"has no \[robot.arm.shoulder_roll\]"),
        (None, ["robot.arm.hand.kind=ball"], "hooks"),
        (None, ["world.pipe.inclination_deg=20"], "level"),
        (None, ["world.pipe.tracked=false"], "tracked = true"),
        (None, ["mission.task.along_pipe_m=1"], "beyond the end of the pipe"),
        (None, ["mission.task.along_pipe_m=0.73"], "valid: -0.71 to 0.71"),  # on the very edge
        (None, ["world.pipe.length_m=0.15"], "too short for the tool's feet; valid: from 0.18"),
    ],
)
def test_wrong_robots_and_tasks_are_input_errors(
    robot: str | None, sets: list[str], message: str
) -> None:
    def load() -> Description:
        return load_description("tool-install", robot=robot, sets=sets)

    with pytest.raises(InputError, match=message):
        plan(Setup(load()))


def test_the_tool_is_installed_and_brought_back() -> None:
    sets = [
        "mission.task.hover_s=4", "mission.task.wait_s=2", "world.things.tool.mass_kg=0.6",
        "mission.timestep_ms=2",
        "world.things.tool.friction=0.2", "world.things.tool.yaw_deg=4",
        "world.things.tool.x_m=0.02",
    ]  # fmt: skip
    result = fly_and_evaluate(load_description("tool-install", sets=sets, seed=3))
    m = result.metrics
    names = [p.name for p in result.phases]
    task, plan = result.description.mission.task, result.plan.way
    _, seat = find_places(result.description.true_world, task)
    off = np.linalg.norm(plan.seat.p_WO - seat.p_WO)
    assert off > 0.01  # of the map: the pipe is put to use where it is seen
    order = [
        "take_off", "approach bench", "grasp", "lift", "carry", "approach pipe", "install", "wait",
        "retrieve", "carry back", "lower", "return", "lift arms", "land",
    ]  # fmt: skip
    assert [n for i, n in enumerate(names) if n in order and n not in names[:i]] == order
    assert m["tool.seat_error_mm"] < 10.0 and m["tool.seat_angle_deg"] < 3.0
    assert m["tool.returned"] == 1.0
    assert m["tip.hover_rms_mm"] < 15.0
    assert m["contact.collisions"] == 0.0
    wait = result.phases[names.index("wait")]
    t = result.samples["t"]
    rows = result.samples[(t > wait.start_s) & (t < wait.end_s)]
    assert np.max(np.abs(rows["left_f_W"])) == 0.0  # it stands by itself
    grasp = names.index("grasp")
    rising = result.samples[result.samples["phase"] == grasp]
    moved = np.linalg.norm(rising["left_p_WH"][20:] - rising["left_p_WH"][:-20], axis=1) / 0.2
    assert np.max(moved) < 0.15  # m/s: platform and hand rise at 0.05 each


class Kick:
    """Somebody moves the tool by `by` (3,) m when the phase `when` begins."""

    def __init__(self, when: str, by: list[float]) -> None:
        self.when, self.by, self.done = when, np.array(by), False

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        if phase == self.when and not self.done:
            self.done = True
            at = int(vehicle.scene.model.joint("object tool").qposadr[0])
            vehicle.sim.data.qpos[at : at + 3] += self.by


def fly_kicked(when: str, by: list[float]) -> RunResult:
    return fly_and_evaluate(load_description("tool-install", sets=QUICK), [Kick(when, by)])


def test_a_missed_grasp_is_repeated_where_the_tool_is_now() -> None:
    result = fly_kicked("lift", [0.06, 0.0, 0.0])  # out of the hooks
    assert result.metrics["tool.retries"] == 1.0
    assert "look again" in [p.name for p in result.phases]
    assert result.metrics["tool.seat_error_mm"] < 10.0 and result.metrics["tool.returned"] == 1.0


@pytest.mark.parametrize(
    ("when", "by", "reason"),
    [
        ("lift", [0.1, 0.0, 0.0], "could not be grasped"),  # over the bench's edge
        ("carry", [0.3, 0.0, 0.0], "lost on the way to the pipe"),
        ("wait", [0.3, 0.0, 0.0], "is no longer on the pipe"),
        ("take_off", [-0.1, 0.05, 0.0], "is not at its planned position"),
    ],
)
def test_a_tool_that_falls_is_left_alone(when: str, by: list[float], reason: str) -> None:
    """The robot does not go after it to the ground, but home."""
    result = fly_kicked(when, by)
    assert result.outcome == "aborted" and reason in result.reason
    assert [p.name for p in result.phases][-2:] == ["lift arms", "land"]
    flown = result.samples[result.samples["t"] < result.phases[-1].start_s]
    after = flown[flown["t"] > result.phases[2].end_s]
    assert np.min(after["p_WB"][:, 2]) > 1.3  # m, over a bench of 0.9 m
    assert result.metrics["tool.returned"] == 0.0


def test_a_tool_that_finds_no_pipe_is_carried_back() -> None:
    """Somebody moves the targets, not the pipe."""

    class MoveTargets(Kick):
        def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
            if phase == "carry" and not self.done:
                self.done = True
                vehicle.assembly.get(TrackedTarget.Me, "tracked pipe")["error_p_W"] += self.by

    moved = MoveTargets("carry", [-0.3, 0.0, 0.0])
    result = fly_and_evaluate(load_description("tool-install", sets=QUICK), [moved])
    assert result.outcome == "aborted"
    assert "nothing took the tool's weight at its place" in result.reason
    assert "carried back to the bench" in result.reason
    assert result.metrics["tool.returned"] == 1.0
    assert result.metrics["contact.collisions"] == 0.0
