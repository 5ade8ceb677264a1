"""Parameters of the planar model (`planar_lrm`) from a robot's nominal scene."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_from_quat
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.planar_lrm import PlanarLrm
from skywright.models.scene import Scene

Array = NDArray[np.float64]


def build_planar_lrm(scene: Scene, robot: Robot) -> PlanarLrm:
    """Read the planar model's parameters.

    Raises InputError when the robot is not a platform with a passive link and two arms of two
    pitch joints, or its masses lie off the plane's lines.
    """
    joints = list_joints(robot)
    shape = [(j.side, j.link.axis, j.link.passive) for j in joints]
    arm = [(0, "y", False)] * 2 + [(1, "y", False)] * 2
    if shape != [(-1, "y", True), *arm]:
        raise InputError(
            f"robot {robot.name!r}: the planar model needs a passive pitch joint and two arms of "
            f"two pitch joints; this one has {', '.join(j.name for j in joints) or 'no joints'}"
        )
    model = scene.model
    m_a, c_a, i_a = _composite(model, "platform")
    m_b, c_b, i_b = _composite(model, joints[0].name)
    m_u, c_u, i_u = _composite(model, joints[1].name)
    m_f, c_f, i_f = _composite(model, joints[2].name)
    hinge, upper, fore = (model.body(joints[i].name).pos for i in (0, 1, 2))
    for c in (c_a, c_b, c_u, c_f, hinge - c_a, upper, fore):
        if abs(c[0]) > 1e-9:
            raise InputError(
                f"robot {robot.name!r}: the planar model needs joints and centres of mass on the "
                "lines along z; move com_x_m and x_m to 0"
            )
    return PlanarLrm(
        m_a, m_b, m_u, m_f, i_a, i_b, i_u, i_f, float(c_a[2] - hinge[2]), float(-upper[2]),
        float(-c_b[2]), float(-fore[2]), float(-c_u[2]), float(-c_f[2]),
    )  # fmt: skip


def _composite(model: mujoco.MjModel, name: str) -> tuple[float, Array, float]:
    """Mass, centre of mass (3,) and inertia about its y axis of a body with what is fixed to it."""
    root = model.body(name).id
    parts: list[tuple[float, Array, float]] = []
    pending = [(root, np.zeros(3), np.eye(3))]
    while pending:
        body, p, rot = pending.pop()
        turn = rot @ rot_from_quat(model.body_iquat[body])
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        mass = float(model.body_mass[body])
        parts.append((mass, p + rot @ model.body_ipos[body], float(inertia[1, 1])))
        for child in range(model.nbody):
            if (
                model.body_parentid[child] == body
                and child != body
                and not model.body_jntnum[child]
            ):
                q = rot_from_quat(model.body_quat[child])
                pending.append((child, p + rot @ model.body_pos[child], rot @ q))
    mass = sum(m for m, _, _ in parts)
    com = sum((m * c for m, c, _ in parts), np.zeros(3)) / mass
    about = sum(i + m * float((c - com)[0] ** 2 + (c - com)[2] ** 2) for m, c, i in parts)
    return mass, com, about
