"""Joint speeds as servos report them: differences of rounded angles through a filter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from plant_parts import build_context, build_part, view
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.readings import Shafts
from skywright.vehicle.sensors.encoders import Encoders, compute_speed_bandwidth


def read(speed: float, seconds: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Angles and speeds that the OTHex's first encoder reads of a joint that turns at `speed`."""
    context = build_context()
    me = build_part(Encoders("encoders"), context)
    qpos = context.scene.model.qpos0.copy()
    mj = view(MuJoCo, qpos=qpos.ctypes.data, nq=len(qpos))
    clock, out = view(Clock, dt=context.dt), view(Shafts)
    at, q, qd = context.scene.places.joint_qpos[0], [], []
    for i in range(round(seconds / context.dt)):
        qpos[at] = 0.1 + speed * i * context.dt
        Encoders.step(me, clock, mj, out)
        q.append(out.q[0])
        qd.append(out.qd[0])
    return np.array(q), np.array(qd), 1.0 / compute_speed_bandwidth(context.robot)


def test_a_steady_speed_is_found_after_the_filter_s_lag() -> None:
    q, qd, tau = read(0.5, 2.0)
    assert np.all(np.abs(np.round(q * 4096 / (2 * math.pi)) * 2 * math.pi / 4096 - q) < 1e-12)
    later = qd[round(8 * tau / 0.002) :]
    assert later.mean() == pytest.approx(0.5, rel=5e-3)
    n = round(tau / 0.002)
    assert qd[n] == pytest.approx(0.5 * (1.0 - math.exp(-1.0)), abs=0.03)


def test_rounding_makes_the_noise_that_the_filter_leaves() -> None:
    """Uniform rounding of white error: d / (sqrt(12) tau) rms; a joint at rest has none."""
    _, qd, tau = read(0.37, 20.0)
    lsb = 2 * math.pi / 4096
    noise = np.std(qd[2000:])
    assert 0.2 * lsb / (math.sqrt(12) * tau) < noise < 2.0 * lsb / (math.sqrt(12) * tau)
    _, rest, _ = read(0.0, 1.0)
    assert np.all(rest == 0.0)
