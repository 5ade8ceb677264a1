"""A plant without a robot's side: built-in components with drives that a test sets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skywright.core.record import Record, View
from skywright.description.loader import load_description
from skywright.models.arm_body import Deviation
from skywright.models.nominal import Nominal
from skywright.models.scene import TIMESTEP, build_scene, home_pose
from skywright.models.spring_bench import believe_springs
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import (
    Allocated,
    Clock,
    Estimate,
    MuJoCo,
    Reference,
    RotorDrive,
    ServoDrive,
    WrenchCommand,
)
from skywright.vehicle.component import Component, Out, PlantContext
from skywright.vehicle.inventory import list_wanted
from skywright.vehicle.recorder import Recorder
from skywright.vehicle.simulation import Simulation
from skywright.vehicle.ticker import Ticker


class Drives(Component):
    """Stands in for a robot: commands what a test writes into its Me."""

    slots = {"look": "reference", "step": "allocate"}

    class Me(Record):
        rotors: RotorDrive
        servos: ServoDrive

    @staticmethod
    def look(ref: Out[Reference], est: Out[Estimate], cmd: Out[WrenchCommand]) -> None:
        ref.t = est.t = 0.0
        cmd.f_B[2] = 1.0

    @staticmethod
    def step(
        me: Me, rotors: Out[RotorDrive], servos: Out[ServoDrive], made: Out[Allocated]
    ) -> None:
        for i in range(rotors.speed.shape[0]):
            rotors.speed[i] = me.rotors.speed[i]
        for j in range(servos.motor.shape[0]):
            servos.motor[j] = me.servos.motor[j]
        made.saturated = 0.0


class Plant(NamedTuple):
    assembly: Assembly
    sim: Simulation
    ticker: Ticker

    def read(self, record: type[Record], name: str = "") -> Any:
        return View(self.assembly.get(record, name))

    @property
    def drives(self) -> Any:
        return self.read(Drives.Me, "drives")

    def run(self, ticks: int, interactive: bool = False) -> None:
        for _ in range(ticks):
            self.assembly.refill(1, self.ticker.n_steps)
            for c in self.assembly.components:
                c.before_tick(float(self.read(Clock).t), 1)
            self.ticker.run(1, interactive)


def build_context(
    mission: str = "pipe-weld-scan",
    sets: Any = (),
    seed: int = 1,
    extend: Sequence[Component] = (),
    **deviation: Any,
) -> PlantContext:
    """Build the plant of a description; `extend` are components that add to its scene."""
    d = load_description(mission, sets=list(sets))
    robot, world = d.robot, d.world
    dev = Deviation(**deviation)
    nominal = Nominal(robot, world)
    scene = build_scene(robot, world, dev, [c.extend_scene for c in extend], nominal=nominal)
    sim = Simulation(scene, home_pose(robot, world, 0.0, 0.0, 0.0))
    return PlantContext(
        nominal, world, 1.0, 1.0 / robot.control.rate_hz, TIMESTEP, "none", frozenset(), {},
        deviation=dev, true=nominal, scene=scene, sim=sim, seed=seed,
        springs=believe_springs(robot),
    )  # fmt: skip


def build_plant(context: PlantContext, *more: Component) -> Plant:
    """Assemble the plant's side of a description, and further components."""
    wanted = [c for c in list_wanted(context) if c.side == "plant"]
    a = Assembly([*wanted, *more, Drives("drives")], context, context.seed)
    sim, mj, m = context.sim, a.get(MuJoCo), context.scene.model
    for name, array in sim.arrays.items():
        mj[name] = array.ctypes.data
    mj["nq"], mj["nv"], mj["nsensor"], mj["nsite"] = m.nq, m.nv, m.nsensordata, m.nsite
    mj["nbody"], mj["npair"], mj["nu"], mj["na"] = m.nbody, m.npair, m.nu, m.na
    clock = a.get(Clock)
    clock["dt"], clock["h"] = context.dt, context.h
    return Plant(a, sim, Ticker(a, sim, round(context.dt / context.h)))


def take_samples(plant: Plant) -> Any:
    """Return the samples recorded since the last call."""
    return next(c for c in plant.assembly.components if isinstance(c, Recorder)).take()


def build_part(component: Component, context: PlantContext) -> Any:
    """Return a component's Me, built, for a step that runs as plain Python."""
    me = View(np.zeros(1, type(component).Me.dtype)[0])  # type: ignore[attr-defined]
    component.build(me, component.table, context)
    return me


def view(record: type[Record], **values: Any) -> Any:
    """Return a record with some values."""
    out = View(np.zeros(1, record.dtype)[0])
    for name, value in values.items():
        out[name] = value
    return out
