"""A bar in both hands: its body in the scene.

Both grippers are closed around it. The scene fixes the bar to the left hand. In the plant a soft
point constraint (GRIP) attaches it to the right hand: lined fingers yield by some millimetres
because the two arms never move in exact symmetry. A slipping gripper is not modelled.
"""

import mujoco
import numpy as np

from skywright.description.robot.spec import Robot
from skywright.models.arm_body import OWN, ROBOT, WORLD
from skywright.models.bar import compute_bar_inertia
from skywright.models.rigid_body import compute_hands_apart

BAR = "bar"
GRIP = [0.02, 1.0]
"""s and damping ratio of the right hand's grip: about 500 N/m against an arm's end of 0.2 kg."""


def add_bar(spec: mujoco.MjSpec, robot: Robot, mass_factor: float, plant: bool) -> None:
    """Add the robot's bar, held by both hands."""
    assert robot.arm is not None and robot.arm.bar is not None
    bar, y = robot.arm.bar, 0.5 * compute_hands_apart(robot)
    body = spec.body("hand0").add_body(name=BAR, pos=[0.0, -y, 0.0])
    body.mass = bar.mass_kg * mass_factor
    body.ipos = np.zeros(3)
    body.inertia = np.diag(compute_bar_inertia(bar)) * mass_factor
    body.explicitinertial = True
    half = 0.5 * bar.length_m - 0.5 * bar.diameter_m
    body.add_geom(
        name=BAR, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.5 * bar.diameter_m, 0, 0],
        fromto=[0, -half, 0, 0, half, 0], rgba=[0.2, 0.55, 0.35, 1],
        contype=ROBOT | OWN, conaffinity=WORLD | OWN, mass=0.0,
    )  # fmt: skip
    if not plant:
        return
    grip = spec.add_equality(
        name="grip", type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=BAR, name2="hand1",
    )  # fmt: skip
    grip.solref = GRIP
    grip.data = np.array([0.0, -y, 0.0, *np.zeros(9)])
