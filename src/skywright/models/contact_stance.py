"""Arm postures in which a flying robot presses on a ceiling or a wall, and its largest press."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_tip,
    compute_tips,
    posture,
)
from skywright.models.rotors import build_rotors
from skywright.models.statics import build_layout, compute_ray, wrench_at
from skywright.models.wind import DragBody, compute_drag

LEAN_MAX = math.radians(20.0)
"""Largest angle of the probe to the surface's normal: friction of 0.36 holds the tip."""
TOLERANCE = 1e-3  # m
RESERVE = 0.035
"""m, of reach that may be given up for a better lever of the joints along the probe."""
BESIDE_FEET = 0.02
"""m, of reach that is given up if docking feet are beside the tip. The remaining reach keeps the
feet 15 mm off the surface. If friction holds the tip, it comes no nearer to the robot's axis, and
the elbow's stop leaves 7 of the 20 mm to the arm of f550-bridge."""
LEVER_MIN = 0.01
"""m/rad: 1 N of press is then 10 mN m at a joint, the dry friction of a small gear."""
GRID = 91
"""Angles per joint in the grid of postures of an arm with up to three joints."""
SAMPLES = 300_000
"""Random postures of an arm with more joints."""


class ContactStance(NamedTuple):
    """The arm with its tip at the intended contact."""

    q: Array  # (n,) rad
    tip: Array  # (3,) m in B
    axis: Array  # (3,) of the probe, in B
    lean: float  # rad, from the requested direction


def find_tip_pose(model: NDArray[Any], start: Array, target: Array) -> Array:
    """Return the joints (n,) rad that bring the tip to `target` (m in B; NaN: free coordinate).

    Raises InputError if the tip stays more than TOLERANCE away.
    """
    n, known = len(start), np.isfinite(target)
    low, high = model[0]["q_min"][:n], model[0]["q_max"][:n]

    def residual(q: Array) -> Array:
        return np.asarray((compute_tip(model, q)[0] - target)[known])

    q = np.asarray(
        least_squares(residual, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high)).x
    )
    if float(np.linalg.norm(residual(q))) > TOLERANCE:
        asked = ", ".join(f"{x:.3f}" if k else "any" for x, k in zip(target, known, strict=True))
        raise InputError(f"the arm does not reach ({asked}) m from the platform's centre")
    return q


def find_free_stance(robot: Robot, facing: str) -> ContactStance:
    """Return the posture for pressing up ("down": the surface faces down) or ahead ("side").

    The search uses a grid of the joints (more than three: a fixed random sample), with a lean of
    the probe of at most LEAN_MAX. With docking feet, it selects the least lean at BESIDE_FEET short
    of the farthest reach. Otherwise it selects the best lever along the probe within RESERVE of the
    farthest reach, which is itself a singularity.

    Raises InputError for a robot without a probe or one that cannot point it in that direction.
    """
    if robot.arm is None or robot.probe is None:
        raise InputError(f"robot {robot.name!r} cannot press: it requires a probe")
    model = build_body_model(robot)
    n = len(posture(robot, "working"))
    toward = np.array([0.0, 0.0, 1.0]) if facing == "down" else np.array([1.0, 0.0, 0.0])
    margin = math.radians(2.0)
    low, high = model[0]["q_min"][:n] + margin, model[0]["q_max"][:n] - margin
    if n > 3:
        postures = np.random.default_rng(0).uniform(low, high, (SAMPLES, n))
    elif n == 0:  # a rigid stick has one posture
        postures = np.zeros((1, 0))
    else:
        grids = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
        postures = np.array(np.meshgrid(*grids)).reshape(n, -1).T
    tips, R = compute_tips(model, postures)
    axes = R[:, :, 2]
    leans = np.arccos(np.clip(axes @ toward, -1.0, 1.0))
    found = [
        (float(tips[i] @ toward), ContactStance(postures[i], tips[i], axes[i], float(leans[i])))
        for i in np.flatnonzero(leans <= LEAN_MAX)
    ]
    if not found:
        way = "up" if facing == "down" else "ahead"
        raise InputError(f"the arm of {robot.name!r} cannot point its probe {way}")
    farthest = max(reach for reach, _ in found)
    if facing == "down" and robot.docking is not None:
        top = farthest - BESIDE_FEET
        near = [stance for reach, stance in found if top - 0.005 <= reach <= top]
        if not near:
            return min(found, key=lambda one: abs(one[0] - top))[1]
        return min(near, key=lambda stance: stance.lean)
    near = [stance for reach, stance in found if reach >= farthest - RESERVE]
    return max(near, key=lambda stance: _compute_lever(model, stance))


def check_lever(robot: Robot, stance: ContactStance) -> None:
    """Raise InputError if no joint moves the tip of a stance along the probe: no press is felt."""
    lever = _compute_lever(build_body_model(robot), stance)
    if lever < LEVER_MIN:
        raise InputError(
            f"the joints of {robot.name!r} move the tip along the probe by {1e3 * lever:.1f} mm "
            f"for each rad where it presses; valid: from {1e3 * LEVER_MIN:g} mm. Mount the arm or "
            "the probe (robot.probe.pitch_deg) such that a joint moves the tip along the probe"
        )


def _compute_lever(model: NDArray[Any], stance: ContactStance) -> float:
    """Return the speed (m/s) of the tip along the probe for a unit speed of the joints.

    The joints move such that the tip moves along the probe, as far as they can: 0 if they cannot.
    """
    n, step = len(stance.q), 1e-6
    J = np.empty((3, n))
    for j in range(n):
        moved = stance.q.copy()
        moved[j] += step
        J[:, j] = (compute_tip(model, moved)[0] - stance.tip) / step
    qd = np.linalg.pinv(J, rcond=1e-6) @ stance.axis
    return float(stance.axis @ J @ qd) / max(float(np.linalg.norm(qd)), 1e-9)


def compute_flying_press(
    robot: Robot, stance: ContactStance, R_WB: Array, gravity: float, *, wind: Array | None = None,
    air_density: float = 1.2, pull: Array | None = None,
) -> float:  # fmt: skip
    """Return the largest press (N) along the probe of a robot that hovers at R_WB; NaN: none.

    `wind` (3,) m/s in W: the air's velocity. Drag depends on the rotor speeds and these on the
    thrusts at the press, so both are iterated. `pull` (3,), in B: additional force of the tip per
    newton of press, such as friction times the direction in which it slides.
    """
    layout = build_layout(build_rotors(robot.rotors), robot.rotors.thrust_fraction)
    mass, p_BC, _ = compute_body(build_body_model(robot, gravity), stance.q)
    hold = wrench_at(mass * gravity * R_WB[2], p_BC)
    push = stance.axis if pull is None else stance.axis + pull
    press = wrench_at(push, stance.tip)
    drag, ray = np.zeros(6), compute_ray(layout, hold, press)
    if wind is not None and np.any(wind):
        p = robot.platform
        areas = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
        body = DragBody(mass, gravity, air_density, p_BC, areas)
        wind_B = (R_WB.T @ wind)[None, :]
        for _ in range(6):
            held = ray.hi if math.isfinite(ray.hi) else 0.0
            thrust = layout.P @ (hold - drag + held * press)
            drag = np.hstack(compute_drag(layout, body, wind_B, thrust[None, :]))[0]
            ray = compute_ray(layout, hold - drag, press)
    return float(ray.hi) if ray.hi >= max(ray.lo, 0.0) else math.nan
