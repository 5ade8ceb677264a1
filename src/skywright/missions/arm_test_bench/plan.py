"""Plan of the mission on the arm's test bench (Sanchez-Cuevas 2020, section 5.2).

The arm of a clamped platform presses a staircase of forces: rest at gamma = (95, 152) deg,
inspection position (61, 55) deg near the surface, force control.
"""

import math
import time

import numpy as np

from skywright.core.rotations import quat_to_rot
from skywright.description.world.structure import find_place
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.missions.arm_test_bench.limit import compute_bench_press
from skywright.missions.arm_test_bench.task import BenchTask
from skywright.missions.skills.moves import compute_move_s
from skywright.missions.skills.pressing import GO_SPEED, check_can_press
from skywright.models.rigid_body import compute_tip, posture
from skywright.models.things.bench import Bench
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

NEAREST, FARTHEST = 0.002, 0.04  # m, tip to surface (FARTHEST: inspection position only)


def find_joints(gamma_deg: list[float]) -> np.ndarray:
    """Return the joint angles (2,) rad of the paper's angles (deg).

    shoulder = gamma_1 - 90 deg, elbow = -gamma_2
    """
    return np.radians([gamma_deg[0] - 90.0, -gamma_deg[1]])


def plan(setup: Setup[BenchTask]) -> MissionPlan[None]:
    """Check the poses against joint limits and surface, and the forces against the largest press.

    Return the plan, with the reason if it is not feasible. Raises InputError if the world is no
    test bench, the robot cannot press or has other than two joints, or a pose exceeds the joints'
    limits.
    """
    began = time.perf_counter()
    d, robot, world, task = setup.description, setup.robot, setup.world, setup.task
    bench = find_first(world.things, Bench)
    if bench is None or setup.surface is None or world.structure is None:
        raise InputError(
            f"world {world.name!r} is not a test bench: it requires a thing of kind "
            "'bench' and [world.structure], see world test-bench"
        )
    check_can_press(robot, d.mission)
    model = setup.model
    n = int(model[0]["n_joints"])
    if n != 2:
        raise InputError(f"robot {robot.name!r} has {n} joints; the test bench requires two")
    surface, blocked = setup.surface, ""
    base, R_WB = np.array([bench.x_m, bench.y_m, bench.z_m]), np.empty((3, 3))
    quat_to_rot(np.array(bench.q_WB), R_WB)
    for name, gamma in (
        ("rest", task.rest_deg),
        ("inspection", task.inspection_deg),
    ):
        q = find_joints(gamma)
        low, high = model[0]["q_min"][:2], model[0]["q_max"][:2]
        if np.any(q < low - 1e-9) or np.any(q > high + 1e-9):
            raise InputError(
                f"mission.task.{name}_deg = {gamma}: beyond the joints' limits of "
                f"{robot.name!r}, shoulder {90 + math.degrees(low[0]):.0f} to "
                f"{90 + math.degrees(high[0]):.0f}, elbow {-math.degrees(high[1]):.0f} to "
                f"{-math.degrees(low[1]):.0f} deg"
            )
        gap = float(find_place(surface, base + R_WB @ compute_tip(model, q)[0])[2])
        if gap < NEAREST or (name == "inspection" and gap > FARTHEST):
            blocked = (
                f"{name} position: the tip is {1000.0 * gap:.0f} mm from the surface; "
                f"valid: {1000.0 * NEAREST:.0f} to {1000.0 * FARTHEST:.0f} mm"
            )
    largest = max(task.forces_n)
    if not blocked:
        q = find_joints(task.inspection_deg)
        can = compute_bench_press(robot, world.structure, base, R_WB, q, world.gravity_mps2)
        if largest > task.force_fraction * can.force:
            blocked = (
                f"a press of {largest:g} N exceeds {task.force_fraction * can.force:.2f} N, "
                f"{task.force_fraction:.0%} (mission.task.force_fraction) of the {can.force:.2f} N "
                f"at which {can.cause}, the probe {math.degrees(can.lean):.0f} deg off the "
                "surface's normal: lower mission.task.forces_n, or move world.structure "
                "nearer to the tip"
            )
    poses = [find_joints(gamma) for gamma in (task.rest_deg, task.inspection_deg)]
    bend = float(np.max(np.abs(poses[1] - poses[0])))
    first = float(np.max(np.abs(poses[0] - posture(robot, "folded"))))
    moves = (first, bend, bend)
    total = sum(compute_move_s(0.0, 0.0, joints, speed=GO_SPEED) for joints in moves)
    return MissionPlan(not blocked, blocked or None, time.perf_counter() - began, total)
