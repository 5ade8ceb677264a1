"""Assembly of a vehicle: components become records in one arena and rows of a schedule.

Records are keyed by (class, name). The name is empty if only one component fills the class, else it
is the name of the component. `Me` is always keyed by the name of its component.
"""

from __future__ import annotations

import dataclasses
import uuid
import zlib
from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import blame
from skywright.core.record import Record, View
from skywright.core.streams import STREAMS, build_stream
from skywright.errors import InputError, SimulationError
from skywright.vehicle.arguments import check_seed
from skywright.vehicle.bus import Clock, Drive, MuJoCo, Setpoint, Truth
from skywright.vehicle.component import Component, Context, Draws, Output, ReferenceBlock
from skywright.vehicle.link_ends import NEAR, name_far, name_near
from skywright.vehicle.native import check_calls, compile_step, shorten_error
from skywright.vehicle.ordering import order_steps
from skywright.vehicle.ports import FILL, Port, Step, list_records, list_steps
from skywright.vehicle.schedule import ROW, count_calls
from skywright.vehicle.sensor_tables import get_table

BLOCK = 1000
"""Control ticks per block of random numbers; at least one mission tick."""
FAST_BLOCK = 2000
"""Physics steps per block of random numbers, for steps of the slot `fast`."""
ALIGN = 64  # bytes
Key = tuple[type[Record], str]


class Carried(NamedTuple):
    """A record that a link transmits: its address at the end that fills it, and at the other."""

    record: type[Record]
    source: int
    target: int


class Block(NamedTuple):
    """Random numbers of one component, drawn as a block."""

    component: Component
    draws: type[Draws]
    rng: np.random.Generator
    fast: bool
    places: list[tuple[int, int]]  # (row, index of the draw in it) of the readers


class State(NamedTuple):
    """A saved assembly; see Assembly.save."""

    arena: NDArray[np.uint8]
    blocks: list[NDArray[Any]]
    generators: list[Any]
    owner: str  # token of the assembly: the arena contains addresses of its memory


class Assembly:
    """The records and the schedule of a vehicle.

    `rows` is the table of the schedule (ROW). The first `n_control` rows run each control tick, the
    others after each physics step.
    """

    def __init__(self, components: Sequence[Component], context: Context, seed: int) -> None:
        """Build all components; raise InputError if they do not fit together."""
        check_calls()
        self.components, self.token = list(components), uuid.uuid4().hex
        names = [c.name for c in self.components]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise InputError(f"two components are named {twice[0]!r}; names must be unique")
        for c in self.components:
            _check_side(c)
        steps = [step for c in self.components for step in list_steps(c)]
        self._fillers: dict[type[Record], list[Step]] = defaultdict(list)
        for step in steps:
            for port in step.ports:
                if port.use == FILL and port.record is not _me(step.component):
                    self._fillers[port.record].append(step)
        self.memories = {_me(c) for c in self.components}
        self._linked = {s.slot for s in steps if s.component.group == "link"}
        self._check_ports(steps)
        self.steps = order_steps(steps, self.resolve)
        self.steps.sort(key=lambda s: s.slot == "fast")
        self._own_records(context)
        context = dataclasses.replace(context, records=self.records, components=self.components)
        self.context, limited = context, self.limit(context)
        for c in dict.fromkeys(step.component for step in self.steps):  # writers before readers
            me = self.records.get((_me(c), c.name))
            given = limited if c.side == "robot" else context
            given = dataclasses.replace(given, carried=self._list_carried(c))
            with blame(type(c), f"component {c.name!r}: build"):
                c.build(None if me is None else View(me[0]), get_table(c, given), given)
        self.n_control = sum(s.slot != "fast" for s in self.steps)
        self._build_rows(context, limited)
        self._build_blocks(seed)

    # --- ports -----------------------------------------------------------------------------------

    def resolve(self, step: Step, port: Port) -> Key | None:
        """Return the key of the record of a port; None for an absent optional one."""
        record, component = port.record, step.component
        if record is _me(component):
            return record, component.name
        if record in (Clock, MuJoCo) or issubclass(record, ReferenceBlock):
            return record, ""
        fillers = self._fillers.get(record, [])
        owners = list(dict.fromkeys(s.component.name for s in fillers))
        wanted = component.ports.get(port.name, "")
        if not owners or (port.optional and wanted and wanted not in owners):
            return None
        if len({type(s.component) for s in fillers}) > 1 or len(owners) == 1:
            name = ""
        elif component.name in owners:
            name = component.name
        else:
            name = wanted
            if name not in owners:
                raise InputError(
                    f"{step.label}: {record.__qualname__} is filled by several components: select "
                    f"one in `ports`, {{{port.name!r}: NAME}}; valid: {', '.join(owners)}"
                )
        return record, name_near(name) if self._is_near(step, port) else name

    def _is_near(self, step: Step, port: Port) -> bool:
        """Whether a port is at the end of a link where its record is filled."""
        if step.component.group == "link":
            return False
        plant = step.component.side == "plant"
        if issubclass(port.record, Drive):
            return "downlink" in self._linked and not plant
        return "link" in self._linked and plant and self._goes_up(port.record)

    def _goes_up(self, record: type[Record]) -> bool:
        fillers = self._fillers.get(record, [])
        return issubclass(record, Output) and any(s.slot == "sense" for s in fillers)

    def _check_ports(self, steps: list[Step]) -> None:
        """Raise InputError for unfilled ports, and for plant records on the robot's side."""
        for step in steps:
            for port in step.ports:
                record = port.record
                if issubclass(record, Draws) or record is _me(step.component):
                    continue
                if step.component.side == "robot" and self._is_plants(record):
                    raise InputError(
                        f"{step.label} runs on the robot and cannot read "
                        f"{record.__qualname__} of the plant: use a sensor's output, or "
                        "Estimate"
                    )
                if record in (Clock, MuJoCo) or issubclass(record, ReferenceBlock):
                    continue
                if record in self._fillers or port.optional:
                    continue
                offered = sorted(r.__qualname__ for r in self._fillers)
                raise InputError(
                    f"{step.label} reads {record.__qualname__}, which no component of this "
                    f"vehicle fills; available: {', '.join(offered)}"
                )

    def _is_plants(self, record: type[Record]) -> bool:
        if record in (Truth, MuJoCo):
            return True
        fillers = [] if issubclass(record, Setpoint) else self._fillers.get(record, [])
        return any(s.component.side == "plant" for s in fillers) and not self._goes_up(record)

    def limit(self, context: Context) -> Context:
        """Return the context of the robot's side, without records and components of the plant."""
        robot = [c for c in self.components if c.side == "robot"]
        named = tuple(c for c in context.named if c.side == "robot")
        memories = {(_me(c), c.name) for c in self.components if c.side == "plant"}
        seen = {
            key: view
            for key, view in self.records.items()
            if key not in memories
            and not self._is_plants(key[0])
            and not (key[1].endswith(NEAR) and self._goes_up(key[0]))
        }
        return dataclasses.replace(context.limit(), records=seen, components=robot, named=named)

    # --- records ---------------------------------------------------------------------------------

    def _own_records(self, context: Context) -> None:
        """Allocate all records in one arena; `self.records` are (1,) views of it."""
        keys: dict[Key, None] = {(Clock, ""): None, (MuJoCo, ""): None}
        for c in self.components:
            if _me(c) is not Record:
                keys[(_me(c), c.name)] = None
        for step in self.steps:
            for port in step.ports:
                key = None if issubclass(port.record, Draws) else self.resolve(step, port)
                if key is not None:
                    far = name_far(key[1])
                    keys[key] = keys[key[0], far] = None
                    if issubclass(key[0], Setpoint) and "downlink" in self._linked:
                        keys[key[0], name_near(far)] = None  # filled by a mission
        sizes = [-(-r.dtype.itemsize // ALIGN) * ALIGN for r, _ in keys]
        raw = np.zeros(sum(sizes) + ALIGN, np.uint8)
        first = -raw.ctypes.data % ALIGN
        self.arena = raw[first : first + sum(sizes)]
        self.records: dict[Any, NDArray[Any]] = {}
        at = 0
        for (record, name), size in zip(keys, sizes, strict=True):
            view = self.arena[at : at + record.dtype.itemsize].view(record.dtype)
            self.records[record, name] = view
            at += size
        self.alive = context.alive

    def get(self, record: type[Record], name: str = "") -> Any:
        """Return a view of a record, at the robot's end of a link.

        Raises KeyError if no component fills it.
        """
        return self.records[record, name][0]

    def address(self, record: type[Record], name: str = "") -> int:
        """Return the address of a record; raise KeyError if no component fills it."""
        return int(self.records[record, name].ctypes.data)

    def _list_carried(self, component: Component) -> list[Carried]:
        """Return the records that a link transmits, in both directions."""
        if component.group != "link":
            return []
        out = []
        for (record, name), view in self.records.items():
            if not name.endswith(NEAR):
                continue
            far = self.records[record, name_far(name)]
            out.append(Carried(record, view.ctypes.data, far.ctypes.data))
        return out

    # --- rows ------------------------------------------------------------------------------------

    def _build_rows(self, context: Context, limited: Context) -> None:
        self.rows = np.zeros(len(self.steps), ROW)
        self._reads: dict[tuple[Component, type[Draws]], list[tuple[int, int]]] = defaultdict(list)
        for i, step in enumerate(self.steps):
            row = self.rows[i]
            given = limited if step.component.side == "robot" else context
            with blame(type(step.component), f"component {step.component.name!r}: get_period"):
                period = step.component.get_period(step.name, given)
            row["every"], row["calls"] = count_calls(period, context.dt)
            row["fast"], row["n"] = step.slot == "fast", len(step.ports)
            types = [self._fill_port(i, k, step, port) for k, port in enumerate(step.ports)]
            if step.component.compiled:
                row["function"] = self._compile(step, types)

    def _fill_port(self, i: int, k: int, step: Step, port: Port) -> np.dtype[Any] | None:
        row = self.rows[i]
        if issubclass(port.record, Draws):
            d = int(row["n_draws"])
            row["draw_port"][d], row["n_draws"] = k, d + 1
            row["draw_stride"][d] = port.record.dtype.itemsize
            self._reads[step.component, port.record].append((i, d))
            return port.record.dtype
        key = self.resolve(step, port)
        if key is None:
            return None
        row["ports"][k] = self.records[key].ctypes.data
        return port.record.dtype

    def _compile(self, step: Step, types: list[np.dtype[Any] | None]) -> int:
        try:
            address, code = compile_step(step.compiled, types)
        except Exception as error:  # numba raises errors of any class
            code_ = step.function.__code__
            raise InputError(
                f"{step.label} does not compile ({code_.co_filename}:{code_.co_firstlineno}): "
                f"{shorten_error(error)}"
            ) from error
        self.alive.append(code)
        return address

    def list_python_rows(self) -> list[int]:
        """Return the rows that run as plain Python."""
        return [i for i in range(len(self.rows)) if self.rows["function"][i] == 0]

    def run_python(self, i: int) -> None:
        """Run row `i` as plain Python, on the same records."""
        step, row, clock = self.steps[i], self.rows[i], self.get(Clock)
        given: list[Any] = []
        for port in step.ports:
            if issubclass(port.record, Draws):
                block = self._find_block(step.component, port.record)
                index = int(clock["fast" if row["fast"] else "block"])
                given.append(View(block[index : index + 1].view(port.record.dtype).reshape(-1)[0]))
                continue
            key = self.resolve(step, port)
            given.append(None if key is None else View(self.records[key][0]))
        step.function(*given)

    # --- draws -----------------------------------------------------------------------------------

    def _build_blocks(self, seed: int) -> None:
        generators: dict[str, np.random.Generator] = {}
        self._blocks: list[Block] = []
        self._drawn: list[NDArray[Any]] = []
        for (component, draws), places in self._reads.items():
            name = draws.stream
            if name not in STREAMS or (name in generators and _is_repeated(component, self)):
                name = f"{component.name} {draws.__qualname__}"
            if name not in generators:
                key = zlib.crc32(name.encode()) + (1 << 32)  # beyond the keys of named streams
                generators[name] = (
                    build_stream(seed, name)
                    if name in STREAMS
                    else np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key,)))
                )
            fast = bool(self.rows["fast"][places[0][0]])
            self._blocks.append(Block(component, draws, generators[name], fast, places))
            self._drawn.append(np.zeros((0, 0)))
        self._generators = list(generators.values())
        clock = self.get(Clock)
        clock["block"], clock["fast"] = BLOCK, FAST_BLOCK

    def refill(self, n_ticks: int, n_steps: int) -> None:
        """Draw new blocks if the present ones end within the next `n_ticks` control ticks."""
        clock = self.get(Clock)
        for fast, name, size, need in (
            (False, "block", BLOCK, n_ticks), (True, "fast", FAST_BLOCK, n_ticks * n_steps),
        ):  # fmt: skip
            if clock[name] + need <= size:
                continue
            clock[name] = 0
            for i, block in enumerate(self._blocks):
                if block.fast == fast:
                    c = block.component
                    with blame(type(c), f"component {c.name!r}: draw", SimulationError):
                        drawn = np.ascontiguousarray(
                            c.draw(block.draws, block.rng, size), np.float64
                        )
                    self._place(i, drawn)

    def _place(self, i: int, drawn: NDArray[Any]) -> None:
        self._drawn[i] = drawn
        for row, k in self._blocks[i].places:
            self.rows[row]["draw_base"][k] = drawn.ctypes.data

    def _find_block(self, component: Component, draws: type[Draws]) -> NDArray[Any]:
        return next(
            drawn
            for block, drawn in zip(self._blocks, self._drawn, strict=True)
            if block.component is component and block.draws is draws
        )

    # --- save and restore ------------------------------------------------------------------------

    def save(self) -> State:
        """Return copies of all records and random states; blocks are immutable and not copied."""
        states = [g.bit_generator.state for g in self._generators]
        return State(self.arena.copy(), list(self._drawn), states, self.token)

    def restore(self, state: State, seed: int | None = None) -> None:
        """Restore a saved state; with a `seed` the following random numbers are drawn from it.

        Raises InputError, and changes nothing, for a state of another assembly or a wrong seed.
        """
        if state.owner != self.token:
            raise InputError(
                "restore: this state was saved by another vehicle; valid: a state of this vehicle"
            )
        check_seed(seed)
        self.arena[:] = state.arena
        for i, drawn in enumerate(state.blocks):
            self._place(i, drawn)
        for generator, saved in zip(self._generators, state.generators, strict=True):
            generator.bit_generator.state = saved
        if seed is not None:
            self._build_blocks(seed)


def _check_side(component: Component) -> None:
    """Raise InputError for a law or an estimator on the plant's side, unless it `is_truth`."""
    if component.side == "robot" or component.group not in ("law", "arms_law", "estimator"):
        return
    if not getattr(component, "is_truth", False):
        raise InputError(
            f"component {component.name!r} is a {component.group.replace('_', ' ')} with "
            "side = 'plant', but runs on the robot; only an estimator with is_truth = "
            "True may read the truth, and reports state it"
        )


def _me(component: Component) -> type[Record]:
    return list_records(type(component)).get("Me", Record)


def _is_repeated(component: Component, assembly: Assembly) -> bool:
    return sum(type(c) is type(component) for c in assembly.components) > 1
