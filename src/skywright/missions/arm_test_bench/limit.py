"""Largest press force of a clamped arm before its tip slides away.

The force loop moves the tip along the probe. Velocity servos yield like springs (a PD around the
integrated command). The shoulder yields to the press, and the motion that the loop adds turns the
probe further from the surface normal. The tip slides with friction in the direction in which the
probe leans. The arm therefore has to reach farther, up to the law's limit REACH. The model is
quasi-static: at each small advance the torques of servos, arm weight, spring and friction balance.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_servos
from skywright.description.robot.spec import Robot
from skywright.description.world.structure import Structure, build_surface, find_place
from skywright.models.force_sensor import compute_spring_force
from skywright.models.rigid_body import build_body_model, compute_kinematics, fill_gravity_torque
from skywright.models.servo_gains import compute_servo_gains
from skywright.vehicle.laws._tip_motion import DAMPING
from skywright.vehicle.laws.backstepping import REACH

STEP = 5e-4  # m, size of an advance
LEAP = 0.02  # rad, largest step of Newton's method
SLACK = 3.0  # largest commanded advance relative to REACH, because the servos yield


class BenchPress(NamedTuple):
    """Largest press force on the path, and the cause of the limit."""

    force: float  # N, along the probe
    lean: float  # rad, angle of the probe from the surface normal at this press
    cause: str


class _State(NamedTuple):
    force: float
    lean: float
    torque: Array  # (2,) N m, of the servos
    p: Array  # (3,) m, tip in B
    axis: Array  # (3,) of the probe, in B
    J: Array  # (2, 2) m/rad, of the tip along and across the probe


def compute_bench_press(
    robot: Robot,
    structure: Structure,
    base: Array,
    R_WB: Array,
    q: Array,
    gravity: float,
    *,
    rigid: bool = False,
) -> BenchPress:
    """Return the largest press from the joints q (2,) rad of a clamped platform.

    The platform is clamped at `base` (3,) m with the attitude R_WB (3, 3). `rigid` neglects that
    the servos yield: torque servos have no such stiffness, and the yielding does not matter if
    friction holds the tip. In these cases only stall and REACH limit the press.
    """
    start = q
    model = build_body_model(robot, gravity)
    servos = [servo for _, servo in list_servos(robot)]
    k = np.array([compute_servo_gains(robot, j)[0] for j in range(len(servos))])
    rigid = rigid or any(servo.mode == "torque" for servo in servos)
    if rigid:
        k = np.full(len(servos), 1e6)
    stall = np.array([servo.stall_torque_nm for servo in servos])
    begin = at = _load(robot, model, structure, base, R_WB, q)
    command, best = q + at.torque / k, BenchPress(0.0, at.lean, "")
    for _ in range(round(SLACK * REACH / STEP)):
        square = at.J @ at.J.T + DAMPING * np.eye(2)
        command = command + at.J.T @ np.linalg.solve(square, [STEP, 0.0])

        def unbalanced(x: Array, goal: Array = command) -> Array:
            return goal - x - _load(robot, model, structure, base, R_WB, x).torque / k

        found = _settle(unbalanced, q)
        if found is None:  # friction turns the probe back and holds the tip
            return compute_bench_press(robot, structure, base, R_WB, start, gravity, rigid=True)
        q = found
        at = _load(robot, model, structure, base, R_WB, q)
        if np.any(np.abs(at.torque) > stall):
            which = int(np.argmax(np.abs(at.torque) / stall)) + 1
            return best._replace(cause=f"joint {which} stalls")
        if at.force > best.force:
            best = BenchPress(at.force, at.lean, "")
        if float(at.axis @ (at.p - begin.p)) > REACH:
            break
    return best._replace(
        cause=f"the force loop reaches the end of its travel of {1000.0 * REACH:.0f} mm"
        if rigid
        else "the tip slides away"
    )


def _settle(unbalanced: Callable[[Array], Array], q: Array) -> Array | None:
    """Return the root of `unbalanced` (2,) near q (2,) rad by Newton's method, or None."""
    step = 1e-6 * np.eye(2)
    for _ in range(30):
        r = unbalanced(q)
        slopes = np.column_stack([(unbalanced(q + d) - r) / 1e-6 for d in step])
        move = np.linalg.solve(slopes, -r)
        q = q + np.clip(move, -LEAP, LEAP)
        if np.max(np.abs(move)) < 1e-9:
            return q
    return None


def _load(
    robot: Robot, model: NDArray[Any], structure: Structure, base: Array, R_WB: Array, q: Array
) -> _State:
    """Return force and torques if the tip slides in the direction in which the probe leans."""
    assert robot.probe is not None
    k, torque = compute_kinematics(model, q), np.zeros(MAX_JOINTS)
    fill_gravity_torque(model[0], k, R_WB.T @ [0.0, 0.0, -model[0]["gravity"]], torque)
    surface, axis, J = build_surface(structure), k["R_BT"][:, 2], k["J_BT"][:, :2]
    n = R_WB.T @ surface.R_WS[:, 2]
    ahead = max(float(-axis @ n), 1e-3)  # cosine of the lean
    gap = float(find_place(surface, base + R_WB @ k["p_BT"])[2]) - robot.probe.tip_radius_m
    force = compute_spring_force(robot.probe, robot.force_sensor, max(-gap, 0.0) / ahead)
    aside = axis + ahead * n
    push = n - structure.friction * aside / max(float(np.linalg.norm(aside)), 1e-9)
    push = (force if gap < 0.0 else 0.0) * push / max(float(-push @ axis), 1e-3)
    rows = np.array([axis @ J, k["R_BT"][:, 0] @ J])
    return _State(
        force if gap < 0.0 else 0.0, float(np.arccos(min(ahead, 1.0))),
        torque[:2] - J.T @ push, k["p_BT"].copy(), axis.copy(), rows,
    )  # fmt: skip
