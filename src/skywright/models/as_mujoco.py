"""Robot and world as a MuJoCo model, for tools that read MJCF."""

from __future__ import annotations

from mujoco import MjModel as MjModel

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.arm_body import Deviation
from skywright.models.scene import build_scene, build_spec, compile_spec


def build_mjcf(robot: Robot, world: World, *, nominal: bool = False) -> str:
    """Return the model as MJCF in SI units and radians; W is MuJoCo's world frame.

    By default it is the plant with zero errors: contacts, joint flexibility, the probe's spring and
    servos. The rotors are the actuators `thrust0`, ...: thrusts (N) with their reaction torques,
    without limits or lag. With `nominal` it is the model that controllers and planners use: rigid
    arm, released spring, no contacts, no actuators. Raises InputError for sizes that MuJoCo
    refuses.
    """
    spec = build_spec(robot, world, None if nominal else Deviation())
    compile_spec(spec, robot, world)
    return str(spec.to_xml())


def build_model(robot: Robot, world: World, *, nominal: bool = False) -> MjModel:
    """Return the same model compiled, as the simulation steps it.

    Raises InputError for sizes that MuJoCo refuses.
    """
    return build_scene(robot, world, None if nominal else Deviation()).model
