"""A person at a stick: when a stick counts as released, and the operator as absent."""

from __future__ import annotations

import numpy as np
import pytest

import skywright.ground.person as person
from skywright.ground.person import PATIENCE_S, STALE_S, Person
from skywright.run.operator import Sight, Stick

SIGHT = Sight(np.zeros(3), False)
TICK = 0.02  # s


class Wall:
    """A wall clock that is turned by hand."""

    now = 1000.0

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, s: float) -> None:
        self.now += s


class Hand(Person):
    """An operator who pushes the stick as long as `there`."""

    there = True

    def listen(self) -> None:
        if self.there:
            self.hear(Stick(np.ones(3), False))


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall()
    monkeypatch.setattr(person, "time", wall)
    return wall


def fly(operator: Person, t: float, seconds: float) -> list[Stick | None]:
    """Read the stick from `t` (s) on, until the operator counts as absent."""
    found = list[Stick | None]()
    while len(found) < seconds / TICK and None not in found:
        found.append(operator.read(t + TICK * len(found), SIGHT))
    return found


@pytest.mark.parametrize(("work", "pause"), [(70.0, 61.0), (30.0, 61.0), (70.0, 10.0), (0.2, 5.0)])
def test_a_pause_does_not_count_as_absence_and_releases_the_stick(
    wall: Wall, work: float, pause: float
) -> None:
    operator = Hand()
    sticks = fly(operator, 0.0, work)
    assert None not in sticks
    wall.now += pause
    operator.there = False
    after = fly(operator, TICK * len(sticks), 100.0)
    assert after[0] is not None and np.all(after[0].axes == 0.0)  # its last message is old
    assert TICK * len(after) == pytest.approx(PATIENCE_S, abs=1.0)


def test_a_stick_is_released_before_its_operator_is_absent(wall: Wall) -> None:
    operator = Hand()
    fly(operator, 0.0, 10.0)
    operator.there = False
    sticks = fly(operator, 10.0, 100.0)
    held = [s for s in sticks if s is not None and np.any(s.axes)]
    assert TICK * len(held) == pytest.approx(STALE_S, abs=2 * TICK)
    assert sticks[-1] is None and TICK * len(sticks) == pytest.approx(PATIENCE_S, abs=2 * TICK)
