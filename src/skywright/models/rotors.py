"""Rotors: geometry, wrench map, speed dynamics, drag and electrical power.

Frames: B is the body frame (FLU). Rotor i sits at azimuth psi_i and points along
Rz(psi_i) Rx(alpha_i) Ry(beta_i) z (Sanchez-Cuevas et al. 2020, section III; the same convention
describes the OTHex of Tognon et al. 2018). Thrust is k_f w^2 along the axis; the propeller's drag
torque acts on the body against its spin.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.description.robot.spec import Rotors


class RotorSet(NamedTuple):
    """Rotors as arrays (n rotors); readable from compiled code. SI units, frame B."""

    position: Array  # (n, 3) m, hubs in B
    axis: Array  # (n, 3) unit thrust directions in B
    spin: Array  # (n,) +1 ccw seen from above, -1 cw
    thrust_min: Array  # (n,) N
    thrust_max: Array  # (n,) N
    k_f: float  # N/(rad/s)^2
    torque_per_thrust: float  # m
    time_constant: float  # s, of the rotor speed
    inertia: float  # kg m^2, rotating parts of one rotor, about its axis
    drag_coefficient: float  # N/(rad/s)/(m/s), in the disc plane
    propeller_radius: float  # m
    figure_of_merit: float
    motor_efficiency: float
    B: Array  # (6, n) wrench [force N; torque about B's origin N m] per newton of thrust


def build_rotors(rotors: Rotors) -> RotorSet:
    """Build the arrays of a robot's rotors.

    `thrust_max` is the physical limit: `rotors.thrust_fraction` (what capability and missions may
    use) is not applied here.
    """
    psi = np.radians(np.asarray(rotors.azimuth_deg, dtype=np.float64))
    alpha = np.radians(np.asarray(rotors.alpha_deg, dtype=np.float64))
    beta = np.radians(np.asarray(rotors.beta_deg, dtype=np.float64))
    n = len(psi)
    radial = np.stack([np.cos(psi), np.sin(psi), np.zeros(n)], axis=1)
    tangential = np.stack([-np.sin(psi), np.cos(psi), np.zeros(n)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    # Rx(alpha) Ry(beta) z = (sin b, -sin a cos b, cos a cos b) in (radial, tangential, up)
    axis = (
        np.sin(beta)[:, None] * radial
        - (np.sin(alpha) * np.cos(beta))[:, None] * tangential
        + (np.cos(alpha) * np.cos(beta))[:, None] * up
    )
    position = np.array(rotors.radii)[:, None] * radial + np.array(rotors.heights)[:, None] * up
    spin = np.array([1.0 if s == "ccw" else -1.0 for s in rotors.spin])
    torque = np.cross(position, axis) - rotors.torque_per_thrust_m * spin[:, None] * axis
    return RotorSet(
        position=np.ascontiguousarray(position),
        axis=np.ascontiguousarray(axis),
        spin=spin,
        thrust_min=np.full(n, float(rotors.thrust_min_n)),
        thrust_max=np.full(n, float(rotors.thrust_max_n)),
        k_f=float(rotors.thrust_coefficient_n_per_rad2s2),
        torque_per_thrust=float(rotors.torque_per_thrust_m),
        time_constant=float(rotors.time_constant_s),
        inertia=float(rotors.rotor_inertia_kgm2),
        drag_coefficient=float(rotors.drag_coefficient_n_per_rads_mps),
        propeller_radius=float(rotors.propeller_radius_m),
        figure_of_merit=float(rotors.figure_of_merit),
        motor_efficiency=float(rotors.motor_efficiency),
        B=np.ascontiguousarray(np.vstack([axis.T, torque.T])),
    )


def compute_electrical_power(rotors: RotorSet, thrust: Array, air_density: float = 1.2) -> float:
    """Return the electrical power (W) of all rotors at the thrusts (n,) N.

    Momentum theory: ideal power T^(3/2) / sqrt(2 rho A), over figure of merit and motor
    efficiency (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., eq. 2.15 and 2.30).
    """
    per = compute_watt_per_n15(rotors, air_density)
    return compute_power(np.ascontiguousarray(thrust, dtype=np.float64), len(thrust), per)


def compute_watt_per_n15(rotors: RotorSet, air_density: float) -> float:
    """Return electrical power over thrust^(3/2) (W/N^1.5) of a rotor."""
    area = math.pi * rotors.propeller_radius**2
    ideal = math.sqrt(2.0 * air_density * area)
    return 1.0 / (ideal * rotors.figure_of_merit * rotors.motor_efficiency)


@njit(cache=True, error_model="numpy")
def compute_power(thrust: Array, n: int, watt_per_n15: float) -> float:
    """Return sum of T_i^(3/2) times `watt_per_n15` (W) over the first n thrusts (N)."""
    total = 0.0
    for i in range(n):
        t = thrust[i]
        if t > 0.0:
            total += t * math.sqrt(t)
    return total * watt_per_n15


@helper
def step_rotor_speed(speed: Array, command: Array, n: int, dt: float, time_constant: float) -> None:
    """Advance rotor speeds (rad/s) in place by dt: the exact first-order lag for a held command."""
    decay = math.exp(-dt / time_constant)
    for i in range(n):
        speed[i] = command[i] + (speed[i] - command[i]) * decay


@helper
def compute_rotor_wrench(B: Array, thrust: Array, f_out: Array, t_out: Array) -> None:
    """Write force (3,) N and torque about B's origin (3,) N m of the thrusts, in B."""
    n = B.shape[1]
    for r in range(3):
        f = 0.0
        t = 0.0
        for i in range(n):
            f += B[r, i] * thrust[i]
            t += B[r + 3, i] * thrust[i]
        f_out[r] = f
        t_out[r] = t


@helper
def compute_rotor_drag(
    position: Array,
    axis: Array,
    speed: Array,
    drag_coefficient: float,
    v_air_B: Array,
    w_WB_B: Array,
    f_out: Array,
    t_out: Array,
) -> None:
    """Write the rotors' in-plane drag: force (3,) N and torque about B's origin (3,) N m, in B.

    The drag at each hub is -c w_i v_perp, with v_perp the part of its velocity through the air that
    is normal to the rotor's axis (Faessler et al. 2018, RA-L 3(2), section III). `v_air_B` is the
    velocity of B's origin relative to the air (m/s, in B), `w_WB_B` the body rate (rad/s).
    """
    for r in range(3):
        f_out[r] = 0.0
        t_out[r] = 0.0
    for i in range(position.shape[0]):
        px, py, pz = position[i, 0], position[i, 1], position[i, 2]
        ax, ay, az = axis[i, 0], axis[i, 1], axis[i, 2]
        vx = v_air_B[0] + w_WB_B[1] * pz - w_WB_B[2] * py
        vy = v_air_B[1] + w_WB_B[2] * px - w_WB_B[0] * pz
        vz = v_air_B[2] + w_WB_B[0] * py - w_WB_B[1] * px
        along = vx * ax + vy * ay + vz * az
        k = -drag_coefficient * abs(speed[i])
        fx = k * (vx - along * ax)
        fy = k * (vy - along * ay)
        fz = k * (vz - along * az)
        f_out[0] += fx
        f_out[1] += fy
        f_out[2] += fz
        t_out[0] += py * fz - pz * fy
        t_out[1] += pz * fx - px * fz
        t_out[2] += px * fy - py * fx
