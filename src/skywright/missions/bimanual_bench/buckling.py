"""Largest squeeze of a free object between two compliant hands before it buckles out sideways.

An object squeezed with F between two hands at the distance L turns if the hands' springs, of
stiffness k across the squeeze, no longer hold it: above F = k L / 2 (docs/papers/suarez-2020.md).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.models.arm_inverse_kinematics import build_arm_chain, compute_arm_fk, compute_arm_ik
from skywright.models.springs import spring_deflection, spring_stiffness
from skywright.models.tip_force import Loaded


class Grasp(NamedTuple):
    """The left hand at one side of a thing; the right arm is its mirror image."""

    short: float  # m, distance of the hand from its goal
    stiffness: float  # N/m, least stiffness of the hand across the squeeze


def compute_grasp(
    robot: Robot, p_BH: Array, roll: float, squeeze: float, load: float, gravity: float
) -> Grasp:
    """Place the left hand at p_BH (3,) m, pressing with `squeeze` (N) along -y under `load` (N).

    `roll` (rad) is the shoulder's. The stiffness of the springs depends on their deflection.
    """
    joints, chain = list_joints(robot), build_arm_chain(robot, 0)
    q, mine = np.zeros(len(joints)), slice(chain.first, chain.first + 4)
    shoulder = Loaded(robot, q, gravity).hand(q)[0] - compute_arm_fk(chain, q[mine])
    found = compute_arm_ik(chain, p_BH - shoulder, roll=roll)
    q[mine] = found.q
    _, J, hold = Loaded(robot, q, gravity).hand(q)
    torque = hold[mine] - J[:, mine].T @ [0.0, squeeze, -load]
    stiffness = [_stiffness(j.link, t) for j, t in zip(joints[mine], torque, strict=True)]
    give = (J[:, mine] / stiffness @ J[:, mine].T)[::2, ::2]  # compliance along x and z
    return Grasp(found.error, 1.0 / float(np.linalg.eigvalsh(give)[-1]))


def _stiffness(link: Any, torque: float) -> float:
    """Return the stiffness (N m/rad) of a joint's spring under a torque (N m); inf without one."""
    k = link.flex_stiffness_nm_per_rad
    if not k:
        return math.inf
    spring = k, math.radians(link.flex_linear_deg or 0.0), link.flex_hardening
    return spring_stiffness(*spring, spring_deflection(*spring, torque))
