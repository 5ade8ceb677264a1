"""A squall: wind that rises in flight beyond what was expected before take-off."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from skywright.core.record import Record, Vec3
from skywright.core.spec import NonNegative, Positive
from skywright.models.capability import compute_capability
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.faults.localisation import FOR_GOOD
from skywright.vehicle.plant import Wind

DRAWN_SHARE, DRAWN_MOST_MPS = (0.6, 1.0), 12.0
"""Of the wind that the robot holds in every direction, and m/s at most: a squall that a mission
draws. A stronger one carries the robot off: beside a structure nothing keeps it from that."""


class Squall(Fault):
    """Wind of `speed_mps` on top of the world's; it rises over `rise_s`, lasts for `for_s`."""

    class Table(Fault.Table):
        """How strong, where it blows to, and how long."""

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
        """Take the times and the direction."""
        me.start, me.end = table.start_s, table.start_s + table.for_s
        me.rise, toward = table.rise_s, math.radians(table.toward_deg)
        me.v_W[:] = [table.speed_mps * math.cos(toward), table.speed_mps * math.sin(toward), 0.0]

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """From any side, for a while or for good; None for a robot that holds in no wind."""
        holds = float(np.nanmin(compute_capability(robot).wind_limit))
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
        for i in range(3):  # on what the world's wind has written for this tick
            wind.body_W[i] += share * me.v_W[i]
            if wind.varies == 1:
                for k in range(len(wind.rotor_W)):
                    wind.rotor_W[k, i] += share * me.v_W[i]
