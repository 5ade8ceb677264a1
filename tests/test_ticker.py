"""Running an assembly over a physics that counts: guards, errors, and steps that never return."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from skywright.core.record import Record
from skywright.errors import SimulationError
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Component, Context, Out
from skywright.vehicle.ticker import Ticker, list_stretches
from skywright.vehicle.time_limit import watch


class Total(Record):
    v: float


class Guard(Component):
    slot = "guard"

    class Me(Record):
        n: float

    @staticmethod
    def step(me: Me, clock: Clock, total: Out[Total]) -> None:
        me.n += 1.0
        total.v = me.n
        if me.n > 24.5:
            clock.fired |= 2


class Sampler(Component):
    slots = {"sample": "fast", "step": "observe"}
    slot = "observe"

    class Me(Record):
        n: float

    @staticmethod
    def sample(me: Me) -> None:
        me.n += 1.0

    @staticmethod
    def step(me: Me, clock: Clock) -> None:
        if clock.tick * 2 != me.n:
            raise ValueError("a step of the physics was not sampled")


class PythonGuard(Guard):
    compiled = False


class Raises(Component):
    slot = "control"
    compiled = False

    @staticmethod
    def step(clock: Clock) -> None:
        if clock.tick == 3:
            raise ValueError("no gain for this mass")


class Endless(Component):
    slot = "control"
    compiled = False

    @staticmethod
    def step(clock: Clock) -> None:
        while clock.tick >= 2:
            pass


class CountingPhysics:
    """In interactive mode a physics is whatever has a `step`."""

    model_address = data_address = 0

    def __init__(self) -> None:
        self.steps = 0

    def step(self, n: int) -> None:
        self.steps += n


def build(*components: Component) -> tuple[Ticker, CountingPhysics]:
    robot: Any = SimpleNamespace()
    a = Assembly(
        components,
        Context(robot, robot, 1.0, 0.002, 0.001, "", frozenset(), {}, robot),
        1,
    )
    a.get(Clock)["dt"] = 0.002
    a.refill(1000, 2)
    physics = CountingPhysics()
    return Ticker(a, physics, 2), physics


@pytest.mark.parametrize("guard", [Guard, PythonGuard])
def test_a_guard_ends_a_mission_tick_after_the_physics_of_its_tick(guard: type[Component]):
    ticker, physics = build(guard("guard"), Sampler("sampler"))
    ticker.run(10, interactive=True)
    ticker.run(10, interactive=True)
    assert physics.steps == 40 and ticker.t == pytest.approx(0.04)
    ticker.run(10, interactive=True)
    assert physics.steps == 50 and int(ticker.assembly.get(Clock)["fired"]) == 2
    assert float(ticker.assembly.get(Total)["v"]) == 25.0


def test_a_python_step_that_raises_is_named():
    ticker, _ = build(Raises("law"))
    with pytest.raises(SimulationError, match=r"component law .Raises.step. raised at t = 0.006 s"):
        ticker.run(10, interactive=True)


def test_a_python_step_that_never_returns_is_interrupted():
    ticker, _ = build(Endless("law"))
    started = time.monotonic()
    with (
        watch(ticker, lambda says: pytest.fail(says), limit=0.5),
        pytest.raises(SimulationError, match=r"component law .Endless.step. did not return within"),
    ):
        ticker.run(10, interactive=True)
    assert time.monotonic() - started < 60.0


def test_compiled_code_that_never_returns_is_named_and_the_process_ended():
    code = """
        import os, sys
        sys.path.insert(0, {tests!r})
        import test_ticker as t
        from skywright.vehicle.time_limit import watch

        class Loop(t.Endless):
            compiled = True

        def stop(says):
            print(says, flush=True)
            os._exit(3)

        ticker, _ = t.build(Loop("law"))
        with watch(ticker, stop, limit=0.5):
            ticker.run(10, interactive=True)
    """
    script = textwrap.dedent(code).format(tests=str(Path(__file__).parent))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 3, done.stderr
    assert "component law (Loop.step) did not return within 0.5 s at t = 0.004 s" in done.stdout


def test_stretches_cover_all_rows_in_order():
    assert list_stretches(0, 5, []) == [(0, 5)]
    assert list_stretches(0, 5, [0, 2, 4]) == [(0, -1), (1, 2), (2, -1), (3, 4), (4, -1)]
    assert list_stretches(3, 5, [0, 2, 4]) == [(3, 4), (4, -1)]
    assert list_stretches(2, 2, []) == []
