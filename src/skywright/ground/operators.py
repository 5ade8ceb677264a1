"""Who may be at the stick while a mission flies (`skywright run MISSION --operator SOURCE`).

- `view`: buttons in the live view, held with mouse or finger;
- `udp:PORT` or `udp:HOST:PORT`: whoever connects to the gateway, see gateway_operator.py;
- `model:careful`, `model:hasty`: a computed operator, see ground/operator_model.py.

What anyone here does is recorded into the run's directory (operator.csv), from which the run is
repeated. Simulated time is held to the wall clock while a person is at the stick.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.ground.operator_model import MANNERS, ModelOperator
from skywright.run.operator import STILL, Sight, Stick

STALE_S = 0.5  # s of wall time after which a stick that is not heard of counts as let go
PATIENCE_S = 60.0  # s of wall time without a sign of the operator: nobody is there
SOURCES = "view, udp:PORT, udp:HOST:PORT, " + ", ".join(f"model:{name}" for name in MANNERS)


def open_operator(source: str, description: Description) -> Person | ModelOperator:
    """Return the operator that `source` names; a computed one draws from the mission's seed.

    That of a gateway is ground.gateway_operator.GatewayOperator. Raises InputError on another name.
    """
    kind, _, rest = source.partition(":")
    if source == "view":
        return ViewOperator()
    if kind == "model" and rest in MANNERS:
        mission: Any = description.mission
        return ModelOperator(rest, mission.seed, mission.task.stick_speed_mps)
    raise InputError(f"--operator {source[:80]!r}; valid: {SOURCES}")


class Person:
    """Someone at a stick: simulated time waits for the wall clock."""

    stale_s = STALE_S

    def __init__(self) -> None:
        self._start = 0.0  # wall time at which the operator took over
        self._heard = -np.inf  # wall time
        self._stick = STILL

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Wait until `t` is now; return the stick, at rest where it was let go or lost."""
        now = time.perf_counter()
        if t == 0.0:
            if not self.begin():
                return None
            self._start = now = time.perf_counter()
        late = now - self._start - t
        if late > STALE_S:  # the computer is slower, or the view was paused
            self._start += late
        elif late < 0.0:
            time.sleep(-late)
        self.listen()
        silent = time.perf_counter() - max(self._heard, self._start)
        if silent > PATIENCE_S:
            return None
        return self._stick if silent < self.stale_s else STILL

    def hear(self, stick: Stick) -> None:
        """Take over what the stick does now."""
        self._stick, self._heard = stick, time.perf_counter()

    def begin(self) -> bool:
        """Ask the operator to take over; returns whether somebody is there."""
        return True

    def listen(self) -> None:
        """Take over what has come since."""

    def close(self) -> None:
        """Stop listening."""


BUTTONS = (
    ("ahead", 0, 1.0), ("back", 0, -1.0), ("left", 1, 1.0), ("right", 1, -1.0), ("up", 2, 1.0),
    ("down", 2, -1.0),
)  # fmt: skip
"""Of the live view: name, axis, direction."""
HOLD_HZ = 20.0


class ViewOperator(Person):
    """Buttons in the live view: as long as one is held the stick is pushed its way."""

    def __init__(self) -> None:
        super().__init__()
        self._held = np.full(len(BUTTONS), -np.inf)  # wall time at which each was last felt
        self._done = -np.inf

    def build_panel(self, gui: Any) -> None:
        """Draw the buttons; `gui` is viser's."""
        with gui.add_folder("operator's stick"):
            self._share = gui.add_slider(
                "deflection", min=0.1, max=1.0, step=0.1, initial_value=0.5
            )
            for i, (name, _, _) in enumerate(BUTTONS):
                self._add(gui, name, i)
            done = gui.add_button("tool is seated: release", color="green")

        @done.on_hold(callback_hz=HOLD_HZ)
        async def press(_: Any) -> None:
            self._done = time.perf_counter()

    def _add(self, gui: Any, name: str, index: int) -> None:
        button = gui.add_button(name)

        @button.on_hold(callback_hz=HOLD_HZ)
        async def hold(_: Any) -> None:
            self._held[index] = time.perf_counter()

    def listen(self) -> None:
        """Push the stick by the buttons that were felt within the last periods."""
        now, axes = time.perf_counter(), np.zeros(3)
        for (_, axis, sign), felt in zip(BUTTONS, self._held, strict=True):
            if now - felt < 4.0 / HOLD_HZ:
                axes[axis] += sign * float(self._share.value)
        last = max(float(np.max(self._held)), self._done)
        if np.isfinite(last):
            self._stick = Stick(axes, now - self._done < 4.0 / HOLD_HZ)
            self._heard = now if now - last < PATIENCE_S else last
