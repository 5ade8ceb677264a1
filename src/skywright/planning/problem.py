"""Data shared by all parts of the planner: robot, surface, limits, and failures."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.world.surface import Cylinder
from skywright.models.body_records import Body, Kinematics
from skywright.models.geometry import ClearanceCore, ClearanceQuery, describe_pair
from skywright.models.link_motion import Motion, build_motion
from skywright.planning.inverse_dynamics import Loads

OK, CLEARANCE, ROTOR, JOINT, MOTOR, SPEED, ACCELERATION, TASK, TILT, SINGULAR = range(10)
"""Outcome of a check along a motion."""
IN_FLIGHT, ON_SURFACE = "mission.clearance_m", "mission.surface_clearance_m"
BETWEEN_PARTS = "mission.self_clearance_m"
"""Keys that set the clearances."""


class Limits(NamedTuple):
    """Limits of a plan."""

    margin: float = 0.03  # m, clearance near the surface
    margin_transit: float = 0.05  # m, least clearance in free flight
    margin_wanted: float = 0.3  # m, preferred clearance in free flight
    margin_self: float = 0.01  # m, between parts of the robot
    margin_shapes: float = 0.02  # m, the same for planners with coarser shapes
    speed: float = 0.5  # m/s, platform
    acceleration: float = 0.5  # m/s^2
    yaw_rate: float = 0.6  # rad/s
    yaw_acceleration: float = 0.6  # rad/s^2
    joint_rate: float = 0.8  # rad/s, while folding
    joint_acceleration: float = 1.5  # rad/s^2
    tilt: float = math.radians(10.0)
    task_error: float = 0.5e-3  # m, of the nominal tip
    axis_error: float = math.radians(0.5)
    resolution: float = 0.004  # m, motion of the fastest point between two clearance checks
    rotor_margin: float = 0.0  # fraction of the usable thrust range that must stay free
    ground: float = 0.25  # m, lowest height of the origin of B in transit


class Problem(NamedTuple):
    """Robot, loads, surface and working memory, readable from compiled code."""

    model: NDArray[Any]  # (1,) BodyModel
    loads: Loads
    clearance: ClearanceCore
    cylinder: Cylinder
    R_WA: Array  # (3, 3) like cylinder.R_WP; the probe's axis follows its normals
    limits: Limits
    push_force: float  # N along the normal while the tip is inside
    reach: float  # m, from B's origin to the robot's farthest point
    kinematics: NDArray[Any]  # (1,) Kinematics, scratch
    body: NDArray[Any]  # (1,) Body, scratch
    motion: Motion  # scratch


class Failure(NamedTuple):
    """The violated constraint of a motion, and where it is violated."""

    code: int
    value: float
    limit: float
    which: int  # rotor, joint or pair
    s: float  # place on the surface (NaN in free flight)
    phi: float
    p_WB: Array
    margin_key: str  # key of the clearance from obstacles


def build_problem(
    model: NDArray[Any],
    loads: Loads,
    query: ClearanceQuery,
    cylinder: Cylinder,
    limits: Limits,
    push_force: float,
    R_WA: Array | None = None,
) -> Problem:
    """Collect the parts; `R_WA` is by default the pipe's frame."""
    m = model[0]
    rotors = float(np.max(np.linalg.norm(loads.position, axis=1), initial=0.0))
    arm = float(sum(np.linalg.norm(m["offset"][i]) for i in range(m["n_links"])))
    arm += float(np.linalg.norm(m["tip_offset"]))
    return Problem(
        model, loads, query.core, cylinder, cylinder.R_WP if R_WA is None else R_WA, limits,
        push_force, max(rotors + 0.2, arm),
        np.zeros(1, Kinematics.dtype), np.zeros(1, Body.dtype), build_motion(),
    )  # fmt: skip


def describe_failure(
    f: Failure, query: ClearanceQuery, joints: tuple[str, ...], model: NDArray[Any] | None = None
) -> str:
    """Return one sentence that states the constraint with its numbers.

    `model` is a (1,) array of `BodyModel`, which states the joints that slide.
    """
    if math.isfinite(f.s):
        where = f" at s = {f.s:.3f} m, phi = {math.degrees(f.phi):.0f} deg"
    else:
        where = f" with the platform at ({f.p_WB[0]:.2f}, {f.p_WB[1]:.2f}, {f.p_WB[2]:.2f}) m"
    name = joints[f.which] if 0 <= f.which < len(joints) else str(f.which)
    if f.code == CLEARANCE:
        pair = describe_pair(query, f.which)
        key = BETWEEN_PARTS if f.which >= query.core.n_world else f.margin_key
        return f"clearance of {pair} {f.value:.4f} m < {f.limit:.3f} m ({key}){where}"
    if f.code == ROTOR:
        sign = ">" if f.value > f.limit else "<"
        return f"rotor {f.which} requires {f.value:.2f} N {sign} {f.limit:.2f} N{where}"
    slides = model is not None and model[0]["slide"][model[0]["joint"] == f.which].any()
    if f.code == JOINT and slides:
        return f"joint {name} at {f.value:.4f} m exceeds its limit of {f.limit:.4f} m{where}"
    if f.code == JOINT:
        at, limit = math.degrees(f.value), math.degrees(f.limit)
        return f"joint {name} at {at:.0f} deg exceeds its limit of {limit:.0f} deg{where}"
    if f.code == MOTOR:
        return f"motor of {name} requires {abs(f.value):.2f} rad/s > {f.limit:.2f} rad/s{where}"
    if f.code == SPEED:
        return f"platform speed {f.value:.3f} m/s > {f.limit:.3f} m/s{where}"
    if f.code == ACCELERATION:
        return f"platform acceleration {f.value:.3f} m/s^2 > {f.limit:.3f} m/s^2{where}"
    if f.code == TILT:
        at, limit = math.degrees(f.value), math.degrees(f.limit)
        return f"platform tilt {at:.1f} deg > {limit:.1f} deg{where}"
    if f.code == TASK:
        return f"reach: the tip deviates from its path by {1000.0 * f.value:.1f} mm{where}"
    return f"reach: the arm is singular{where}"
