"""A robot in Betaflight's representation: mixer, gains of rate and attitude loops, command line.

The mixer is that of the robot's geometry about its centre of mass (arms folded), so motor i of
Betaflight is rotor i of the robot file. One unit of its torque about an axis adds the mixer's
entries to the motors' commands; a command is a share of a rotor's full speed, so its thrust grows
with the square.

Rate loop: P, lead by D, and I. With the lag T of the rotors and T_o of filters and exchange, D / P
cancels a share L of T, up to LEAD, and the crossover is 0.5 / (T - L T + T_o), at which the phase
margin is above 60 deg. Settings are limited to 250: for a larger inertia, L and crossover are those
of the fastest loop within this limit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture

Array = NDArray[np.float64]

MOTORS_MAX = 8
"""Number of motors of the firmware's mixer."""
TILT_MAX = 1e-3
"""Largest 1 - cos of a rotor's tilt that is neglected."""
IDLE = 0.055
"""Share at which armed motors idle (motor_idle = 550)."""
MIN_CHECK = 1050  # us, end of the throttle's dead zone
ANGLE_LIMIT_DEG, RATE_DEG_S, YAW_RATE_DEG_S = 30, 200, 100
"""At full stick: tilt, and the rates that scale roll and pitch, and yaw."""
P_SCALE, I_SCALE, D_SCALE = 0.032029, 0.244381, 0.000529
"""Torque in thousandths per deg/s, per deg and per deg/s^2, for a gain of 1 in the settings."""
GAIN_MAX = 250
OTHER_LAG = 0.012  # s: packets at 500 Hz, loop, filters of gyroscope and D at their defaults
LEAD = 0.6
RATE_PER_LAG = 0.5
YAW_PER_ROLL = 0.5
ATTITUDE_PER_RATE = 0.4
CROSSOVER_MIN = {"roll": 5.0, "pitch": 5.0, "yaw": 1.5}
"""rad/s; slower loops cannot hold a robot in gusts."""
INTEGRAL = 0.4
"""Integral gain over P, as a share of the crossover."""
AXES = ("roll", "pitch", "yaw")


class BetaflightAirframe(NamedTuple):
    """A robot about its centre of mass; n motors."""

    mass: float  # kg
    thrust_max: Array  # (n,) N
    mix: Array  # (n, 4) shares: throttle, torque about x, y and z of B; the largest entries are 1
    hover: float  # command that carries the weight, of the motor with throttle 1
    units: Array  # (3,) N m of one unit of torque at hover
    gains: Array  # (3, 3) settings P, I, D of roll, pitch, yaw
    angle_gain: float  # 1/s, of the attitude loop

    def compute_throttle(self, thrust: float) -> float:
        """Return the throttle (0 to 1) with the total thrust `thrust` (N)."""
        slope = (1.0 - IDLE) * self.mix[:, 0]
        a = float(self.thrust_max @ slope**2)
        b = 2.0 * IDLE * float(self.thrust_max @ slope)
        c = IDLE**2 * float(np.sum(self.thrust_max)) - thrust
        root = b * b - 4.0 * a * c
        return min(max((-b + math.sqrt(max(root, 0.0))) / (2.0 * a), 0.0), 1.0)

    def compute_thrust(self, throttle: float) -> float:
        """Return the thrust (N) of a throttle (0 to 1), the inverse of `compute_throttle`."""
        command = IDLE + (1.0 - IDLE) * throttle * self.mix[:, 0]
        return float(self.thrust_max @ command**2)


def build_airframe(robot: Robot, world: World) -> BetaflightAirframe:
    """Compute the airframe; raises InputError, with the reason, if Betaflight cannot fly it."""
    nominal = Nominal(robot, world)
    rotors, n = nominal.rotors, len(nominal.rotors.spin)
    if n > MOTORS_MAX:
        raise InputError(f"{robot.name!r} has {n} rotors; Betaflight's mixer has {MOTORS_MAX}")
    tilt = math.degrees(math.acos(min(max(float(rotors.axis[:, 2].min()), -1.0), 1.0)))
    if float(rotors.axis[:, 2].min()) < 1.0 - TILT_MAX:
        raise InputError(
            f"{robot.name!r} has rotors that are tilted by {tilt:.0f} deg; Betaflight's mixer has "
            "throttle, roll, pitch and yaw only: it flies robots whose thrusts are parallel to "
            "z of B (--autopilot px4 takes tilted rotors)"
        )
    mass, p_BC, I_B = compute_body(nominal.model, posture(robot, "folded"))
    inertia = np.diag(I_B - mass * (p_BC @ p_BC * np.eye(3) - np.outer(p_BC, p_BC)))
    torque = rotors.B[3:] - np.cross(p_BC, rotors.axis).T  # about the centre of mass, per newton
    B = np.vstack([rotors.axis[:, 2], torque])
    if np.linalg.matrix_rank(B, tol=1e-6) < 4:
        raise InputError(f"{robot.name!r}: its rotors cannot produce torque about all three axes")
    share = np.linalg.pinv(B)[:, 0]
    if share.min() <= 0.0:
        raise InputError(
            f"{robot.name!r}: level hover would require a rotor with thrust of zero or less"
        )
    mix = np.column_stack([np.sqrt(share), np.linalg.pinv(B)[:, 1:]])
    mix /= np.abs(mix).max(axis=0)
    most, weight = rotors.thrust_max, mass * world.gravity_mps2
    hover = math.sqrt(weight / float(most @ mix[:, 0] ** 2))
    if hover > 0.9:
        raise InputError(
            f"{robot.name!r} hovers at {hover:.2f} of its motors' speed; the largest is 0.9"
        )
    slope = 2.0 * hover * mix[:, 0] * most * (1.0 - IDLE)  # N per unit of a motor's command
    units = np.array([torque[a] @ (slope * mix[:, 1 + a]) for a in range(3)])
    tuned = [
        _tune(robot.name, axis, float(inertia[a] / units[a]), rotors.time_constant)
        for a, axis in enumerate(AXES)
    ]
    gains = np.array([t.gains for t in tuned])
    slower = min(tuned[0].crossover, tuned[1].crossover)
    return BetaflightAirframe(
        mass, most, mix, hover, units, np.maximum(np.round(gains), 0.0),
        ATTITUDE_PER_RATE * slower,
    )  # fmt: skip


class _Tuned(NamedTuple):
    crossover: float  # rad/s
    gains: tuple[float, float, float]


def _tune(name: str, axis: str, inertia: float, lag: float) -> _Tuned:
    """Return the fastest rate loop whose gains fit the settings.

    `inertia` (s^2) is that of the robot over a unit of torque, `lag` (s) that of the rotors.
    """
    best = _Tuned(0.0, (0.0, 0.0, 0.0))
    for lead in np.linspace(0.0, 0.0 if axis == "yaw" else LEAD, 61):
        wanted = RATE_PER_LAG / (lag * (1.0 - lead) + OTHER_LAG)
        if axis == "yaw":
            wanted *= YAW_PER_ROLL
        p = inertia / (1e-3 * np.degrees(1.0))  # per rad/s of crossover
        p, i, d = p / P_SCALE, p * INTEGRAL / I_SCALE, p * lead * lag / D_SCALE
        crossover = min(wanted, GAIN_MAX / max(p, d), math.sqrt(GAIN_MAX / i))
        if crossover > best.crossover:
            best = _Tuned(crossover, (p * crossover, i * crossover**2, d * crossover))
    if best.crossover < CROSSOVER_MIN[axis]:
        raise InputError(
            f"{name!r}: its inertia about {axis} is too large for Betaflight's gains (0 to "
            f"{GAIN_MAX}): the rate loop would cross over at {best.crossover:.1f} rad/s, and "
            f"{CROSSOVER_MIN[axis]:g} rad/s are needed"
        )
    return best


def list_commands(airframe: BetaflightAirframe) -> list[str]:
    """Return the lines for Betaflight's command line, without `save`."""
    lines = ["mixer CUSTOM", "mmix reset"]
    for i, (throttle, x, y, z) in enumerate(airframe.mix):
        # Betaflight negates its yaw torque before it mixes
        lines.append(f"mmix {i} {throttle:.4f} {x:.4f} {y:.4f} {-z + 0.0:.4f}")
    lines += [
        "aux 0 0 0 1700 2100 0 0",  # arm switch: first auxiliary channel
        "aux 1 1 1 1700 2100 0 0",  # ANGLE: second
        # on a busy computer the firmware's radio task may not run for a second: hold the sticks,
        # delay the failsafe
        *(f"rxfail {channel} h" for channel in range(4)),
    ]
    settings: dict[str, object] = {
        "simplified_pids_mode": "OFF", "motor_idle": round(1e4 * IDLE), "min_check": MIN_CHECK,
        "thrust_linear": 0, "throttle_boost": 0, "anti_gravity_gain": 0, "iterm_relax": "OFF",
        "yaw_motors_reversed": "OFF", "rc_smoothing": "OFF", "deadband": 0, "yaw_deadband": 0,
        "angle_limit": ANGLE_LIMIT_DEG, "angle_p_gain": round(10.0 * airframe.angle_gain),
        "angle_feedforward": 0, "angle_earth_ref": 0, "rates_type": "ACTUAL",
        "failsafe_delay": 200,
    }  # fmt: skip
    for a, axis in enumerate(AXES):
        p, i, d = (int(g) for g in airframe.gains[a])
        settings |= {f"p_{axis}": p, f"i_{axis}": i, f"d_{axis}": d, f"d_max_{axis}": 0}
        settings[f"f_{axis}"] = 0
        rate = (YAW_RATE_DEG_S if axis == "yaw" else RATE_DEG_S) // 10
        settings |= {f"{axis}_rc_rate": rate, f"{axis}_srate": rate, f"{axis}_expo": 0}
    return lines + [f"set {name} = {value}" for name, value in settings.items()]


def format_commands(airframe: BetaflightAirframe, comment: str) -> str:
    """Return the text to paste into Betaflight's command line."""
    return "\n".join([f"# {comment}", *list_commands(airframe), "save"]) + "\n"
