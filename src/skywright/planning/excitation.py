"""Motions that excite a robot's dynamics for identification: sums of sines on every axis.

Each channel (angles, then accelerations of the platform) has its own harmonics, so that the
channels are orthogonal over the flight and their effects are separable. Phases follow Schroeder
(1970, IEEE Trans. Inf. Theory 16(1)), which keeps the peak of a sum low. (Morelli and Klein,
Aircraft System Identification, 2nd ed. 2016, section 9.5.)
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import log_so3, rot_z
from skywright.core.types import REFERENCE
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip
from skywright.planning.inverse_dynamics import Loads

Table = NDArray[np.void]

ROW = 0.02  # s, between rows
RAMP = 2.0  # s, to full amplitude and back to rest
SMALLEST = 0.2
"""Least fraction of the requested amplitudes at which a motion is still planned."""


class Excitation(NamedTuple):
    """Requested peaks, and the frequency band."""

    duration: float  # s
    tilt: float  # rad, roll and pitch of a platform that can tilt in place
    yaw: float  # rad
    acceleration: float  # m/s^2
    low: float  # Hz
    high: float  # Hz


class Motion(NamedTuple):
    """A motion, or the reason why it cannot be flown."""

    rows: Table | None
    scale: float  # fraction of the requested amplitudes
    rotor_margin: float  # least unused fraction of the thrust range
    blocked_by: str


def build_sines(t: Array, lines: Array, order: int) -> Array:
    """Return a sum of sines (n,) with a peak of about one; `order` 1 or 2 is its integral.

    `lines` (k,) Hz. Phases are Schroeder's; each integration divides a line by its angular
    frequency.
    """
    k = np.arange(1, len(lines) + 1)
    phase = -math.pi * k * (k - 1) / len(lines)
    w = 2.0 * math.pi * lines
    whole = np.cos(np.outer(t, w) + phase).sum(axis=1)
    peak = float(np.abs(whole).max())
    turned = phase - 0.5 * math.pi * order
    return np.asarray((np.cos(np.outer(t, w) + turned) / w**order).sum(axis=1) / peak)


def share_lines(e: Excitation, channels: int) -> list[Array]:
    """Assign the harmonics of the flight's duration within the band to the channels in turn."""
    base = 1.0 / (e.duration - 2.0 * RAMP)
    first, last = math.ceil(e.low / base), math.floor(e.high / base)
    lines = base * np.arange(first, last + 1)
    return [np.asarray(lines[i::channels], dtype=np.float64) for i in range(channels)]


def count_lines(e: Excitation, channels: int) -> int:
    """Return the least number of lines of a channel."""
    if e.duration <= 2.0 * RAMP:
        return 0
    return min(len(lines) for lines in share_lines(e, channels))


def plan_excitation(
    robot: Robot, loads: Loads, e: Excitation, start: Array, q: Array, gravity: float
) -> Motion:
    """Plan the motion about the hover pose `start` (x, y, z, yaw) with the arm at `q`.

    The amplitudes are reduced together until every rotor stays within its limits. Robots with
    parallel rotors excite roll and pitch by lateral accelerations.
    """
    reason = ""
    for scale in np.arange(1.0, SMALLEST - 0.01, -0.1):
        rows = _build_rows(robot, e, float(scale), start, q, bool(loads.full))
        margin, reason = _check_rotors(robot, loads, rows, q, gravity)
        if not reason:
            return Motion(rows, float(scale), margin, "")
    return Motion(None, 0.0, math.nan, f"at {SMALLEST:.0%} of the amplitudes: {reason}")


def _build_rows(
    robot: Robot, e: Excitation, scale: float, start: Array, q: Array, tilts: bool
) -> Table:
    fine = 5  # finer steps between rows, for derivatives of the attitude
    n = round(e.duration / ROW)
    t = np.asarray(ROW / fine * np.arange(n * fine + 1), dtype=np.float64)
    window, slope, curve = _window(t, e.duration)
    lines = share_lines(e, 6)
    p = np.zeros((len(t), 3))
    v, a = np.zeros_like(p), np.zeros_like(p)
    for i in range(3):
        # the position is a windowed double integral, so that it starts and ends at rest
        size = scale * e.acceleration
        s2, s1, s0 = (size * build_sines(t, lines[3 + i], k) for k in (2, 1, 0))
        p[:, i] = window * s2
        v[:, i] = slope * s2 + window * s1
        a[:, i] = curve * s2 + 2.0 * slope * s1 + window * s0
    peaks = np.array([e.tilt, e.tilt, e.yaw]) * scale * (np.array([tilts, tilts, True]))
    angles = np.column_stack([window * peaks[i] * build_sines(t, lines[i], 0) for i in range(3)])
    R = _from_angles(angles + np.array([0.0, 0.0, start[3]]))
    w, log = np.zeros_like(p), np.zeros(3)
    step = t[1]
    for k in range(1, len(t) - 1):
        log_so3(np.ascontiguousarray(R[k - 1].T @ R[k + 1]), log)
        w[k] = log / (2.0 * step)
    wd = np.gradient(w, step, axis=0)
    rows = np.zeros(n + 1, REFERENCE)
    every = slice(None, None, fine)
    turn = rot_z(start[3])
    rows["t"] = t[every]
    rows["p_WB"] = start[:3] + (p @ turn.T)[every]
    rows["v_WB"], rows["a_WB"] = (v @ turn.T)[every], (a @ turn.T)[every]
    rows["R_WB"], rows["w_WB_B"], rows["wd_WB_B"] = R[every], w[every], wd[every]
    rows["q"][:, : len(q)] = q
    rows["R_WS"] = np.eye(3)
    rows["active"] = 1.0
    tip, R_BT = compute_tip(build_body_model(robot), q)
    rows["p_WT"] = rows["p_WB"] + rows["R_WB"] @ tip
    rows["R_WT"] = rows["R_WB"] @ R_BT
    rows["v_WT"] = np.gradient(rows["p_WT"], ROW, axis=0)
    return rows


def _from_angles(angles: Array) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll) (n, 3, 3) of rows (roll, pitch, yaw)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles).T, np.sin(angles).T
    R = np.empty((len(angles), 3, 3))
    R[:, 0] = np.column_stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr])
    R[:, 1] = np.column_stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr])
    R[:, 2] = np.column_stack([-sp, cp * sr, cp * cr])
    return R


def _window(t: Array, duration: float) -> tuple[Array, Array, Array]:
    """Return a window that rises and falls over RAMP (s) with two continuous derivatives."""
    u = np.clip(np.minimum(t, duration - t) / RAMP, 0.0, 1.0)
    sign = np.where(t < 0.5 * duration, 1.0, -1.0)
    rise = u**3 * (10 - 15 * u + 6 * u**2)
    first = 30 * u**2 * (1 - u) ** 2 * sign / RAMP
    second = 60 * u * (1 - u) * (1 - 2 * u) / RAMP**2
    return rise, first, second


def _check_rotors(
    robot: Robot, loads: Loads, rows: Table, q: Array, gravity: float
) -> tuple[float, str]:
    """Return the least unused fraction of the thrust range, and what is exceeded, or ""."""
    mass, c, I_B = compute_body(build_body_model(robot, gravity), q)
    w, wd, R = rows["w_WB_B"], rows["wd_WB_B"], rows["R_WB"]
    up = rows["a_WB"] + np.array([0.0, 0.0, gravity])
    if not loads.full:
        lean = np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])
        limit = math.radians(robot.control.tilt_max_deg)
        if lean.max() > limit:
            most, at = math.degrees(limit), math.degrees(float(lean.max()))
            return math.nan, f"tilt {at:.1f} deg, permitted {most:.1f} deg"
        R = np.array([_point_along(z, rot) for z, rot in zip(up, R, strict=True)])
        wd = np.gradient(_rates(R), ROW, axis=0)
    s = np.einsum("nji,nj->ni", R, up)  # specific force of B's origin
    f = mass * (s + np.cross(wd, c) + np.cross(w, np.cross(w, c)))
    tau = wd @ I_B.T + np.cross(w, w @ I_B.T) + mass * np.cross(c, s)
    thrust = np.hstack([f, tau]) @ loads.P.T
    span = loads.t_max - loads.t_min
    margin = np.minimum(thrust - loads.t_min, loads.t_max - thrust) / span
    if margin.min() < 0.0:
        i = int(np.argmin(margin.min(axis=0)))
        worst = float(thrust[np.argmin(margin[:, i]), i])
        allowed = f"{loads.t_min[i]:.2f} to {loads.t_max[i]:.2f} N"
        return float(margin.min()), f"rotor {i + 1} would require {worst:.2f} N; valid: {allowed}"
    return float(margin.min()), ""


def _point_along(z: Array, R: Array) -> Array:
    """Return the attitude with z_B along `z` and the heading of `R`."""
    z = z / np.linalg.norm(z)
    y = np.cross(z, R[:, 0])
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])


def _rates(R: Array) -> Array:
    w, log = np.zeros((len(R), 3)), np.zeros(3)
    for k in range(1, len(R) - 1):
        log_so3(np.ascontiguousarray(R[k - 1].T @ R[k + 1]), log)
        w[k] = log / (2.0 * ROW)
    return w


def plan_joint_move(robot: Robot, row: np.void, q: Array, speed: float) -> Table:
    """Move the arm from the row's joints to `q` (n,) rad with the platform held, rest to rest."""
    here = np.array(row["q"][: len(q)])
    n = max(math.ceil(1.875 * float(np.max(np.abs(q - here), initial=0.0)) / speed / ROW), 1)
    u = np.linspace(0.0, 1.0, n + 1)
    path = here + (u**3 * (10 - 15 * u + 6 * u**2))[:, None] * (q - here)
    return _hold_while(robot, row, path)


def plan_joint_swing(
    robot: Robot, row: np.void, amplitude: float, e: Excitation, low: Array, high: Array
) -> Table:
    """Move all joints by sines of peak `amplitude` (rad) about the row's angles, within limits.

    `low`, `high` (n,) rad: if an angle is closer to a limit, the centre of the motion is shifted.
    """
    n = len(low)
    here = np.array(row["q"][:n])
    t = np.asarray(ROW * np.arange(round(e.duration / ROW) + 1), dtype=np.float64)
    window, _, _ = _window(t, e.duration)
    size = np.minimum(amplitude, 0.5 * (high - low))
    middle = np.clip(here, low + size, high - size)
    lines = share_lines(e, max(n, 1))
    swing = np.column_stack([size[j] * build_sines(t, lines[j], 0) for j in range(n)])
    return _hold_while(robot, row, here + window[:, None] * (middle - here + swing))


def _hold_while(robot: Robot, row: np.void, path: Array) -> Table:
    """Hold the platform of `row` while the joints follow `path` (k, n)."""
    rows = np.repeat(np.array(row)[None], len(path))
    rows["t"] = ROW * np.arange(len(path))
    n = path.shape[1]
    for field in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
        rows[field] = 0.0
    rows["q"][:, :n] = path
    rows["qd"][:, :n] = np.gradient(path, ROW, axis=0)
    model = build_body_model(robot)
    for k, q in enumerate(path):
        tip, R_BT = compute_tip(model, q)
        rows["p_WT"][k] = row["p_WB"] + row["R_WB"] @ tip
        rows["R_WT"][k] = row["R_WB"] @ R_BT
    rows["v_WT"] = np.gradient(rows["p_WT"], ROW, axis=0)
    return rows
