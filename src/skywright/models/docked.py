"""Largest press of a docked robot: balance of rotors, feet and arm under slope, wind and reach.

The docking gear's feet rest on a ceiling; the arm presses its tip against the same surface. Rotor
thrusts have limits, a foot can only push (unilateral contact) and its tangential force stays within
its friction cone. The largest force is therefore a linear programme over thrusts, foot forces and
the press:

    maximise F   subject to   B T + sum_i G_i f_i - F w_tip + w_weight + w_drag = 0

G_i spans the friction pyramid of foot i, which is inside the cone and therefore conservative. Frame
B, SI units, torques about B's origin. The limit is static, as in the capability analysis.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, linprog

from skywright.core.arrays import Array
from skywright.description.robot.docking import Docking
from skywright.description.robot.limbs import list_servos
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.docking_body import list_feet
from skywright.models.force_resolution import map_to_servos
from skywright.models.force_sensor import compute_spring_force
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip, posture
from skywright.models.rotors import build_rotors
from skywright.models.statics import Layout, build_layout, wrench_at

PYRAMID = 16
"""Sides of the friction pyramid; it contains cos(pi / 16) = 98 % of the cone."""
REACH_TOLERANCE = 1e-3  # m, between the tip and the requested contact point
LEAN_MAX = math.radians(20.0)
"""Largest angle of the slider to the surface's normal."""
DRAG_ROUNDS = 3
"""Rounds of linearisation: rotor drag grows with the square root of the unknown thrusts."""


class DockedPress(NamedTuple):
    """The largest press in one condition; if none exists, NaN and "cannot stay docked"."""

    force: float  # N, of the tip on the surface, along its normal
    limit: str  # active limit: rotors, feet, servos, slider, or cannot stay docked
    thrust: Array  # (n,) N
    foot_load: Array  # (feet,) N, normal force on each foot
    foot_friction: Array  # (feet,) tangential over normal force
    q: Array  # rad, arm
    lean: float  # rad, slider to the surface's normal


class Stance(NamedTuple):
    """The arm with its tip at a contact point, from `find_stance`."""

    q: Array  # rad
    lean: float  # rad, slider to the surface's normal
    tip: Array  # (3,) m in B
    mass: float  # kg, whole robot
    p_BC: Array  # (3,) m
    lever: Array  # (joints,) m, torque of each joint per newton of press
    dC_dq: Array  # (3, joints) m/rad, of the whole robot's centre of mass


class DockedRobot(NamedTuple):
    """Data of a robot for the programme; built once by `build_docked`."""

    robot: Robot
    docking: Docking
    layout: Layout
    model: NDArray[Any]
    feet: Array  # (feet, 3) m
    pyramid: Array  # (6, feet * PYRAMID), wrench per newton of normal force
    gravity: float
    air_density: float


def build_docked(
    robot: Robot, *, thrust_fraction: float | None = None, gravity: float = 9.81,
    air_density: float = 1.2,
) -> DockedRobot:  # fmt: skip
    """Prepare a robot for `compute_docked_press`.

    Raises InputError if it has no docking gear or no arm with a probe.
    """
    if robot.docking is None:
        raise InputError(f"robot {robot.name!r} has no docking gear: add a [robot.docking] table")
    if robot.arm is None or robot.probe is None:
        raise InputError(
            f"robot {robot.name!r} cannot press: it requires [robot.arm] and [robot.probe]"
        )
    fraction = robot.rotors.thrust_fraction if thrust_fraction is None else thrust_fraction
    feet = list_feet(robot.docking)
    turn = 2.0 * math.pi * np.arange(PYRAMID) / PYRAMID
    edges = np.column_stack(
        [
            robot.docking.friction * np.cos(turn),
            robot.docking.friction * np.sin(turn),
            -np.ones(PYRAMID),
        ]
    )
    columns = [wrench_at(edge, foot) for foot in feet for edge in edges]
    layout = build_layout(build_rotors(robot.rotors), fraction)
    layout = layout._replace(  # absolute thrusts: a preload has no wrench
        t_min=layout.t_min + layout.preload, t_max=layout.t_max + layout.preload,
        preload=np.zeros_like(layout.preload),
    )  # fmt: skip
    return DockedRobot(
        robot, robot.docking, layout, build_body_model(robot, gravity), feet,
        np.array(columns).T, gravity, air_density,
    )  # fmt: skip


def compute_docked_press(
    docked: DockedRobot,
    stance: Stance,
    *,
    slope: float = 0.0,
    slope_toward: float = 0.0,
    wind: float = 0.0,
    wind_toward: float = 0.0,
) -> DockedPress:
    """Compute the largest press in one condition.

    `slope` (rad) of the surface, which rises toward `slope_toward` (rad from ahead, positive to the
    left); the robot is parallel to it. `wind` (m/s, horizontal) blows toward `wind_toward`.

    Raises InputError if a value is not finite or is out of range.
    """
    for name, value in {"slope": slope, "wind": wind, "toward": slope_toward + wind_toward}.items():
        if not math.isfinite(value):
            raise InputError(f"{name} is {value}; valid: a finite number")
    if not 0.0 <= slope < math.pi / 2 or wind < 0.0:
        raise InputError(
            f"slope {math.degrees(slope):g} deg and wind {wind:g} m/s; valid: slope from 0 to "
            "below 90 deg, wind from 0"
        )
    q, lean, mass = stance.q, stance.lean, stance.mass
    R_WB = _rising(slope, slope_toward)
    up_B = R_WB[2]
    weight = wrench_at(-mass * docked.gravity * up_B, stance.p_BC)
    press = wrench_at(np.array([0.0, 0.0, -1.0]), stance.tip)  # on the robot, per newton
    wind_B = R_WB.T @ (wind * np.array([math.cos(wind_toward), math.sin(wind_toward), 0.0]))
    body, hubs = _compute_drag(docked, wind_B)
    ceiling, stop = _arm_limit(docked, stance, up_B)
    low, high = docked.layout.t_min, docked.layout.t_max
    # rotor speed over thrust: a chord first, then tangents at the last solution
    rate = (np.sqrt(high) - np.sqrt(low)) / (high - low)
    start, thrust = np.sqrt(low) - rate * low, low
    found: Any = None
    for _ in range(DRAG_ROUNDS if wind > 0.0 else 1):
        B = docked.layout.B + hubs * rate
        found = _solve(docked, B, press, weight + body + hubs @ start, ceiling)
        if found is None:
            break
        thrust = found[: len(thrust)]
        root = np.sqrt(np.maximum(thrust, 1e-3))
        rate, start = 0.5 / root, 0.5 * root
    n = len(thrust)
    if found is None:
        empty = np.full(len(docked.feet), math.nan)
        return DockedPress(
            math.nan, "cannot stay docked", np.full(n, math.nan), empty, empty, q, lean
        )
    shares = found[n:-1].reshape(len(docked.feet), PYRAMID)
    normal = shares.sum(axis=1)
    turn = 2.0 * math.pi * np.arange(PYRAMID) / PYRAMID
    sideways = docked.docking.friction * np.hypot(shares @ np.cos(turn), shares @ np.sin(turn))
    largest = float(found[-1])
    if largest > ceiling - 1e-6:
        limit = stop
    elif np.any(thrust > docked.layout.t_max - 1e-6):
        limit = "rotors"
    else:
        limit = "feet"
    ratio = sideways / np.maximum(normal, 1e-12)
    return DockedPress(largest, limit, thrust, normal, ratio, q, lean)


def _compute_drag(docked: DockedRobot, wind_B: Array) -> tuple[Array, Array]:
    """Return the drag (6,) of the body and (6, n) of the rotors per root of thrust, about B."""
    p, r = docked.robot.platform, docked.layout.rotors
    areas = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
    force = 0.5 * docked.air_density * areas * float(np.linalg.norm(wind_B)) * wind_B
    across = wind_B - (r.axis @ wind_B)[:, None] * r.axis
    hub = r.drag_coefficient / math.sqrt(r.k_f) * across
    return wrench_at(force, np.zeros(3)), np.hstack([hub, np.cross(r.position, hub)]).T


def compute_drag(docked: DockedRobot, wind_B: Array, thrust: Array) -> Array:
    """Return the wrench (6,) of wind (3,) m/s on body and rotors, in B about its origin.

    `thrust` (n,) N sets the speeds of the rotors, whose drag grows with them.
    """
    body, hubs = _compute_drag(docked, wind_B)
    return np.asarray(body + hubs @ np.sqrt(np.maximum(thrust, 0.0)))


def _solve(
    docked: DockedRobot, B: Array, press: Array, load: Array, ceiling: float
) -> Array | None:
    """Solve the programme over (thrusts, pyramid edges, press)."""
    layout, feet = docked.layout, len(docked.feet)
    n, edges = len(layout.t_max), docked.pyramid.shape[1]
    cost = np.zeros(n + edges + 1)
    cost[-1] = -1.0
    loads = np.zeros((feet, n + edges + 1))
    for i in range(feet):
        loads[i, n + i * PYRAMID : n + (i + 1) * PYRAMID] = -1.0
    found = linprog(
        cost,
        A_ub=loads,
        b_ub=np.full(feet, -docked.docking.foot_load_n),
        A_eq=np.hstack([B, docked.pyramid, press[:, None]]),
        b_eq=-load,
        bounds=[*zip(layout.t_min, layout.t_max, strict=True), *[(0.0, None)] * edges,
                (0.0, ceiling)],
        method="highs",
    )  # fmt: skip
    return np.asarray(found.x) if found.status == 0 else None


def find_stance(docked: DockedRobot, contact: Sequence[float] | Array | None = None) -> Stance:
    """Return the arm posture with its tip at `contact` (2,) m, in the plane of the feet in B.

    The default contact is the tip of the working posture, where the search also starts.

    Raises InputError if the tip stays more than REACH_TOLERANCE away, if the slider leans more than
    LEAN_MAX, or if the point is not finite.
    """
    start = posture(docked.robot, "working")
    height = docked.docking.height_m
    if contact is None:
        x, y = compute_tip(docked.model, start)[0][:2]
    else:
        point = np.asarray(contact, dtype=np.float64)
        if point.shape != (2,) or not np.all(np.isfinite(point)):
            raise InputError(f"contact point is {contact}; give two finite numbers X,Y in m")
        x, y = point
    n = len(start)
    low, high = docked.model[0]["q_min"][:n], docked.model[0]["q_max"][:n]
    target = np.array([x, y, height])

    def residual(q: Array) -> Array:
        return np.asarray(compute_tip(docked.model, q)[0] - target)

    inside = np.clip(start, low + 1e-6, high - 1e-6)
    q = np.asarray(least_squares(residual, inside, bounds=(low, high), xtol=1e-9).x)
    tip, R_BT = compute_tip(docked.model, q)
    gap = float(np.linalg.norm(tip - target))
    lean = math.acos(min(max(float(R_BT[2, 2]), -1.0), 1.0))
    if gap > REACH_TOLERANCE:
        raise InputError(
            f"the arm of {docked.robot.name!r} does not reach ({x:.3f}, {y:.3f}) m in the plane of "
            f"its docking feet ({height:g} m up): its tip stays {gap:.3f} m away"
        )
    if lean > LEAN_MAX:
        raise InputError(
            f"at ({x:.3f}, {y:.3f}) m the slider of {docked.robot.name!r} is inclined by "
            f"{math.degrees(lean):.0f} deg to the surface normal; valid: at most "
            f"{math.degrees(LEAN_MAX):.0f} deg"
        )
    mass, p_BC, _ = compute_body(docked.model, q)
    step, lever, dC_dq = 1e-6, np.zeros(n), np.zeros((3, n))
    for j in range(n):
        low_q, high_q = q.copy(), q.copy()
        low_q[j] -= step
        high_q[j] += step
        rise = compute_tip(docked.model, high_q)[0][2] - compute_tip(docked.model, low_q)[0][2]
        lever[j] = rise / (2 * step)
        moved = compute_body(docked.model, high_q)[1] - compute_body(docked.model, low_q)[1]
        dC_dq[:, j] = moved / (2 * step)
    return Stance(q, lean, tip, mass, p_BC, lever, dC_dq)


def _arm_limit(docked: DockedRobot, stance: Stance, up_B: Array) -> tuple[float, str]:
    """Return the largest press (N) that servos and slider allow, and which of them limits it."""
    robot = docked.robot
    assert robot.arm is not None and robot.probe is not None
    probe = robot.probe
    slider = compute_spring_force(probe, robot.force_sensor, probe.spring_travel_m)
    gravity = stance.mass * docked.gravity * up_B @ stance.dC_dq
    slope, offset = map_to_servos(robot, stance.lever), map_to_servos(robot, gravity)
    best = math.inf
    for (_, servo), a, b in zip(list_servos(robot), slope, offset, strict=True):
        if abs(a) > 1e-9:
            best = min(best, (servo.stall_torque_nm - math.copysign(1.0, a) * b) / abs(a))
    best = max(best, 0.0)
    return (best, "servos") if best < slider else (slider, "slider")


def _rising(slope: float, toward: float) -> Array:
    """Return R_WB of a robot parallel to a surface that rises by `slope` toward `toward`."""
    d = np.array([math.cos(toward), math.sin(toward), 0.0])
    across = np.array([-d[1], d[0], 0.0])
    along = math.cos(slope) * d + np.array([0.0, 0.0, math.sin(slope)])
    frame = np.column_stack([along, across, np.cross(along, across)])
    return frame @ np.column_stack([d, across, [0.0, 0.0, 1.0]]).T
