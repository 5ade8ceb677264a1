"""A squall: wind that rises in flight beyond the forecast."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from skywright.core.record import Record, Vec3
from skywright.core.spec import NonNegative, Positive
from skywright.errors import InputError
from skywright.models.capability import compute_least_wind_limit
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.faults.localisation import FOR_GOOD
from skywright.vehicle.plant import Wind

DRAWN_SHARE, DRAWN_MOST_MPS = (0.6, 1.0), 12.0
"""Range of a drawn squall over the wind that the robot holds in every direction, and limit (m/s).
A stronger squall blows the robot away, which no procedure beside a structure can prevent."""


class Squall(Fault):
    """Adds `speed_mps` to the world's wind; it rises over `rise_s` and lasts for `for_s`."""

    class Table(Fault.Table):
        """Speed, direction, rise time and duration."""

        speed_mps: NonNegative = 8.0
        toward_deg: float = Field(default=90.0, ge=-360, le=360)
        rise_s: Positive = 2.0
        for_s: Positive = FOR_GOOD

    class Me(Record):
        start: float  # s
        end: float  # s
        rise: float  # s
        v_W: Vec3  # m/s, the squall's full wind

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the times and the direction."""
        me.start, me.end = table.start_s, table.start_s + table.for_s
        me.rise, toward = table.rise_s, math.radians(table.toward_deg)
        me.v_W[:] = [table.speed_mps * math.cos(toward), table.speed_mps * math.sin(toward), 0.0]

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """From any side, for a time or for good; None for a robot that holds in no wind."""
        try:
            holds = compute_least_wind_limit(robot, world.gravity_mps2, world.air_density_kg_m3)
        except InputError:  # the robot cannot lift its weight: it works on a bench
            return None
        if not holds > 0.0:
            return None
        return {
            "speed_mps": min(holds, DRAWN_MOST_MPS) * float(rng.uniform(*DRAWN_SHARE)),
            "toward_deg": float(rng.uniform(-180.0, 180.0)),
            "for_s": float(rng.choice([5.0, 20.0, FOR_GOOD])),
        }

    @staticmethod
    def step(me: Me, clock: Clock, wind: InOut[Wind]) -> None:
        share = min(max((clock.t - me.start) / me.rise, 0.0), 1.0)
        share = min(share, max((me.end - clock.t) / me.rise, 0.0))
        for i in range(3):  # added to the wind of the world in this tick
            wind.body_W[i] += share * me.v_W[i]
            if wind.varies == 1:
                for k in range(len(wind.rotor_W)):
                    wind.rotor_W[k, i] += share * me.v_W[i]
