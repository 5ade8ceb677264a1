"""Filtered columns of the model from a log: contribution of each parameter to force and torque.

With the specific force s = R^T (v' + g e_z) of B's origin, w the body rate, T_i = k_f w_i^2 the
thrust of a rotor by the robot file, and h = m c the first moment of mass about B's origin
(Newton-Euler about B's origin, Siciliano et al. 2009, Robotics, section 7.3):

    force    m s + w' x h + w x (w x h)   = sum_i g_i T_i a_i + drag + R^T f_wind
    torque   I w' + w x I w + h x s       = sum_i g_i T_i (p_i x a_i - kappa s_i a_i) + drag
                                            - J sum_i s_i (w_i' a_i + w x a_i w_i)

g_i is the gain of rotor i over the file, J the inertia of the rotating parts of one rotor. The
rotors' drag acts at the height of their hubs, or above it, because flapping blades also transmit a
torque. Without velocity in the log, drag follows from the specific force minus the thrusts. A still
arm deflects slightly when the platform shakes; the wrench of that motion is small and computed from
the nominal model (`arm`). The same zero-phase low-pass filter runs over every column, so the
filtered columns satisfy the same equation without delay. Derivatives are computed after the filter.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from skywright.analysis.identify.flight_log import FlightLog
from skywright.core.arrays import Array, Ints
from skywright.core.types import MAX_JOINTS
from skywright.errors import InputError
from skywright.models.body_records import Kinematics
from skywright.models.link_motion import build_motion
from skywright.models.rigid_body import build_body_model, fill_kinematics
from skywright.models.rotors import RotorSet, build_rotors
from skywright.models.vectors import build_cross_matrix
from skywright.planning.inverse_dynamics import compute_wrench

CUTOFF = 5.0  # Hz, of the low-pass filter
EDGE = 0.6  # s, omitted at both ends of a stretch, where the filter rings
KEEP = 4.0  # kept samples per cycle of the cut-off; more add no information
STILL = np.radians(2.0)  # rad, maximum motion of a joint within a pose
SHORTEST = 3.0  # s, minimum duration of a stretch
POSE = np.radians(6.0)  # rad, poses closer than this are merged


class Columns(NamedTuple):
    """Filtered columns of k samples, each in one arm pose; r rotors. Frame B."""

    t: Array  # (k,) s
    pose: Ints  # (k,) index into `poses`
    block: Ints  # (k,) index of the second that contains the sample
    poses: Array  # (poses, joints) rad
    s: Array  # (k, 3) m/s^2
    wd: Array  # (k, 3) rad/s^2
    wh: Array  # (k, 3, 3): w' x h + w x (w x h) = wh @ h
    ww: Array  # (k, 3, 3): w x (w x h) = ww @ h
    s_cross: Array  # (k, 3, 3): h x s = s_cross @ h
    inertia: Array  # (k, 3, 6): I w' + w x I w over (xx, yy, zz, xy, xz, yz), w' included
    gyroscopic: Array  # (k, 3, 6): w x I w alone
    thrust: Array  # (k, r) N, by the robot file
    thrust_rate: Array  # (k, r) N/s
    spin: Array  # (k, 3) 1/s^2: torque about B's origin per rotor inertia
    spin_rate: Array  # (k, 3) 1/s^3
    no_air: Array  # (k,) 1 if the log holds no velocity, so that drag is unknown, else 0
    rotor_drag: Array  # (k, 6): force and torque per unit of drag coefficient
    body_drag: Array  # (k, 3): force per m^2 of C_D A along each axis
    arm: Array  # (k, 6): force and torque about B's origin, from motion about the arm's pose
    R_T: Array  # (k, 3, 2): R^T e_x, R^T e_y: regressors of a steady wind force


INERTIA_AXES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def inertia_columns(a: Array) -> Array:
    """Return C (k, 3, 6) with I a = C (xx, yy, zz, xy, xz, yz)."""
    out = np.zeros((len(a), 3, 6))
    for column, (i, j) in enumerate(INERTIA_AXES):
        out[:, i, column] += a[:, j]
        if i != j:
            out[:, j, column] += a[:, i]
    return out


def build_columns(log: FlightLog, time_constant: float | None = None) -> Columns:
    """Build the columns of all stretches of free flight with a still arm.

    `time_constant` (s) filters commanded rotor signals if no measured ones exist. Raises InputError
    if no stretch is long enough.
    """
    rotors = build_rotors(log.robot.rotors)
    period = log.period
    cutoff = min(CUTOFF, 0.35 / period)
    sos = butter(4, cutoff * 2.0 * period, output="sos")
    step = max(round(1.0 / (KEEP * cutoff) / period), 1)
    thrust = compute_thrusts(log, rotors, time_constant)
    parts: list[Columns] = []
    poses: list[Array] = []
    for begin, end in find_stretches(log):
        edge = round(EDGE / period)
        use = slice(edge, end - begin - edge, step)
        part = _build_stretch(log, rotors, thrust, slice(begin, end), period, sos, use)
        q = log.q[begin:end].mean(axis=0)
        near = [i for i, p in enumerate(poses) if np.max(np.abs(p - q), initial=0.0) < POSE]
        if not near:
            poses.append(q)
        index = near[0] if near else len(poses) - 1
        part = part._replace(pose=np.full(len(part.t), index))
        parts.append(Columns(*(x if n == "poses" else x[use] for n, x in part._asdict().items())))
    if not parts:
        raise InputError(
            f"{log.name}: no {SHORTEST:g} s of free flight with a still arm; "
            "identification is not possible"
        )
    joined = [
        np.concatenate([getattr(p, name) for p in parts])
        for name in Columns._fields
        if name != "poses"
    ]
    values = dict(zip([n for n in Columns._fields if n != "poses"], joined, strict=True))
    return Columns(poses=np.array(poses), **values)


def find_stretches(log: FlightLog) -> list[tuple[int, int]]:
    """Return [begin, end) of the stretches of free flight in which no joint moves."""
    out = []
    least = round(max(SHORTEST, 2 * EDGE + 1.0) / log.period)
    begin = 0
    n = len(log.t)
    while begin < n:
        if not log.free[begin]:
            begin += 1
            continue
        end, low, high = begin, log.q[begin].copy(), log.q[begin].copy()
        while end < n and log.free[end]:
            low, high = np.minimum(low, log.q[end]), np.maximum(high, log.q[end])
            if np.any(high - low > STILL):
                break
            end += 1
        if end - begin >= least:
            out.append((begin, end))
        begin = max(end, begin + 1)
    return out


def compute_thrusts(log: FlightLog, rotors: RotorSet, time_constant: float | None) -> Array:
    """Return each rotor's thrust (n, r) N by the robot file, from measured or commanded signals."""
    if log.rotor_speed is not None:
        return rotors.k_f * log.rotor_speed**2
    assert log.rotor_command is not None
    signal = log.rotor_command
    if time_constant:
        decay = np.exp(-np.gradient(log.t) / time_constant)
        out = signal.copy()
        for i in range(1, len(signal)):
            out[i] = signal[i - 1] + (out[i - 1] - signal[i - 1]) * decay[i]
        signal = out
    return signal if log.command_is_thrust else rotors.k_f * signal**2


def compute_arm_wrench(
    log: FlightLog, q: Array, slope: Callable[[Array], Array], s: Array, w: Array, wd: Array,
    use: slice,
) -> Array:  # fmt: skip
    """Return the additional wrench (k, 6) of moving joints q (k, joints) over a rigid mean pose.

    Only the samples in `use` are computed; the others are zero.
    """
    out = np.zeros((len(q), 6))
    n = q.shape[1]
    if n == 0 or np.max(np.ptp(q, axis=0)) < 1e-6:
        return out
    model = build_body_model(log.robot, log.gravity)
    motion, kin = build_motion(), np.zeros(1, Kinematics.dtype)
    qd, still, at = np.zeros((len(q), MAX_JOINTS)), np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
    qdd = np.zeros_like(qd)
    qd[:, :n] = slope(q)
    qdd[:, :n] = slope(qd[:, :n])
    a_W = s - np.array([0.0, 0.0, log.gravity])  # with R = 1: one pair with this specific force
    f, t, none, one = np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3)
    mean = q.mean(axis=0)
    for sign, joints, rate, acceleration in ((1.0, q, qd, qdd), (-1.0, None, None, None)):
        at[:n] = mean
        fill_kinematics(model[0], at, kin[0])
        for i in range(len(q))[use]:
            if joints is not None:
                at[:n] = joints[i]
                fill_kinematics(model[0], at, kin[0])
            first = still if rate is None else rate[i]
            second = still if acceleration is None else acceleration[i]
            compute_wrench(
                model[0], kin[0], one, w[i], wd[i], a_W[i], first, second, none, motion, f, t
            )
            out[i, :3] += sign * f
            out[i, 3:] += sign * t
    return out


def _build_stretch(
    log: FlightLog, rotors: RotorSet, thrust: Array, at: slice, period: float, sos: Array,
    use: slice,
) -> Columns:  # fmt: skip
    def smooth(x: Array) -> Array:
        return np.asarray(sosfiltfilt(sos, x, axis=0))

    def slope(x: Array) -> Array:
        """Five-point derivative with an error of fourth order."""
        out = np.gradient(x, period, axis=0)
        out[2:-2] = (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * period)
        return out

    R, w, T = log.R_WB[at], log.w_WB_B[at], thrust[at]
    to_body = np.swapaxes(R, 1, 2)
    v_WB = np.zeros_like(w) if log.v_WB is None else log.v_WB[at]
    v_B = np.einsum("kij,kj->ki", to_body, v_WB)
    if log.specific_force_B is not None:
        s = smooth(log.specific_force_B[at])
    else:  # R^T v' = (R^T v)' + w x (R^T v)
        s = slope(smooth(v_B)) + smooth(np.cross(w, v_B) + log.gravity * to_body[:, :, 2])
    wd = slope(smooth(w))
    W = build_cross_matrix(w)
    ww = smooth(W @ W)
    gyroscopic = smooth(np.einsum("kij,kjc->kic", W, inertia_columns(w)))
    arm = compute_arm_wrench(log, smooth(log.q[at]), slope, s, smooth(w), wd, use)
    omega = np.sqrt(np.maximum(T, 0.0) / rotors.k_f)
    spin = smooth(-omega * rotors.spin) @ rotors.axis
    reaction = slope(spin) + np.cross(smooth(w), spin)
    force, torque = np.zeros_like(w), np.zeros_like(w)
    for i in range(len(rotors.axis) if log.v_WB is not None else 0):
        air = v_B + np.cross(w, rotors.position[i])
        across = air - (air @ rotors.axis[i])[:, None] * rotors.axis[i]
        hub = -omega[:, i : i + 1] * across
        force += hub
        torque += np.cross(rotors.position[i], hub)
    speed = np.linalg.norm(v_B, axis=1, keepdims=True)
    return Columns(
        t=log.t[at],
        pose=np.zeros(len(w), dtype=np.int64),
        block=np.floor(log.t[at]).astype(np.int64),
        poses=np.zeros((0, 0)),
        s=s,
        wd=wd,
        wh=build_cross_matrix(wd) + ww,
        ww=ww,
        s_cross=-build_cross_matrix(s),
        inertia=inertia_columns(wd) + gyroscopic,
        gyroscopic=gyroscopic,
        thrust=smooth(T),
        thrust_rate=slope(smooth(T)),
        spin=reaction,
        spin_rate=slope(reaction),
        no_air=np.full(len(w), float(log.v_WB is None)),
        rotor_drag=smooth(np.hstack([force, torque])),
        body_drag=smooth(-0.5 * log.air_density * speed * v_B),
        arm=arm,
        R_T=smooth(to_body[:, :, :2]),
    )
