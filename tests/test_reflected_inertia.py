"""Motors behind a belt: what their rotors add to the arm, against a derivation by symbols."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_servos
from skywright.models.arm_body import Deviation
from skywright.models.rigid_body import build_body_model
from skywright.models.scene import build_scene, set_pose

if TYPE_CHECKING:
    import sympy as sp


def derive_mass_matrix(model, motors: list[float]) -> sp.Matrix:
    """Mass matrix of the OTHex's arm on a platform held fast, from its kinetic energy.

    Joints turn about y, positive down. Both motors sit at the base; motor 2 turns link 2 by a belt
    whose pulley at the base stands still while link 1 turns, so that with ratio 1 it turns by the
    absolute angle of link 2 (Tognon 2018, III-B).
    """
    import sympy as sp  # takes a second, in every worker if at the top

    q, v = sp.symbols("q1 q2"), sp.symbols("v1 v2")
    angle, rate = [q[0], q[0] + q[1]], [v[0], v[0] + v[1]]

    def place(vec, a):
        x, _, z = (sp.Float(float(n), 17) for n in vec)
        return sp.Matrix([sp.cos(a) * x + sp.sin(a) * z, -sp.sin(a) * x + sp.cos(a) * z])

    links = [1, 2]  # link 0 is the bracket
    origins = [sp.zeros(2, 1), place(model["offset"][2], angle[0])]
    energy = sum(J * w**2 / 2 for J, w in zip(motors, rate, strict=True))
    for origin, i, a, w in zip(origins, links, angle, rate, strict=True):
        com = origin + place(model["com"][i], a)
        speed = com.jacobian(q) * sp.Matrix(v)
        energy += float(model["mass"][i]) * speed.dot(speed) / 2
        energy += float(model["inertia"][i][1, 1]) * w**2 / 2
    return sp.lambdify([q], sp.hessian(energy, v))


def test_rotors_behind_the_belt_couple_the_joints():
    d = load_description("pipe-weld-scan")
    motors = [servo.armature_kgm2 for _, servo in list_servos(d.robot)]
    derived = derive_mass_matrix(build_body_model(d.robot)[0], motors)
    without = derive_mass_matrix(build_body_model(d.robot)[0], [0.0, 0.0])
    scene = build_scene(d.robot, d.world, Deviation())
    m, data = scene.model, mujoco.MjData(scene.model)
    full, at = np.zeros((m.nv, m.nv)), scene.places.joint_dof
    for q in ([-0.6, 0.9], [0.3, -1.2], [0.0, 0.0]):
        set_pose(scene, data, np.array([0.0, 0, 2.0]), np.array([1.0, 0, 0, 0]), np.array(q))
        mujoco.mj_forward(m, data)
        mujoco.mj_fullM(m, data, full)
        np.testing.assert_allclose(full[np.ix_(at, at)], derived(q), atol=1e-9)
        belt = np.array(d.robot.arm.belt)
        reflected = np.linalg.inv(belt).T @ np.diag(motors) @ np.linalg.inv(belt)
        np.testing.assert_allclose(np.array(derived(q)) - without(q), reflected, atol=1e-12)
    assert np.all(m.dof_armature[at] == 0.0)


def test_without_a_belt_a_rotor_turns_with_its_joint():
    d = load_description("bridge-contact")
    model = build_scene(d.robot, d.world, Deviation()).model
    for name, limb in zip(d.robot.arm.servos, ("shoulder", "elbow"), strict=True):
        armature = model.dof_armature[model.joint(limb).dofadr[0]]
        assert armature == pytest.approx(d.robot.arm.servos[name].armature_kgm2)
    assert np.all(model.tendon_armature == 0.0)
