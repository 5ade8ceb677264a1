"""Orders that an operator may give during a mission: next, retry, retract.

A mission opens a contact (`Orders.contact`, `Orders.attempt`) if it can retreat from it and start
it again. It flies a hold that may end early with `Orders.passes`. At any other time an order is
refused with the reason.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from skywright.run.faults._response import build_rest
from skywright.run.faults._trail import build_crumb
from skywright.run.flight import Flight
from skywright.run.pilot import STEADY_S, GivenBack, TakenOver, rejoin
from skywright.vehicle.interface import Ticked
from skywright.vehicle.results import Result

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

R = TypeVar("R")

PATIENCE_S = 120.0
"""s without an order after a retract; the robot then comes home, or completes the work."""
BY_ORDER = "left out by the operator's order"
WAITING = "wait for order"
"""The phase after a retract."""


class Order(StrEnum):
    """The valid orders."""

    NEXT = "next"
    RETRY = "retry"
    RETRACT = "retract"


ORDERS: dict[Order, str] = {
    Order.NEXT: "end the hold that is flown now; after `retract`, leave the contact out and go on",
    Order.RETRY: "draw back from the contact, fly to where it began, and try it again",
    Order.RETRACT: "draw back from the contact and hold until `retry` or `next`",
}
"""Meaning of each order, for messages and the documentation."""


class ContactEnded(Exception):
    """Raised when an order ends a contact; the mission catches it where it opened the contact."""

    repeats = True

    def __init__(self, order: Order, taken: TakenOver, first: int) -> None:
        """`taken` is the interrupted phase; `first` is the index of its crumb in the trail."""
        super().__init__(f"the operator ordered {order}")
        self.order, self.taken, self.first = order, taken, first


class Detour(NamedTuple):
    """Functions that leave a contact on an operator's order, and return to its start."""

    back: Callable[[], None]
    again: Callable[[], None]


class Orders:
    """The orders of one flight."""

    def __init__(self, s: Supervisor) -> None:
        self._s: Supervisor = weakref.proxy(s)  # weak: a cycle would keep the flight in memory
        self._given: Order | None = None
        self._contact = ""  # the open contact
        self._holds = False  # whether the present hold may end early
        self._must = ""  # why the interrupted contact cannot be left out
        self._why = BY_ORDER  # reason stated for a contact that is left out
        self.waits = False
        """Whether the robot has retreated and waits for `retry` or `next`."""
        self.left_out: dict[str, list[str]] = {}
        """Reason -> names of the contacts that were left out."""

    # --- orders ------------------------------------------------------------------------------

    def find_refusal(self, order: Order) -> str:
        """Return why an order is refused now, "" if it is accepted."""
        s = self._s
        says = ""
        if not s.kind.flies or s.senses.told("active") < 0.5:
            says = "the robot does not fly"
        elif s.pilot.switch or s.pilot.flies:
            says = "a pilot flies the robot: give it back first"
        elif s.senses.responding:
            says = "the robot flies the response of a fault rule"
        elif order == Order.RETRACT and self.waits:
            says = "the robot has already retreated: order retry or next"
        elif order == Order.NEXT and self.waits and self._must:
            says = f"the contact cannot be left out: {self._must}; valid: retry"
        elif order == Order.NEXT and not (self._holds or self.waits):
            says = f"{s.phase} cannot be ended early; valid: a hold, or a contact after retract"
        elif order != Order.NEXT and not (self._contact or self.waits):
            says = f"{s.phase} has no contact that this mission can repeat"
        return says and f"{order} refused: {says}"

    def give(self, order: str) -> Result:
        """Accept or refuse an order; it is executed from the next tick."""
        if order in list(Order):
            says = self.find_refusal(Order(order))
        else:
            says = f"order {order!r} refused: valid: {', '.join(Order)}"
        if not says:
            self._given = Order(order)
        return Result(not says, says, self._s.vehicle.t)

    def follow(self) -> None:
        """Execute a pending order, once a tick; raises ContactEnded if the order ends a contact."""
        if self._given in (None, Order.NEXT) or not self._contact or self.waits:
            return
        order, self._given = self._given, None
        if self._s.pilot.switch or self._s.senses.responding:
            return
        s = self._s
        crumbs = s.trail.crumbs
        crumbs.append(build_crumb(s.senses))
        row, engaged = np.array(s.vehicle.reference), s.senses.engaged
        taken = TakenOver(s.phase, row, *s.vehicle.tracking, engaged)
        raise ContactEnded(order, taken, len(crumbs) - 1)

    # --- interface of missions ---------------------------------------------------------------

    def passes(self, seconds: float) -> Iterator[Ticked]:
        """Tick for a time (s) without pilot flight; the order `next` ends it early."""
        s = self._s
        end = s.clock + seconds
        self._holds, self._given = True, None
        try:
            while s.clock < end - 1e-9 and self._given != Order.NEXT:
                yield s.tick()
        finally:
            self._holds, self._given = False, None

    @contextmanager
    def contact(self, what: str) -> Iterator[None]:
        """Open a contact; inside, `retry` and `retract` raise ContactEnded."""
        self._contact, self._given = what, None
        try:
            yield
        finally:
            self._contact, self._given = "", None

    def attempt(
        self,
        what: str,
        do: Callable[[], R],
        left_out: R,
        detour: Detour | None = None,
        must: str = "",
    ) -> R:
        """Execute the work of a contact, again if ordered; returns `left_out` after `next`.

        `must` is the reason if the contact cannot be left out, else "". `do` begins at rest, clear
        of the object. `detour` defines how the robot retreats from there and returns; by default
        the arm's posture stays unchanged. Without a detour, the work is also repeated if a pilot
        took over in the contact and gave back.
        """
        s = self._s
        row, crumbs = np.array(s.vehicle.reference), s.trail.crumbs
        while True:
            first, self._must = len(crumbs), must
            crumbs.append(build_crumb(s.senses))
            try:
                with self.contact(what):
                    return do()
            except (ContactEnded, GivenBack) as ended:
                if not ended.repeats or (detour and isinstance(ended, GivenBack)):
                    raise
                if self.go_on(ended, row, first, detour) == Order.NEXT:
                    self.left_out.setdefault(self._why, []).append(what)
                    return left_out

    def go_on(
        self,
        ended: ContactEnded | GivenBack,
        row: Any,
        first: int | None = None,
        detour: Detour | None = None,
    ) -> Order:
        """Fly to a REFERENCE row from which the contact can start again; returns RETRY or NEXT.

        After an order, the robot first retreats and, after RETRACT, waits. The return path is the
        path flown since the crumb `first` (default: where the contact ended).
        """
        s, order = self._s, Order.RETRY
        s.watch = None
        if isinstance(ended, ContactEnded):
            s.end("drawn back")
            s.begin("draw back")
            if detour is None:
                s.kind.withdraw(s, s.way)
                s.body.track(build_rest(s)[None])
            else:
                detour.back()
            if ended.order != Order.RETRY:
                order = self._wait(ended, detour is not None)
        if detour is None:
            rejoin(s, ended.first if first is None else first, row)
        else:
            s.begin("rejoin")
            detour.again()
            s.wait(STEADY_S)
        return order

    def _wait(self, ended: ContactEnded, goes_on: bool) -> Order:
        """Hold until there is an order.

        If none comes and `goes_on`, the contact is left out, or repeated if it must not be left
        out, so that a load is put down before the robot comes home. Otherwise GivenBack is raised.
        """
        s = self._s
        s.begin(WAITING)
        end = s.clock + PATIENCE_S
        self.waits, self._given, self._why = True, None, BY_ORDER
        try:
            while self._given is None:
                s.tick()
                if s.clock > end:
                    self._why = f"no order came for {PATIENCE_S:g} s after retract"
                    if not goes_on:
                        raise GivenBack(self._why, ended.taken, ended.first)
                    return Order.RETRY if self._must else Order.NEXT
            return self._given
        finally:
            self.waits, self._given = False, None

    def judge(self, flight: Flight) -> Flight:
        """Return the flight; if a contact was left out, it is not completed."""
        if not self.left_out:
            return flight
        told = "; ".join(f"{why}: {', '.join(what)}" for why, what in self.left_out.items())
        reason = f"{told}; {flight.reason}" if flight.reason else told
        return flight._replace(completed=False, reason=reason)
