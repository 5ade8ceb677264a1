"""The control link: measurements reach the controller, and commands the robot, late or never.

Each control tick the robot sends one packet with everything it measured, and the controller one
with its command. A packet takes `delay` plus normal jitter, arrives in order (a later packet waits
for an earlier one), and is lost with a fixed probability. Packets are stamped; the clocks agree.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.types import IMU_BATCH, MAX_JOINTS, MAX_ROTORS, MEASUREMENT
from skywright.description.world.spec import Link

Array = NDArray[np.float64]
Record = Any

DEPTH = 256  # packets under way each way: more than the longest delay holds
LINK_BLOCK = 1000  # control ticks of noise drawn at a time

f8, i8 = np.float64, np.int64

LINK = np.dtype(
    [
        ("on", i8),
        ("delay", f8),
        ("jitter", f8),
        ("loss", f8),
        ("index", i8),
        ("noise", f8, (LINK_BLOCK, 2)),  # normal: up, down
        ("chance", f8, (LINK_BLOCK, 2)),  # uniform: up, down
        ("sent", MEASUREMENT),  # what the robot measures now
        ("up_head", i8),
        ("up_tail", i8),
        ("up_last", f8),  # s, arrival of the newest packet under way
        ("up_arrival", f8, DEPTH),
        ("up", MEASUREMENT, DEPTH),
        ("down_head", i8),
        ("down_tail", i8),
        ("down_last", f8),
        ("down_arrival", f8, DEPTH),
        ("down_speed", f8, (DEPTH, MAX_ROTORS)),
        ("down_motor", f8, (DEPTH, MAX_JOINTS)),
        # what the robot holds: the newest command that arrived
        ("speed", f8, MAX_ROTORS),  # rad/s
        ("motor", f8, MAX_JOINTS),  # rad/s (position servos: rad)
    ]
)


@njit(cache=True, error_model="numpy")
def _arrival(lk: Record, t: float, last: float, way: int) -> float:
    """When a packet sent now arrives; packets keep their order."""
    return max(t + max(lk.delay + lk.jitter * lk.noise[lk.index, way], 0.0), last)


@njit(cache=True, error_model="numpy")
def send_measurement(lk: Record, t: float) -> None:
    """Put `lk.sent` under way to the controller."""
    if lk.chance[lk.index, 0] < lk.loss:
        return
    i = lk.up_head
    nxt = (i + 1) % DEPTH
    if nxt == lk.up_tail:
        lk.up_tail = (lk.up_tail + 1) % DEPTH
    lk.up_last = _arrival(lk, t, lk.up_last, 0)
    lk.up_arrival[i] = lk.up_last
    _copy_measurement(lk.sent, lk.up[i])
    lk.up_head = nxt


@njit(cache=True, error_model="numpy")
def receive_measurement(lk: Record, t: float, meas: Record) -> None:
    """Merge what has arrived by `t` into `meas`: the newest state, all inertial samples."""
    meas.imu_n = 0
    meas.mocap_fresh = meas.fix_fresh = meas.odo_fresh = meas.range_fresh = 0.0
    meas.marker_fresh = 0.0
    while lk.up_tail != lk.up_head and lk.up_arrival[lk.up_tail] <= t + 1e-9:
        _merge(lk.up[lk.up_tail], meas)
        lk.up_tail = (lk.up_tail + 1) % DEPTH
    if meas.mocap_fresh > 0.0:
        meas.mocap_age = t - meas.mocap_t
    if meas.imu_n > 0:
        for i in range(3):
            meas.gyro[i] = 0.0
            for k in range(meas.imu_n):
                meas.gyro[i] += meas.imu_gyro[k, i] / meas.imu_n


@njit(cache=True, error_model="numpy")
def _merge(new: Record, meas: Record) -> None:
    meas.t = new.t
    for j in range(MAX_JOINTS):
        meas.q[j], meas.qd[j], meas.deflection[j] = new.q[j], new.qd[j], new.deflection[j]
    for k in range(new.imu_n):
        if meas.imu_n < IMU_BATCH:
            n = meas.imu_n
            for i in range(3):
                meas.imu_gyro[n, i], meas.imu_accel[n, i] = new.imu_gyro[k, i], new.imu_accel[k, i]
            meas.imu_n = n + 1
    if new.mocap_fresh > 0.0:
        _copy_mocap(new, meas)
    meas.force = new.force
    _copy_others(new, meas)


@njit(cache=True, error_model="numpy")
def _copy_mocap(a: Record, b: Record) -> None:
    b.mocap_fresh, b.mocap_t, b.mocap_period = a.mocap_fresh, a.mocap_t, a.mocap_period
    for i in range(3):
        b.p_WB[i], b.p_WT[i], b.axis_W[i] = a.p_WB[i], a.p_WT[i], a.axis_W[i]
        b.p_WM[i], b.p_WP[i] = a.p_WM[i], a.p_WP[i]
        for j in range(3):
            b.R_WB[i, j] = a.R_WB[i, j]
            b.R_WM[i, j], b.R_WP[i, j] = a.R_WM[i, j], a.R_WP[i, j]


@njit(cache=True, error_model="numpy")
def _copy_measurement(a: Record, b: Record) -> None:
    b.t, b.imu_n = a.t, a.imu_n
    for j in range(MAX_JOINTS):
        b.q[j], b.qd[j], b.deflection[j] = a.q[j], a.qd[j], a.deflection[j]
    for k in range(a.imu_n):
        for i in range(3):
            b.imu_gyro[k, i], b.imu_accel[k, i] = a.imu_gyro[k, i], a.imu_accel[k, i]
    _copy_mocap(a, b)
    b.force = a.force
    b.fix_fresh = b.odo_fresh = b.range_fresh = b.marker_fresh = 0.0
    _copy_others(a, b)


@njit(cache=True, error_model="numpy")
def _copy_others(a: Record, b: Record) -> None:
    """Copy what is new; of several packets that arrive together the last of each sensor stays."""
    if a.fix_fresh > 0.0:
        b.fix_fresh, b.fix_t, b.fix_heading = 1.0, a.fix_t, a.fix_heading
        for i in range(3):
            b.fix_p[i] = a.fix_p[i]
    if a.odo_fresh > 0.0:
        b.odo_fresh, b.odo_t = 1.0, a.odo_t
        for i in range(3):
            b.odo_p[i] = a.odo_p[i]
            for j in range(3):
                b.odo_R[i, j] = a.odo_R[i, j]
    if a.marker_fresh > 0.0:
        b.marker_fresh = 1.0
        for i in range(3):
            b.p_BM[i] = a.p_BM[i]
            for j in range(3):
                b.R_BM[i, j] = a.R_BM[i, j]
    if a.range_fresh > 0.0:
        b.range_fresh, b.range_t, b.range = 1.0, a.range_t, a.range


@njit(cache=True, error_model="numpy")
def send_command(lk: Record, t: float, rotor_speed: Array, motor_speed: Array) -> None:
    """Put a command under way to the robot, then hand the robot what has arrived by `t`."""
    if lk.chance[lk.index, 1] >= lk.loss:
        i = lk.down_head
        nxt = (i + 1) % DEPTH
        if nxt == lk.down_tail:
            lk.down_tail = (lk.down_tail + 1) % DEPTH
        lk.down_last = _arrival(lk, t, lk.down_last, 1)
        lk.down_arrival[i] = lk.down_last
        for r in range(MAX_ROTORS):
            lk.down_speed[i, r] = rotor_speed[r]
        for j in range(MAX_JOINTS):
            lk.down_motor[i, j] = motor_speed[j]
        lk.down_head = nxt
    while lk.down_tail != lk.down_head and lk.down_arrival[lk.down_tail] <= t + 1e-9:
        i = lk.down_tail
        for r in range(MAX_ROTORS):
            lk.speed[r] = lk.down_speed[i, r]
        for j in range(MAX_JOINTS):
            lk.motor[j] = lk.down_motor[i, j]
        lk.down_tail = (i + 1) % DEPTH
    lk.index += 1


def build_link(link: Link) -> NDArray[Any]:
    """Return a (1,) array of LINK; without delay, jitter and loss it stays off."""
    out = np.zeros(1, LINK)
    lk = out[0]
    lk["on"] = int(link.delay_s > 0.0 or link.jitter_s > 0.0 or link.loss_fraction > 0.0)
    lk["delay"], lk["jitter"], lk["loss"] = link.delay_s, link.jitter_s, link.loss_fraction
    lk["index"] = LINK_BLOCK
    return out


def draw_link(lk: Record, stream: np.random.Generator) -> None:
    """Fill the block of noise."""
    lk["noise"] = stream.standard_normal((LINK_BLOCK, 2))
    lk["chance"] = stream.random((LINK_BLOCK, 2))
    lk["index"] = 0
