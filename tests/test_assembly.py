"""Assemblies of small components: ports, order, draws, both ways of running, save and restore."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np
import pytest

from skywright.core.record import Array, Record, Vec3, View, fill
from skywright.core.spec import Positive, Spec
from skywright.errors import InputError
from skywright.vehicle.assembly import BLOCK, Assembly
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import (
    Component,
    Context,
    InOut,
    Normal,
    Out,
    Output,
    ReferenceBlock,
    Sensor,
    Uniform,
    helper,
)
from skywright.vehicle.follower import Press, check_field
from skywright.vehicle.native import read_error
from skywright.vehicle.schedule import end_control, is_due, run_rows


class Count(Output):
    fresh: float
    n: float


class Level(Output):
    fresh: float
    v: float


class Total(Record):
    v: float
    trace: Vec3


class Counter(Component):
    """Counts its calls."""

    slot = "observe"
    side = "plant"

    class Me(Record):
        step_: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        me.step_ = 2.0

    @staticmethod
    def step(me: Me, clock: Clock, truth: Out[Truth]) -> None:
        truth.p_WB[0] += me.step_
        truth.v_WB[0] = clock.t


class Gauge(Sensor):
    class Table(Spec):
        rate_hz: Positive = 250.0
        noise: Positive = 0.1

    class Me(Record):
        noise: float
        sum: float

    class Noise(Normal):
        v: float
        w: float

    class Chance(Uniform):
        u: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        me.noise = table.noise

    @staticmethod
    def step(me: Me, truth: Truth, noise: Noise, chance: Chance, out: Out[Level]) -> None:
        me.sum += noise.w + chance.u
        out.fresh, out.v = 1.0, truth.p_WB[0] + me.noise * noise.v


@helper
def double(x: float) -> float:
    return 2.0 * x


class Doubler(Component):
    """Reads a sensor and an optional port that nothing fills."""

    slot = "estimate"

    @staticmethod
    def step(level: Level, count: Count | None, total: Out[Total]) -> None:
        total.v = double(level.v)
        if count is not None:
            total.v = -1.0


class Shifter(Component):
    slot = "estimate"

    @staticmethod
    def step(clock: Clock, total: InOut[Total]) -> None:
        for i in range(3):
            total.trace[i] = total.v + i
        total.v += 1.0


def build_context(dt: float = 0.002) -> Context:
    robot: Any = SimpleNamespace()
    return Context(robot, robot, 1.0, dt, 0.001, "none", frozenset(), {}, robot)


def assemble(*components: Component, seed: int = 1) -> Assembly:
    return Assembly(components, build_context(), seed)


def run(a: Assembly, ticks: int, python: bool = False) -> list[float]:
    """Run control ticks row by row; `python` runs all rows as plain Python."""
    clock = a.get(Clock)
    clock["dt"] = 0.002
    seen = []
    for _ in range(ticks):
        a.refill(1, 2)
        if python:
            for i in range(a.n_control):
                row = a.rows[i]
                if is_due(clock["tick"], row["every"], row["calls"], row["phase"]):
                    a.run_python(i)
        elif run_rows(a.rows.ctypes.data, 0, a.n_control, a.address(Clock)):
            break
        end_control(a.address(Clock))
        seen.append(float(a.get(Total)["v"]) if (Total, "") in a.records else 0.0)
    return seen


def build_all(seed: int = 1, shuffle: int = 0) -> Assembly:
    parts = [
        Counter("counter"),
        Gauge("gauge", Gauge.Table()),
        Doubler("doubler"),
        Shifter("shift"),
    ]
    np.random.default_rng(shuffle).shuffle(parts)  # type: ignore[arg-type]
    return assemble(*parts, seed=seed)


def test_rows_run_in_the_order_of_slots_and_of_who_fills_what():
    orders = [[s.component.name for s in build_all(shuffle=k).steps] for k in range(4)]
    assert orders == [["counter", "gauge", "doubler", "shift"]] * 4
    a = build_all()
    values = run(a, 3)
    truth, level = a.get(Truth), a.get(Level)
    assert truth["p_WB"][0] == 6.0 and truth["v_WB"][0] == pytest.approx(0.004)
    assert values[-1] == 2.0 * level["v"] + 1.0
    assert list(a.get(Total)["trace"]) == [values[-1] - 1.0 + i for i in range(3)]


def test_a_sensor_runs_at_its_rate_and_its_noise_is_white():
    a = build_all()
    noise = []
    for _ in range(400):
        before = float(a.get(Gauge.Me, "gauge")["sum"])
        run(a, 1)
        noise.append(float(a.get(Gauge.Me, "gauge")["sum"]) - before)
    assert np.count_nonzero(noise) == 200  # 250 Hz at 500 Hz
    drawn = np.array(noise)[np.nonzero(noise)]
    assert np.std(drawn) == pytest.approx(np.sqrt(1.0 + 1.0 / 12.0), rel=0.15)
    assert len(np.unique(drawn)) == 200


def test_both_ways_of_running_are_bit_identical_over_blocks():
    ticks = BLOCK + 50
    assert run(build_all(), ticks) == run(build_all(), ticks, python=True)


def test_seeds_change_the_noise_and_other_components_do_not():
    alone = assemble(Counter("counter"), Gauge("gauge", Gauge.Table()), Doubler("doubler"))
    more = assemble(
        Counter("counter"), Gauge("another", Gauge.Table()), Gauge("gauge", Gauge.Table()),
        Reader("doubler"),
    )  # fmt: skip
    assert run(alone, 50) == run(more, 50)
    assert run(build_all(seed=1), 50) != run(build_all(seed=2), 50)


class Reader(Component):
    """Says which of several gauges it reads."""

    slot = "estimate"
    ports = {"level": "gauge"}

    @staticmethod
    def step(level: Level, total: Out[Total]) -> None:
        total.v = 2.0 * level.v


def test_of_several_instances_a_reader_names_one():
    with pytest.raises(InputError, match=r"select one in `ports`.*valid: another, gauge"):
        assemble(
            Counter("counter"), Gauge("another", Gauge.Table()), Gauge("gauge", Gauge.Table()),
            Doubler("doubler"),
        )  # fmt: skip


def test_saved_and_restored_it_repeats_bit_for_bit():
    a = build_all()
    run(a, BLOCK - 20)
    state = a.save()
    first = run(a, 60)  # over the end of a block
    a.restore(state)
    assert run(a, 60) == first
    a.restore(state, seed=7)
    other = run(a, 60)
    assert other != first
    a.restore(state, seed=7)
    assert run(a, 60) == other


class Failing(Component):
    slot = "control"

    class Me(Record):
        n: float

    @staticmethod
    def step(me: Me, total: InOut[Total]) -> None:
        me.n += 1.0
        if me.n > 3.0:
            raise ValueError("gain table exceeded")


def test_a_step_that_raises_is_told_with_file_and_line():
    a = assemble(
        Counter("counter"), Gauge("gauge", Gauge.Table()), Doubler("doubler"), Failing("fails")
    )
    assert len(run(a, 10)) == 3
    clock = a.get(Clock)
    error, place = read_error(int(clock["error"]))
    assert a.steps[int(clock["failed"])].component.name == "fails"
    assert repr(error) == "ValueError('gain table exceeded')"
    line = Failing.step.__code__.co_firstlineno
    assert place.rpartition(":")[0].endswith("test_assembly.py")
    assert line < int(place.rpartition(":")[2]) <= line + 5


class Cheat(Component):
    slot = "control"

    @staticmethod
    def step(truth: Truth, total: InOut[Total]) -> None:
        total.v = truth.p_WB[0]


class Stepless(Component):
    slot = "control"


class Unmarked(Component):
    slot = "control"

    @staticmethod
    def step(total) -> None:  # type: ignore[no-untyped-def]
        total.v = 0.0


class Misspelt(Component):
    slot = "control"

    @staticmethod
    def step(total: Out[Total]) -> None:
        total.velocity = 1.0


class Late(Component):
    slot = "contrl"

    @staticmethod
    def step(total: Out[Total]) -> None:
        total.v = 0.0


class NeedsA(Component):
    slot = "control"

    @staticmethod
    def step(total: Total, count: Out[Count]) -> None:
        count.n = total.v


class NeedsB(Component):
    slot = "control"

    @staticmethod
    def step(count: Count, total: Out[Total]) -> None:
        total.v = count.n


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([Doubler("d")], "d .Doubler.step. reads Level, which no component of this vehicle fills"),
        ([Counter("c"), Counter("c")], "two components are named 'c'"),
        ([Counter("c"), NeedsB("b"), NeedsA("a"), Cheat("law")], "cannot read Truth of the plant"),
        ([Stepless("law")], "Stepless has no static method 'step'"),
        ([Unmarked("law")], "parameter 'total' has no annotation"),
        ([Late("law")], "slot 'contrl' of Late.step is unknown; valid: clear, observe"),
        ([NeedsA("a"), NeedsB("b")], "each reads the output of the next"),
        ([NeedsB("b"), Misspelt("law"), NeedsA("a")], "both fill Total"),
        ([Misspelt("law")], r"does not compile .*test_assembly.py:\d+.*velocity"),
    ],
)
def test_what_does_not_fit_is_refused(parts: list[Component], message: str):
    with pytest.raises(InputError, match=message):
        assemble(*parts)


class Inner(Record):
    a: Vec3


class Base(Record):
    x: float
    n: int


class Whole(Base):
    inner: Inner
    y: float


def test_records_inherit_nest_and_copy_by_name():
    assert Whole.dtype.names == ("x", "n", "inner", "y") and Whole.dtype.itemsize == 48
    one, other = np.zeros(1, Whole.dtype), np.ones(1, Base.dtype)
    view = View(one[0])
    view.inner.a[1], view.y = 3.0, 2.0
    assert one["inner"]["a"][0, 1] == 3.0 and one["y"][0] == 2.0
    with pytest.raises(AttributeError, match="no field 'z'; valid: x, n, inner, y"):
        view.z = 1.0
    view.y = 0.0
    fill(one[0], other[0])
    assert one["x"][0] == 1.0 and one["n"][0] == 1 and one["y"][0] == 0.0
    with pytest.raises(TypeError, match=r"Wrong.name: .* is not a type of a field; valid: float"):
        type("Wrong", (Record,), {"__annotations__": {"name": str}})
    with pytest.raises(TypeError, match="is not a type of a field"):
        type("Wrong", (Record,), {"__annotations__": {"v": Array}})


def test_context_is_not_changed_by_a_component():
    with pytest.raises(dataclasses.FrozenInstanceError):
        build_context().dt = 1.0  # type: ignore[misc]


def test_a_block_of_the_reference_has_fields_of_a_row_alone() -> None:
    class Misspelt(ReferenceBlock):
        forces: float

    class Short(ReferenceBlock):
        f_feet_B: Annotated[Array, 2]

    for block, known, says in (
        (Misspelt, (), "Misspelt.forces: a row has no such field; valid: t, "),
        (Short, (), r"Short.f_feet_B is .*; valid: .*\(3,\)"),
        (Press, ("force",), "Press.force: another record has this field"),
    ):
        with pytest.raises(InputError, match=says):
            for name in block.dtype.names:
                check_field(block, name, known)
