"""Torque of a law per body rate, by finite differences of its step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import Estimate, WrenchCommand
from skywright.vehicle.component import Law
from skywright.vehicle.ports import Port, Step

STEP = 1e-3
"""rad/s, step of the central difference."""


def measure_rate_torque(assembly: Assembly, law: Law) -> NDArray[np.float64] | None:
    """Return the derivative (3, 2) N m s/rad of the law's torque by the roll and pitch rates.

    The law runs as plain Python on the present records, which are restored. Returns None if the law
    reads no estimate, commands no torque, or raises.
    """
    i = next((i for i, s in enumerate(assembly.steps) if s.component is law), None)
    if i is None:
        return None
    seen, commanded = (_find(assembly, assembly.steps[i], r) for r in (Estimate, WrenchCommand))
    if seen is None or commanded is None:
        return None
    state, out = assembly.save(), np.zeros((3, 2))
    try:
        for axis in (0, 1):
            for sign in (1.0, -1.0):
                assembly.restore(state)
                seen["w_WB_B"][0, axis] += sign * STEP
                assembly.run_python(i)
                out[:, axis] += sign * commanded["t_B"][0] / (2.0 * STEP)
    except Exception:  # a user's step; it fails in flight too
        return None
    finally:
        assembly.restore(state)
    return out if np.all(np.isfinite(out)) else None


def _find(assembly: Assembly, step: Step, record: type) -> NDArray[np.void] | None:
    """Return the record (1,) at a port of a step."""
    ports: list[Port] = [p for p in step.ports if p.record is record]
    key = assembly.resolve(step, ports[0]) if ports else None
    return None if key is None else assembly.records[key]
