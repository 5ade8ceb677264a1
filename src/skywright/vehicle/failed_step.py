"""What is done where a step of the robot's own computer failed."""

from __future__ import annotations

import numpy as np

from skywright.errors import SimulationError
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import RotorDrive, ServoDrive, ShaftCommand, WrenchCommand
from skywright.vehicle.component import ArmsLaw, Law
from skywright.vehicle.ticker import StepFailed


def silence(assembly: Assembly, failed: StepFailed) -> None:
    """Run the component that failed and the laws no more, and command nothing from now on."""
    rows, records = assembly.rows, assembly.records
    for i, step in enumerate(assembly.steps):
        if step.component is failed.component or isinstance(step.component, (Law, ArmsLaw)):
            rows["phase"][i] = rows["every"][i]  # never due
    for record in (WrenchCommand, RotorDrive):
        records[record, ""].view(np.float64)[:] = 0.0
    if (ShaftCommand, "") in records:  # a command that was not finite was not applied
        asked, held = records[ShaftCommand, ""]["theta"], records[ServoDrive, ""]["motor"]
        np.copyto(asked, held, where=~np.isfinite(asked))


def explain_not_finite(assembly: Assembly, law: str, t: float) -> SimulationError:
    """Return what to raise where a command, or else the simulated state, is not finite."""
    records = assembly.records
    given = [records[k, ""][0] for k in (WrenchCommand, ShaftCommand) if (k, "") in records]
    values = np.concatenate([np.ravel(r[name]) for r in given for name in r.dtype.names])
    if not np.all(np.isfinite(values)):
        return StepFailed(
            f"control law {law!r} returned NaN or infinity at t = {t:.3f} s "
            "(force, torque or joint command); the command was not applied"
        )
    return SimulationError(f"the simulation diverged at t = {t:.3f} s: the state is not finite")
