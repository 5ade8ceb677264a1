"""Checks that a robot can hover, and finds its weakest arm posture."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotors import build_rotors
from skywright.models.statics import (
    UP,
    Layout,
    build_layout,
    compute_lateral_forces,
    compute_thrust,
    wrench_at,
)


def check_can_fly(robot: Robot, gravity: float = 9.81) -> float:
    """Raise InputError with the numbers if the robot cannot lift or balance itself.

    The check uses the thrust fraction of missions, with the arm folded and in its working posture.
    Returns the largest share of a rotor's thrust_max_n at hover.
    """
    share = 0.0
    layout = build_layout(build_rotors(robot.rotors), robot.rotors.thrust_fraction)
    model = build_body_model(robot, gravity)
    for which in ("folded", "working"):
        mass, p_BC, _ = compute_body(model, posture(robot, which))
        thrust = check_hover(robot, layout, mass, p_BC, gravity, which)
        share = max(share, float(np.max(thrust / layout.rotors.thrust_max)))
    return share


def check_hover(
    robot: Robot, layout: Layout, mass: float, p_BC: Array, gravity: float, label: str
) -> Array:
    """Return the hover thrusts (n,) N, or raise InputError that states the missing thrust or
    torque."""
    weight = mass * gravity
    thrust = compute_thrust(layout, wrench_at(weight * UP, p_BC))
    if thrust is not None:
        return thrust
    least, most = layout.t_min + layout.preload, layout.t_max + layout.preload
    ends = np.sort([least * layout.B[2], most * layout.B[2]], axis=0)  # some may push down
    idle, lift = (float(x) for x in ends.sum(axis=1))
    limit = f"{100 * most[0] / layout.rotors.thrust_max[0]:.0f} % of thrust_max_n"
    if weight >= lift:
        raise InputError(
            f"robot {robot.name!r} cannot lift its weight: it weighs {weight:.1f} N ({mass:.2f} "
            f"kg), its rotors lift at most {lift:.1f} N at {limit}; reduce masses or raise "
            "robot.rotors.thrust_max_n"
        )
    if weight <= idle:
        raise InputError(
            f"robot {robot.name!r} cannot descend: it weighs {weight:.1f} N, its rotors lift at "
            f"least {idle:.1f} N at thrust_min_n; lower robot.rotors.thrust_min_n"
        )
    loads = layout.P @ wrench_at(weight * UP, p_BC)
    excess = np.maximum(loads - layout.t_max, layout.t_min - loads)
    i = int(np.argmax(excess))
    need = float(loads[i] + layout.preload[i])
    raise InputError(
        f"robot {robot.name!r} cannot hover with its arm {label}: the centre of mass is at "
        f"({p_BC[0]:.3f}, {p_BC[1]:.3f}) m, rotor {i + 1} would need {need:.2f} N; valid: "
        f"{least[i]:.2f} to {most[i]:.2f} N ({limit})"
    )


def read_numbers(value: Any) -> Array | None:
    """Return a number or an array of numbers, or None if the value is neither."""
    try:
        out = np.asarray(value)
    except ValueError:  # lists of different lengths
        return None
    return out.astype(np.float64) if out.dtype.kind in "fiu" else None


def choose_posture(
    robot: Robot, choice: str | Sequence[float] | Array, worst_q: Array
) -> tuple[Array, str]:
    """Return joint angles (rad) and the posture's name."""
    if robot.arm is None:
        return np.zeros(0), "none"
    if not isinstance(choice, str):
        q = read_numbers(choice)
        if q is None:
            raise InputError(
                f"posture {choice!r}; valid: extended, folded, worst, or {len(worst_q)} angles "
                "(rad)"
            )
        if q.shape != worst_q.shape:
            given = f"{q.size} angles" if q.ndim == 1 else f"the shape {q.shape}"
            raise InputError(f"posture has {given}; the arm has {len(worst_q)} joints")
        if not np.all(np.isfinite(q)):
            i = int(np.argmin(np.isfinite(q)))
            raise InputError(f"posture[{i}] is {q[i]}; valid: a finite angle (rad)")
        return q, "given"
    if choice == "worst":
        return worst_q, choice
    if choice in ("extended", "folded"):
        return posture(robot, "working" if choice == "extended" else "folded"), choice
    raise InputError(f"unknown posture {choice!r}; valid: extended, folded, worst")


def find_worst_posture(
    robot: Robot, model: NDArray[Any], layout: Layout, gravity: float
) -> tuple[Array, float]:
    """Return the posture (rad) with the least lateral force in any direction, and that force.

    The grid spans the joint limits and ignores collisions of the arm with the robot, so the answer
    is conservative. For other layouts than six independent rotors the posture is the one with the
    largest horizontal offset of the centre of mass.
    """
    n = int(model[0]["n_joints"])
    lo, hi = model[0]["q_min"][:n], model[0]["q_max"][:n]
    points = 1 if n == 0 else max(3, min(19, int(800 ** (1.0 / n))))
    if points**n > 3000:  # many joints: a fixed quasi-random sample instead of a grid
        fractions = np.random.default_rng(0).random((2000, n))
        candidates: Any = lo + fractions * (hi - lo)
    else:
        candidates = itertools.product(
            *(np.linspace(a, b, points) for a, b in zip(lo, hi, strict=True))
        )
    directions = np.radians(np.arange(0.0, 360.0, 30.0))
    best_q, best_score, best_force = np.zeros(n), math.inf, math.nan
    for candidate in candidates:
        q = np.asarray(candidate, dtype=np.float64)
        mass, p_BC, _ = compute_body(model, q)
        if layout.exact:
            forces = compute_lateral_forces(layout, mass * gravity, p_BC, directions)
            score = float(np.min(np.nan_to_num(forces, nan=-1.0)))
        else:
            score = -float(math.hypot(p_BC[0], p_BC[1]))
        if score < best_score:
            best_q, best_score = q, score
    if layout.exact:
        best_force = best_score if best_score >= 0.0 else math.nan
    return best_q, best_force
