"""Response to the failure of a step of the robot's computer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.errors import SimulationError
from skywright.vehicle.assembly import Assembly, Key
from skywright.vehicle.bus import Allocated, RotorDrive, ServoDrive, ShaftCommand, WrenchCommand
from skywright.vehicle.component import ArmsLaw, Component, Law
from skywright.vehicle.ticker import StepFailed

RESTART_S = 0.06
"""s, until a watchdog has restarted a control law: three of its periods of 20 ms."""


class WatchdogState(NamedTuple):
    """A saved watchdog; see Watchdog.save."""

    due_at: NDArray[Any]  # of the schedule's rows
    due: float
    used: bool
    memories: dict[Key, NDArray[Any]]


class Watchdog:
    """Restarts a failed control law in flight once, and stops a law that fails again.

    The law restarts with its memory before the first step (`memories`), as a restarted process
    does; integrals and other states of the flight are lost. Until then the rotors hold their speed
    and the servos their angle. An estimator is not restarted, because it would have no initial
    position.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        self._laws = [c for c in assembly.components if isinstance(c, (Law, ArmsLaw))]
        names = {c.name for c in self._laws}
        self.memories = {
            key: rows.copy()
            for key, rows in assembly.records.items()
            if key[0] in assembly.memories and key[1] in names
        }
        self._due_at = assembly.rows[["every", "phase"]].copy()
        self._due = math.inf  # s, time of the restart
        self._used = False

    def stop(self, failed: StepFailed, t: float) -> bool:
        """Stop the step that failed at time t (s); return whether it is restarted."""
        again = not self._used and (failed.component is None or failed.component in self._laws)
        self._used, self._due = True, t + RESTART_S if again else math.inf
        self._leave_out([failed.component, *self._laws])
        records = self.assembly.records
        if again:
            self._forget(failed)
            given, made = records[WrenchCommand, ""], records[Allocated, ""]
            given.view(np.float64)[:] = 0.0  # also speeds and torques of the joints
            given["f_B"], given["t_B"] = made["f_B_alloc"], made["t_B_alloc"]
        else:
            for record in (WrenchCommand, RotorDrive):
                records[record, ""].view(np.float64)[:] = 0.0
        if (ShaftCommand, "") in records:  # a command that was not finite was not applied
            asked, held = records[ShaftCommand, ""]["theta"], records[ServoDrive, ""]["motor"]
            np.copyto(asked, held, where=~np.isfinite(asked))
        return again

    def save(self) -> WatchdogState:
        """Return its state, with the steps that it leaves out; gains of `memories` may change."""
        due_at = self.assembly.rows[["every", "phase"]].copy()
        memories = {key: rows.copy() for key, rows in self.memories.items()}
        return WatchdogState(due_at, self._due, self._used, memories)

    def restore(self, saved: WatchdogState) -> None:
        """Restore the state that `save` returned."""
        self.assembly.rows[["every", "phase"]] = saved.due_at
        self._due, self._used = saved.due, saved.used
        for key, rows in saved.memories.items():
            self.memories[key][:] = rows

    @property
    def is_pending(self) -> bool:
        """Whether a restart is due later."""
        return self._due < math.inf

    def look(self, t: float) -> None:
        """Restart the law when it is due."""
        if t >= self._due - 1e-9:
            self._due = math.inf
            self.assembly.rows[["every", "phase"]] = self._due_at

    def _leave_out(self, components: Sequence[Component | None]) -> None:
        rows = self.assembly.rows
        for i, step in enumerate(self.assembly.steps):
            if step.component in components:
                rows["every"][i], rows["phase"][i] = 2, 2  # never due, unlike every = 1

    def _forget(self, failed: StepFailed) -> None:
        """Reset the memory of the failed law, and that of another law if it is not finite."""
        for (record, name), first in self.memories.items():
            rows = self.assembly.records[record, name]
            law = next(c for c in self._laws if c.name == name)
            failed_one = failed.component or next(c for c in self._laws if isinstance(c, Law))
            if law is failed_one or not np.all(np.isfinite(rows.view(np.float64))):
                rows[:] = first


def explain_not_finite(assembly: Assembly, law: Law, t: float) -> SimulationError:
    """Return the error for a command or, if all are finite, a state that is not finite."""
    records = assembly.records
    given = [records[k, ""][0] for k in (WrenchCommand, ShaftCommand) if (k, "") in records]
    values = np.concatenate([np.ravel(r[name]) for r in given for name in r.dtype.names])
    if not np.all(np.isfinite(values)):
        label = next((s.label for s in assembly.steps if s.component is law), law.name)
        return StepFailed(
            f"control law {label} returned NaN or infinity at t = {t:.3f} s "
            "(force, torque or joint command); the command was not applied"
        )
    return SimulationError(f"the simulation diverged at t = {t:.3f} s: the state is not finite")
