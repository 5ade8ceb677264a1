"""An operator at the ground station's page: keyboard or gamepad, through the station."""

from __future__ import annotations

import time

from skywright.core.interrupt import check_interrupt
from skywright.ground.feed import Feed
from skywright.ground.person import PATIENCE_S, Person
from skywright.run.operator import STILL, Sight, Stick

INVITE = "Take control, hold Space (or a shoulder button) and move the stick."
WORK = (
    "Centre the dot below Stick, then follow the remaining path; at its end, press Enter while you "
    "hold Space."
)


class PageOperator(Person):
    """The stick of the page in control; `Feed` checks the page's stick again."""

    def __init__(self) -> None:
        super().__init__()
        self.feed: Feed | None = None

    def begin(self) -> bool:
        """Wait for a stick; return whether one arrived within PATIENCE_S."""
        assert self.feed is not None
        self.feed.ask(INVITE)
        ends = time.perf_counter() + PATIENCE_S
        while time.perf_counter() < ends:
            check_interrupt()
            self.feed.wait_a_moment()
            if self.feed.steering.order:
                break  # the rules answer it in the next tick
            if self.feed.steering.stick.age(time.monotonic()) < 1.0:
                self.feed.ask(WORK)
                return True
        return bool(self.feed.steering.order)

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the stick; None, and end the request, if no operator is present."""
        if self.feed is not None:
            self.feed.tell_sight(t, sight)
        stick = super().read(t, sight)
        if stick is None and self.feed is not None:
            self.feed.ask("")
        return stick

    def listen(self) -> None:
        """Store the newest stick; one that is too old becomes zero."""
        assert self.feed is not None
        self.feed.poll()
        now = time.monotonic()
        stick = self.feed.steering.stick.read(now)
        if stick is not STILL:
            self.hear(stick)
        else:
            self._stick = STILL
