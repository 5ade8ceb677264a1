"""What a law answers rates of the body with, measured on its own step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import Estimate, WrenchCommand
from skywright.vehicle.component import Law
from skywright.vehicle.ports import Port, Step

STEP = 1e-3
"""rad/s, each way."""


def measure_rate_torque(assembly: Assembly, law: Law) -> NDArray[np.float64] | None:
    """Return N m (3, 2): by how much the law's torque changes for 1 rad/s of roll and pitch.

    It is called as plain Python on the records of this moment, which are put back. None: the law
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
    except Exception:  # a user's step, which has failed in flight then, too
        return None
    finally:
        assembly.restore(state)
    return out if np.all(np.isfinite(out)) else None


def _find(assembly: Assembly, step: Step, record: type) -> NDArray[np.void] | None:
    """The record (1,) that a step has at a port."""
    ports: list[Port] = [p for p in step.ports if p.record is record]
    key = assembly.resolve(step, ports[0]) if ports else None
    return None if key is None else assembly.records[key]
