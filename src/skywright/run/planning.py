"""Plans a mission from its description; common to all kinds of missions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import blame
from skywright.core.rotations import rot_z
from skywright.description.loader import Description
from skywright.description.map_error import check_map_error
from skywright.description.mission.spec import T
from skywright.description.world.scenario import get_limits
from skywright.models.geometry import compute_area_clearance, compute_clearance, query_clearance
from skywright.models.rigid_body import posture
from skywright.models.scene import TIMESTEP, build_scene
from skywright.planning.motion.plan_file import PlanFile
from skywright.run.duration import estimate_duration, estimate_work_s
from skywright.run.gyro_limit import find_noisy_gyroscope
from skywright.run.kind import P, load_kind
from skywright.run.limits import find_exceeded_wind
from skywright.run.link_limit import find_exceeded_delay
from skywright.run.localisation_limit import find_slow_localisation
from skywright.run.need import Need, estimate_need
from skywright.run.operator import Recording
from skywright.run.parts import build_law
from skywright.run.setup import Setup

Array = NDArray[np.float64]

CLIMB_STEP = 0.05  # m, between clearance checks of take-off and landing


class MissionPlan(NamedTuple, Generic[P]):
    """The plan of a mission, or why there is none."""

    feasible: bool
    blocked_by: str | None
    plan_s: float
    duration_s: float  # of the planned motion
    min_clearance_m: float = math.nan
    min_rotor_margin: float = math.nan
    segments: Mapping[str, NDArray[Any]] = {}  # REFERENCE rows, each segment's time from 0
    way: P | None = None  # data of the kind of mission
    traces: Mapping[str, NDArray[Any]] = {}  # clearance and rotor margin along each segment
    file: PlanFile | None = None  # the plan as a file, for kinds that plan platform and joints
    need: Need | None = None  # of time and energy, as estimated
    operator: Recording | None = None  # the recorded operator, for kinds that have one
    flight_s: float = math.nan  # of the whole flight, as estimated

    def get_way(self) -> P:
        """Return the kind's data of a feasible plan."""
        return cast(P, self.way)

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright plan --json`; numbers that do not exist are null."""

        def number(x: float) -> float | None:
            return float(x) if math.isfinite(x) else None

        return {
            "feasible": self.feasible,
            "blocked_by": self.blocked_by,
            "plan_s": self.plan_s,
            "duration_s": number(self.duration_s),
            "flight_s": number(self.flight_s),
            "min_clearance_m": number(self.min_clearance_m),
            "min_rotor_margin": number(self.min_rotor_margin),
            "need": None if self.need is None else self.need._asdict(),
            "metrics": self.metrics,
        }

    @property
    def metrics(self) -> dict[str, float]:
        """Metrics of a path planner, such as `plan.cost`; empty for other planners."""
        return {} if self.file is None else dict(self.file.metrics)


def refuse(blocked_by: str, plan_s: float) -> MissionPlan[Any]:
    """Return the plan of a mission that cannot be flown, with the reason, after `plan_s` (s)."""
    return MissionPlan(False, blocked_by, plan_s, math.nan)


def plan_mission(description: Description[T], setup: Setup[T] | None = None) -> MissionPlan[Any]:
    """Plan the description's mission; an infeasible one is reported in `blocked_by`, not raised.

    `setup` is the Setup of the description, if one was already built. Raises InputError if robot or
    world lack a part that the mission requires.
    """
    setup = setup or Setup(description)
    timestep = 1e-3 * description.mission.timestep_ms
    if timestep > TIMESTEP:  # raises if a contact is too stiff for it
        build_scene(setup.robot, setup.world, timestep=timestep)
    kind = load_kind(description.mission.kind)
    with blame(type(kind), "mission.kind: plan"):
        plan = kind.plan(setup)
    check_map_error(description.world, description.plant, description.origin)
    if not plan.feasible and plan.plan_s > description.mission.planner_time_s:
        plan = kind.plan(setup)  # the first call in a process may have spent its time compiling
    if not kind.flies:
        return _add_estimates(setup, plan)
    if plan.feasible and not kind.held:
        blocked = _find_blocked_climb(setup)
        if blocked is not None:
            plan = plan._replace(feasible=False, blocked_by=blocked)
    if plan.feasible:
        blocked = _find_left_area(setup, plan.segments)
        if blocked is not None:
            plan = plan._replace(feasible=False, blocked_by=blocked)
    sensed = find_exceeded_delay(setup) or find_slow_localisation(setup)
    if plan.feasible and sensed is None:  # builds the law, which a blocked plan may not permit
        law = build_law(description, setup)
        sensed = law.find_unflyable(setup) or find_noisy_gyroscope(setup)
    if sensed is not None:
        return plan._replace(feasible=False, blocked_by=sensed)
    too_windy = find_exceeded_wind(setup, plan.segments)
    if too_windy is not None:
        return plan._replace(feasible=False, blocked_by=too_windy)
    return _add_estimates(setup, plan)


def _add_estimates(setup: Setup[Any], plan: MissionPlan[Any]) -> MissionPlan[Any]:
    """Add the estimated duration of the flight, and its need unless the robot stays on a bench."""
    if not plan.feasible:
        return plan
    kind = load_kind(setup.description.mission.kind)
    with blame(type(kind), "mission.kind: compute_added_s"):
        work = estimate_work_s(setup, plan)
    need = estimate_need(setup, work) if kind.flies else None
    return plan._replace(flight_s=estimate_duration(setup, work).total, need=need)


def _find_blocked_climb(setup: Setup[Any]) -> str | None:
    """Return a message if an object blocks the path from the ground to the hover point, or None."""
    robot, hover, query = setup.robot, setup.hover, setup.clearance_aloft
    folded, attitude = posture(robot, "folded"), rot_z(float(hover[3]))
    ground, margin = robot.platform.gear_height_m, setup.description.mission.climb_clearance_m
    if hover[2] <= ground:
        return (
            f"mission.hover_height_m = {hover[2]:g}: the platform of {robot.name!r} is at "
            f"{ground:g} m where it stands (robot.platform.gear_height_m); valid: above that"
        )
    for z in np.linspace(ground, hover[2], max(math.ceil((hover[2] - ground) / CLIMB_STEP), 1) + 1):
        at = np.array([hover[0], hover[1], z])
        found = compute_clearance(query, at, attitude, folded)
        if found.distance < margin:
            pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
            return (
                f"take-off and landing at ({hover[0]:.2f}, {hover[1]:.2f}) m: {pair} come within "
                f"{max(found.distance, 0.0):.3f} m at a height of {z:.2f} m; at least {margin:g} m "
                "(mission.climb_clearance_m) are required"
            )
    return None


def _find_left_area(setup: Setup[Any], segments: Mapping[str, NDArray[Any]]) -> str | None:
    """Return a message if some part of the robot leaves the world's area in a plan, or None."""
    limits, query, scene = get_limits(setup.world), setup.clearance, setup.scene
    if limits is None:
        return None
    worst, where = 0.0, ""
    planes = [tuple(plane) for plane in np.argwhere(np.isfinite(limits))]
    for name, rows in segments.items():
        for row in rows:
            q = row["q"][: scene.n_joints]
            query_clearance(query.core, row["p_WB"], row["R_WB"], q, 0.0, 0.0)  # places the robot
            if compute_area_clearance(query, scene, limits) >= worst:
                continue
            for axis, side in planes:
                one = np.tile([-math.inf, math.inf], (3, 1))
                one[axis, side] = limits[axis, side]
                distance = compute_area_clearance(query, scene, one)
                if distance < worst:
                    worst = distance
                    key = f"world.area.{'xyz'[axis]}_{('min', 'max')[side]}_m"
                    where = (
                        f"{name} at t = {row['t']:.2f} s: the robot is {-worst:.2f} m outside the "
                        f"world's area ({key} = {limits[axis, side]:g})"
                    )
    return where or None
