"""Two compliant arms on a bench (Suarez 2020, equations (29) to (33)).

Trials, each at its own station: squeeze and lift a box without handles; pull a plug and notice the
release; lead a bar held by both hands; use the arms as a sensor of the base's drift. The platform
is clamped; between the stations the bench carries it.
"""

import math
from typing import NamedTuple

from skywright.core.arrays import Array
from skywright.description.world.spec import World
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.missions.bimanual_bench.task import BimanualBench
from skywright.models.arm_inverse_kinematics import has_arm_chain
from skywright.models.compliant_arms import is_compliant
from skywright.models.rigid_body import posture
from skywright.models.things.bench import Bench
from skywright.models.things.box import Box
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

TRIAL_S = 37.0  # s, about, of one trial


class BenchPlan(NamedTuple):
    """What the trials know."""

    world: World
    folded: Array  # (n_joints,) rad


def plan(setup: Setup[BimanualBench]) -> MissionPlan[BenchPlan]:
    """Check that robot and world are those of a bench; there is no way to plan."""
    robot, world, task = setup.robot, setup.world, setup.task
    if not is_compliant(robot) or not has_arm_chain(robot) or robot.arm is None:
        raise InputError(
            f"robot {robot.name!r} has no compliant arms of pitch, roll, yaw and elbow: "
            "bimanual-bench needs two, such as bimanual"
        )
    if robot.arm.sides != 2:
        raise InputError(f"robot {robot.name!r} has one arm; bimanual-bench needs two")
    if find_first(world.things, Bench) is None:
        raise InputError(f"world {world.name!r} has no bench: give it a thing of kind 'bench'")
    needs = {
        "squeeze": task.box, "unplug": task.plug, "bar": task.bar, "position-sensor": task.post
    }  # fmt: skip
    for trial in task.trials:
        thing = world.find_thing(needs[trial], Box)
        if not thing.moves and trial != "position-sensor":
            raise InputError(
                f"trial {trial!r}: world.things.{needs[trial]} does not move; set moves = true"
            )
    total = TRIAL_S * len(task.trials)
    return MissionPlan(
        True, None, 0.0, total, math.inf,
        way=BenchPlan(world, posture(robot, "folded")),
    )  # fmt: skip
