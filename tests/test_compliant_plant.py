"""The plant of the compliant arms: conservation, springs, servos, encoders, and static deflections.

Suarez 2020: springs (14)-(16), servo (17), Cartesian stiffness (27).
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import root

from plant_parts import view
from skywright.core.record import View
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.models.arm_body import Deviation
from skywright.models.body_records import Kinematics
from skywright.models.rigid_body import (
    build_body_model,
    fill_gravity_torque,
    fill_hands,
    fill_kinematics,
)
from skywright.models.rotors import build_rotors
from skywright.models.scene import Scene, build_scene
from skywright.models.servo_gains import compute_inertia_beyond, compute_servo_gains
from skywright.models.springs import spring_deflection, spring_torque
from skywright.vehicle.actuators._position_servos import PositionServos
from skywright.vehicle.arms.ports import Deflections
from skywright.vehicle.arms.truth import ServoState
from skywright.vehicle.bus import Clock, MuJoCo, ServoDrive
from skywright.vehicle.sensors.deflection_encoders import DeflectionEncoders

WORLD = load_world("open")[0]
ROBOT = load_robot("bimanual")[0]
JOINTS = [limb.name for limb in list_joints(ROBOT)]
SP, SY, EP = (JOINTS.index(f"left_{n}") for n in ("shoulder_pitch", "shoulder_yaw", "elbow_pitch"))
G = 9.81
DT = 0.002  # s, control tick
HEAVY = 1e6  # kg: a platform that does not move


# --- conservation -----------------------------------------------------------------------------


def undamped(name: str) -> Scene:
    """The plant without dampers, friction, stops and servos; springs and gear play stay."""
    scene = build_scene(load_robot(name)[0], WORLD, Deviation())
    m = scene.model
    m.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    m.opt.integrator, m.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2e-4
    m.dof_damping[:], m.dof_frictionloss[:], m.jnt_limited[:] = 0.0, 0.0, 0
    m.tendon_limited[:] = 0
    m.actuator_gainprm[:], m.actuator_biasprm[:] = 0.0, 0.0
    return scene


def spring_energy(robot, scene: Scene, qpos) -> float:
    """Energy (J) of all springs: k x^2 / 2 up to the linear range, k h (x - x_l)^2 / 2 more."""
    servos, m, total = list_servos(robot), scene.model, 0.0
    for limb, at in zip(list_joints(robot), scene.places.flex_qpos, strict=True):
        link = limb.link
        if at >= 0:
            play = math.radians(servos[limb.servo][1].backlash_deg)
            x = max(abs(qpos[at]) - play / 2, 0.0)
            over = max(x - math.radians(link.flex_linear_deg), 0.0)
            k = link.flex_stiffness_nm_per_rad
            total += 0.5 * k * (x**2 + (link.flex_hardening - 1.0) * over**2)
        if link.lateral_stiffness_nm_per_rad is not None:
            bend = qpos[m.joint(f"{limb.name} lateral").qposadr[0]]
            total += 0.5 * link.lateral_stiffness_nm_per_rad * bend**2
    return total


def start_wild(scene: Scene, seed: int) -> Any:
    m, rng = scene.model, np.random.default_rng(seed)
    d = mujoco.MjData(m)
    d.qpos[:3], d.qpos[3:7] = [0.0, 0.0, 6.0], [0.8, 0.36, -0.48, 0.0]
    d.qpos[7:] = rng.uniform(-0.6, 0.6, m.nq - 7)
    flex = scene.places.flex_qpos[scene.places.flex_qpos >= 0]
    d.qpos[flex] = rng.uniform(-0.35, 0.35, len(flex))  # 20 deg: far into the harder part
    d.qvel[:] = rng.normal(size=m.nv)
    mujoco.mj_forward(m, d)
    mujoco.mj_subtreeVel(m, d)
    return d


@pytest.mark.parametrize("name", ["bimanual", "bimanual-longreach"])
def test_energy_is_conserved_without_damping(name: str) -> None:
    """Springs, gear play, shafts and passive link give back what they take: (10), (11)."""
    robot, scene = load_robot(name)[0], undamped(name)
    m, d = scene.model, start_wild(scene, 3)
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # arms that meet lose energy
    e0, spring0 = d.energy.sum(), spring_energy(robot, scene, d.qpos)
    gravity = G * float(m.body_mass @ d.xipos[:, 2])
    assert d.energy[0] == pytest.approx(gravity + spring0, rel=1e-12)
    springs, drift = [], 0.0
    for _ in range(50):
        mujoco.mj_step(m, d, 50)
        mujoco.mj_forward(m, d)
        springs.append(spring_energy(robot, scene, d.qpos))
        drift = max(drift, abs(d.energy.sum() - e0))
    assert max(springs) - min(springs) > 0.3  # they did work meanwhile
    assert drift < 3e-5 * (max(springs) - min(springs))


def test_momentum_is_conserved_without_gravity() -> None:
    scene = undamped("bimanual-longreach")
    m = scene.model
    m.opt.gravity[:] = 0.0
    d = start_wild(scene, 8)
    platform = scene.places.platform_body
    linear, angular = d.subtree_linvel[platform].copy(), d.subtree_angmom[platform].copy()
    assert np.linalg.norm(angular) > 0.1
    mujoco.mj_step(m, d, 2500)
    mujoco.mj_forward(m, d)
    mujoco.mj_subtreeVel(m, d)
    np.testing.assert_allclose(d.subtree_linvel[platform], linear, atol=1e-9)
    np.testing.assert_allclose(d.subtree_angmom[platform], angular, atol=1e-6)


# --- springs ----------------------------------------------------------------------------------


@given(
    k=st.floats(0.1, 10.0), linear=st.floats(0.01, 0.5), hardening=st.floats(1.0, 20.0),
    deflection=st.floats(-1.5, 1.5),
)  # fmt: skip
def test_deflection_is_the_inverse_of_torque(
    k: float, linear: float, hardening: float, deflection: float
) -> None:
    torque = spring_torque(k, linear, hardening, deflection)
    assert spring_deflection(k, linear, hardening, torque) == pytest.approx(deflection, abs=1e-12)
    if abs(deflection) <= linear:
        assert torque == k * deflection  # (15) without damping
    # the torque is the slope of the energy, continuous at the end of the linear range
    h = 1e-6

    def energy(x: float) -> float:
        over = max(abs(x) - linear, 0.0)
        return 0.5 * k * (x * x + (hardening - 1.0) * over * over)

    slope = (energy(deflection + h) - energy(deflection - h)) / (2.0 * h)
    assert torque == pytest.approx(slope, abs=1e-3 * k * hardening)


def test_inertia_beyond_a_joint_is_that_of_the_stretched_arm() -> None:
    """What sizes dampers and stiff servos, against MuJoCo's mass matrix, arms hanging."""
    for name in ("bimanual", "bimanual-longreach"):
        robot = load_robot(name)[0]
        scene = build_scene(robot, WORLD)
        d = mujoco.MjData(scene.model)
        mujoco.mj_forward(scene.model, d)
        full = np.zeros((scene.model.nv, scene.model.nv))
        mujoco.mj_fullM(scene.model, d, full)
        limbs = [limb.name for limb in list_joints(robot)]
        at = 0 if robot.pendulum is not None else limbs.index("left_shoulder_pitch")
        exact = full[scene.places.joint_dof[at], scene.places.joint_dof[at]]
        # it takes the shoulders' distance from the middle for reach, too
        assert compute_inertia_beyond(robot, at) == pytest.approx(exact, rel=0.03)


# --- servos -----------------------------------------------------------------------------------


class Bench(NamedTuple):
    """The plant on a platform that does not move."""

    scene: Scene
    m: Any
    d: Any
    servos: Any  # PositionServos.Me
    state: Any  # ServoState
    clock: Any
    mj: Any
    hand: int  # body of the left hand

    def act(self, command) -> None:
        """Let the servos take a command of shaft angles for a control tick."""
        drive = view(ServoDrive)
        drive.motor[: len(command)] = command
        PositionServos.step(self.servos, self.clock, drive, self.mj, self.state)
        self.clock.tick += 1

    def run(self, command, seconds: float) -> Any:
        """Command shaft angles (n,) rad; returns theta (n_steps, n) at 1 ms."""
        out = []
        for _ in range(round(seconds / DT)):
            self.act(command)
            for _ in range(2):
                mujoco.mj_step(self.m, self.d)
                out.append(self.d.qpos[self.scene.places.joint_qpos])
        return np.array(out)


def build_bench(gravity: float = 0.0, start=None, calm: float = 0.0) -> Bench:
    """Shafts at `start` (n,) rad; `calm` is more damping (N m s/rad) for tests of rest."""
    scene = build_scene(ROBOT, WORLD, Deviation())
    m, base = scene.model, scene.places.platform_body
    m.body_mass[base], m.body_inertia[base] = HEAVY, HEAVY
    m.opt.gravity[:] = [0.0, 0.0, -gravity]
    m.dof_damping[scene.places.joint_dof + 1] += calm
    mujoco.mj_setConst(m, mujoco.MjData(m))
    d, records = mujoco.MjData(m), {(ServoState, ""): np.zeros(1, ServoState.dtype)}
    context = SimpleNamespace(deviation=Deviation(), 
        robot=ROBOT, world=WORLD, scene=scene, rotors=build_rotors(ROBOT.rotors), records=records,
        start=(0.0, 0.0, 0.0),
    )  # fmt: skip
    servos, state = view(PositionServos.Me), View(records[ServoState, ""][0])
    PositionServos("servos").build(servos, None, context)
    state.held[:] = state.now[:] = 0.0
    d.qpos[2], d.xfrc_applied[base, 2] = 5.0, HEAVY * gravity
    if start is not None:
        d.qpos[scene.places.joint_qpos] = start
        state.now[: len(start)] = state.held[: len(start)] = start
    mujoco.mj_forward(m, d)
    mj = view(
        MuJoCo, ctrl=d.ctrl.ctypes.data, nu=m.nu, qpos=d.qpos.ctypes.data, nq=m.nq,
    )  # fmt: skip
    return Bench(scene, m, d, servos, state, view(Clock, dt=DT), mj, m.body("hand0").id)


@pytest.mark.parametrize("joint", [SP, SY, EP])
def test_step_response_of_a_servo_is_that_of_17(joint: int) -> None:
    """theta + T_s theta_dot = theta_ref: 63 % after T_s +-10 %, whatever the step.

    A fifth of T_s is the inner loop's, of second order: 86 % come a little before 2 T_s.
    """
    period = ROBOT.arm.servos["shoulder_pitch_servo"].position_time_constant_s
    for degrees in (2.0, 10.0):
        bench, command = build_bench(), np.zeros(8)
        command[joint] = -math.radians(degrees)
        theta = bench.run(command, 0.2)[:, joint] / bench.state.held[joint]
        for times, within in ((1.0, 0.1), (2.0, 0.15)):
            t = 1e-3 * (np.argmax(theta >= 1.0 - math.exp(-times)) + 1)
            assert t == pytest.approx(times * period, rel=within)
        assert theta.max() < 1.02  # no overshoot of its own


def test_servo_moves_no_faster_than_its_no_load_speed() -> None:
    """A step of 80 deg: the shaft cruises at 6.3 rad/s (shoulder yaw, whose load is small)."""
    bench, command = build_bench(), np.zeros(8)
    command[SY] = math.radians(80.0)
    theta = bench.run(command, 0.4)[:, SY]
    speed = ROBOT.arm.servos["shoulder_yaw_servo"].no_load_speed_rad_s
    cruise = (np.interp([0.3, 0.7], theta[:180], np.arange(180) * 1e-3) @ [-1.0, 1.0]) / 0.4
    assert 1.0 / cruise == pytest.approx(speed, rel=0.05)
    # torque and speed are limited apart: after a stalled start it catches up a little faster
    assert np.diff(theta).max() * 1e3 < 1.2 * speed


def test_a_blocked_servo_pushes_with_its_stall_torque() -> None:
    bench, command = build_bench(), np.full(8, math.radians(50.0))
    blocked = bench.d.qpos.copy()
    for _ in range(200):
        bench.act(command)
        mujoco.mj_step(bench.m, bench.d, 2)
        bench.d.qpos[:], bench.d.qvel[:] = blocked, 0.0
    stall = [servo.stall_torque_nm for _, servo in list_servos(ROBOT)]
    np.testing.assert_allclose(bench.d.actuator_force[6:], stall)


def test_commands_are_rounded_and_held_for_20_ms() -> None:
    bench = build_bench()
    servo = ROBOT.arm.servos["shoulder_pitch_servo"]
    held, lsb, motor = [], math.radians(servo.resolution_deg), np.zeros(MAX_JOINTS)
    for i in range(500):  # 1 s of a ramp of 1 rad/s
        motor[SP] = -i * DT
        bench.act(motor)
        held.append(bench.state.held[SP])
    held = np.array(held)
    changes = np.flatnonzero(np.diff(held))
    assert np.all(np.diff(changes) * DT == pytest.approx(servo.command_period_s))
    np.testing.assert_allclose(held / lsb, np.round(held / lsb), atol=1e-9)
    late = -np.arange(500) * DT - held  # behind by up to a period, and half a unit of rounding
    assert np.abs(late[1:]).max() <= servo.command_period_s + lsb / 2 + 1e-9


def test_gear_play_is_felt_at_the_output() -> None:
    """Pushed to and fro with less and less torque, what remains of the way is the backlash."""
    bench = build_bench(calm=0.1)
    flex = bench.scene.places.flex_qpos[SP]
    k = ROBOT.arm.links["shoulder_pitch"].flex_stiffness_nm_per_rad
    ways = []
    for torque in (0.04, 0.02):
        ends = []
        for sign in (1.0, -1.0):
            bench.d.qfrc_applied[bench.scene.places.joint_dof[SP] + 1] = sign * torque
            bench.run(np.zeros(8), 4.0)
            ends.append(bench.d.qpos[flex])
        ways.append(ends[0] - ends[1])
    assert 2.0 * ways[1] - ways[0] == pytest.approx(math.radians(0.3), abs=2e-4)
    assert ways[0] - ways[1] == pytest.approx(2.0 * 0.02 / k, rel=0.02)


def test_deflection_encoders_read_at_200_hz_with_their_noise() -> None:
    """14 bit, 0.05 deg of noise, an error that follows the angle below 0.2 deg."""
    bench, n = build_bench(), 1000  # two seconds
    encoders, out = DeflectionEncoders("encoders"), view(Deflections)
    me = view(DeflectionEncoders.Me)
    context = SimpleNamespace(
        robot=ROBOT, scene=bench.scene, stream=lambda name: np.random.default_rng(1)
    )
    encoders.build(me, None, context)
    noise = np.random.default_rng(4).standard_normal((n, MAX_JOINTS))
    true = math.radians(6.0)
    bench.d.qpos[bench.scene.places.flex_qpos] = -true
    read = np.zeros((n, 8))
    for i in range(n):
        bench.clock.t = i * DT
        draw = view(DeflectionEncoders.Noise, raw=noise[i])
        DeflectionEncoders.step(me, bench.clock, bench.mj, draw, out)
        read[i] = out.deflection[:8]
    sensed = [n for n, limb in enumerate(list_joints(ROBOT)) if limb.link.deflection_encoder]
    assert JOINTS.index("left_shoulder_pitch") in sensed and SY not in sensed
    assert np.all(read[:, SY] == 0.0)
    for j in sensed:
        fresh = np.flatnonzero(np.diff(read[:, j]) != 0.0)
        # two readings in a row may fall on one count, more readings than 200 Hz cannot be
        assert 0.9 * 200.0 * n * DT * (2 / 3) < len(fresh) <= 200.0 * n * DT
        lsb = 2.0 * math.pi / 2**14
        np.testing.assert_allclose(read[:, j] / lsb, np.round(read[:, j] / lsb), atol=1e-6)
        assert np.std(read[:, j]) == pytest.approx(math.radians(0.05), rel=0.15)
        assert abs(np.mean(read[:, j]) - true) < math.radians(0.03)


# --- static deflections -----------------------------------------------------------------------

L_POSE = np.array([0.0, 0.0, 0.0, -math.pi / 2] * 2)


def compute_statics(q, g_B) -> tuple[Any, Any]:
    """Gravity torques (8,) and the left hand's Jacobian (3, 8) of our own model."""
    model, k = build_body_model(ROBOT), np.zeros(1, Kinematics.dtype)
    full, torque = np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
    full[:8] = q
    fill_kinematics(model[0], full, k[0])
    fill_hands(model[0], k[0])
    fill_gravity_torque(model[0], k[0], np.asarray(g_B, dtype=float), torque)
    return torque[:8], k[0]["J_BH"][0][:, :8].copy()


def test_cartesian_stiffness_in_the_l_pose() -> None:
    """(27), (28) with shoulder pitch and elbow: [[70.6, -23.7], [-23.7, 23.7]] N/m in x-z."""
    _, J = compute_statics(L_POSE, [0.0, 0.0, -G])
    J = J[np.ix_([0, 2], [SP, EP])]
    Kp = np.diag([2.93, 1.48])
    K_C = np.linalg.inv(J).T @ Kp @ np.linalg.inv(J)
    # z up and x forward: pushed forward the hand also rises
    np.testing.assert_allclose(np.abs(K_C), [[70.56, 23.68], [23.68, 23.68]], atol=0.01)
    for force, degrees, way in (
        ([2.0, 0.0], [9.78, 0.0], 0.0427),
        ([0.0, 2.0], [9.78, 19.36], 0.127),
    ):
        spring = np.linalg.solve(Kp, J.T @ force)
        np.testing.assert_allclose(np.abs(np.degrees(spring)), degrees, atol=0.01)
        assert abs(np.array(force) @ (J @ spring)) / 2.0 == pytest.approx(way, abs=3e-4)


def solve_statics(command, force, gravity: float) -> tuple[Any, Any]:
    """Equilibrium of springs with play, weight and a force on the left hand: (theta, q).

    spring_torque(theta - q) holds the weight less the force; the servo's shaft sags by that
    torque over its inner gain.
    """
    servos, links = list_servos(ROBOT), [limb.link for limb in list_joints(ROBOT)]
    kp = np.array([compute_servo_gains(ROBOT, j)[0] for j in range(8)])

    def angles(torque) -> tuple[Any, Any]:
        theta = command - torque / kp
        play = np.radians([servo.backlash_deg for _, servo in servos]) / 2
        deflection = [
            spring_deflection(
                x.flex_stiffness_nm_per_rad, math.radians(x.flex_linear_deg), x.flex_hardening, t
            )
            for x, t in zip(links, torque, strict=True)
        ]
        return theta, theta - deflection - play * np.tanh(torque / 1e-7)

    def residual(torque):
        weight, J = compute_statics(angles(torque)[1], [0.0, 0.0, -gravity])
        return weight - J.T @ force - torque

    found = root(residual, np.zeros(8), method="krylov", options={"fatol": 1e-9})
    pitch = [SP, EP]
    assert np.abs(residual(found.x)[pitch]).max() < 1e-6
    return angles(found.x)


CASES = {
    "forward": [2.0, 0.0, 0.0],
    "upward": [0.0, 0.0, 2.0],
    "light": [0.2, 0.0, 0.1],
}


@pytest.mark.parametrize("gravity", [0.0, G])
@pytest.mark.parametrize("case", CASES)
def test_hand_yields_as_statics_say(case: str, gravity: float) -> None:
    """The plant at rest in the L pose against an equilibrium that our own model computes."""
    force = np.array(CASES[case])
    command = np.round(L_POSE / math.radians(0.325)) * math.radians(0.325)
    bench = build_bench(gravity, start=command, calm=0.5)
    bench.d.xfrc_applied[bench.hand, :3] = force
    bench.run(command, 8.0)
    places = bench.scene.places
    theta = bench.d.qpos[places.joint_qpos]
    deflection = -bench.d.qpos[places.flex_qpos]
    theta_des, q_des = solve_statics(command, force, gravity)
    for j in (SP, EP):
        assert theta[j] == pytest.approx(theta_des[j], abs=1e-4)
        assert deflection[j] == pytest.approx(theta_des[j] - q_des[j], abs=2e-4)
