"""Two compliant arms on a bench (Suarez 2020, equations (29) to (33)).

Trials, each at its own station: squeeze and lift a box without handles; pull a plug and detect its
release; control a bar held by both hands; measure the base's drift with the arms. The platform is
clamped; the bench moves it between the stations.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.spec import World
from skywright.description.world.things import find_first, locate_thing
from skywright.errors import InputError
from skywright.missions.bimanual_bench.buckling import compute_grasp
from skywright.missions.bimanual_bench.task import BimanualBench
from skywright.missions.skills.hook_grip import check_hands_free
from skywright.models.arm_inverse_kinematics import has_arm_chain
from skywright.models.compliant_arms import is_compliant
from skywright.models.rigid_body import posture
from skywright.models.things.bench import Bench
from skywright.models.things.box import Box
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

TRAVEL_S, FOLD_S = 2.0, 2.3  # s, from station to station; typical time to fold the arms before
STATIONS = {"squeeze": 0.0, "unplug": 1.0, "bar": 2.0, "position-sensor": 3.0}
"""m, y of each station in the world `bench`."""
ELBOWS_OUT = math.radians(15.0)  # roll: forearms stay clear of the object
GRIP_BELOW = 0.33  # m, hands below the platform's origin at the post
ABOVE = 0.25  # of its height, above the middle of a lifted thing: so it is stable
BAR_AHEAD, BAR_UP = 0.03, 0.06  # m, motion of the bar
SHORT = 0.01  # m, largest distance of a hand from its contact point


class BenchPlan(NamedTuple):
    """Inputs of the trials."""

    world: World
    folded: Array  # (n_joints,) rad


def plan(setup: Setup[BimanualBench]) -> MissionPlan[BenchPlan]:
    """Check that robot and world suit a bench; no path is planned."""
    robot, world, task = setup.robot, setup.world, setup.task
    check_hands_free(robot, "bimanual-bench")
    if not is_compliant(robot) or not has_arm_chain(robot) or robot.arm is None:
        raise InputError(
            f"robot {robot.name!r} has no compliant arms of pitch, roll, yaw and elbow: "
            "bimanual-bench requires two, see bimanual"
        )
    if robot.arm.sides != 2:
        raise InputError(f"robot {robot.name!r} has one arm; bimanual-bench requires two")
    if robot.arm.hand.kind != "ball":
        raise InputError(
            f"robot.arm.hand.kind is {robot.arm.hand.kind!r}; valid for bimanual-bench: 'ball', "
            "since it holds things between two pads"
        )
    if find_first(world.things, Bench) is None:
        raise InputError(f"world {world.name!r} has no bench: add a thing of kind 'bench'")
    needs = {
        "squeeze": task.box, "unplug": task.plug, "bar": task.bar, "position-sensor": task.post
    }  # fmt: skip
    for trial in task.trials:
        thing = world.find_thing(needs[trial], Box)
        if not thing.moves and trial != "position-sensor":
            raise InputError(
                f"trial {trial!r}: world.things.{needs[trial]} is not movable; set moves = true"
            )
    blocked = next((x for t in task.trials if (x := _check_grasp(setup, t, needs[t]))), None)
    total = TRAVEL_S * len(task.trials) + FOLD_S * (len(task.trials) - 1)
    return MissionPlan(
        blocked is None, blocked, 0.0, total, math.inf,
        way=BenchPlan(world, posture(robot, "folded")),
    )  # fmt: skip


def _check_grasp(setup: Setup[BimanualBench], trial: str, name: str) -> str | None:
    """Return why hands do not reach the thing of a trial, or squeeze it out; None if neither."""
    robot, world, task = setup.robot, setup.world, setup.task
    bench, box, p = find_first(world.things, Bench), world.find_thing(name, Box), locate_thing(
        world.things, name
    ).p  # fmt: skip
    assert bench is not None and robot.arm is not None
    ball, free = robot.arm.hand.radius_m, trial != "position-sensor"
    up = ABOVE * box.size_z_m if trial in ("squeeze", "bar") else 0.0
    up = up if free else bench.z_m - GRIP_BELOW - float(p[2])
    ways = {  # (ahead, up) m, where it is held and loads the hands
        "squeeze": [(0.0, 0.0), (0.0, task.lift_m)],
        "unplug": [(-task.unplug_threshold_m, 0.0)],
        "bar": [(0.0, BAR_UP), (BAR_AHEAD, BAR_UP)],
        "position-sensor": [(0.0, 0.0)],
    }[trial]
    load = 0.5 * (box.mass_kg or 0.0) * world.gravity_mps2 if free else 0.0
    least = math.inf
    for ahead, lift in ways:
        at = [p[0] + ball + ahead - bench.x_m, p[1] + 0.5 * box.size_y_m + ball - STATIONS[trial]]
        grasp = compute_grasp(
            robot, np.array([*at, p[2] + up + lift - bench.z_m]), ELBOWS_OUT, task.squeeze_n, load,
            world.gravity_mps2,
        )  # fmt: skip
        if grasp.short > SHORT:
            return (
                f"trial {trial!r}: a hand of {robot.name!r} ends {1e3 * grasp.short:.0f} mm from "
                f"the side of world.things.{name}: move that thing, or the bench that holds the "
                "robot"
            )
        least = min(least, 0.5 * grasp.stiffness * (box.size_y_m + 2.0 * ball))
    if not free or task.squeeze_n <= task.squeeze_fraction * least:
        return None
    share = task.squeeze_fraction
    return (
        f"trial {trial!r}: a squeeze of {task.squeeze_n:g} N exceeds {share * least:.2f} N, "
        f"{share:.0%} (mission.task.squeeze_fraction) of the {least:.2f} N = k L / 2 at which "
        f"{name} would buckle out between the hands: lower mission.task.squeeze_n, or make "
        f"world.things.{name} wider"
    )
