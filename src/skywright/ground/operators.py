"""Who may be at the stick while a mission flies (`skywright run MISSION --operator SOURCE`).

- `view`: buttons in the live view, held with mouse or finger;
- `udp:PORT` or `udp:HOST:PORT`: datagrams with the stick of any device, see `UdpOperator`;
- `model:careful`, `model:hasty`: a computed operator, see ground/operator_model.py.

What anyone here does is recorded into the run's directory (operator.csv), from which the run is
repeated. Simulated time is held to the wall clock while a person is at the stick.
"""

from __future__ import annotations

import socket
import sys
import time
from typing import Any

import numpy as np

from skywright.core.interrupt import check_interrupt
from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.ground.operator_model import MANNERS, ModelOperator
from skywright.run.operator import STILL, Sight, Stick

STALE_S = 0.5  # s of wall time after which a stick that is not heard of counts as let go
PATIENCE_S = 60.0  # s of wall time without a sign of the operator: nobody is there
DATAGRAM = 200  # bytes; a longer one is no stick
AT_ONCE = 1000  # datagrams read in one go: a flood of them must not stop the flight
SOURCES = "view, udp:PORT, udp:HOST:PORT, " + ", ".join(f"model:{name}" for name in MANNERS)


def open_operator(source: str, description: Description) -> Person | ModelOperator:
    """Return the operator that `source` names; a computed one draws from the mission's seed.

    Raises InputError on another name, or a port that cannot be had.
    """
    kind, _, rest = source.partition(":")
    if source == "view":
        return ViewOperator()
    if kind == "model" and rest in MANNERS:
        mission: Any = description.mission
        return ModelOperator(rest, mission.seed, mission.task.stick_speed_mps)
    host, _, port = rest.rpartition(":")
    if kind == "udp" and port.isascii() and port.isdigit() and int(port) <= 65535:
        return UdpOperator(host or "127.0.0.1", int(port))
    raise InputError(f"--operator {source[:80]!r}; valid: {SOURCES}")


class Person:
    """Someone at a stick: simulated time waits for the wall clock."""

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
        return self._stick if silent < STALE_S else STILL

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


class UdpOperator(Person):
    """A stick by UDP: datagrams of text, `dx,dy,dz,button`, each axis from -1 to 1, button 0 or 1.

    They are sent all the time, 20 to 100 a second. What is not such a datagram is counted and
    dropped; the newest of those that came counts.
    """

    def __init__(self, host: str, port: int) -> None:
        """Listen on `host` (127.0.0.1: from this computer only); port 0 takes a free one."""
        super().__init__()
        self.received, self.malformed = 0, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, TypeError) as error:  # TypeError: a host that no name can be
            self._socket.close()
            raise InputError(
                f"--operator udp:{host[:80]}:{port}: cannot listen on this address: "
                f"{getattr(error, 'strerror', None) or error}"
            ) from None
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])

    def begin(self) -> bool:
        """Forget what came before; wait for the first datagram."""
        print(f"operator: waiting for datagrams on port {self.port}", file=sys.stderr, flush=True)
        self.listen()
        self._heard, ends = -np.inf, time.perf_counter() + PATIENCE_S
        while not np.isfinite(self._heard) and time.perf_counter() < ends:
            check_interrupt()
            time.sleep(0.01)
            self.listen()
        return bool(np.isfinite(self._heard))

    def listen(self) -> None:
        """Read the datagrams that have come."""
        for _ in range(AT_ONCE):
            try:
                data = self._socket.recv(DATAGRAM + 1)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # a port that was closed at the other end
                continue
            stick = parse_datagram(data)
            if stick is None:
                self.malformed += 1
            else:
                self.received += 1
                self.hear(stick)

    def close(self) -> None:
        """Stop listening, and say what came."""
        self._socket.close()
        if self.received + self.malformed:
            print(
                f"operator: {self.received} datagrams, {self.malformed} malformed ones dropped",
                file=sys.stderr,
            )


def parse_datagram(data: bytes) -> Stick | None:
    """Return the stick of a datagram; None where it is malformed."""
    if len(data) > DATAGRAM:
        return None
    try:
        values = [float(x) for x in data.decode("ascii").split(",")]
    except (UnicodeDecodeError, ValueError):
        return None
    if len(values) != 4 or not all(abs(x) <= 1.0 for x in values) or values[3] not in (0.0, 1.0):
        return None  # NaN is not within 1, either
    return Stick(np.array(values[:3]), values[3] == 1.0)


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
