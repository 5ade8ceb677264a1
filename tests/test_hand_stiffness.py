"""Stiffness of compliant hands: against MuJoCo's statics, and refusals."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_joints
from skywright.evidence.hand_stiffness import main, measure
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene


@pytest.mark.parametrize("name", ["bimanual", "bimanual-longreach"])
def test_a_hand_has_the_stiffness_of_its_springs(name: str) -> None:
    """The Jacobian of MuJoCo's model, with the stiffness of the robot file."""
    d = load_description("waypoints", robot=name)
    scene = build_scene(d.robot, d.world)
    data = mujoco.MjData(scene.model)
    q = posture(d.robot, "working")
    data.qpos[3], data.qpos[scene.places.joint_qpos] = 1.0, q
    mujoco.mj_forward(scene.model, data)
    left, right = measure(name)
    mine = [x.side == 0 and not x.link.passive for x in list_joints(d.robot)]
    k = [x.link.flex_stiffness_nm_per_rad for x in list_joints(d.robot)]
    J = np.zeros((3, scene.model.nv))
    body = scene.model.body("hand0").id
    mujoco.mj_jacBody(scene.model, data, J, None, body)
    moved = J[:, scene.places.joint_dof][:, mine]
    C = moved @ np.diag(1.0 / np.array(k, dtype=float)[mine]) @ moved.T
    assert left.own == pytest.approx(1.0 / np.linalg.eigvalsh(C)[-1], rel=1e-3)
    assert right.own == pytest.approx(left.own, rel=1e-6) and math.isnan(right.active)
    assert 0.5 < left.active < 0.2 * left.own


def test_rigid_arms_are_refused() -> None:
    for name in ("othex", "ars-lrm"):
        found = CliRunner().invoke(main, [name])
        assert found.exit_code == 2 and "have no springs" in found.stderr
    found = CliRunner().invoke(main, ["bimanual"])
    assert (
        found.exit_code == 0
        and "left hand: springs 9.3 N/m; by control at most 1.1" in found.output
    )
