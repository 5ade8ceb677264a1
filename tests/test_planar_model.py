"""The planar model equals the spatial model (MuJoCo) restricted to the plane."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.errors import InputError
from skywright.models.planar import build_planar_lrm, fill_equations, fill_terms
from skywright.models.scene import build_scene

Array = NDArray[np.float64]

ROBOT = load_robot("ars-lrm")[0]
WORLD = load_world("open")[0]
SCENE = build_scene(ROBOT, WORLD)
PARAMETERS = build_planar_lrm(SCENE, ROBOT)
GRAVITY = 9.81
ORDER = ("right_shoulder_pitch", "right_elbow_pitch", "left_shoulder_pitch", "left_elbow_pitch")
N_JOINTS = 5


def spatial_rates(q: Array, u: Array, f: Array) -> Array:
    """Accelerations of MuJoCo's model with the degrees of freedom out of the plane held."""
    model, data = SCENE.model, mujoco.MjData(SCENE.model)
    joints = [model.joint(n) for n in ("pendulum", *ORDER)]
    data.qpos[:7] = [q[0], 0, q[1], np.cos(q[2] / 2), 0, np.sin(q[2] / 2), 0]
    data.qvel[[0, 2, 4]] = u[[0, 1, 2]]
    for joint, angle, rate in zip(joints, q[3:], u[3:], strict=True):
        data.qpos[joint.qposadr], data.qvel[joint.dofadr] = angle, rate
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    plane = [0, 2, 4, *(int(j.dofadr[0]) for j in joints)]
    applied = np.zeros(8)
    applied[0], applied[1], applied[2] = f[0] * np.sin(q[2]), f[0] * np.cos(q[2]), f[1]
    applied[4:] = f[2:]
    return np.linalg.solve(mass[np.ix_(plane, plane)], applied - data.qfrc_bias[plane])


def planar_rates(q: Array, u: Array, f: Array) -> Array:
    """Accelerations by (3)."""
    M, rhs, terms = np.zeros((8, 8)), np.zeros((8, 24)), np.zeros(24)
    fill_equations(PARAMETERS, q, M, rhs)
    fill_terms(u, f, GRAVITY, terms)
    return np.linalg.solve(M, rhs @ terms)


numbers = st.lists(st.floats(-3, 3), min_size=22, max_size=22).map(np.array)


@settings(max_examples=60, deadline=None)
@given(numbers)
def test_accelerations_agree_with_the_spatial_model(x: Array) -> None:
    q, u, f = x[:8], x[8:16], 10.0 * x[16:]
    ours = planar_rates(q, u, f)
    theirs = spatial_rates(q, u, f)
    np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-8)


def test_at_rest_in_hover_only_what_is_unbalanced_moves() -> None:
    """Everything hanging, thrust equal to the weight: an equilibrium."""
    mass = float(np.sum(SCENE.model.body_mass))
    f = np.array([mass * GRAVITY, 0, 0, 0, 0, 0])
    rates = planar_rates(np.zeros(8), np.zeros(8), f)
    np.testing.assert_allclose(rates, 0.0, atol=1e-9)


def test_a_robot_without_the_paper_s_joints_is_refused() -> None:
    other = load_robot("bimanual-longreach")[0]
    with pytest.raises(InputError, match="two arms of two pitch joints"):
        build_planar_lrm(build_scene(other, WORLD), other)
