"""The arm's test bench (Sanchez-Cuevas 2020, section 5.2): clamped, pressing up a force staircase.

Rest at gamma = (95, 152) deg, inspection position (61, 55) deg near the surface, force control.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from skywright.core.rotations import quat_to_rot
from skywright.core.spec import NonNegative, Spec
from skywright.description.loader import Description
from skywright.description.mission.spec import Mission
from skywright.description.world.structure import build_surface, find_place
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.missions.bridge_contact.task import PressForces
from skywright.missions.skills.pressing import Presser, check_can_press
from skywright.models.rigid_body import build_body_model, compute_tip
from skywright.models.things.bench import Bench
from skywright.run.flight import Flight
from skywright.run.planning import MissionPlan

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

NEEDS = frozenset({"arms", "whole_body", "probe"})
FLIES = False

NEAREST, FARTHEST = 0.002, 0.04  # m, of the tip to the surface in the inspection position
SETTLE_S = 1.0


class BenchTask(Spec):
    """The staircase of forces, and the paper's two poses as its gamma_1, gamma_2."""

    rest_deg: list[float] = Field(default=[95.0, 152.0], min_length=2, max_length=2)
    inspection_deg: list[float] = Field(default=[61.0, 55.0], min_length=2, max_length=2)
    forces_n: PressForces = [2.0, 4.0, 6.0, 8.0]
    ramp_s: float = Field(default=1.0, ge=0.1, le=60)
    settle_s: NonNegative = 3.0
    hold_s: float = Field(default=4.0, ge=0.2, le=600)


class ArmTestBenchMission(Mission):
    """A mission of the kind "arm-test-bench"."""

    task: BenchTask = BenchTask()


def find_joints(gamma_deg: list[float]) -> np.ndarray:
    """Return the joints (rad) of the paper's angles: shoulder = gamma_1 - 90, elbow = -gamma_2."""
    return np.radians([gamma_deg[0] - 90.0, -gamma_deg[1]])


def plan(d: Description) -> MissionPlan:
    """Check the poses against joints and surface."""
    began = time.perf_counter()
    robot, world, mission = d.robot, d.world, d.mission
    assert isinstance(mission, ArmTestBenchMission)
    bench = find_first(world.things, Bench)
    if bench is None or world.structure is None:
        raise InputError(
            f"world {world.name!r} is no test bench: it needs a thing of kind 'bench' and "
            "[world.structure], as world test-bench has"
        )
    check_can_press(robot, mission)
    model = build_body_model(robot, world.gravity_mps2)
    n = int(model[0]["n_joints"])
    if n != 2:
        raise InputError(f"robot {robot.name!r} has {n} joints; the test bench is for two")
    surface, blocked = build_surface(world.structure), ""
    base, R_WB = np.array([bench.x_m, bench.y_m, bench.z_m]), np.empty((3, 3))
    quat_to_rot(np.array(bench.q_WB), R_WB)
    for name, gamma in (
        ("rest", mission.task.rest_deg),
        ("inspection", mission.task.inspection_deg),
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
                f"{name} position: the tip is {1e3 * gap:.0f} mm from the surface; the inspection "
                f"begins {1e3 * NEAREST:.0f} to {1e3 * FARTHEST:.0f} mm from it"
            )
    task = mission.task
    total = 12.0 + len(task.forces_n) * (task.ramp_s + task.settle_s + task.hold_s)
    return MissionPlan(
        not blocked, blocked or None, time.perf_counter() - began, total, math.nan, math.nan, {},
        None, 0.0, 0.0,
    )  # fmt: skip


def fly(s: Supervisor) -> Flight:
    """Rest, inspection position, staircase, rest; nothing flies."""
    mission = s.mission
    assert isinstance(mission, ArmTestBenchMission)
    task = mission.task
    bench = Presser(s, task)
    s.begin("start")
    s.wait(SETTLE_S)
    bench.go("rest", q=find_joints(task.rest_deg))
    s.wait(SETTLE_S)
    bench.go("inspection position", q=find_joints(task.inspection_deg))
    s.wait(SETTLE_S)
    # to the law a clamped platform is a docked one whose feet carry nothing
    reason = bench.press("bench", "clamped", task.forces_n, "", lambda _: {"docked": 1.0})
    bench.go("back to rest", q=find_joints(task.rest_deg))
    s.wait(SETTLE_S)
    return Flight(not reason, reason)
