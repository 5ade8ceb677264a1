"""Collisions: pads, gauges, momentum, and the mission that flies into something."""

from __future__ import annotations

import functools
import math
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from cut_flights import check_cuts, fly_until
from skywright.core.record import View
from skywright.core.rotations import rot_z
from skywright.description.dump import dump_description
from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.loader import load_robot
from skywright.description.world.spec import World
from skywright.description.world.things import locate_thing
from skywright.errors import InputError
from skywright.missions.impact import plan as impact_plan
from skywright.missions.impact.metrics import find_end
from skywright.models.arm_body import Deviation
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.scene import Scene, build_scene
from skywright.models.things.box import Box
from skywright.models.things.pad import Pad
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.observers.gauges import Gauges, Loads

# without weight the cascade has no pendulum to damp: its loops are separated instead
FLOATING = {"world.gravity_mps2": 1e-9, "robot.control.motion_sensitivity": 0.0}


def build_floating(robot: str) -> tuple[Scene, mujoco.MjData, np.ndarray]:
    """A robot without weight, rotors off, at the place where it touches the pad, moving at it."""
    d = load_description("impact", robot=robot, sets=FLOATING)
    way = plan_mission(d).way
    scene = build_scene(d.robot, d.world, Deviation())
    data = mujoco.MjData(scene.model)
    data.qpos[:3] = way.p_contact - 0.005 * way.ahead
    data.qpos[scene.places.joint_qpos] = way.q
    servos = scene.model.nu - scene.model.na
    mujoco.mj_forward(scene.model, data)
    data.act[:] = data.actuator_length[servos:]
    data.ctrl[servos:] = data.act
    data.qvel[:3] = 0.5 * way.ahead
    return scene, data, way.ahead


@pytest.mark.parametrize("robot", ["bimanual", "bimanual-longreach"])
def test_the_pad_receives_the_momentum_that_the_robot_loses(robot: str) -> None:
    scene, data, ahead = build_floating(robot)
    model, body = scene.model, scene.places.platform_body
    # floating bodies with moving joints keep their momentum to first order in the step only
    model.opt.timestep = 2.5e-4
    me, loads, mj = (View(np.zeros(1, r.dtype)[0]) for r in (Gauges.Me, Loads, MuJoCo))
    context = SimpleNamespace(scene=scene, h=model.opt.timestep)
    Gauges("gauges").build(me, None, context)
    mj.sensordata, mj.nsensor = data.sensordata.ctypes.data, model.nsensordata
    mj.site_xpos, mj.site_xmat = data.site_xpos.ctypes.data, data.site_xmat.ctypes.data
    mj.nsite = model.nsite

    def momentum() -> np.ndarray:
        mujoco.mj_subtreeVel(model, data)
        return np.array(model.body_subtreemass[body] * data.subtree_linvel[body])

    mujoco.mj_forward(model, data)
    before = momentum()
    for _ in range(1600):
        mujoco.mj_step(model, data)
        Gauges.watch(me, mj, loads)
    mujoco.mj_forward(model, data)
    lost = before - momentum()
    assert lost @ ahead > 0.3  # N s: it did hit
    np.testing.assert_allclose(loads.impulse_W, lost, atol=0.03 * np.linalg.norm(lost))
    assert 0.02 < loads.touch_s <= 0.4


@pytest.mark.parametrize("mass", [0.3, 3.0])
def test_a_pad_is_a_spring_of_its_own(mass: float) -> None:
    """A box of any mass meets the stiffness and damping of the file (closed form)."""
    thing = {"kind": "box", "moves": True, "size_x_m": 0.05, "size_y_m": 0.05, "size_z_m": 0.05,
             "mass_kg": mass, "x_m": 6.0, "y_m": 0.0, "z_m": 2.0, "friction": 0.0}  # fmt: skip
    d = load_description("impact", sets={**FLOATING, "world.things.bob": thing})
    pad = d.world.find_thing("pad", Pad)
    scene = build_scene(d.robot, d.world, Deviation())
    data = mujoco.MjData(scene.model)
    face, R = locate_thing(d.world.things, "pad")
    ahead = R[:, 0]
    joint = scene.model.joint("object bob")
    data.qpos[joint.qposadr[0] : joint.qposadr[0] + 3] = face - 0.026 * ahead
    data.qvel[joint.dofadr[0] : joint.dofadr[0] + 3] = 0.5 * ahead
    plate = scene.model.joint("pad").qposadr[0]
    way = []
    for _ in range(160):
        mujoco.mj_step(scene.model, data)
        way.append(float(data.qpos[plate]))
    # after the catch of the plate both move as one damped oscillator
    k, c, m = pad.stiffness_n_per_m, pad.damping_ns_per_m, mass + pad.mass_kg
    w, z = math.sqrt(k / m), 0.5 * c / math.sqrt(k * m)
    wd = w * math.sqrt(1.0 - z * z)
    t = np.linspace(0.0, math.pi / wd, 200)
    x = 0.5 * mass / m / wd * np.exp(-z * w * t) * np.sin(wd * t)
    assert max(way) == pytest.approx(float(np.max(x)), rel=0.05)


def test_gauges_carry_the_weight_of_what_hangs_on_them() -> None:
    d = load_description(
        "impact", robot="bimanual", sets={"world.things.bench": {"kind": "bench", "z_m": 1.5}}
    )
    vehicle = build_vehicle(d)
    for _ in range(400):  # until the springs have stopped ringing
        vehicle.tick()
    vehicle.devices.gauges.zero()
    vehicle.tick()
    gauges = vehicle.assembly.get(Gauges.Me, "gauges")
    assert d.robot.arm is not None
    mass = sum(limb.link.mass_kg for limb in list_limbs(d.robot)) + 2 * d.robot.arm.hand.mass_kg
    factor = 1.0 + d.plant.mass_error
    np.testing.assert_allclose(gauges["f_zero_B"], [0.0, 0.0, -9.81 * factor * mass], atol=0.1)
    assert vehicle.read(Loads).f_peak < 0.1  # zeroed, nothing is left


@functools.cache
def fly(robot: str, *sets: str) -> RunResult:
    return fly_and_evaluate(load_description("impact", robot=robot, sets=sets))


def test_springs_and_the_passive_joint_spare_the_platform() -> None:
    """Suarez 2020, table 3: stiff joints pass on most, the passive link least."""
    stiff = fly("bimanual", "mission.task.joints=stiff")
    soft = fly("bimanual")
    far = fly_until("return", load_description("impact", robot="bimanual-longreach"))
    torque = [r.metrics["impact.peak_torque_nm"] for r in (stiff, soft, far)]
    assert torque[0] > 2.0 * torque[1] > 4.0 * torque[2]
    for r in (stiff, soft, far):
        assert r.metrics["impact.speed_error_mps"] < 0.05
        # the collision gives what it stops, at most twice that; the pressing after it is not of it
        carried = 0.5 * compute_body(build_body_model(r.description.robot), np.zeros(9))[0]
        assert 0.0 < r.metrics["impact.impulse_ns"] < 2.0 * carried
        # 1 kHz: no sample of the recording (100 Hz) exceeds the peak, and one comes near it
        home = next((p.start_s for p in r.phases if p.name == "return"), math.inf)
        s = r.samples[(r.samples["pad_touch_s"] > 0.0) & (r.samples["t"] < home)]  # it lands later
        sampled = float(np.max(np.linalg.norm(s["load_t_B"], axis=1)))
        assert 0.3 * r.metrics["impact.peak_torque_nm"] < sampled
        assert sampled <= r.metrics["impact.peak_torque_nm"] + 1e-9


def test_a_collision_ends_where_the_pad_is_let_go_or_the_platform_stands() -> None:
    s = np.zeros(40, dtype=[("t", float), ("pad_f_peak", float), ("v_WB", float, 3)])
    s["t"], ahead = 0.01 * np.arange(40), np.array([0.0, 1.0, 0.0])
    s["v_WB"][:, 1] = 0.5
    s["pad_f_peak"][:30] = 5.0
    s["pad_f_peak"][8:11] = 0.0  # a bounce is no end
    s["pad_f_peak"][16:24] = 0.2
    assert find_end(s, ahead) == 16
    assert find_end(s[:14], ahead) == 13  # neither: the last sample
    s["v_WB"][12:, 1] = -0.1
    assert find_end(s, ahead) == 12


def test_stiff_joints_fail_for_the_right_reason() -> None:
    result = fly("bimanual", "mission.task.joints=stiff")
    failed = [v.name for v in result.requirements if not v.passed]
    assert failed == ["impact.torque_share"]
    assert fly("bimanual").outcome == "succeeded"
    check_cuts(fly("bimanual"))


def test_a_stiff_robot_is_dumped_and_loaded_as_it_flew(tmp_path: object) -> None:
    d = load_description("impact", robot="bimanual", sets=["mission.task.joints=stiff"])
    assert d.robot.arm is not None
    assert all(x.flex_stiffness_nm_per_rad is None for x in d.robot.arm.links.values())
    file = tmp_path / "mission.toml"  # type: ignore[operator]
    file.write_text(dump_description(d), encoding="utf-8")
    again = load_description(file)
    assert again.robot == d.robot and again.mission == d.mission
    soft, _ = load_robot("bimanual")
    assert soft.arm is not None and soft.arm.links["elbow_pitch"].flex_stiffness_nm_per_rad


def test_the_link_touches_before_anything_else() -> None:
    d = load_description("impact", sets=["mission.task.part=link"])
    plan = plan_mission(d)
    assert plan.feasible and plan.way.touched == "pendulum shell"
    # an obstacle high enough meets the propellers first, and the plan says so
    tall = load_description("impact", robot="bimanual", sets=["world.things.bar.size_z_m=1.2"])
    blocked = plan_mission(tall)
    assert not blocked.feasible and "propeller" in str(blocked.blocked_by)


def test_the_passive_link_is_no_part_of_the_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its name begins with the letters of the probe's pen."""
    d = load_description("impact", robot="bimanual-longreach", sets=["mission.task.part=arm"])
    found = impact_plan._find_contact
    monkeypatch.setattr(
        impact_plan, "_find_contact", lambda *args: (found(*args)[0], "pendulum shell")
    )
    plan = plan_mission(d)
    assert not plan.feasible and "pendulum shell would touch" in str(plan.blocked_by)


def test_wrong_missions_are_told() -> None:
    for robot, sets, found in (
        ("bimanual", ["mission.task.part=link"], "no passive link"),
        ("hexarotor", [], "has no arm"),
        ("bimanual", ["mission.task.speed_mps=3"], "speed_mps is 3"),
        ("bimanual", ["mission.task.part=foot"], "part"),
        ("bimanual", ["mission.task.joints=soft"], "joints"),
        ("bimanual", ["world.things.pad.stiffness_n_per_m=-1"], "stiffness_n_per_m"),
    ):
        with pytest.raises(InputError, match=found):
            plan_mission(load_description("impact", robot=robot, sets=sets))
    with pytest.raises(InputError, match="has no pad"):
        plan_mission(load_description("impact", world="open"))


def test_a_turned_pad_looks_where_its_box_does() -> None:
    box = Box(x_m=1.0, y_m=2.0, z_m=1.0, size_x_m=0.4, size_y_m=0.2, size_z_m=0.2, yaw_deg=90.0)
    pad = Pad(on="b.front", width_m=0.2, height_m=0.2)
    face, R = locate_thing(World(name="w", things={"b": box, "p": pad}).things, "p")
    np.testing.assert_allclose(R, rot_z(math.pi / 2), atol=1e-12)
    np.testing.assert_allclose(face, [1.0, 2.0 - 0.2 - 0.05 - 0.02, 1.0])
