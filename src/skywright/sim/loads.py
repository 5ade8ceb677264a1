"""What a collision does to the platform: wrench of arms or link on it, and the force on the pads.

Read after every physics step (1 kHz): a blow lasts milliseconds, and a sample of the recording
(100 Hz) would miss its peak.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numba import njit

from skywright.models.gauges import find_gauges

Record = Any
Array = Any

MAX_MOUNTS = 4
MAX_PADS = 4
TOUCH = 0.1  # N, force above which a pad counts as touched

f8, i8 = np.float64, np.int64

LOADS = np.dtype(
    [
        ("on", i8),
        ("n_mounts", i8),
        ("mount", i8, (MAX_MOUNTS, 3)),  # site, addresses of force and torque
        ("origin", i8),  # site of B
        ("n_pads", i8),
        ("pad", i8, MAX_PADS),
        ("dt", f8),  # s, physics step
        ("zero", i8),  # 1: the next step's wrench is the one to count from
        ("f_zero_B", f8, 3),
        ("t_zero_B", f8, 3),
        # wrench of what the platform carries, on it, about its origin, beyond the one counted from
        ("f_B", f8, 3),  # N
        ("t_B", f8, 3),  # N m
        ("f_peak", f8),  # N, largest size since the last sample
        ("t_peak", f8),
        # contact with pads
        ("pad_f_W", f8, 3),  # N, force on the pads
        ("pad_peak", f8),  # N, since the last sample
        ("impulse_W", f8, 3),  # N s, given to the pads so far
        ("touch_s", f8),  # s, in contact so far
    ]
)
"""Gauges of the plant (models/gauges.py)."""


def fill_loads(loads: Record, model: mujoco.MjModel) -> None:
    """Write addresses and step of a LOADS record; without gauges it stays off."""
    mounts, origin, pads = find_gauges(model)
    if origin < 0:
        return
    loads["on"], loads["origin"], loads["dt"] = 1, origin, model.opt.timestep
    loads["n_mounts"], loads["n_pads"] = len(mounts), len(pads)
    loads["mount"][: len(mounts)], loads["pad"][: len(pads)] = mounts, pads
    loads["zero"] = 1


@njit(cache=True, error_model="numpy")
def watch_loads(loads: Record, sensordata: Array, site_xpos: Array, site_xmat: Array) -> None:
    """Take the gauges of one physics step.

    MuJoCo's sensors give what holds the child, in the site's axes; the platform feels the opposite.
    """
    f_W, t_W = np.zeros(3), np.zeros(3)
    o = loads.origin
    for m in range(loads.n_mounts):
        s, at, about = loads.mount[m, 0], loads.mount[m, 1], loads.mount[m, 2]
        f, arm = np.zeros(3), np.empty(3)
        for i in range(3):
            arm[i] = site_xpos[s, i] - site_xpos[o, i]
            for j in range(3):
                f[i] -= site_xmat[s, 3 * i + j] * sensordata[at + j]
                t_W[i] -= site_xmat[s, 3 * i + j] * sensordata[about + j]
            f_W[i] += f[i]
        t_W[0] += arm[1] * f[2] - arm[2] * f[1]
        t_W[1] += arm[2] * f[0] - arm[0] * f[2]
        t_W[2] += arm[0] * f[1] - arm[1] * f[0]
    force = torque = 0.0
    if loads.zero:
        loads.f_peak = loads.t_peak = 0.0
    for i in range(3):
        f_B = t_B = 0.0
        for j in range(3):
            f_B += site_xmat[o, 3 * j + i] * f_W[j]
            t_B += site_xmat[o, 3 * j + i] * t_W[j]
        if loads.zero:
            loads.f_zero_B[i], loads.t_zero_B[i] = f_B, t_B
        loads.f_B[i], loads.t_B[i] = f_B - loads.f_zero_B[i], t_B - loads.t_zero_B[i]
        force += loads.f_B[i] ** 2
        torque += loads.t_B[i] ** 2
        loads.pad_f_W[i] = 0.0
        for p in range(loads.n_pads):
            loads.pad_f_W[i] -= sensordata[loads.pad[p] + i]  # MuJoCo: force that the pad exerts
        loads.impulse_W[i] += loads.pad_f_W[i] * loads.dt
    loads.zero = 0
    loads.f_peak = max(loads.f_peak, math.sqrt(force))
    loads.t_peak = max(loads.t_peak, math.sqrt(torque))
    pressed = math.sqrt(
        loads.pad_f_W[0] ** 2 + loads.pad_f_W[1] ** 2 + loads.pad_f_W[2] ** 2
    )  # fmt: skip
    loads.pad_peak = max(loads.pad_peak, pressed)
    if pressed > TOUCH:
        loads.touch_s += loads.dt


@njit(cache=True, error_model="numpy")
def sample_loads(loads: Record, row: Record) -> None:
    """Write the gauges into a sample and start new peaks."""
    for i in range(3):
        row.load_f_B[i], row.load_t_B[i] = loads.f_B[i], loads.t_B[i]
        row.pad_f_W[i], row.pad_impulse_W[i] = loads.pad_f_W[i], loads.impulse_W[i]
    row.load_f_peak, row.load_t_peak = loads.f_peak, loads.t_peak
    row.pad_f_peak, row.pad_touch_s = loads.pad_peak, loads.touch_s
    loads.f_peak = loads.t_peak = loads.pad_peak = 0.0
