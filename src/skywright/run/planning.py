"""From a description to a plan: what all kinds of missions share."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.description.loader import Description
from skywright.description.mission.registry import load_kind
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.allocation import build_allocator
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.rigid_body import posture
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene
from skywright.planning.inverse_dynamics import Loads, build_loads
from skywright.planning.motion.plan_file import PlanFile
from skywright.planning.problem import Limits
from skywright.planning.scan import ScanPlan
from skywright.run.limits import (
    compute_wind_allowance,
    find_exceeded_push,
    find_exceeded_wind,
)

Array = NDArray[np.float64]

CLIMB_STEP = 0.05  # m, between clearance checks of take-off and landing
CLIMB_MARGIN = 0.1  # m, kept from everything on the way up and down


class MissionPlan(NamedTuple):
    """What a mission will fly, or why it cannot."""

    feasible: bool
    blocked_by: str | None
    plan_s: float
    duration_s: float
    min_clearance_m: float
    min_rotor_margin: float
    segments: dict[str, NDArray[Any]]  # REFERENCE rows, each segment's time from 0
    scan: ScanPlan | None
    depth_m: float  # of the desired tip inside the surface
    push_force_n: float
    task: Any = None  # what a kind of mission wants to keep

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright plan --json`; numbers that do not exist are null."""

        def number(x: float) -> float | None:
            return float(x) if math.isfinite(x) else None

        return {
            "feasible": self.feasible,
            "blocked_by": self.blocked_by,
            "plan_s": self.plan_s,
            "duration_s": number(self.duration_s),
            "min_clearance_m": number(self.min_clearance_m),
            "min_rotor_margin": number(self.min_rotor_margin),
            "metrics": self.metrics,
        }

    @property
    def metrics(self) -> dict[str, float]:
        """What a planner of paths says of its plan, such as `plan.cost`; others say nothing."""
        file = getattr(self.task, "file", None)
        return dict(file.metrics) if isinstance(file, PlanFile) else {}


def plan_mission(description: Description) -> MissionPlan:
    """Plan the description's mission; an impossible one is told in `blocked_by`, not raised.

    Raises InputError when robot or world lack what the mission is about.
    """
    kind = load_kind(description.mission.kind)
    plan_it = kind.plan
    plan: MissionPlan = plan_it(description)
    if not plan.feasible and plan.plan_s > description.mission.planner_time_s:
        plan = plan_it(description)  # the first call in a process may have spent its time compiling
    if not getattr(kind, "FLIES", True):
        return plan
    if plan.feasible and not getattr(kind, "HELD", False):
        blocked = _find_blocked_climb(description)
        if blocked is not None:
            plan = plan._replace(feasible=False, blocked_by=blocked)
    too_windy = find_exceeded_wind(description, plan.segments)
    if too_windy is None and plan.push_force_n > 0.0 and plan.feasible:
        too_windy = find_exceeded_push(description, plan.push_force_n)
    if too_windy is not None:
        return plan._replace(feasible=False, blocked_by=too_windy)
    return plan


def _find_blocked_climb(d: Description) -> str | None:
    """Say what stands in the way between the ground and the hover point, or return None."""
    robot, hover = d.robot, find_hover(d)
    query = build_clearance(build_scene(robot, d.world), with_ground=False)
    folded, attitude = posture(robot, "folded"), rot_z(float(hover[3]))
    ground = robot.platform.gear_height_m
    for z in np.linspace(ground, hover[2], max(math.ceil((hover[2] - ground) / CLIMB_STEP), 1) + 1):
        at = np.array([hover[0], hover[1], z])
        found = compute_clearance(query, at, attitude, folded)
        if found.distance < CLIMB_MARGIN:
            pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
            return (
                f"take-off and landing at ({hover[0]:.2f}, {hover[1]:.2f}) m: {pair} come within "
                f"{max(found.distance, 0.0):.3f} m < {CLIMB_MARGIN:.2f} m at a height of {z:.2f} m"
            )
    return None


def build_mission_loads(robot: Robot, world: World) -> Loads:
    """Return rotors with the mission's thrust fraction, and the mean wind as an allowance."""
    rotors = build_rotors(robot.rotors)
    p = robot.platform
    return build_loads(
        build_allocator(rotors), rotors.position, rotors.axis, rotors.drag_coefficient,
        robot.rotors.thrust_fraction,
        np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2]),
        world.air_density_kg_m3, compute_wind_allowance(robot, world),
    )  # fmt: skip


def build_limits(robot: Robot) -> Limits:
    """Return the limits that a robot file sets."""
    c = robot.control
    return Limits(
        speed=c.speed_max_mps,
        acceleration=c.acceleration_max_mps2,
        tilt=math.radians(c.tilt_max_deg),
        ground=robot.platform.gear_height_m + 0.05,
    )


def find_hover(description: Description) -> Array:
    """Return the hover point over the start: x, y, z (m) and yaw (rad)."""
    m = description.mission
    return np.array([m.start_x_m, m.start_y_m, m.hover_height_m, math.radians(m.start_yaw_deg)])
