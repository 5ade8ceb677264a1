"""The plant's physics: conservation, spring, contact force, rotors, wind."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from plant_parts import build_context, build_part, view
from skywright.description.loader import load_description
from skywright.description.mission.spec import Plant
from skywright.description.robot.limbs import list_joints, list_limbs
from skywright.description.robot.loader import load_robot
from skywright.models.arm_body import Deviation
from skywright.models.deviation import build_deviation
from skywright.models.fixed_body import FIXED, list_moving
from skywright.models.part_masses import link_direction
from skywright.models.scene import build_scene, set_pose
from skywright.vehicle.actuators._torque_servos import TorqueServos
from skywright.vehicle.actuators._velocity_servos import VelocityServos
from skywright.vehicle.bus import MuJoCo, ServoDrive
from skywright.vehicle.physics import step_physics


@pytest.fixture(scope="module")
def description():
    return load_description("pipe-weld-scan")


def test_energy_and_momentum_are_conserved_in_free_fall(description):
    scene = build_scene(description.robot, description.world, Deviation())
    m = scene.model
    m.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    m.opt.timestep = 2e-4
    m.dof_damping[:] = 0.0
    m.jnt_limited[:] = 0
    m.actuator_gainprm[:] = 0.0
    m.actuator_biasprm[:] = 0.0
    d = mujoco.MjData(m)
    set_pose(scene, d, np.array([-3.0, 0, 5.0]), np.array([1.0, 0, 0, 0]), np.array([0.3, 0.4]))
    d.qvel[:6] = [0.2, -0.1, 0.3, 0.5, -0.4, 0.6]
    mujoco.mj_forward(m, d)
    mujoco.mj_subtreeVel(m, d)
    e0, l0 = d.energy.sum(), d.subtree_angmom[1].copy()
    kinetic0 = d.energy[1]
    for _ in range(1500):
        mujoco.mj_step(m, d)
    mujoco.mj_forward(m, d)
    mujoco.mj_subtreeVel(m, d)
    assert abs(d.energy.sum() - e0) < 1e-5 * abs(d.energy[1] - kinetic0)
    np.testing.assert_allclose(d.subtree_angmom[1], l0, atol=1e-6)


def test_nominal_model_and_plant_agree_without_deviation(description):
    nominal = build_scene(description.robot, description.world)
    plant = build_scene(description.robot, description.world, Deviation())
    assert plant.model.body_mass.sum() == pytest.approx(nominal.model.body_mass.sum(), abs=1e-12)
    dn, dp = mujoco.MjData(nominal.model), mujoco.MjData(plant.model)
    q = np.array([-0.6, 0.9])
    for scene, d in ((nominal, dn), (plant, dp)):
        set_pose(scene, d, np.array([0.1, 0.2, 1.0]), np.array([0.8, 0, 0, 0.6]), q)
        mujoco.mj_forward(scene.model, d)
    np.testing.assert_allclose(dn.site("tip").xpos, dp.site("tip").xpos, atol=1e-12)


def test_deviation_changes_what_it_names(description):
    nominal = build_scene(description.robot, description.world, Deviation())
    off = build_scene(
        description.robot, description.world, Deviation(mass_factor=1.05, link_length_error=0.01)
    )
    assert off.model.body_mass.sum() == pytest.approx(1.05 * nominal.model.body_mass.sum())
    d = mujoco.MjData(off.model)
    d0 = mujoco.MjData(nominal.model)
    for m, x in ((off.model, d), (nominal.model, d0)):
        mujoco.mj_forward(m, x)
    reach = np.linalg.norm(d.site("tip").xpos - d0.site("tip").xpos)
    assert reach == pytest.approx(0.01, abs=1e-9)


@pytest.mark.parametrize("name", ["othex", "bimanual-longreach"])
def test_each_joint_and_link_has_its_own_error(name: str) -> None:
    robot, _ = load_robot(name)
    world = load_description("waypoints").world
    limbs, joints = list_limbs(robot), list_joints(robot)
    plain = build_deviation(Plant(), robot, 3)
    plant = Plant(joint_offset_spread_deg=0.3, link_length_spread_m=0.001)
    drawn = [build_deviation(plant, robot, seed) for seed in range(200)]
    # the other draws stay, so that a seed means the same flight
    np.testing.assert_allclose(plain.joint_offset, math.radians(0.4))
    np.testing.assert_array_equal(drawn[3].rotor_gain, plain.rotor_gain)
    np.testing.assert_array_equal(drawn[3].spring_factor, plain.spring_factor)
    zeros = np.degrees([d.joint_offset for d in drawn]) - 0.4
    assert np.std(zeros, axis=0) == pytest.approx(0.3, rel=0.2)
    assert np.max(np.abs(np.corrcoef(zeros.T) - np.eye(len(joints)))) < 0.3
    # the plant's tip is off by each link's error along that link
    scenes = [build_scene(robot, world, d) for d in (plain, drawn[3])]
    datas = [mujoco.MjData(x.model) for x in scenes]
    for scene, data in zip(scenes, datas, strict=True):
        mujoco.mj_forward(scene.model, data)
    last = max(i for i, x in enumerate(limbs) if x.side <= 0)
    want, i = np.zeros(3), last
    while (i := limbs[i].parent) >= 0:
        R = datas[0].body(limbs[i].name).xmat.reshape(3, 3)
        want += drawn[3].link_length_errors[i] * (R @ link_direction(limbs[i].link))
    places = [d.body(limbs[last].name).xpos for d in datas]
    assert np.linalg.norm(want) > 1e-4
    np.testing.assert_allclose(places[1] - places[0], want, atol=1e-12)


def test_contact_sensor_reads_the_force_on_the_tip_in_W(description):
    """Pressed on the pipe with a known force, the plant's sensor shows it, away from the pipe."""
    scene = build_scene(description.robot, description.world, Deviation())
    m = scene.model
    m.opt.gravity[:] = 0.0
    d = mujoco.MjData(m)
    pipe = description.world.pipe
    q = np.array([-math.radians(40), math.radians(40)])
    set_pose(scene, d, np.zeros(3), np.array([1.0, 0, 0, 0]), q)
    mujoco.mj_forward(m, d)
    tip = d.site("tip").xpos.copy()
    p = np.array([pipe.x_m - pipe.diameter_m / 2 - 0.001, pipe.y_m, pipe.z_m]) - tip
    set_pose(scene, d, p, np.array([1.0, 0, 0, 0]), q)
    d.act[:] = [q[0], q[0] + q[1]]
    n_rotors = m.nu - 2
    d.ctrl[:] = 0.0
    force = 1.5
    for _ in range(6000):  # push, with strong damping on the free joint only
        d.qfrc_applied[:6] = -8.0 * d.qvel[:6]
        d.qfrc_applied[3:6] = -2.0 * d.qvel[3:6] - 30.0 * d.qpos[4:7]
        d.qfrc_applied[0] += force
        mujoco.mj_step(m, d)
    f = d.sensordata[scene.places.sensor_tip_force :][:3]
    assert n_rotors == 6
    assert abs(abs(f[0]) - force) < 0.05
    spring = -d.qpos[scene.places.slider_qpos]
    probe = description.robot.probe
    assert spring == pytest.approx(
        (force - probe.spring_preload_n) / probe.spring_n_per_m, abs=5e-4
    )


def test_stepping_from_compiled_code_is_mujoco_s_own_step(description):
    scene = build_scene(description.robot, description.world, Deviation())
    a, b = mujoco.MjData(scene.model), mujoco.MjData(scene.model)
    for d in (a, b):
        d.ctrl[:6] = [5.0, 4.5, 3.0, 3.1, 4.6, 5.2]
    step_physics(scene.model._address, a._address, 200)
    mujoco.mj_step(scene.model, b, 200)
    assert a.qpos.tobytes() == b.qpos.tobytes()


def build_servos(description):
    """The arm's servos on a plant without gravity, as (scene, data, a step of the servos)."""
    scene = build_scene(description.robot, description.world, Deviation())
    m, d = scene.model, mujoco.MjData(scene.model)
    me, drive = build_part(VelocityServos("servos"), build_context()), view(ServoDrive)
    mj = view(
        MuJoCo, ctrl=d.ctrl.ctypes.data, nu=m.nu, act=d.act.ctypes.data, na=m.na,
        qpos=d.qpos.ctypes.data, nq=m.nq, qvel=d.qvel.ctypes.data, nv=m.nv,
    )  # fmt: skip
    m.opt.gravity[:] = 0.0
    q = np.array([0.2, 0.3])
    set_pose(scene, d, np.array([-3.0, 0, 5.0]), np.array([1.0, 0, 0, 0]), q)
    mujoco.mj_forward(m, d)
    d.act[:] = d.actuator_length[6:]
    return scene, d, me, drive, lambda: VelocityServos.step(me, drive, mj)


def test_a_stalled_servo_does_not_wind_up(description):
    """Blocked for two seconds at full command, then freed at rest: no leap."""
    scene, d, me, drive, step = build_servos(description)
    drive.motor[0] = 1.0
    blocked, begin = d.qpos.copy(), float(d.act[0])
    for _ in range(1000):
        step()
        mujoco.mj_step(scene.model, d, 2)
        d.qpos[:], d.qvel[:] = blocked, 0.0  # an unyielding hand
    lag = float(me.lag[0])
    assert abs(d.act[0] - begin) < lag + 0.01
    assert lag < 0.2


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_fast_servo_without_a_load_does_not_stall(description, speed):
    """Its command runs ahead by kv / kp times its speed, at 3 rad/s by more than the stall's."""
    scene, d, me, drive, step = build_servos(description)
    drive.motor[1] = speed
    assert speed < 2.0 or me.damping_s[1] * speed > me.lag[1]
    for _ in range(250):
        step()
        mujoco.mj_step(scene.model, d, 2)
    motor = float(me.motor_from_joint[1, :2] @ d.qvel[me.qvel[:2]])
    assert motor == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize(("part", "mode"), [(VelocityServos, "velocity"), (TorqueServos, "torque")])
def test_each_servo_behind_a_passive_joint_gets_its_own_command(part, mode: str) -> None:
    """The pendulum's angle is not that of a servo; its deflection does not stall one."""
    joints = ("shoulder_pitch_servo", "elbow_pitch_servo")
    sets = [f"robot.arm.{name}.mode={mode}" for name in joints]
    context = build_context("bar-transport", sets)
    limbs, scene = list_joints(context.robot), context.scene
    assert [limb.servo for limb in limbs] == [-1, 0, 1, 2, 3]
    m, data = scene.model, mujoco.MjData(scene.model)
    me, drive = build_part(part("servos"), context), view(ServoDrive)
    mj = view(
        MuJoCo, ctrl=data.ctrl.ctypes.data, nu=m.nu, act=data.act.ctypes.data, na=m.na,
        qpos=data.qpos.ctypes.data, nq=m.nq, qvel=data.qvel.ctypes.data, nv=m.nv,
    )  # fmt: skip
    q = np.array([0.5, 0.1, -0.2, 0.3, -0.4])
    set_pose(scene, data, np.array([0.0, 0.0, 3.0]), np.array([1.0, 0, 0, 0]), q)
    mujoco.mj_forward(m, data)
    rotors = len(context.rotors.thrust_min)
    data.act[:] = data.actuator_length[rotors:][: m.na]
    told = np.array([0.0, -0.04, 0.03, -0.02, 0.01])
    drive.motor[:5] = told
    part.step(me, drive, mj)
    np.testing.assert_array_equal(data.ctrl[rotors : rotors + 4], told[1:])


@pytest.mark.parametrize("mission", ["pipe-weld-scan", "bar-insertion", "bridge-contact"])
def test_what_stands_still_is_a_weightless_body_of_the_plant_at_its_place(mission: str) -> None:
    d = load_description(mission)
    nominal = build_scene(d.robot, d.world).model
    plant = build_scene(d.robot, d.world, Deviation()).model
    data = mujoco.MjData(plant)
    mujoco.mj_kinematics(plant, data)
    fixed = [b for b in range(plant.nbody) if plant.body(b).name.startswith(FIXED)]
    assert fixed and not any(nominal.body(b).name.startswith(FIXED) for b in range(nominal.nbody))
    assert not set(list_moving(plant)) & {plant.body(b).name for b in fixed}
    assert not np.any(plant.body_mass[fixed]) and not np.any(plant.body_weldid[fixed])
    assert not np.any(plant.geom_bodyid[plant.geom_type != mujoco.mjtGeom.mjGEOM_PLANE] == 0)
    of_world = [g for g in range(nominal.ngeom) if nominal.geom_bodyid[g] == 0]
    names = {nominal.geom(g).name for g in of_world} - {"ground"}
    assert names == {plant.geom(g).name for g in np.flatnonzero(np.isin(plant.geom_bodyid, fixed))}
    for g in of_world:
        h = plant.geom(nominal.geom(g).name).id
        np.testing.assert_allclose(data.geom_xpos[h], nominal.geom_pos[g], atol=1e-12)
        kept = ("contype", "conaffinity", "condim", "size", "friction", "solref", "margin")
        for name in kept:
            values = (getattr(model, f"geom_{name}")[i] for model, i in ((plant, h), (nominal, g)))
            np.testing.assert_array_equal(*values)
