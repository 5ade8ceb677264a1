"""A robot as PX4's parameters: geometry with tilt axes, motor curve, hover thrust, gains.

Names and units are those of release 1.14. PX4's body frame is FRD with its origin in the centre of
mass: y and z of B (FLU) change their signs. Rotor i of PX4 is rotor i of the robot file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.links.px4.gains import (
    Gains,
    compute_force_units,
    compute_gains,
    compute_torque_units,
)
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture

Array = NDArray[np.float64]

FLU_TO_FRD = np.array([1.0, -1.0, -1.0])
FUNCTION_MOTOR = 101
"""PWM_MAIN_FUNC1 of "Motor 1"."""
ROTORS_MAX = 12
"""Rotors of CA_ROTOR_COUNT."""
TYPES = {3: 15, 4: 2, 6: 13, 8: 14, 10: 35, 12: 29}
"""Rotors -> MAV_TYPE; other numbers use 2 (quadrotor)."""
RATE_P_MAX = 0.5
"""Largest MC_ROLLRATE_P that ground stations accept; MC_ROLLRATE_K scales a larger gain."""
HOVER_RANGE = (0.1, 0.8)
"""Range of MPC_THR_HOVER."""
NOISE_LEAST = (0.01, 0.05)
"""m, rad: lower limits of EKF2_EVP_NOISE and EKF2_EVA_NOISE. The filter's default is 0.1 m, with
which it tracks a pose of millimetre accuracy late."""
POSITION_ONLY = 11
"""EKF2_EV_CTRL: horizontal and vertical position and yaw of motion capture, no velocity."""


class Parameter(NamedTuple):
    """A parameter of PX4; an int is an INT32, a float a FLOAT."""

    name: str
    value: int | float
    meaning: str


class Airframe(NamedTuple):
    """A robot in PX4's representation: one rigid body about its centre of mass."""

    mass: float  # kg
    p_BC: Array  # (3,) m, centre of mass, arms folded
    inertia: Array  # (3,) kg m^2, about the axes of B through it
    position: Array  # (n, 3) m, hubs from the centre of mass, FLU
    hover: float  # share of the total thrust that carries the weight
    gains: Gains
    force_units: Array  # N, of PX4's thrust of 1 along the axes of B
    torque_units: Array  # (3,) N m, of PX4's torque of 1 about them


def build_airframe(robot: Robot, world: World) -> Airframe:
    """Compute the airframe; raises InputError if PX4 cannot represent it."""
    nominal = Nominal(robot, world)
    rotors, n = nominal.rotors, len(nominal.rotors.spin)
    if n > ROTORS_MAX:
        raise InputError(f"{robot.name!r} has {n} rotors; PX4 controls at most {ROTORS_MAX}")
    mass, p_BC, I_B = compute_body(nominal.model, posture(robot, "folded"))
    I_C = I_B - mass * (p_BC @ p_BC * np.eye(3) - np.outer(p_BC, p_BC))
    B = rotors.B.copy()
    B[3:] -= np.cross(p_BC, rotors.axis).T  # torque about the centre of mass
    lift = float(rotors.axis[:, 2] @ rotors.thrust_max)
    if lift <= 0.05 * float(np.sum(rotors.thrust_max)):
        raise InputError(
            f"{robot.name!r}: its rotors at equal thrust do not lift it; PX4 hovers with a share "
            "of all thrust (MPC_THR_HOVER)"
        )
    hover = mass * world.gravity_mps2 / lift
    if not HOVER_RANGE[0] <= hover <= HOVER_RANGE[1]:
        raise InputError(
            f"{robot.name!r} hovers at {hover:.2f} of its thrust; PX4's MPC_THR_HOVER is "
            f"{HOVER_RANGE[0]:g} to {HOVER_RANGE[1]:g}"
        )
    units = compute_torque_units(B, rotors.thrust_max)
    gains = compute_gains(np.diag(I_C).copy(), units, rotors.time_constant)
    return Airframe(
        mass, p_BC, np.diag(I_C).copy(), rotors.position - p_BC, hover, gains,
        compute_force_units(B, rotors.thrust_max), units,
    )  # fmt: skip


def list_parameters(robot: Robot, world: World) -> list[Parameter]:
    """Return the parameters with which PX4 flies a robot in a world; raises as build_airframe."""
    airframe = build_airframe(robot, world)
    return [
        *_list_geometry(robot, world, airframe),
        *_list_gains(airframe),
        *_list_estimator(robot, world, airframe),
        Parameter("COM_RC_IN_MODE", 4, "no radio: offboard and commands only"),
        Parameter("COM_RCL_EXCEPT", 4, "offboard goes on without radio"),
        Parameter("NAV_RCL_ACT", 0, "no action without radio"),
        Parameter("NAV_DLL_ACT", 0, "no action without ground station"),
    ]


def _list_geometry(robot: Robot, world: World, airframe: Airframe) -> Iterator[Parameter]:
    rotors = Nominal(robot, world).rotors
    n = len(rotors.spin)
    yield Parameter("MAV_TYPE", TYPES.get(n, 2), f"{n} rotors")
    yield Parameter("CA_AIRFRAME", 0, "multirotor")
    yield Parameter("CA_ROTOR_COUNT", n, "")
    for i in range(n):
        p, axis = airframe.position[i] * FLU_TO_FRD, rotors.axis[i] * FLU_TO_FRD
        for name, value in zip("XYZ", p, strict=True):
            meaning = "m from the centre of mass, forward, right, down"
            yield Parameter(f"CA_ROTOR{i}_P{name}", float(value), meaning)
        for name, value in zip("XYZ", axis, strict=True):
            yield Parameter(f"CA_ROTOR{i}_A{name}", float(value), "thrust axis")
        moment = float(rotors.spin[i] * rotors.torque_per_thrust)
        yield Parameter(f"CA_ROTOR{i}_KM", moment, "m, positive counter-clockwise from above")
        yield Parameter(f"PWM_MAIN_FUNC{i + 1}", FUNCTION_MOTOR + i, f"motor {i + 1}")
    yield Parameter("THR_MDL_FAC", 1.0, "thrust goes with the square of the command")
    yield Parameter("MPC_THR_HOVER", airframe.hover, "weight over the thrust of all rotors")


def _list_gains(airframe: Airframe) -> Iterator[Parameter]:
    gains = airframe.gains
    for axis, name in enumerate(("ROLL", "PITCH", "YAW")):
        p = float(gains.rate_p[axis])
        k = max(p / RATE_P_MAX, 1.0)
        yield Parameter(f"MC_{name}RATE_K", k, "factor of all three")
        yield Parameter(f"MC_{name}RATE_P", p / k, "torque per rad/s")
        yield Parameter(f"MC_{name}RATE_I", float(gains.rate_i[axis]) / k, "torque per rad")
        yield Parameter(f"MC_{name}RATE_D", 0.0, "the lag is in P")
        yield Parameter(f"MC_{name}_P", float(gains.attitude_p[axis]), "1/s, attitude")


def _list_estimator(robot: Robot, world: World, airframe: Airframe) -> Iterator[Parameter]:
    s, folded = robot.sensors, airframe.p_BC
    places = {"IMU": np.array([s.imu_x_m, s.imu_y_m, s.imu_z_m]) - folded}
    if world.localisation == "gnss":
        places["GPS"] = np.array([s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]) - folded
        yield Parameter("SYS_HAS_GPS", 1, "satellites")
        yield Parameter("EKF2_GPS_CTRL", 7, "position, height and velocity of satellites")
        yield Parameter("EKF2_EV_CTRL", 0, "no motion capture")
        yield Parameter("EKF2_HGT_REF", 1, "height by satellites")
        yield Parameter("EKF2_GPS_DELAY", 1e3 * world.gnss.latency_s, "ms")
    else:
        places["EV"] = -folded
        yield Parameter("SYS_HAS_GPS", 0, "motion capture in place of satellites")
        yield Parameter("EKF2_GPS_CTRL", 0, "no satellites")
        yield Parameter("EKF2_EV_CTRL", POSITION_ONLY, "position and yaw of motion capture")
        yield Parameter("EKF2_HGT_REF", 3, "height by motion capture")
        yield Parameter("EKF2_EVP_NOISE", NOISE_LEAST[0], "m, least value; a pose states its own")
        yield Parameter("EKF2_EVA_NOISE", NOISE_LEAST[1], "rad, likewise")
        yield Parameter("EKF2_MAG_TYPE", 5, "heading by motion capture, no magnetometer")
        own = world.localisation == "total-station"  # the onboard computer's, without delay
        yield Parameter("EKF2_EV_DELAY", 0.0 if own else 1e3 * world.mocap.latency_s, "ms")
    for sensor, p in places.items():
        for name, value in zip("XYZ", p * FLU_TO_FRD, strict=True):
            yield Parameter(f"EKF2_{sensor}_POS_{name}", float(value), "m from the centre of mass")


def format_value(value: int | float) -> str:
    """Return a parameter's value as text: floats with 7 digits, the precision of a single."""
    if isinstance(value, int):
        return str(value)
    assert math.isfinite(value)
    return f"{value + 0.0:.7g}"


def format_file(parameters: list[Parameter], comment: str) -> str:
    """Return the text of a .params file, which ground stations load."""
    lines = [f"# {comment}", "#", "# Vehicle-Id Component-Id Name Value Type"]
    for p in parameters:
        kind = 6 if isinstance(p.value, int) else 9
        lines.append(f"1\t1\t{p.name}\t{format_value(p.value)}\t{kind}")
    return "\n".join(lines) + "\n"


def format_environment(parameters: list[Parameter], comment: str) -> str:
    """Return lines for a shell: PX4's SITL reads PX4_PARAM_NAME from release 1.15 on."""
    lines = [f"# {comment}"]
    lines += [f"export PX4_PARAM_{p.name}={format_value(p.value)}" for p in parameters]
    return "\n".join(lines) + "\n"


def format_script(parameters: list[Parameter], comment: str) -> str:
    """Return a start-up script, px4-rc.params, which PX4's SITL runs in every release."""
    lines = [f"# {comment}"]
    for p in parameters:
        says = f"  # {p.meaning}" if p.meaning else ""
        lines.append(f"param set {p.name} {format_value(p.value)}{says}")
    return "\n".join(lines) + "\n"


FORMATS = {"file": format_file, "env": format_environment, "script": format_script}
"""Formats of `skywright sitl --params`, by name."""
