"""(27) of Sanchez-Cuevas 2020: the arm's inverse dynamics as torques, against MuJoCo's."""

from __future__ import annotations

import functools
from typing import Any

import mujoco
import numpy as np
import pytest
from numba import njit

from skywright.analysis.identify.lag import fit_servos
from skywright.analysis.identify.load import build_log
from skywright.core.record import fill
from skywright.core.rotations import exp_so3, quat_from_rot
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.arm_body import Deviation
from skywright.models.body_records import Body, Kinematics
from skywright.models.link_motion import compute_joint_inertia
from skywright.models.rigid_body import build_body_model, fill_body, fill_kinematics
from skywright.models.scene import build_scene, set_pose
from skywright.recordings.columns import Column
from skywright.run.backends import build_vehicle
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Estimate, Reference, WrenchCommand
from skywright.vehicle.follower import Press
from skywright.vehicle.laws._tip_motion import DAMPING
from skywright.vehicle.laws.backstepping_torque import (
    SENSITIVITY,
    BacksteppingTorque,
    TorqueLoop,
    command_torques,
    compute_force_gain,
    compute_sensitivity,
)
from skywright.vehicle.topics import list_topics

ROBOT = "f550-bridge-torque"
LAW = {"mission.law": "backstepping_torque"}


@functools.cache
def build_law() -> tuple[Any, Any]:
    d = load_description("arm-test-bench", robot=ROBOT, sets=LAW)
    return d, build_vehicle(d).assembly.get(BacksteppingTorque.Me, "law")


@njit
def compute(
    me: Any, ref: Any, press: Any, est: Any, body: Any, model: Any, kin: Any, cmd: Any
) -> None:
    command_torques(me, ref, press, est, body, model, kin, cmd)


class Case:
    """Law, belief and plant (as the robot file has it) at one random state in the air."""

    def __init__(self, seed: int, press: float = 0.0, f_tip: float = 0.0, force: float = 0.0):
        d, law = build_law()
        names = (BacksteppingTorque.Me, Reference, Press, Estimate, Body, Kinematics, WrenchCommand)
        self.me, ref, pr, est, body, kin, cmd = (np.zeros(1, r.dtype)[0] for r in names)
        fill(self.me, law)
        self.scene = build_scene(d.robot, d.world, Deviation())
        self.model = build_body_model(d.robot)
        self.rng = rng = np.random.default_rng(seed)
        self.R = np.empty((3, 3))
        exp_so3(rng.normal(size=3), self.R)
        self.q = np.array([rng.uniform(-1.8, 0.1), rng.uniform(-2.6, -0.4)])
        self.qd, self.w, self.a, self.wd = (rng.normal(size=n) for n in (2, 3, 3, 3))
        est["q"][:2], est["qd"][:2], est["R_WB"], est["w_WB_B"] = self.q, self.qd, self.R, self.w
        ref["q"][:2] = self.q + 0.1 * rng.normal(size=2)
        ref["qd"][:2] = rng.normal(size=2)
        ref["R_WB"], ref["a_WB"], ref["wd_WB_B"] = np.eye(3), self.a, self.wd
        fill_kinematics(self.model[0], est["q"], kin)
        fill_body(self.model[0], kin, body)
        ref["p_WT"] = body["p_BT"] + 0.004 * rng.normal(size=3)
        pr["press"], pr["docked"], pr["force"], est["f_tip"] = press, press, force, f_tip
        self.ref, self.press, self.est, self.body, self.cmd = ref, pr, est, body, cmd
        compute(self.me, ref, pr, est, body, self.model[0], kin, cmd)
        self.torque = np.array(cmd["torque"][:2])

    def find_free(self) -> np.ndarray:
        """Return the accelerations (2,) that the joints' own loop asks for, (30)."""
        me, ref = self.me, self.ref
        return np.asarray(
            ref["qd"][:2] / me["dt"] + me["damp"] * (ref["qd"][:2] - self.qd)
            + me["stiff"] * (ref["q"][:2] - self.q)
        )  # fmt: skip

    def answer(self, torque: np.ndarray, f_tip_W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (q'', inverse): MuJoCo's joint accelerations under `torque` (2,) with a force at
        the tip, the platform accelerating as its reference does, and what mj_inverse asks for it.
        """
        model, data = self.scene.model, mujoco.MjData(self.scene.model)
        set_pose(self.scene, data, np.array([0.0, 0.0, 50.0]), quat_from_rot(self.R), self.q)
        dof = self.scene.places.joint_dof
        data.qvel[3:6], data.qvel[dof] = self.w, self.qd
        J = np.zeros((3, model.nv))
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # friction of the gears

        def inverse(qdd: np.ndarray) -> np.ndarray:
            data.qacc[:] = 0.0
            data.qacc[:3], data.qacc[3:6], data.qacc[dof] = self.a, self.wd, qdd
            mujoco.mj_inverse(model, data)
            mujoco.mj_jacSite(model, data, J, None, self.scene.places.tip_site)
            return np.array((data.qfrc_inverse - J.T @ f_tip_W)[dof])

        rest = inverse(np.zeros(2))
        M = np.column_stack([inverse(e) - rest for e in np.eye(2)])
        qdd = np.linalg.solve(M, torque - rest)
        return qdd, inverse(qdd)


@pytest.mark.parametrize("seed", range(8))
def test_free_torques_are_mujoco_s_inverse_dynamics(seed: int) -> None:
    """(27) with (30) in joints: the plant's own inverse dynamics of the acceleration asked for."""
    c = Case(seed)
    qdd, inverse = c.answer(c.torque, np.zeros(3))
    np.testing.assert_allclose(inverse, c.torque, rtol=1e-6)
    np.testing.assert_allclose(qdd, c.find_free(), rtol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_a_tip_that_presses_moves_as_the_force_asks(seed: int) -> None:
    """Against the plant with the measured force at its tip, for which the law has only (31).

    Along the probe Lambda (z'' + k_v z') = (1 + k_f) (F - F_s) with Lambda of the joints' mass
    matrix, and that is what makes q'' differ from the one of damping alone.
    """
    c = Case(seed, press=1.0, f_tip=3.0, force=4.0)
    z_W = c.R @ c.body["R_BT"][:, 2]
    qdd, _ = c.answer(c.torque, -3.0 * z_W)
    M = compute_joint_inertia(c.model, c.q) + c.me["rotor"][:2, :2]
    J = c.body["R_BT"][:, [2, 0]].T @ c.body["J_BT"][:, :2]
    step, turned = 1e-6, []
    for sign in (1.0, -1.0):
        kin, body, est = (np.zeros(1, r.dtype)[0] for r in (Kinematics, Body, Estimate))
        est["q"][:2] = c.q + sign * step * c.qd
        fill_kinematics(c.model[0], est["q"], kin)
        fill_body(c.model[0], kin, body)
        turned.append(c.body["R_BT"][:, [2, 0]].T @ body["J_BT"][:, :2])
    bias = (turned[0] - turned[1]) / (2 * step) @ c.qd
    free = c.find_free()
    invert = J.T @ np.linalg.inv(J @ J.T + DAMPING * np.eye(2))
    push = np.linalg.solve(M, J[0]) * (1.0 + c.me["k_f"]) * (4.0 - 3.0)
    damped = free + invert @ (-c.me["damp"] * J @ c.qd - bias - J @ free)
    np.testing.assert_allclose(qdd, push + damped, rtol=1e-6)
    assert np.linalg.norm(push) > 1e-3 * np.linalg.norm(damped)


def test_at_rest_the_torques_carry_the_force_asked_for_once() -> None:
    """The printed (27), -J^T F_d - F_C, would hold it twice or not at all (E004-12)."""
    c = Case(3, press=1.0, f_tip=4.0, force=4.0)
    none = Case(3, press=1.0, f_tip=4.0, force=4.0 / (1.0 + 1.0 / float(c.me["k_f"])))  # F_d = 0
    lever = c.body["R_BT"][:, 2] @ c.body["J_BT"][:, :2]
    np.testing.assert_allclose(c.torque - none.torque, 4.0 * lever, rtol=1e-9, atol=1e-12)


def test_a_tip_in_the_air_is_not_pushed_hard() -> None:
    c, harder = (Case(1, press=1.0, f_tip=0.0, force=f) for f in (5.0, 8.0))
    np.testing.assert_array_equal(c.torque, harder.torque)
    soft = Case(1, press=1.0, f_tip=0.0, force=0.1)
    assert np.linalg.norm(soft.torque - c.torque) > 0.05


def test_the_mass_matrix_is_mujoco_s() -> None:
    c = Case(5)
    data, model = mujoco.MjData(c.scene.model), c.scene.model
    set_pose(c.scene, data, np.array([0.0, 0.0, 50.0]), np.array([1.0, 0, 0, 0]), c.q)
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    dof = c.scene.places.joint_dof
    own = compute_joint_inertia(c.model, c.q) + c.me["rotor"][:2, :2]
    np.testing.assert_allclose(own, M[np.ix_(dof, dof)], rtol=1e-9)


def test_gains_follow_from_the_dead_time() -> None:
    loop = TorqueLoop(25.0, 125.0, 0.003, 0.77, 1200.0)
    k_f = compute_force_gain(loop)
    assert compute_sensitivity(loop, k_f) <= SENSITIVITY < compute_sensitivity(loop, 1.1 * k_f)
    assert compute_force_gain(loop._replace(delay=0.006)) < k_f
    assert compute_force_gain(loop._replace(spring=0.0)) == 0.0
    late = loop._replace(delay=0.043)
    assert compute_sensitivity(late, in_air=True) == np.inf  # unstable, |S| would be below 2
    # a pair of closed poles, from the same polynomial without dead time and filter
    s = np.roots([loop.mass, loop.mass * 2 * loop.w, (1 + k_f) * loop.spring])
    assert np.all(s.real < 0) and abs(s[0]) == pytest.approx(
        np.sqrt((1 + k_f) * loop.spring / loop.mass)
    )


@pytest.mark.parametrize(
    ("robot", "sets", "told"),
    [
        ("f550-bridge", LAW, "commands torques"),
        (ROBOT, {"mission.law": "backstepping"}, "commands speeds"),
        (
            ROBOT,
            LAW | {"world.link.delay_s": 0.02, "mission.law.arm_bandwidth_rad_s": 20.0},
            "dead time",
        ),
        (ROBOT, LAW | {"robot.arm.servo1.mode": "velocity"}, "different modes"),
    ],
)
def test_what_does_not_fit_is_told(robot: str, sets: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        build_vehicle(load_description("arm-test-bench", robot=robot, sets=sets))


@pytest.mark.parametrize("mode", ["velocity", "torque"])
def test_friction_of_the_gears_stops_what_is_weaker(mode: str) -> None:
    sets = {f"robot.arm.servo{i}.{k}": v for i in (1, 2)
            for k, v in (("mode", mode), ("friction_nm", 0.1))}  # fmt: skip
    d = load_description("bridge-contact", sets=sets)
    scene = build_scene(d.robot, d.world, Deviation())
    model, data = scene.model, mujoco.MjData(scene.model)
    model.opt.gravity[:] = 0.0
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    for torque, moves in ((0.08, False), (0.15, True)):
        set_pose(scene, data, np.array([0.0, 0, 50]), np.array([1.0, 0, 0, 0]), np.zeros(2) - 1.0)
        data.qfrc_applied[scene.places.joint_dof[0]] = torque
        for _ in range(200):
            mujoco.mj_step(model, data)
        turned = abs(data.qpos[scene.places.joint_qpos[0]] + 1.0)
        assert (turned > 0.05) == moves, turned


def test_the_bench_is_flown_by_torques() -> None:
    sets = LAW | {"mission.task.hold_s": 1.0, "mission.task.forces_n": [4.0]}
    result = fly_and_evaluate(load_description("arm-test-bench", robot=ROBOT, sets=sets))
    s = result.samples
    assert "cmd_torque" in s.dtype.names
    names = [p.name for p in result.phases]
    q = np.degrees(s["q"][s["phase"] == names.index("inspection position")][-1][:2])
    assert q == pytest.approx([61.0 - 90.0, -55.0], abs=3.0)
    assert "hold 4 N" in names, result.reason
    columns = [Column("cmd_torque", (2,), unit="N m", meaning="")]
    carried = {topic.name: topic.fields for topic in list_topics(columns, ("a", "b"), 6)}
    assert carried == {"/command/torques": {"effort": "cmd_torque"}}
    # no lag of a speed can be identified from torques
    robot, world = result.description.robot, result.description.world
    log = build_log("", robot, world, s, np.array(names)[s["phase"]], ("a", "b"))
    assert np.any(s["qd"]) and fit_servos(log) == []


def test_a_stuck_servo_of_torques_holds_its_angle() -> None:
    fault = {"plant.faults": {"j": {"kind": "joint", "joint": 1, "how": "stuck", "start_s": 0.5}}}
    sets = LAW | fault | {"mission.task.hold_s": 1.0, "mission.task.forces_n": [1.0]}
    s = fly_and_evaluate(load_description("arm-test-bench", robot=ROBOT, sets=sets)).samples
    late = s[s["t"] > s["t"][0] + 0.6]
    assert np.ptp(np.degrees(late["q"][:, 0])) < 2.0  # of the spring that stands for its gear
    assert np.max(np.abs(late["cmd_torque"][:, 0])) > 0.1  # though the law asks it to move
