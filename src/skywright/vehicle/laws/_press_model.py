"""Model of a robot that presses its probe on a surface, for the gains along the normal.

The tip is a spring between robot and surface: that of the probe in series with the compliance of
the robot. The loop is opened at the rotors and contains their lag and the dead time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import cross
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.link_age import compute_mean_age
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_kinematics,
    posture,
)
from skywright.models.servo_gains import compute_servo_gains
from skywright.vehicle.loops import choose_bandwidths
from skywright.vehicle.tip_force import find_tip_sensor

SENSITIVITY = 2.0  # largest |S|
DEAD_TICKS = 1.5  # control periods from a measurement to the middle of the thrust it causes
FREQUENCIES = np.geomspace(0.01, 500.0, 1500)  # rad/s


class Contact(NamedTuple):
    """Robot against a surface along the probe, in its working posture."""

    mass: float  # kg
    k: float  # N/m, spring of the probe in series with the compliance of the robot
    k_hard: float  # N/m, with the slider at an end of its travel
    lag: float  # s, of the rotors
    delay: float  # s, dead time


def build_contact(robot: Robot, world: World, table: Any, dt: float, h: float) -> Contact:
    """Model a robot that presses along its probe; `dt`, `h` (s): control period, physics step.

    The dead time includes half a period of the sensor of the tip's force, if there is one.
    """
    assert robot.probe is not None
    sensor = find_tip_sensor(robot)
    model, q = build_body_model(robot, world.gravity_mps2), posture(robot, "working")
    mass, p_BC, inertia = compute_body(model, q)
    k = compute_kinematics(model, q)
    along, lever = k["R_BT"][:, 2], np.empty(3)
    cross(k["p_BT"] - p_BC, along, lever)
    inertia = inertia - mass * (p_BC @ p_BC * np.eye(3) - np.outer(p_BC, p_BC))
    w_R = choose_bandwidths(table, _Given(robot)).attitude_bandwidth_rad_s  # type: ignore[arg-type]
    gives = float(lever @ np.linalg.solve(inertia, lever)) / w_R**2  # m/N
    gives += _compute_arm_compliance(robot, model, (along @ k["J_BT"])[: len(q)])
    delay = DEAD_TICKS * dt + h + (0.5 * sensor.period if sensor is not None else 0.0)
    delay += 2.0 * compute_mean_age(world.link, dt)
    return Contact(
        mass, 1.0 / (1.0 / robot.probe.spring_n_per_m + gives), 1.0 / gives,
        robot.rotors.time_constant_s, delay,
    )  # fmt: skip


class _Given(NamedTuple):
    """Context with the fields that `choose_bandwidths` reads."""

    robot: Robot


def _compute_arm_compliance(robot: Robot, model: NDArray[Any], lever: Array) -> float:
    """Return the compliance (m/N) of the tip: springs and servos with their levers (m)."""
    n = len(lever)
    out = sum(
        a**2 / limb.link.flex_stiffness_nm_per_rad
        for a, limb in zip(lever, list_joints(robot), strict=True)
        if limb.link.flex_stiffness_nm_per_rad
    )
    at_motors = model[0]["belt"][:n, :n].T @ lever
    stiffness = [compute_servo_gains(robot, i)[0] for i in range(len(list_servos(robot)))]
    return float(out + sum(a**2 / k for a, k in zip(at_motors, stiffness, strict=True)))


def compute_peak(
    c: Contact, law: Callable[[Any, float], Any], w: Array = FREQUENCIES, air: bool = True
) -> float:
    """Return the largest |S| at the rotors: spring free, spring at an end, in the air.

    `law(s, k)` is the commanded force per displacement of the tip (N/m), with a contact spring k
    (N/m) whose force is measured.
    """
    s = 1j * w
    late, worst = np.exp(-s * c.delay) / (1.0 + c.lag * s), 0.0
    for k in (c.k, c.k_hard, 0.0) if air else (c.k, c.k_hard):
        loop = law(s, k) * late / (c.mass * s**2 + k)
        worst = max(worst, float(np.max(1.0 / np.abs(1.0 + loop))))
    return worst


def compute_gust_share(c: Contact, law: Callable[[Any, float], Any], w: Array) -> Array:
    """Return |F / gust| (n,) at w (n,) rad/s, the spring free or at an end: the larger."""
    s = 1j * w
    late = np.exp(-s * c.delay) / (1.0 + c.lag * s)
    both = [np.abs(k / (c.mass * s**2 + k + law(s, k) * late)) for k in (c.k, c.k_hard)]
    return np.asarray(np.maximum(*both))
