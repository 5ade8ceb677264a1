"""A flight log made in closed form from known parameters, as signals and as PX4 writes them."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import butter, sosfiltfilt

from skywright.analysis.identify.fit import INERTIA_AXES, Fit, fit_parameters
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.signals import build_columns
from skywright.description.robot.loader import load_robot
from skywright.models.rigid_body import posture
from skywright.models.rotors import build_rotors

ROBOT = load_robot("f550-bridge")[0]
GRAVITY = 9.81
MASS = 2.6
GAIN = np.array([0.93, 0.98, 1.02, 0.95, 1.05, 0.99])
COM = np.array([0.006, -0.004, 0.010])
KAPPA, DRAG, SPIN_INERTIA = 0.0145, 1.6e-4, 2e-5
INERTIA = np.array([0.0560, 0.0620, 0.0740, 0.0006, -0.0035, -0.0004])


def _matrix(y: np.ndarray) -> np.ndarray:
    out = np.empty((3, 3))
    for value, (i, j) in zip(y, INERTIA_AXES, strict=True):
        out[i, j] = out[j, i] = value
    return out


def make_log(
    duration: float = 60.0, rate: float = 200.0, noise: float = 0.0, tilt: float = 0.06,
    push: float = 0.3, seed: int = 0,
) -> FlightLog:  # fmt: skip
    """Signals of a motion and the rotor speeds that the true robot needs for it, exactly.

    Attitude and velocity are sums of sines with derivatives in closed form, so that nothing of
    the code under test goes into the truth. `tilt` (rad) and `push` (m/s) are amplitudes.
    """
    t = np.arange(0.0, duration, 1.0 / rate)
    rng = np.random.default_rng(seed)

    def sines(size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        out = np.zeros((3, len(t), 3))
        for axis in range(3):
            for _ in range(5):
                w, phase = 2 * math.pi * rng.uniform(0.15, 1.2), rng.uniform(0, 2 * math.pi)
                a = size / 5
                out[0, :, axis] += a * np.sin(w * t + phase)
                out[1, :, axis] += a * w * np.cos(w * t + phase)
                out[2, :, axis] -= a * w * w * np.sin(w * t + phase)
        return out[0], out[1], out[2]

    angles, rates, seconds = sines(tilt)
    v, a, _ = sines(push)
    (r, p, y), (rd, pd, yd), (rdd, pdd, ydd) = angles.T, rates.T, seconds.T
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    R = np.empty((len(t), 3, 3))
    R[:, 0] = np.column_stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr])
    R[:, 1] = np.column_stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr])
    R[:, 2] = np.column_stack([-sp, cp * sr, cp * cr])
    # Euler rates to body rates, and their derivative
    w = np.column_stack([rd - sp * yd, cr * pd + sr * cp * yd, -sr * pd + cr * cp * yd])
    wd = np.column_stack(
        [
            rdd - sp * ydd - cp * pd * yd,
            cr * pdd + sr * cp * ydd - sr * rd * pd + (cr * cp * rd - sr * sp * pd) * yd,
            -sr * pdd + cr * cp * ydd - cr * rd * pd + (-sr * cp * rd - cr * sp * pd) * yd,
        ]
    )
    s = np.einsum("kji,kj->ki", R, a + [0.0, 0.0, GRAVITY])
    v_B = np.einsum("kji,kj->ki", R, v)
    h, I_B = MASS * COM, _matrix(INERTIA)
    force = MASS * s + np.cross(wd, h) + np.cross(w, np.cross(w, h))
    torque = wd @ I_B.T + np.cross(w, w @ I_B.T) + np.cross(h, s)
    rotors = build_rotors(ROBOT.rotors)
    lever = np.cross(rotors.position, rotors.axis) - KAPPA * rotors.spin[:, None] * rotors.axis
    B = np.vstack([rotors.axis.T, lever.T]) * GAIN
    area = np.array(
        [
            ROBOT.platform.drag_area_x_m2,
            ROBOT.platform.drag_area_y_m2,
            ROBOT.platform.drag_area_z_m2,
        ]
    )
    body = -0.5 * 1.2 * area * np.linalg.norm(v_B, axis=1, keepdims=True) * v_B
    T = np.full((len(t), 6), MASS * GRAVITY / 6)
    slow = butter(4, 6.0, fs=rate, output="sos")
    for _ in range(30):  # drag depends on the speeds that it asks for
        omega = np.sqrt(np.maximum(T, 0.01) / rotors.k_f)
        f, m = force - body, torque.copy()
        # momentum of the rotors in B; without the filter the sum would not converge
        spin = sosfiltfilt(slow, SPIN_INERTIA * (omega * rotors.spin) @ rotors.axis, axis=0)
        m += np.gradient(spin, t, axis=0, edge_order=2) + np.cross(w, spin)
        for i in range(6):
            air = v_B + np.cross(w, rotors.position[i])
            hub = (
                -DRAG
                * omega[:, i : i + 1]
                * (air - (air @ rotors.axis[i])[:, None] * rotors.axis[i])
            )
            f, m = f - hub, m - np.cross(rotors.position[i], hub)
        T = np.linalg.solve(B, np.hstack([f, m]).T).T
    assert T.min() > 0.2
    q = posture(ROBOT, "folded")
    n = (len(t), 3)
    return FlightLog(
        name="made", robot=ROBOT, t=t, free=np.ones(len(t), dtype=bool),
        v_WB=v + 0.2 * noise * rng.standard_normal(n), R_WB=R,
        w_WB_B=w + noise * rng.standard_normal(n), specific_force_B=None,
        rotor_speed=np.sqrt(T / rotors.k_f), rotor_command=None, command_is_thrust=False,
        joints=("shoulder", "elbow"), q=np.tile(q, (len(t), 1)), servo_unit="rad/s",
        servo_command=np.zeros((len(t), 2)), servo_response=np.zeros((len(t), 2)),
        gravity=GRAVITY, air_density=1.2,
    )  # fmt: skip


def truth() -> dict[str, float]:
    out = {f"rotor_gain_{i + 1}": g for i, g in enumerate(GAIN)}
    out |= {
        "torque_per_thrust_m": KAPPA,
        "drag_coefficient_n_per_rads_mps": DRAG,
        "rotor_delay_s": 0.0,
        "rotor_inertia_kgm2": SPIN_INERTIA,
        "drag_height_m": 0.0,
    }
    out |= {f"pose_1.com_{a}_m": c for a, c in zip("xyz", COM, strict=True)}
    for value, (i, j) in zip(INERTIA, INERTIA_AXES, strict=True):
        out[f"pose_1.inertia_{'xyz'[i]}{'xyz'[j]}_kgm2"] = value
    return out


def fit(log: FlightLog, mass: float = MASS) -> Fit:
    return fit_parameters(build_columns(log), log.robot, mass, log.gravity)


def ulog_topics(log: FlightLog) -> dict[str, dict[str, np.ndarray]]:
    """The log as PX4 writes it: NED, FRD, rpm, microseconds from some start."""
    t = log.t + 12.5
    to_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    flip = np.array([1.0, -1.0, -1.0])
    R = to_ned @ log.R_WB * flip
    w = np.sqrt(np.maximum(1 + R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2], 1e-12)) / 2
    q = np.column_stack(
        [w, (R[:, 2, 1] - R[:, 1, 2]) / (4 * w), (R[:, 0, 2] - R[:, 2, 0]) / (4 * w),
         (R[:, 1, 0] - R[:, 0, 1]) / (4 * w)]
    )  # fmt: skip
    v = log.v_WB @ to_ned.T
    assert log.rotor_speed is not None
    rpm = log.rotor_speed * 60 / (2 * math.pi)
    return {
        "vehicle_angular_velocity": {
            "timestamp": t, **{f"xyz[{i}]": log.w_WB_B[:, i] * flip[i] for i in range(3)}
        },
        "vehicle_attitude": {"timestamp": t, **{f"q[{i}]": q[:, i] for i in range(4)}},
        "vehicle_local_position": {
            "timestamp": t, **{n: v[:, i] for i, n in enumerate(("vx", "vy", "vz"))}
        },
        "esc_status": {
            "timestamp": t, **{f"esc[{i}].esc_rpm": rpm[:, i] for i in range(6)}
        },
    }  # fmt: skip


def rotor_parameters(order: list[int]) -> dict[str, float]:
    """CA_ROTOR parameters of the robot with its rotors logged in another order."""
    hubs = build_rotors(ROBOT.rotors).position
    out: dict[str, float] = {"CA_ROTOR_COUNT": 6}
    for i, k in enumerate(order):
        out |= {f"CA_ROTOR{i}_PX": float(hubs[k, 0]), f"CA_ROTOR{i}_PY": float(-hubs[k, 1])}
    return out
