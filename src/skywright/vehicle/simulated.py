"""The physics back end: the perturbed plant and the robot, assembled from components.

Fast mode runs each mission tick in one compiled call. Interactive mode runs the schedule from
Python: components may be plain Python, and a debugger works. Both are bit-identical.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import blame
from skywright.core.record import View
from skywright.description.world.spec import World
from skywright.description.world.thing import Fixture
from skywright.errors import InputError, SimulationError
from skywright.models.arm_body import Deviation
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, compute_tip, joint_names, posture
from skywright.models.rotor_loss import RotorsLeft
from skywright.models.scene import TIMESTEP, build_scene, home_pose
from skywright.models.spring_bench import find_springs
from skywright.recordings.columns import Column, Stream, Topic
from skywright.vehicle.allocation import RotorAllocation
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import Allocated, Body, Clock, Estimate
from skywright.vehicle.component import Component, Estimator, Law, PlantContext
from skywright.vehicle.devices import DEVICES, Devices, find_bench
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.failed_step import Watchdog, explain_not_finite
from skywright.vehicle.follower import Follower, RowNow
from skywright.vehicle.guard import NOT_FINITE
from skywright.vehicle.instruments.eddy_current import EddyProbe
from skywright.vehicle.interface import R, Table, Ticked, build_limits
from skywright.vehicle.inventory import list_wanted
from skywright.vehicle.link_arc import compute_link_arc
from skywright.vehicle.observers.operator import Operator
from skywright.vehicle.pilot_switch import NoPilotSwitch
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.ports import list_steps, overrides
from skywright.vehicle.recorder import Recorder
from skywright.vehicle.saved import Saved
from skywright.vehicle.set_up import build_home_row, check_rate, fill_bus, list_offers
from skywright.vehicle.setpoints import Actuators
from skywright.vehicle.simulation import Simulation
from skywright.vehicle.streams import StreamRecorder
from skywright.vehicle.ticker import StepFailed, TickCount, Ticker
from skywright.vehicle.topics import list_topics

Array = NDArray[np.float64]
C = TypeVar("C", bound=Component)


class Recorded(NamedTuple):
    """The recorded columns, topics and streams of a run."""

    columns: tuple[Column, ...]
    topics: tuple[Topic, ...]
    streams: tuple[Stream, ...] = ()


class SimulatedVehicle(NoPilotSwitch):
    """A back end (vehicle.interface.Backend) that flies the plant."""

    offers: frozenset[str]
    refuses = ""
    n_ticks = TickCount()

    def __init__(
        self,
        nominal: Nominal,
        law: Law,
        estimator: Estimator,
        *,
        world: World | None = None,
        seed: int,
        deviation: Deviation,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
        interactive: bool = False,
        timestep: float = TIMESTEP,
        calibrated: bool = True,
        parts: Sequence[Component] = (),
        on_samples: Callable[[NDArray[Any]], None] | None = None,
    ) -> None:
        """`world` is the one flown in: with more things than that of `nominal`, and with pipe or
        structure where they truly are. Missions read these as `nominal` has them.

        `start` is x, y (m) and yaw (rad) of the take-off place; see Deviation for the plant.

        `parts` are further components: sensors and effects that the description names. `timestep`
        (s) is the physics step. Springs are `calibrated` with known loads, or the file's.
        Raises InputError where they do not fit together.
        """
        self.nominal, self.law, self.estimator = nominal, law, estimator
        self.robot, world = nominal.robot, world or nominal.world
        robot, known = nominal.robot, {n: getattr(nominal.world, n) for n in ("pipe", "structure")}
        self.world = world.model_copy(update=known)
        # surfaces at their position in the map are not built again
        true = nominal if world == self.world else Nominal(robot, world)
        self.interactive = interactive
        self.n_steps, self.dt = check_rate(robot, timestep)
        self.n_ticks = max(MISSION_TICK / self.dt, 1.0)

        def extend(spec: Any) -> None:
            for part in parts:
                with blame(type(part), f"component {part.name!r}: extend_scene"):
                    part.extend_scene(spec)

        self.scene = build_scene(robot, world, deviation, [extend], nominal=true, timestep=timestep)
        self.n_joints = self.scene.n_joints
        self.offers = list_offers(robot)
        self.limits = build_limits(robot)
        self.model, self.rotors = nominal.model, nominal.rotors
        self.arc = compute_link_arc(robot, self.model)
        home = home_pose(robot, world, *start)
        self.sim = Simulation(self.scene, home)
        context = PlantContext(
            nominal, world, compute_body(self.model, posture(robot, "working"))[0], self.dt,
            timestep, law.name, frozenset(), {},
            find_springs(robot, self.scene if calibrated else None, seed), deviation=deviation,
            scene=self.scene, sim=self.sim, seed=seed, start=start, true=true, known=self.world,
        )  # fmt: skip
        named = [
            law,
            *estimator.assemble(
                estimator.table, context if estimator.is_truth else context.limit()
            ),
            *parts,
        ]
        asked = {port.record for c in named for step in list_steps(c) for port in step.ports}
        context = dataclasses.replace(context, named=tuple(named), asked=frozenset(asked))
        self.assembly = Assembly([*named, *list_wanted(context)], context, seed)
        fill_bus(self.assembly, self.sim, self.scene, self.dt)
        self.ticker = Ticker(self.assembly, self.sim, self.n_steps)
        self.watchdog = Watchdog(self.assembly)
        self.interactive |= bool(self.assembly.list_python_rows())
        components = self.assembly.components
        self._before = [c for c in components if overrides(c, "before_tick")]
        self._after = [c for c in components if overrides(c, "after_tick")]
        self._follower, self._recorder = self.find(Follower), self.find(Recorder)
        self._raw = [c for c in components if isinstance(c, StreamRecorder)]
        self.on_samples, self.order = on_samples, ""  # by an operator: "abort" or "land"
        self.on_stream: Callable[[str, NDArray[Any]], None] | None = None
        self.track(build_home_row(nominal, world, home, start[2]))

    def find(self, kind: type[C]) -> C:
        """Return the component of a class; raises InputError if the vehicle has none."""
        found = next((c for c in self.assembly.components if isinstance(c, kind)), None)
        if found is None:
            raise InputError(f"{self.robot.name!r} in {self.world.name!r} has no {kind.__name__}")
        return found

    def read(self, record: type[R], name: str = "") -> R:
        """Return a copy of a record; `name` is the component that fills it, if several do.

        Raises InputError if no component of this vehicle fills it.
        """
        return cast(R, View(cast(View, self.look(record, name)).copy()))

    def look(self, record: type[R], name: str = "") -> R:
        """Return a record itself, which must not be modified; raises as `read` does."""
        try:
            return cast(R, View(self.assembly.get(record, name)))
        except KeyError:
            raise InputError(
                f"no component of {self.robot.name!r} in {self.world.name!r} fills "
                f"{record.__name__}"
            ) from None

    @property
    def t(self) -> float:
        """Mission time (s)."""
        return self.ticker.t

    @property
    def reference(self) -> Any:
        """A copy of the REFERENCE row at the last control tick."""
        return self._follower.read_row()

    @property
    def reference_now(self) -> RowNow:
        """The same without a copy."""
        return RowNow(self._follower)

    @property
    def estimate(self) -> Any:
        """A copy of Estimate at the last control tick."""
        return self.read(Estimate)

    @property
    def localised(self) -> bool:
        """Whether the estimator has started."""
        return bool(self.look(EstimatorState).ready > 0.0)

    @property
    def fix_age(self) -> float:
        """Time (s) since the last position fix."""
        return self.t - float(self.assembly.get(EstimatorState)["heard"])

    @property
    def saturated(self) -> bool:
        """Whether the rotors could not produce the wrench commanded at the last control tick."""
        return bool(self.assembly.get(Allocated)["saturated"] > 0.0)

    @property
    def force(self) -> float:
        """Force (N) of the tip at the last control tick, from the probe's sensor."""
        return float(self.assembly.get(Estimate)["f_tip"])

    @property
    def pose_std(self) -> float:
        """Largest standard deviation (m) of the estimated position; NaN if unknown."""
        return float(self.look(EstimatorState).pose_std)

    def track(self, table: Table) -> None:
        """Follow `table` from now on; after its end the reference stays at its last row."""
        self._table = np.ascontiguousarray(table)
        self._table_start, self._table_end = self.t, float(self._table[-1]["t"])
        self._follower.track(self._table, self.t)

    @property
    def tracking(self) -> tuple[Table, float]:
        """The table that is tracked, and the time (s) along it."""
        return self._table, self.t - self._table_start

    def tick(self, guards: int = 0) -> Ticked:
        """Run one mission tick; raises StepFailed (a step of the robot) or SimulationError."""
        clock = self.assembly.get(Clock)
        clock["mask"], clock["fired"] = guards, 0
        self.watchdog.look(self.t)
        self.assembly.refill(self.n_ticks, self.n_steps)
        for c in self._before:
            with blame(type(c), f"component {c.name!r}: before_tick", SimulationError):
                c.before_tick(self.t, self.n_ticks)
        self.ticker.run(self.n_ticks, self.interactive)
        if self._recorder.is_full or any(c.is_full for c in self._raw):
            self.flush()
        fired = int(clock["fired"])
        if fired & NOT_FINITE:
            raise explain_not_finite(self.assembly, self.law, self.t)
        for c in self._after:
            with blame(type(c), f"component {c.name!r}: after_tick", SimulationError):
                c.after_tick(self.t)
        return Ticked(self.t, fired, self.t - self._table_start >= self._table_end - 1e-9)

    def flush(self) -> None:
        """Deliver the samples, and raw samples by their topic, taken since the last delivery."""
        samples = self._recorder.take()
        if len(samples) and self.on_samples is not None:
            self.on_samples(samples)
        for recorder in self._raw:
            for topic, rows in recorder.take():
                if self.on_stream is not None:
                    self.on_stream(topic, rows)

    def save(self) -> Saved:
        """Return the state on which the next tick depends; see restore."""
        parts = {c.name: c.save() for c in self.assembly.components}
        return Saved(
            self.assembly.save(), self.sim.save(), self._table, self._table_start, parts,
            self.watchdog.save(), self.order,
        )  # fmt: skip

    def restore(self, saved: Saved, seed: int | None = None) -> None:
        """Restore a state that this vehicle saved: the same ticks follow bit for bit.

        With a `seed`, the noise from then on is that of this seed. Samples not yet delivered at
        either time are discarded. Raises InputError, and changes nothing, for a state of another
        vehicle or a wrong seed.
        """
        if not isinstance(saved, Saved):
            raise InputError(f"restore: {saved!r:.60}; valid: a state that save() returned")
        self.assembly.restore(saved.assembly, seed)
        self.sim.restore(saved.physics)
        for c in self.assembly.components:
            c.restore(saved.parts[c.name])
            if seed is not None:
                c.reseed(seed)
        self.watchdog.restore(saved.watchdog)
        self.order = saved.order
        self._table, self._table_start = saved.table, saved.table_start
        self._table_end = float(self._table[-1]["t"])
        self._recorder.take()
        for recorder in self._raw:
            recorder.take()

    def tip_of(self, row: Any) -> tuple[Array, Array]:
        """Nominal (p_WT, R_WT) of a row's platform pose and joints."""
        p_BT, R_BT = compute_tip(self.model, row["q"])
        return row["p_WB"] + row["R_WB"] @ p_BT, row["R_WB"] @ R_BT

    def get_memory(self, name: str) -> View:
        """Return parameters and state of component `name`, to modify; InputError if unknown."""
        for (record, owner), rows in self.assembly.records.items():
            if owner == name and record in self.assembly.memories:
                return View(rows[0])
        names = ", ".join(c.name for c in self.assembly.components)
        raise InputError(f"no component {name!r} with state; components: {names}")

    def read_memory(self, name: str) -> Any:
        """Return a copy of the record of `get_memory`."""
        return self.get_memory(name).copy()

    @property
    def actuators(self) -> Actuators:
        """Values that a mission sets of actuators, by the names of their columns."""
        return Actuators(self._recorder.setpoints)

    @property
    def devices(self) -> Devices:
        """All devices; built on demand, to avoid a reference cycle."""
        return Devices(self, frozenset(DEVICES))

    @property
    def recorded(self) -> Recorded:
        """The recorded columns, topics and streams."""
        columns = self._recorder.list_columns()
        joints, n_rotors = joint_names(self.robot), len(self.nominal.rotors.axis)
        streams = [b.stream for c in self._raw for b in c.buffers]
        return Recorded(columns, list_topics(columns, joints, n_rotors), tuple(streams))

    @property
    def last_sample(self) -> Any:
        """The newest sample, as an array (1,) that later ticks overwrite: copy it to keep it."""
        return self._recorder.last

    def in_contact(self) -> bool:
        """Whether the instrument's lift-off signal indicates contact."""
        found = self.assembly.records.get((EddyProbe.Reading, ""))
        return found is not None and bool(found["in_contact"][0])

    def calibrate_probe(self, null: Array, axis: Array) -> None:
        """Judge contact by how far the signal is from `null` (2,), in units, along `axis` (2,)."""
        me = self.get_memory("eddy current")
        me.null[:], me.lift_axis[:] = null, axis

    def give_up_rotor(self, i: int) -> RotorsLeft | None:
        """Allocate to the other rotors from now on; returns None if they cannot hold the robot.

        No tilt is planned for a law that directs its thrust by tilting the platform.
        """
        body, law, allocation = self.read(Body), self.find(Law), self.find(RotorAllocation)
        left = allocation.give_up(
            self.get_memory(allocation.name), i, float(body.mass * body.gravity), body.p_BC,
            math.radians(self.robot.control.tilt_max_deg) if law.needs_full_actuation else 0.0,
        )  # fmt: skip
        if left is not None:
            law.give_up_rotor(self.get_memory(law.name), left)
        return left

    @property
    def has_link(self) -> bool:
        """Whether there is a control link between robot and controller."""
        return any(c.group == "link" for c in self.assembly.components)

    def tune_law(self, tuned: Law, nominal: Nominal) -> None:
        """Set the gains of the law to those of `tuned`, built for a nominal robot and world; the
        law's state is kept. A law that restarts has them, too. Raises InputError, and changes
        nothing, if there are no such gains."""
        given = self.assembly.limit(self.assembly.context)
        given = dataclasses.replace(given, nominal=nominal, world=nominal.world)
        key = next(
            (record, owner) for record, owner in self.assembly.records
            if owner == self.law.name and record in self.assembly.memories
        )  # fmt: skip
        for rows in (self.assembly.records[key], self.watchdog.memories[key]):
            before = rows.copy()
            try:
                tuned.build(View(rows[0]), tuned.table, given)
            except InputError:
                rows[:] = before
                raise

    def stop_computer(self, failed: StepFailed) -> bool:
        """Stop the failed step; a law is restarted once, and this returns True."""
        return self.watchdog.stop(failed, self.t)

    def release(self) -> None:
        """Open the clamp that holds the platform, permanently; InputError if there is none."""
        find_bench(self.world)
        self.sim.data.eq_active[self.scene.model.equality(Fixture.CLAMP).id] = 0

    def set_stick(self, stick: Array, button: bool) -> None:
        """Set the operator's input (3,) and button of the following samples."""
        self.find(Operator).set(stick, button)

    def set_phase(self, index: int) -> None:
        """Set the phase index of the following samples."""
        self.assembly.get(Clock)["phase"] = index
