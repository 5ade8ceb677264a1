"""The nominal rigid body against MuJoCo, finite differences and hand calculation."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from skywright.core.types import MAX_JOINTS
from skywright.description.loader import load_description
from skywright.models.body_records import Kinematics
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_tip,
    fill_kinematics,
    joint_names,
)
from skywright.models.scene import build_scene, set_pose

CASES = [("pipe-weld-scan", None), ("waypoints", "f550-bridge"), ("waypoints", None)]


@pytest.fixture(scope="module", params=CASES, ids=["othex", "f550", "hexarotor"])
def setting(request):
    mission, robot = request.param
    d = load_description(mission, robot)
    return d.robot, build_scene(d.robot, d.world), build_body_model(d.robot)


def random_q(robot, rng):
    if robot.arm is None:
        return np.zeros(0)
    links = [robot.arm.links[n] for n in joint_names(robot)]
    return np.array([np.radians(rng.uniform(x.joint_min_deg, x.joint_max_deg)) for x in links])


def test_composite_body_and_tip_equal_mujoco(setting):
    robot, scene, model = setting
    data = mujoco.MjData(scene.model)
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = random_q(robot, rng)
        set_pose(scene, data, np.zeros(3), np.array([1.0, 0, 0, 0]), q)
        mujoco.mj_forward(scene.model, data)
        full = np.zeros((scene.model.nv, scene.model.nv))
        mujoco.mj_fullM(scene.model, data, full)
        mass, com, inertia = compute_body(model, q)
        assert abs(mass - full[0, 0]) < 1e-9
        np.testing.assert_allclose(inertia, full[3:6, 3:6], atol=1e-9)
        np.testing.assert_allclose(com, data.subtree_com[1], atol=1e-9)
        if robot.arm is not None:
            p, r = compute_tip(model, q)
            np.testing.assert_allclose(p, data.site("tip").xpos, atol=1e-12)
            np.testing.assert_allclose(r, data.site("tip").xmat.reshape(3, 3), atol=1e-12)


def test_tip_jacobians_match_finite_differences(setting):
    robot, _, model = setting
    n = len(joint_names(robot))
    k = np.zeros(1, Kinematics.dtype)
    rng = np.random.default_rng(4)
    for _ in range(10):
        q = np.zeros(MAX_JOINTS)
        q[:n] = random_q(robot, rng)
        fill_kinematics(model[0], q, k[0])
        jac, jac_w = k[0]["J_BT"].copy(), k[0]["Jw_BT"].copy()
        assert np.all(jac[:, n:] == 0.0)
        for j in range(n):
            step = np.zeros(MAX_JOINTS)
            step[j] = 1e-6
            (p1, r1), (p0, r0) = compute_tip(model, q + step), compute_tip(model, q - step)
            np.testing.assert_allclose(jac[:, j], (p1 - p0) / 2e-6, atol=1e-8)
            skew = (r1 - r0) / 2e-6 @ r0.T
            np.testing.assert_allclose(jac_w[:, j], [skew[2, 1], skew[0, 2], skew[1, 0]], atol=1e-5)


def test_othex_weighs_what_table_1_says():
    robot = load_description("pipe-weld-scan").robot
    mass, _, _ = compute_body(build_body_model(robot), np.zeros(2))
    assert mass == pytest.approx(1.6 + 0.45 + 0.2, abs=1e-9)
