"""Orders and stick of an operator: received at any time, executed in a tick.

Orders are checked on the robot's side (run/pilot.py, run/orders.py, the rules); the reason of a
refusal is sent back to the page.
"""

from __future__ import annotations

import math
import time
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from skywright.ground.control import HOLD_S, StickJudge, Told
from skywright.ground.disturb import DISTURBANCES, list_repeats, switch_on
from skywright.ground.link import read_flight
from skywright.links.pair import read_number
from skywright.run.hand_flight import Mode
from skywright.run.operator import Stick
from skywright.run.orders import WAITING, Order

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor
    from skywright.vehicle.simulated import SimulatedVehicle

RULED = {"abort": "come_home", "land": "land_here"}
"""Orders that the rules answer -> their response."""
PILOT = {"take_over": "manual", "give_back": "rejoin"}
"""Orders of the pilot's switch -> the next phase."""
ORDERS = frozenset({*RULED, *PILOT, *Order})
"""All orders."""
MODES = frozenset(Mode)
MOST = 8  # orders queued for a tick
RECENT = 500  # sticks over which the status reports the median age


class Steering:
    """Orders, stick and disturbances of one flight."""

    def __init__(self) -> None:
        self.order = ""
        """The order of RULED that was given; it stays set."""
        self.starts: dict[str, float] = {}  # of disturbances, s
        self.stick = StickJudge()
        self.said = ""
        """Why the last order was refused, or ""."""
        self.ages = deque[float](maxlen=RECENT)  # s, ages of the sticks on arrival
        self._held = False  # whether the dead-man switch is held
        self._given = deque[tuple[str, str]](maxlen=MOST)

    # --- reception ---------------------------------------------------------------------------

    def hear(self, message: dict[str, Any]) -> bool:
        """Process a message; return whether it is one of the operator's."""
        kind, what = message["k"], message.get("what")
        if kind == "stick":
            return self._hear_stick(message)
        if kind == "control":
            self.stick.forget()
            return True
        if not isinstance(what, str):
            return False
        if kind == "order" and what in RULED:
            self.order = what
        elif (kind == "order" and what in ORDERS) or (kind == "mode" and what in MODES):
            self._given.append((kind, what))
        elif kind == "disturb" and what in DISTURBANCES:
            self.starts.setdefault(what, math.nan)
        else:
            return False
        return True

    def _hear_stick(self, message: dict[str, Any]) -> bool:
        axes, now = message.get("v"), time.monotonic()
        at, seq = read_number(message.get("at"), 0.0, 1e12), read_number(message.get("s"), 0, 2**53)
        if at is None or seq is None or not isinstance(axes, list) or len(axes) != 3:
            return False
        values = [read_number(x, -1.0, 1.0) for x in axes]
        flight = read_flight(message.get("f"))
        if flight is None or any(x is None for x in values):
            return False
        stick = Stick(np.array(values, float), message.get("b") is True, tuple(flight))
        if message.get("d") is not True:  # the dead-man switch is released: zero stick
            stick = Stick(np.zeros(3), False)
        if self.stick.hear(Told(int(seq), at, stick), now):  # counts dropped messages
            self._held = message.get("d") is True
            self.ages.append(now - at)
        return True

    @property
    def moves(self) -> bool:
        """Whether the stick currently has an effect."""
        return self._held and self.stick.age(time.monotonic()) < HOLD_S

    # --- execution ---------------------------------------------------------------------------

    def carry_out(self, t: float, vehicle: SimulatedVehicle, s: Supervisor[Any] | None) -> None:
        """Execute the orders at `t` (s); without a supervisor only the disturbances."""
        for name, start in list(self.starts.items()):
            if math.isnan(start):
                self.starts[name] = t
                if not switch_on(vehicle, name, t):
                    self.said = f"this flight was started without {DISTURBANCES[name].label!r}"
                    self.starts.pop(name)
        if s is None:
            return
        while self._given:
            self.said = self._do(s, *self._given.popleft())
        now = time.monotonic()
        if s.pilot.flies and self.stick.age(now) < HOLD_S:
            s.move_stick(list(self.stick.read(now).flight))

    def _do(self, s: Supervisor[Any], kind: str, what: str) -> str:
        """Execute an order; return why it was refused, or ""."""
        if kind == "mode":
            return s.choose_mode(what).reason
        if what == "take_over":
            return s.take_over().reason
        if what == "give_back":
            return s.give_back().reason
        return s.order(what).reason

    # --- status ------------------------------------------------------------------------------

    def tell(self, s: Supervisor[Any] | None) -> dict[str, Any]:
        """Return the status for a page, as plain JSON."""
        age = self.stick.age(time.monotonic())
        begun = {name: start for name, start in self.starts.items() if math.isfinite(start)}
        told: dict[str, Any] = {
            "order": self.order, "said": self.said, "age_s": round(age, 3) if age < 1e6 else None,
            "disturbed": {name: round(start, 2) for name, start in begun.items()},
            "repeats": list_repeats(begun),
            "stick_ms": round(1e3 * float(np.median(self.ages)), 1) if self.ages else None,
            "pilot": None, "refusals": {}, "waits": False, "checklist": [],
        }  # fmt: skip
        if s is not None:
            p = s.pilot
            told["pilot"] = {
                "switch": p.switch, "flies": p.flies, "says": p.says, "mode": str(p.mode),
                "flown": p.flown, "lacks": p.lacks,
            }  # fmt: skip
            told["refusals"] = {str(order): s.orders.find_refusal(order) for order in Order}
            told["waits"] = s.orders.waits and s.phase == WAITING
            told["checklist"] = [c.to_json() for c in s.checked]
        return told
