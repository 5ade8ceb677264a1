"""Progress of a run on standard error: a bar with phase and real-time factor."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn
from rich.progress import Progress as Bar

from skywright.reports.terminal import new_console
from skywright.run.warm_up import is_compiled

if TYPE_CHECKING:
    from skywright.description.loader import Description
    from skywright.run.planning import MissionPlan
    from skywright.vehicle.simulated import SimulatedVehicle

REDRAW_S = 0.1
"""Minimum wall time between two updates of the bar."""


class Progress:
    """An observer (evaluation.run.Observer) that displays the progress of a run.

    On a terminal it draws one bar; elsewhere it writes one line per phase. `quiet` writes nothing.
    """

    def __init__(self, *, quiet: bool = False, console: Console | None = None) -> None:
        self._console = console or new_console(stderr=True)
        self._quiet = quiet
        self._bar: Bar | None = None
        self._task: TaskID | None = None
        self._phase = ""
        self._total = 0.0
        self._began = self._drawn = 0.0

    def on_plan(self, plan: MissionPlan, description: Description) -> None:
        """Show the estimated duration of the flight and start the bar."""
        self._total = plan.flight_s if math.isfinite(plan.flight_s) else 0.0
        self._began = time.perf_counter()
        if self._quiet:
            return
        takes = f": the flight takes about {self._total:.0f} s" if self._total else ""
        self._console.print(f"planned in {plan.plan_s:.2f} s{takes}")
        if not self._console.is_terminal:
            return
        self._bar = Bar(
            TextColumn("{task.description:<12}"),
            BarColumn(bar_width=30),
            TextColumn("{task.completed:.0f} of {task.total:.0f} s  {task.fields[factor]}"),
            console=self._console,
            transient=True,
            auto_refresh=False,  # no thread besides the simulation
        )
        self._task = self._bar.add_task("start", total=self._total, factor="")
        self._bar.start()

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Update the bar, at most ten times per second of wall time."""
        if self._quiet:
            return
        phase = phase or self._phase  # between two phases there is none
        if phase != self._phase:
            self._phase = phase
            if self._bar is None:
                self._console.print(f"{t:7.1f} s  {phase.replace('_', ' ')}", markup=False)
        if self._bar is None or self._task is None:
            return
        now = time.perf_counter()
        if now - self._drawn < REDRAW_S:
            return
        self._drawn = now
        factor = t / max(now - self._began, 1e-6)
        left = (self._total - t) / max(factor, 1e-6)
        rest = f", about {left:.0f} s left" if t <= self._total else ", longer than estimated"
        self._bar.update(
            self._task,
            description=phase.replace("_", " "),
            completed=t,
            total=max(self._total, t),
            factor=f"{factor:.0f} x real time{rest if self._total else ''}",
        )
        self._bar.refresh()

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def announce_planning(console: Console | None = None) -> None:
    """Print on a terminal that planning has begun; it may take a minute."""
    console = console or new_console(stderr=True)
    if console.is_terminal:
        console.print("planning ...", markup=False, highlight=False)


def announce_compilation(console: Console | None = None) -> bool:
    """Print a note if the first run compiles; call it before planning. Returns whether it
    printed."""
    if is_compiled():
        return False
    console = console or new_console(stderr=True)
    console.print("compiling (first run on this machine, about 40 s) ...", markup=False)
    return True
