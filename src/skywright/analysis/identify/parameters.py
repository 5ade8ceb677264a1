"""Parameters of the model, with the robot file's values and their physical limits."""

import math
from typing import NamedTuple

import numpy as np

from skywright.analysis.identify.signals import INERTIA_AXES
from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import build_body_model, compute_body

GAIN, COEFFICIENT, INERTIA = 2.0, 5.0, 3.0
"""Factors on the robot file's value, in both directions, that limit an identified value: GAIN for a
rotor's thrust (another propeller needs another file), COEFFICIENT for a propeller's drag torque and
a rotor's inertia, INERTIA for the robot's inertia."""
COM = 0.1  # m, maximum distance from the file's centre of mass and height of rotor drag
DELAY = (-0.05, 0.2)  # s


class Parameter(NamedTuple):
    """One parameter of the model."""

    name: str
    unit: str
    nominal: float  # from the robot file
    scale: float  # numerical scale
    widest: float  # half width of the confidence interval from which it is not identified
    meaning: str
    low: float = -math.inf  # physical limit, from the robot file
    high: float = math.inf


def list_parameters(robot: Robot, poses: Array, gravity: float) -> list[Parameter]:
    """Return the model's parameters with the robot file's values."""
    r = robot.rotors
    model = build_body_model(robot, gravity)
    out = [
        Parameter(
            f"rotor_gain_{i + 1}", "", 1.0, 0.1, 0.05, f"thrust of rotor {i + 1} over the file's",
            1.0 / GAIN, GAIN,
        )
        for i in range(len(r.azimuth_deg))
    ]  # fmt: skip
    k, c = r.torque_per_thrust_m, r.drag_coefficient_n_per_rads_mps
    out.append(
        Parameter(
            "torque_per_thrust_m", "m", k, k, 0.25 * k, "propellers' drag torque over thrust",
            k / COEFFICIENT, COEFFICIENT * k,
        )
    )  # fmt: skip
    out.append(
        Parameter(
            "drag_coefficient_n_per_rads_mps",
            "N/((rad/s)(m/s))",
            c,
            max(c, 1e-5),
            max(0.3 * c, 1e-5),
            "rotors' drag in their discs",
        )
    )
    p = robot.platform
    for axis in "xyz":
        area = getattr(p, f"drag_area_{axis}_m2")
        out.append(
            Parameter(
                f"drag_area_{axis}_m2",
                "m^2",
                area,
                max(area, 0.01),
                max(0.3 * area, 0.01),
                f"C_D A of the body along {axis}",
            )
        )
    for axis in "xy":
        out.append(
            Parameter(f"wind_force_{axis}_n", "N", 0.0, 1.0, 0.2, f"steady force along {axis} of W")
        )
    out.append(
        Parameter(
            "rotor_delay_s", "s", 0.0, 0.01, 0.005,
            "delay of the thrust relative to the rotor signals of the log", *DELAY,
        )
    )  # fmt: skip
    j, height = r.rotor_inertia_kgm2, float(np.mean(r.heights))
    out += [
        Parameter(
            "rotor_inertia_kgm2", "kg m^2", j, max(j, 1e-8), max(0.3 * j, 1e-8),
            "of what turns in one rotor", 0.0, max(COEFFICIENT * j, 1e-7),
        ),
        Parameter(
            "drag_height_m", "m", height, 0.01, 0.01,
            "where the rotors' drag acts above B, the torque of flapping blades included",
            height - COM, height + COM,
        ),
    ]  # fmt: skip
    for n, q in enumerate(poses):
        _, com, I_B = compute_body(model, q)
        size = float(np.trace(I_B)) / 3.0
        where = f"pose_{n + 1}"
        for axis, value in zip("xyz", com, strict=True):
            out.append(
                Parameter(
                    f"{where}.com_{axis}_m",
                    "m",
                    float(value),
                    0.01,
                    0.01,
                    f"centre of mass, arm in pose {n + 1}",
                    float(value) - COM,
                    float(value) + COM,
                )
            )
        for i, j in INERTIA_AXES:
            name = "xyz"[i] + "xyz"[j]
            value = float(I_B[i, j])
            widest = 0.15 * value if i == j else 0.1 * size
            low, high = (value / INERTIA, INERTIA * value) if i == j else (-size, size)
            out.append(
                Parameter(
                    f"{where}.inertia_{name}_kgm2",
                    "kg m^2",
                    value,
                    size,
                    widest,
                    f"inertia about B's origin, arm in pose {n + 1}",
                    low,
                    high,
                )
            )
    return out
