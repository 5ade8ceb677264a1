"""The space of the bar transport: platform in the vertical plane, both arms on one bar.

Both hands hold one rigid bar across the robot, so both arms have equal angles; the paper's six
variables (q1, q3, and two joints per arm) become four. The costs and metrics still count both arms.
The passive joint follows its equilibrium, the platform stays level.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.limbs import SIDES
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.kinematic_tree import PlanningScene, build_planning_scene
from skywright.models.scene import build_scene
from skywright.planning.motion.space import Carried, Coordinate, Space, build_space

HANDS = ("hand0", "hand1")

BENCHMARK = tuple((seed, 0.5 if seed <= 5 else 0.75) for seed in range(1, 11))
"""Seed and difficulty of the ten random scenarios of the benchmark. Do not change them."""


class Transport(NamedTuple):
    """The carried bar, its start and goal; configurations are (x m, z m, shoulders, elbows rad)."""

    start: tuple[float, float, float, float] = (0.0, 2.0, 0.0, -math.pi / 2)
    goal: tuple[float, float, float, float] = (9.0, 2.0, 0.0, -math.pi / 2)
    margin: float = 0.2  # m, clearance from obstacles
    margin_self: float = 0.02  # m, between parts of the robot
    bar_length: float = 2.0  # m; 0: no bar
    bar_radius: float = 0.02  # m
    bar_mass: float = 0.3  # kg
    p1: float = 1.0  # weights of cost (6)
    p2: float = 0.1


class TransportProblem(NamedTuple):
    """A space with its ends, and the data for messages."""

    space: Space
    start: Array
    goal: Array
    scene: PlanningScene
    world: World
    transport: Transport


def build_transport(
    robot: Robot, world: World, transport: Transport | None = None
) -> TransportProblem:
    """Build the planar problem of carrying a bar through a world's structures.

    A world without an area leaves 5 m beside start and goal and 10 m above them. Raises InputError
    if the robot lacks the joints, an end is beyond a joint's range, or limits cross.
    """
    t, arm = transport or Transport(), robot.arm
    moving = {} if arm is None else {n: x for n, x in arm.links.items() if x.joint != "fixed"}
    if arm is None or arm.sides != 2 or robot.pendulum is None or len(moving) != 2:
        raise InputError(
            f"robot {robot.name!r} cannot carry a bar: it requires a pendulum and two arms "
            "(sides = 2) of two joints"
        )
    scene = build_planning_scene(build_scene(robot, world), robot)
    area = get_structures(world).area
    limits = np.array([[-math.inf, math.inf], [-math.inf, math.inf], [0.0, math.inf]])
    if area is not None:
        limits = np.array(
            [[area.x_min_m, area.x_max_m], [area.y_min_m, area.y_max_m], [0.0, area.z_max_m]]
        )
    near, far = sorted((t.start[0], t.goal[0]))
    top = max(t.start[1], t.goal[1])
    coordinates = [
        Coordinate("x", ("x",), max(limits[0, 0], near - 5.0), min(limits[0, 1], far + 5.0)),
        Coordinate("z", ("z",), 0.0, min(limits[2, 1], top + 10.0)),
    ]
    for name, link in moving.items():
        drives = tuple(f"{side}_{name}" for side in SIDES)
        joint = scene.joints.index(drives[0])
        low, high = float(scene.q_min[joint]), float(scene.q_max[joint])
        for end, c in (("start", t.start), ("goal", t.goal)):
            at = c[len(coordinates)]
            if not low - 1e-9 <= at <= high + 1e-9:
                raise InputError(
                    f"{end}: joint {drives[0]} at {link.describe(round(at, 4))}; valid: "
                    f"{link.describe(low)} to {link.describe(high)}"
                )
        coordinates.append(Coordinate(name, drives, low, high))
    carried = Carried(HANDS, t.bar_length, t.bar_radius, t.bar_mass) if t.bar_length > 0 else None
    space = build_space(
        scene, coordinates, {}, margin=t.margin, margin_self=t.margin_self, area=limits,
        passive="pendulum", carried=carried, p1=t.p1, p2=t.p2,
    )  # fmt: skip
    return TransportProblem(
        space, np.array(t.start), np.array(t.goal), scene, world, t
    )  # fmt: skip


def build_scenario(world: World, seed: int | None, difficulty: float = 0.5) -> World:
    """Return the world with the random structures of `seed`, or its own for None."""
    return world.model_copy(update={"scenario_seed": seed, "difficulty": difficulty})
