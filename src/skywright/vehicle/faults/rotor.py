"""A rotor with less thrust than commanded, or none: a chipped propeller, a failed motor."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from skywright.core.record import Record
from skywright.core.spec import Fraction
from skywright.errors import InputError
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Fault, InOut, words
from skywright.vehicle.plant import RotorState


class Rotor(Fault):
    """Thrust and drag torque of one rotor are scaled by `efficiency`; at 0 the rotor stops."""

    class Table(Fault.Table):
        """The rotor and its remaining efficiency."""

        rotor: int = Field(default=1, ge=1)
        efficiency: Fraction = 0.7

    class Me(Record):
        start: float  # s
        i: int
        efficiency: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the rotor; raise InputError if the robot has no such rotor."""
        n = len(context.rotors.thrust_min)
        if table.rotor > n:
            raise InputError(
                f"plant.faults.{self.name}.rotor is {table.rotor}; {context.robot.name!r} has "
                f"rotors 1 to {n}"
            )
        me.start, me.i, me.efficiency = table.start_s, table.rotor - 1, table.efficiency

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Any rotor, with no thrust or with 70 %."""
        rotor = int(rng.integers(len(robot.rotors.azimuth_deg))) + 1
        return {"rotor": rotor, "efficiency": float(rng.choice([0.0, 0.7]))}

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, rotors: InOut[RotorState]) -> None:
        if clock.t < me.start:
            return
        ctrl = words(mj.ctrl, mj.nu)
        ctrl[me.i] *= me.efficiency
        rotors.thrust[me.i] *= me.efficiency
        if me.efficiency == 0.0:
            rotors.speed[me.i] = 0.0
