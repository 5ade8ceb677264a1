"""The law whole_body_qp: its solver, its program, what it does at each limit and without one."""

from __future__ import annotations

import math

import daqp
import mujoco
import numpy as np
import pytest
from scipy.optimize import linprog, minimize, nnls

from skywright.core.record import View
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.loader import load_description
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.arm_body import Deviation
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_kinematics,
    posture,
)
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene
from skywright.run.backends import build_vehicle
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.allocation import follow_told
from skywright.vehicle.bus import ThrustCommand
from skywright.vehicle.laws import _daqp
from skywright.vehicle.laws._arm_reaction import fill_reaction
from skywright.vehicle.laws._qp_task import EDGE, FACETS
from skywright.vehicle.stepped import LawStep

WALL = rot_y(-math.pi / 2)  # of a surface that faces -x


def build(*sets: str, robot: str = "othex", law: str = "whole_body_qp") -> LawStep:
    mission = "waypoints" if robot == "omnicopter" else "pipe-weld-scan"
    return LawStep(
        build_vehicle(load_description(mission, robot=robot, sets=[f"mission.law={law}", *sets]))
    )


def press(law: LawStep, push: float = 0.02, slide: float = 0.01) -> None:
    """Ask for a tip `push` (m) inside a wall before it, sliding up; the robot stands still."""
    ref, est = law.reference, law.estimate
    q = posture(law.vehicle.robot, "working")
    for row in (ref, est):
        row.q[: len(q)] = q
    k = compute_kinematics(law.vehicle.model, q)
    est.p_WT = est.p_WB + est.R_WB @ k["p_BT"]
    ref.R_WS, ref.track_tip, ref.dead_zone = WALL, 1.0, 0.03
    ref.p_WT = est.p_WT + push * -WALL[:, 2]
    ref.v_WT = [0.0, 0.0, slide]


def disturb(law: LawStep, seed: int, size: float = 1.0) -> None:
    """Move the estimate off its reference."""
    rng, est = np.random.default_rng(seed), law.estimate
    angles = 0.05 * size * rng.standard_normal(3)
    est.R_WB = est.R_WB @ rot_z(angles[0]) @ rot_y(angles[1]) @ rot_x(angles[2])
    est.v_WB = est.v_WB + 0.05 * size * rng.standard_normal(3)
    est.w_WB_B = est.w_WB_B + 0.1 * size * rng.standard_normal(3)
    n = int(law.vehicle.model[0]["n_joints"])
    est.q[:n] += 0.02 * size * rng.standard_normal(n)
    est.qd[:n] += 0.05 * size * rng.standard_normal(n)


def read_program(law: LawStep) -> tuple[np.ndarray, ...]:
    """Return H, A, lower, upper, x of the last program, the bounds among the rows."""
    me = law.ports["me"]
    n, rows = int(me.n + me.m + 3), int(2 * me.m + FACETS)
    from skywright.core.compiled import table, words

    H, A = table(me.H, n, n), table(me.A, rows, n)
    both = [words(me[name], n + rows) for name in ("lower", "upper")]
    return (
        H.copy(),
        np.vstack([np.eye(n), A]),
        both[0].copy(),
        both[1].copy(),
        words(me.x, n).copy(),
    )


@pytest.fixture(scope="module")
def free() -> LawStep:
    return build()


@pytest.fixture(scope="module")
def weak() -> LawStep:
    """Rotors that hold the weight, and little beside it."""
    return build("robot.rotors.thrust_max_n=6.8")


@pytest.fixture
def at_rest(free: LawStep, weak: LawStep):
    """Both laws as they were before the test."""
    saved = [(law, law.vehicle.save()) for law in (free, weak)]
    yield
    for law, state in saved:
        law.vehicle.restore(state)


def test_the_solver_solves_as_its_python_interface_does() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        n, m = 7, 6
        root = rng.standard_normal((n, n))
        p = _daqp.build_program(n, m)
        p.H[:], p.f[:] = root @ root.T + 0.1 * np.eye(n), rng.standard_normal(n)
        p.A[:] = rng.standard_normal((m, n))
        p.lower[:], p.upper[:] = -rng.uniform(0.0, 0.5, n + m), rng.uniform(0.0, 0.5, n + m)
        _daqp.solve(_daqp.load_solver(), p.problem.ctypes.data, p.result.ctypes.data)
        x, value, flag, _ = daqp.solve(p.H, p.f, p.A, p.upper, p.lower, np.zeros(n + m, np.int32))
        assert p.result["flag"][0] == flag == _daqp.OPTIMAL
        np.testing.assert_allclose(p.x, x, atol=1e-9)
        assert p.result["value"][0] == pytest.approx(value)


def test_another_layout_of_the_solvers_records_is_noticed(monkeypatch) -> None:
    shorter = [(n, _daqp.RESULT.fields[n][0]) for n in _daqp.RESULT.names if n != "nodes"]
    monkeypatch.setattr(_daqp, "RESULT", np.dtype(shorter, align=True))
    with pytest.raises(RuntimeError, match=r"daqp 0\.11\.\d+ has another layout"):
        _daqp.load_solver.__wrapped__()


@pytest.mark.parametrize("robot", ["othex", "tilthex-arm"])
def test_the_arms_reaction_is_the_platforms_rows_of_the_mass_matrix(robot: str) -> None:
    """Against MuJoCo, whose free joint moves the origin of B, in W, and turns in B."""
    d = load_description("pipe-weld-scan", robot=robot)
    q = posture(d.robot, "working") + 0.1
    scene = build_scene(d.robot, d.world, Deviation())
    data = mujoco.MjData(scene.model)
    data.qpos[:7] = [0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0]
    data.qpos[scene.places.joint_qpos] = q
    mujoco.mj_forward(scene.model, data)
    M = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, M)
    model = build_body_model(d.robot)
    k = compute_kinematics(model, q)
    for j, at in enumerate(scene.places.joint_qpos):
        dof = int(scene.model.jnt_dofadr[np.flatnonzero(scene.model.jnt_qposadr == at)[0]])
        force, torque = np.zeros(3), np.zeros(3)
        fill_reaction(View(model[0]), View(k), j, force, torque)
        np.testing.assert_allclose([*force, *torque], M[:6, dof], atol=1e-9)


def test_without_a_limit_it_is_laws_2_to_4_and_the_moment_of_the_contact(free, at_rest) -> None:
    paper = build(law="push_and_slide")
    both = [(law, law.vehicle.save()) for law in (free, paper)]
    for seed in range(8):
        for law, state in both:
            law.vehicle.restore(state)
            press(law)
            law.reference.v_WT = v = np.array([0.004, 0.0, 0.01])  # also off the wall
            disturb(law, seed, 0.4)
        own, told = free.step(), free.ports["told"]
        wanted = paper.step()
        assert told.given == 1.0 and told.limits == 0.0
        np.testing.assert_allclose(own.qd, wanted.qd, atol=1e-12)
        body, est, me = free.ports["body"], free.estimate, free.ports["me"]
        push = -float(body.mass * me.wn_p**2 * WALL[:, 2] @ (free.reference.p_WT - est.p_WT))
        against = v / math.hypot(*v, 1e-3)
        contact = est.R_WB.T @ (push * (WALL[:, 2] - me.friction * against))
        assert push > 1.0
        qdd = (wanted.qd[:2] - est.qd[:2]) / me.T_v[:2]
        force, torque = np.array(wanted.f_B), np.array(wanted.t_B)
        torque -= np.cross(body.p_BT - body.p_BC, contact)
        for j in range(2):
            f, t = np.zeros(3), np.zeros(3)
            fill_reaction(free.ports["model"], free.ports["kin"], j, f, t)
            force, torque = force + f * qdd[j], torque + t * qdd[j]
        np.testing.assert_allclose(own.f_B, force, atol=1e-9)
        np.testing.assert_allclose(own.t_B, torque, atol=1e-9)
        made = me.B[:, :6] @ told.thrust[:6]
        np.testing.assert_allclose(made[:5], [*own.f_B, *own.t_B[:2]], atol=1e-9)
        assert made[5] == pytest.approx(me.t_z, abs=1e-9)


def test_the_cost_is_that_of_the_dynamics_about_the_centre_of_mass(weak, at_rest) -> None:
    """H from the wrenches of rotors, accelerating joints and the contact, each row weighted."""
    press(weak, push=0.12)
    disturb(weak, 3, 2.0)
    weak.step()
    body, R, me = weak.ports["body"], np.array(weak.estimate.R_WB), weak.ports["me"]
    columns = []

    def add(force_B: np.ndarray, torque: np.ndarray) -> None:
        columns.append([*R @ force_B, *torque - np.cross(body.p_BC, force_B)])

    for i in range(6):
        add(me.B[:3, i], me.B[3:, i])
    for j in range(2):
        f, t = np.zeros(3), np.zeros(3)
        fill_reaction(weak.ports["model"], weak.ports["kin"], j, f, t)
        add(-f, -t)
    for axis in _axes(weak):
        add(R.T @ axis, np.cross(body.p_BT, R.T @ axis))
    weight = float(body.mass * body.gravity)
    vertical, lateral, roll, yaw, contact, arm = me.weight
    rows = np.array([lateral, lateral, vertical, *np.array([roll, roll, yaw]) / me.lever]) / weight
    J = rows[:, None] * np.array(columns).T
    least = [*[6e-2 / weight] * 6, *arm / me.a_max[:2], *[contact / weight] * 3]
    H = read_program(weak)[0]
    np.testing.assert_allclose(H, J.T @ J + np.diag(np.square(least)), rtol=1e-9, atol=1e-12)


def test_eight_rotors_get_what_the_allocation_would_tell_them() -> None:
    law = build(robot="omnicopter")
    disturb(law, 1)
    cmd = law.step()
    a, told = law.vehicle.assembly.context.allocator, law.ports["told"]
    wrench = [*cmd.f_B, *cmd.t_B[:2], law.ports["me"].t_z]
    np.testing.assert_allclose(told.thrust[:8], a.P @ wrench + a.preload, atol=1e-9)
    assert told.given == 1.0 and told.limits == 0.0


def test_at_a_limit_the_solution_is_optimal(weak, at_rest) -> None:
    """KKT of each recorded program, and SciPy finds nothing better."""
    bound, state = 0, weak.vehicle.save()
    for seed in range(6):
        weak.vehicle.restore(state)
        press(weak, push=0.12)
        disturb(weak, seed, 2.0)
        weak.step()
        if weak.ports["told"].limits != 1.0:
            continue
        bound += 1
        H, A, low, high, x = read_program(weak)
        rows = A @ x
        assert np.all(rows >= low - 1e-5) and np.all(rows <= high + 1e-5)
        at_low, at_high = rows < low + 1e-5, rows > high - 1e-5
        normals = np.vstack([A[at_high], -A[at_low]])
        # H x + normals' lam = 0 with lam >= 0: nearest point of a cone
        scale = np.abs(H @ x).max()
        lam = nnls(normals.T / scale, -H @ x / scale)[0]
        np.testing.assert_allclose(normals.T @ lam, -H @ x, atol=1e-4 * scale)
        limits = [(lo, hi) for lo, hi in zip(low[: len(x)], high[: len(x)], strict=True)]
        inside = {
            "type": "ineq",
            "fun": lambda y, A=A, high=high: np.where(high < 1e29, high - A @ y, 1.0),
        }
        other = minimize(
            lambda y, H=H: 0.5 * y @ H @ y, x, jac=lambda y, H=H: H @ y, bounds=limits,
            constraints=[inside], method="SLSQP",
        )  # fmt: skip
        assert 0.5 * x @ H @ x <= other.fun * (1.0 + 1e-4) + 1e-9
    assert bound >= 3


def test_rotor_limits_hold_and_roll_and_pitch_come_before_the_push(weak, at_rest) -> None:
    press(weak, push=0.12)
    cmd, told, me = weak.step(), weak.ports["told"], weak.ports["me"]
    assert told.limits == 1.0
    T = told.thrust[:6]
    assert np.all(me.t_min[:6] - 1e-12 <= T) and np.all(me.t_max[:6] + 1e-12 >= T)
    assert np.max(T - me.t_max[:6]) == pytest.approx(0.0, abs=1e-6)
    body = weak.ports["body"]
    missing = me.B[:, :6] @ T - [*cmd.f_B, *cmd.t_B[:2], me.t_z]
    contact = read_program(weak)[4][-3:]  # what is given up of it
    force_C = np.column_stack([*_axes(weak)]) @ contact
    force, torque = missing[:3] + weak.estimate.R_WB.T @ force_C, missing[3:]
    torque = (
        torque
        - np.cross(body.p_BC, missing[:3])
        + np.cross(body.p_BT - body.p_BC, weak.estimate.R_WB.T @ force_C)
    )
    weight = body.mass * body.gravity
    assert contact[2] < -0.5  # some newtons less of the push than asked for
    assert abs(force[2]) < 0.005 * weight and np.all(np.abs(torque[:2]) < 0.005 * weight * me.lever)


def _axes(law: LawStep) -> list[np.ndarray]:
    n, down = WALL[:, 2], np.array([0.0, 0.0, -1.0])  # sliding up, braked downwards
    return [down, np.cross(n, down), n]


def test_the_friction_cone_holds(at_rest) -> None:
    law = build("mission.law.friction_cone=0.1")
    press(law, push=0.03)
    law.step()
    told, me = law.ports["told"], law.ports["me"]
    assert me.friction > me.mu == 0.1 and told.limits == 1.0
    push = float(law.ports["body"].mass * me.wn_p**2 * 0.03)
    f = read_program(law)[4][-3:] + [me.friction * push * 0.01 / math.hypot(0.01, 1e-3), 0.0, push]
    assert f[2] > 0.5 * push
    assert math.hypot(f[0], f[1]) <= 0.1 * f[2] + 1e-6
    assert max(EDGE @ f[:2]) == pytest.approx(0.1 * math.cos(math.pi / 8) * f[2], abs=1e-5)


def test_a_joint_slows_down_before_its_stop(free, at_rest) -> None:
    press(free, push=0.0)
    me, ref, est = free.ports["me"], free.reference, free.estimate
    top = float(me.q_max[0])
    est.q[0], ref.q[0] = top - 0.01, top + 1.0
    cmd = free.step()
    assert free.ports["told"].limits == 1.0
    assert cmd.qd[0] == pytest.approx(me.stop_rate * 0.01, abs=1e-5)
    est.q[0] = top + 0.02  # beyond it: back
    assert free.step().qd[0] == pytest.approx(-me.stop_rate * 0.02, abs=1e-4)


def test_limits_that_contradict_each_other_give_way(free, at_rest) -> None:
    """Far beyond a stop at speed, what would take it back at once is more than the servo has."""
    press(free, push=0.0)
    me, est = free.ports["me"], free.estimate
    me.a_max[0] = 5.0
    est.q[0], est.qd[0] = me.q_max[0] + 0.5, 3.0
    cmd, told = free.step(), free.ports["told"]
    assert told.limits == 2.0 and told.given == 1.0
    assert cmd.qd[0] == pytest.approx(3.0 - 5.0 * me.T_v[0], abs=1e-6)  # brakes as it can
    assert np.all(np.isfinite(told.thrust)) and np.all(told.thrust[:6] >= me.t_min[:6])


def test_what_is_not_a_number_commands_no_thrust(free, at_rest) -> None:
    press(free)
    free.estimate.v_WB[0] = math.nan
    free.run()  # `step` refuses it before the law sees it
    assert free.ports["told"].given == 0.0


def test_plain_python_does_what_compiled_code_does(weak, at_rest) -> None:
    press(weak, push=0.12)
    weak.step()  # the body is that of these joints
    state = weak.vehicle.save()
    weak.step()
    compiled = np.array(weak.ports["told"].thrust), np.array(weak.command.qd)
    weak.vehicle.restore(state)
    weak.assembly.run_python(weak.rows[-1])
    assert weak.ports["told"].limits == 1.0
    np.testing.assert_allclose(weak.ports["told"].thrust, compiled[0], atol=1e-9)
    np.testing.assert_allclose(weak.command.qd, compiled[1], atol=1e-9)


def test_the_allocation_keeps_told_thrusts_within_the_rotors_limits() -> None:
    told, B = np.zeros(1, ThrustCommand.dtype)[0], np.ones((6, 8))
    low, high, preload, thrust = np.full(8, -2.0), np.full(8, 2.0), np.full(8, 3.0), np.full(8, 9.0)

    def follow(wrench: float) -> float:
        both = np.full(3, wrench)
        return follow_told(View(told), low, high, preload, B, both, both, 1e-6, 3.0, thrust)

    assert follow(0.0) == 3.0 and np.all(thrust == 9.0)  # nothing is told: as it was
    told["given"], told["thrust"][:8] = 1.0, np.arange(8.0)
    assert follow(26.0) == 0.0  # the sum of
    np.testing.assert_allclose(thrust, [1.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0])
    assert follow(27.0) == 1.0
    told["thrust"][:8] = 3.0
    assert follow(27.0) == 0.0  # given up by the law; no rotor is at a limit
    told["thrust"][3] = math.nan
    assert follow(26.0) == 3.0 and np.all(np.isfinite(thrust))


@pytest.mark.parametrize(
    ("robot", "why"),
    [("bimanual", "lateral force"), ("hexarotor", "lateral force")],
)
def test_robots_that_it_cannot_fly_are_refused(robot: str, why: str) -> None:
    d = load_description("waypoints", robot=robot, sets=["mission.law=whole_body_qp"])
    with pytest.raises(InputError, match=why) as told:
        build_law(d, Setup(d))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("robot", "why"),
    [("bimanual", "servos that take angles"), ("ars-lrm", "springs|without a servo")],
)
def test_arms_whose_speeds_it_cannot_command_are_refused(robot: str, why: str) -> None:
    d = load_description("waypoints", robot=robot)
    from skywright.vehicle.laws.whole_body_qp import WholeBodyQp

    with pytest.raises(InputError, match=why):
        WholeBodyQp("law").check_robot(d.robot)


def find_hover(robot: Robot, lost: int) -> np.ndarray | None:
    """Return up (3,) in B of a hover without a rotor, or None.

    Thrusts within their limits that balance u, weights along u at the centre of mass, are a convex
    set: between its least and its largest lift it has a u of length 1.
    """
    rotors = build_rotors(robot.rotors)
    mass, c, _ = compute_body(build_body_model(robot), posture(robot, "folded"))
    turn = np.array([[0.0, -c[2], c[1]], [c[2], 0.0, -c[0]], [-c[1], c[0], 0.0]])
    A = np.hstack([rotors.B, -9.81 * mass * np.vstack([np.eye(3), turn])])
    limits = [*zip(rotors.thrust_min, rotors.thrust_max, strict=True), *[(None, None)] * 3]
    limits[lost] = (0.0, 0.0)
    ends = []
    for sign in (1.0, -1.0):
        cost = np.zeros(A.shape[1])
        cost[-1] = sign
        found = linprog(cost, A_eq=A, b_eq=np.zeros(6), bounds=limits, method="highs")
        if found.status != 0:
            return None
        ends.append(found.x[-3:])
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    line = (1.0 - share) * ends[0] + share * ends[1]
    length = np.linalg.norm(line, axis=1)
    return line[int(np.argmin(np.abs(length - 1.0)))] if length[0] < 1.0 < length[-1] else None


def test_five_rotors_of_the_othex_hold_it_only_where_it_leans() -> None:
    """Level flight is what the laws ask for, so that no law here flies on without a rotor."""
    robot = load_description("pipe-weld-scan").robot
    ups = [find_hover(robot, i) for i in range(6)]
    assert ups[0] is None and ups[5] is None  # the front ones carry the arm
    leans = [math.degrees(math.acos(min(up[2], 1.0))) for up in ups[1:5]]  # type: ignore[index]
    np.testing.assert_allclose(leans, [21.6, 13.8, 13.8, 21.6], atol=2.0)
