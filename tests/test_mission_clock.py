"""Durations of free flight: a time for which a pilot flies does not count."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.missions.scan.fly import TRIM_TIMES, _trim
from skywright.missions.sensor_install.fly import WATCH_S, _check_swing, _watch_hand

AWAY = 30.0  # s, for which a pilot flies in the third tick


class Interrupted:
    """A supervisor whose third tick includes the flight of a pilot."""

    def __init__(self, update: Any = lambda s: None) -> None:
        self.update, self.n, self.clock, self.phase = update, 0, 0.0, ""
        zero = {"p_WT": np.zeros(3), "q": np.zeros(2), "qd": np.zeros(2)}
        hands = SimpleNamespace(p_WH=np.zeros((1, 3)), swing=0)
        self.vehicle = SimpleNamespace(
            t=0.0, reference={"p_WT": np.zeros(3)}, estimate=zero, read=lambda record: hands
        )
        self.body = SimpleNamespace(hold=lambda: None)
        self.devices = SimpleNamespace(helper=SimpleNamespace(push=lambda name, force: None))

    def begin(self, name: str) -> None:
        self.phase = name

    def end(self, outcome: str) -> None:
        pass

    def wait(self, seconds: float) -> None:
        pass

    def tick(self) -> Any:
        self.n += 1
        self.clock += 0.02
        self.vehicle.t = self.clock + (AWAY if self.n > 2 else 0.0)
        self.update(self)
        return SimpleNamespace(t=self.vehicle.t)


def test_the_integral_settles_after_the_pilot_has_given_back() -> None:
    def err(s: Interrupted) -> None:
        s.vehicle.estimate["p_WT"][0] = 0.02 if s.clock < 5.0 else 0.0

    s: Any = Interrupted(err)
    _trim(s)
    assert s.clock == pytest.approx(6.0, abs=0.05)  # 1 s after the error has settled
    never: Any = Interrupted(lambda s: s.vehicle.estimate["p_WT"].fill(0.02))
    _trim(never)
    assert never.clock == pytest.approx(TRIM_TIMES[1], abs=0.05)


def test_a_hand_is_averaged_over_the_whole_time() -> None:
    s: Any = Interrupted()
    _watch_hand(s)
    assert s.clock == pytest.approx(WATCH_S, abs=0.03)


def test_a_push_goes_on_after_the_pilot_has_given_back() -> None:
    def swing(s: Interrupted) -> None:
        s.vehicle.estimate["q"][0] = 0.1 * s.clock

    s: Any = Interrupted(swing)
    way: Any = SimpleNamespace(yaw=0.0, swing_rad_s=3.0)
    assert _check_swing(s, 0.2, way)
    assert s.clock == pytest.approx(2.0, abs=0.05) and s.phase == "swing check"
