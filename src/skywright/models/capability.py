"""Static limits of a robot: forces, tilts, wind, payload, loads and endurance.

All limits that missions use are computed here, with the nominal model and with `thrust_fraction` of
the rotors' upper limit (the rest is reserved for control). Directions are horizontal in B, from +x
counter-clockwise. The limits are static: rotor thrusts that hold the robot (weight, arm offset,
drag, push) stay within their range; transients need an additional margin.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.hover import check_can_fly, check_hover, choose_posture, find_worst_posture
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip
from skywright.models.rotor_loss import list_rotors_left
from skywright.models.rotors import build_rotors, compute_electrical_power
from skywright.models.statics import (
    UP,
    Layout,
    build_layout,
    compute_lateral_forces,
    compute_polytope,
    compute_ray,
    compute_thrust,
    compute_tilt_limit,
    wrench_at,
)
from skywright.models.wind import (
    FASTEST,
    DragBody,
    compute_hold,
    compute_largest,
    compute_wind_limits,
    is_held,
)

MOTOR_TIMEOUT_S = 0.5
"""s without a command over the control link after which motor controllers stop the motors."""
EVERY_SIDE = np.radians(np.arange(0.0, 360.0, 5.0))
"""rad; directions of the limits."""
EVERY_SIDE.setflags(write=False)
LARGEST_PUSH = 100.0
"""N; upper bound of the search for the largest push."""


class Capability(NamedTuple):
    """The static limits of one robot in one arm posture. m directions, n rotors."""

    robot: str
    posture: str  # "extended", "folded", "worst", "given" or "none" (no arm)
    q: Array  # rad, arm joints of that posture
    layout: Layout
    body: DragBody
    p_BT: Array  # (3,) m, tip
    thrust_fraction: float
    tilt_max: float  # rad, that control may command
    directions: Array  # (m,) rad
    lateral_force: Array  # (m,) N at level attitude, through the centre of mass
    wind_limit: Array  # (m,) m/s blowing toward; level, or tilted without lateral force
    wind_limit_tilted: Array  # (m,) m/s with the best lean up to tilt_max
    tilts: Array  # (k,) rad
    lateral_force_tilted: Array  # (4, k) N against tilt, leaning toward +x, +y, -x, -y; NaN: none
    hover_tilt: tuple[float, float]  # rad (roll, pitch), the smaller of both directions
    hover_tilt_signed: dict[str, float]  # rad, each direction
    hover_thrust: Array  # (n,) N
    hover_power: float  # W, avionics included
    endurance: float  # s
    dispensable: tuple[int, ...]  # rotors, from 1, whose single loss allows a controlled landing
    lean_without: tuple[float, ...]  # rad, lean at hover after the loss of each of them
    payload: float  # kg at B's origin, in addition to the carried mass
    vertical_force: float  # N, largest at level attitude without torque about the centre of mass
    force_polytope: Array  # (v, 3) N, no torque about the centre of mass
    torque_polytope: Array  # (v, 3) N m at hover, about the centre of mass
    worst_q: Array  # rad, posture with the smallest lateral force (or largest offset)
    worst_lateral_force: float  # N, the smallest over directions in that posture

    def to_json(self) -> dict[str, Any]:
        """Return the command line's `--json` object. Undefined numbers are None."""
        r = self.layout.rotors
        return {
            "robot": self.robot,
            "mass_kg": self.body.mass,
            "thrust_fraction": self.thrust_fraction,
            "directions_deg": np.degrees(self.directions).round(9).tolist(),
            "lateral_force_n": _plain(self.lateral_force),
            "wind_limit_mps": _plain(self.wind_limit),
            "hover_tilt_deg": {
                "roll": _number(math.degrees(self.hover_tilt[0])),
                "pitch": _number(math.degrees(self.hover_tilt[1])),
            },
            "hover_power_w": self.hover_power,
            "endurance_s": self.endurance,
            "dispensable_rotors": list(self.dispensable),
            "falls_without_link_s": MOTOR_TIMEOUT_S,
            "lean_without_rotor_deg": np.degrees(self.lean_without).round(3).tolist(),
            "rotors": [
                {
                    "position_m": r.position[i].tolist(),
                    "axis": r.axis[i].tolist(),
                    "thrust_min_n": float(r.thrust_min[i]),
                    "thrust_max_n": float(r.thrust_max[i]),
                    # signed: torque on the body about `axis` per thrust (ccw propellers: negative)
                    "torque_per_thrust_m": float(-r.spin[i] * r.torque_per_thrust),
                    "spin": "ccw" if r.spin[i] > 0 else "cw",
                }
                for i in range(len(r.axis))
            ],
            "posture": self.posture,
            "posture_deg": np.degrees(self.q).tolist(),
            "com_m": self.body.p_BC.tolist(),
            "wind_direction": "toward",
            "wind_limit_tilted_mps": _plain(self.wind_limit_tilted),
            "hover_tilt_signed_deg": {
                k: _number(math.degrees(v)) for k, v in self.hover_tilt_signed.items()
            },
            "lateral_force_against_tilt": {
                "tilt_deg": np.degrees(self.tilts).round(9).tolist(),
                **{
                    f"toward_{name}_n": _plain(row)
                    for name, row in zip(
                        ("0", "90", "180", "270"), self.lateral_force_tilted, strict=True
                    )
                },
            },
            "hover_thrust_n": self.hover_thrust.tolist(),
            "payload_kg": _number(self.payload),
            "vertical_force_n": _number(self.vertical_force),
            "force_polytope_n": self.force_polytope.tolist(),
            "torque_polytope_nm": self.torque_polytope.tolist(),
            "worst_posture_deg": np.degrees(self.worst_q).tolist(),
            "worst_lateral_force_n": _number(self.worst_lateral_force),
        }


def _number(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _plain(values: Array) -> list[float | None]:
    return [_number(v) for v in values]


def compute_capability(
    robot: Robot,
    *,
    posture: str | Sequence[float] | Array = "extended",
    thrust_fraction: float | None = None,
    directions_deg: Sequence[float] | Array | None = None,
    gravity: float = 9.81,
    air_density: float = 1.2,
) -> Capability:
    """Compute the static limits of a robot.

    `posture`: "extended" (the joints' `working_deg`), "folded", "worst" (least lateral force on a
    grid over the joint limits) or joint angles in rad. `directions_deg`: 72 by default.

    Raises InputError if the robot cannot hover in that posture (`check_can_fly`), if the posture is
    unknown or if the rotors cannot control attitude and height.
    """
    fraction = robot.rotors.thrust_fraction if thrust_fraction is None else thrust_fraction
    if not 0.0 < fraction <= 1.0:
        raise InputError(f"thrust_fraction is {fraction:g}; valid: above 0 and at most 1")
    layout = build_layout(build_rotors(robot.rotors), fraction)
    directions = EVERY_SIDE
    if directions_deg is not None:
        directions = np.radians(np.asarray(directions_deg, dtype=np.float64))
    model = build_body_model(robot, gravity)
    worst_q, worst_force = find_worst_posture(robot, model, layout, gravity)
    q, label = choose_posture(robot, posture, worst_q)
    body = build_drag_body(robot, model, q, gravity, air_density)
    mass, p_BC = body.mass, body.p_BC
    hover = check_hover(robot, layout, mass, p_BC, gravity, label)
    weight = mass * gravity
    tilt_max = math.radians(robot.control.tilt_max_deg)
    level = wrench_at(weight * UP, p_BC)
    tilts = np.radians(np.arange(0.0, robot.control.tilt_max_deg + 0.5, 1.0))
    signed = {
        "roll+": compute_tilt_limit(layout, weight, p_BC, np.array([1.0, 0.0, 0.0])),
        "roll-": compute_tilt_limit(layout, weight, p_BC, np.array([-1.0, 0.0, 0.0])),
        "pitch+": compute_tilt_limit(layout, weight, p_BC, np.array([0.0, 1.0, 0.0])),
        "pitch-": compute_tilt_limit(layout, weight, p_BC, np.array([0.0, -1.0, 0.0])),
    }
    arm = np.cross(p_BC, np.eye(3)).T  # torque about B's origin per force at C
    power = compute_electrical_power(layout.rotors, hover, air_density)
    power += robot.battery.avionics_power_w
    usable = robot.battery.energy_wh * 3600.0 * robot.battery.usable_fraction
    wind = compute_wind_limits(layout, body, directions, tilt_max)
    left = list_rotors_left(layout.rotors, weight, p_BC, tilt_max)
    return Capability(
        robot=robot.name,
        posture=label,
        q=q,
        layout=layout,
        body=body,
        p_BT=compute_tip(model, q)[0],
        thrust_fraction=fraction,
        tilt_max=tilt_max,
        directions=directions,
        lateral_force=compute_lateral_forces(layout, weight, p_BC, directions),
        wind_limit=wind,
        wind_limit_tilted=_best_lean(layout, body, directions, tilt_max, wind),
        tilts=tilts,
        lateral_force_tilted=np.array(
            [_lateral_against_tilt(layout, weight, p_BC, k * math.pi / 2, tilts) for k in range(4)]
        ),
        hover_tilt=(min(signed["roll+"], signed["roll-"]), min(signed["pitch+"], signed["pitch-"])),
        hover_tilt_signed=signed,
        hover_thrust=hover,
        hover_power=power,
        endurance=usable / power,
        dispensable=tuple(left),
        lean_without=tuple(x.lean for x in left.values()),
        payload=max(compute_ray(layout, level, wrench_at(gravity * UP, np.zeros(3))).hi, 0.0),
        vertical_force=compute_ray(layout, np.zeros(6), wrench_at(UP, p_BC)).hi,
        force_polytope=compute_polytope(layout, np.zeros(6), np.vstack([np.eye(3), arm])),
        torque_polytope=compute_polytope(layout, level, np.vstack([np.zeros((3, 3)), np.eye(3)])),
        worst_q=worst_q,
        worst_lateral_force=worst_force,
    )


def build_drag_body(
    robot: Robot, model: NDArray[Any], q: Array, gravity: float, air_density: float
) -> DragBody:
    """Build the data of drag and weight at joints `q` (n_joints,) rad of a `BodyModel`."""
    mass, p_BC, _ = compute_body(model, q)
    p = robot.platform
    area = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
    return DragBody(mass, gravity, air_density, p_BC, area)


def _lateral_against_tilt(
    layout: Layout, weight: float, p_BC: Array, direction: float, tilts: Array
) -> Array:
    """Return the largest horizontal force (k,) N toward `direction` at each lean toward it."""
    d = np.array([math.cos(direction), math.sin(direction), 0.0])
    out = np.full(len(tilts), np.nan)
    coplanar = np.allclose(layout.B[:2], 0.0, atol=1e-12)
    for i, tilt in enumerate(tilts):
        up_B = math.cos(tilt) * UP - math.sin(tilt) * d
        d_B = math.cos(tilt) * d + math.sin(tilt) * UP
        w0, w1 = wrench_at(weight * up_B, p_BC), wrench_at(d_B, p_BC)
        if coplanar:  # only one force is feasible: the one that keeps the sum along z_B
            force = weight * math.tan(tilt)
            if compute_thrust(layout, w0 + force * w1) is not None:
                out[i] = force
        else:
            hi = compute_ray(layout, w0, w1).hi
            out[i] = hi if hi >= 0.0 else math.nan
    return out


def _best_lean(
    layout: Layout, body: DragBody, directions: Array, tilt_max: float, level: Array
) -> Array:
    """Return the wind limit (m,) at the best lean into the wind, up to `tilt_max`."""
    if not layout.full:
        return level
    d = np.column_stack([np.cos(directions), np.sin(directions), np.zeros(len(directions))])
    m, leans = len(directions), np.linspace(0.0, tilt_max, 7)

    def holds(speed: Array) -> Mask:  # some leans balance only in wind: each speed is tested at all
        wind = np.tile(speed[:, None] * d, (len(leans), 1))
        held = compute_hold(layout, body, wind, lean=np.repeat(leans, m))
        return np.any(is_held(layout, *held, tilt_max).reshape(len(leans), m), axis=0)

    return np.fmax(level, compute_largest(holds, len(directions), FASTEST))


def compute_least_wind_limit(robot: Robot, gravity: float, air_density: float) -> float:
    """Return the largest wind (m/s) that a robot with extended arm holds from every direction.

    It is the least `wind_limit` of `compute_capability`. Raises InputError as that does.
    """
    layout = build_layout(build_rotors(robot.rotors), robot.rotors.thrust_fraction)
    model = build_body_model(robot, gravity)
    q, label = choose_posture(robot, "extended", np.zeros(0))
    body = build_drag_body(robot, model, q, gravity, air_density)
    check_hover(robot, layout, body.mass, body.p_BC, gravity, label)
    tilt_max = math.radians(robot.control.tilt_max_deg)
    return float(np.nanmin(compute_wind_limits(layout, body, EVERY_SIDE, tilt_max)))


def compute_wind_limit(capability: Capability, toward_deg: float) -> float:
    """Return the largest wind (m/s) toward `toward_deg` in B that the robot holds.

    It is computed for this direction, without interpolation, in the capability's posture.
    """
    c = capability
    angle = np.array([math.radians(toward_deg)])
    return float(compute_wind_limits(c.layout, c.body, angle, c.tilt_max)[0])


def compute_force_limit(
    capability: Capability,
    direction_B: Sequence[float] | Array,
    wind_B: Sequence[float] | Array = (0.0, 0.0, 0.0),
    p_BT: Array | None = None,
) -> float:
    """Return the largest push (N) at the tip along `direction_B` that the robot can hold.

    `direction_B` (3,): direction of the force on the environment, in B at level attitude; `wind_B`
    (3,) m/s: the air's velocity; `p_BT`: the tip, if it differs from that of the posture. Robots
    with lateral force stay level, the others tilt up to `tilt_max`. Returns NaN if the wind alone
    is infeasible, and at most LARGEST_PUSH.
    """
    c = capability
    d = np.asarray(direction_B, dtype=np.float64)
    size = float(np.linalg.norm(d))
    if not (math.isfinite(size) and size > 0.0):
        raise InputError(
            f"push direction is {list(map(float, d))}; valid: a finite, non-zero vector"
        )
    point = c.p_BT if p_BT is None else np.asarray(p_BT, dtype=np.float64)
    wind = np.asarray(wind_B, dtype=np.float64)[None, :]

    def holds(force: Array) -> Mask:
        push = force[:, None] * (d / size)[None, :]
        thrust, tilt = compute_hold(c.layout, c.body, wind, push, point)
        return is_held(c.layout, thrust, tilt, c.tilt_max)

    return float(compute_largest(holds, 1, LARGEST_PUSH)[0])


__all__ = [
    "FASTEST",
    "Capability",
    "check_can_fly",
    "compute_capability",
    "compute_force_limit",
    "compute_lateral_forces",
    "compute_least_wind_limit",
    "compute_wind_limit",
]
